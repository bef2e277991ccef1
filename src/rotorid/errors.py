"""Errors that carry data: what was found, where, what was expected, and the cure."""

from __future__ import annotations

from rotorid.screen import one_line


class InputError(ValueError):
    """Input that cannot be used, said in one line.

    Parameters
    ----------
    found, expected, cure : str
        What was there, what should have been, and what to do about it.
    file : str, optional
        The file that holds it.
    place : str, optional
        Where in the file: a key, a line, a column, an equation.

    Examples
    --------
    >>> print(InputError("'kgg'", "a mass", "write kg", file="a.toml", place="parameters.m"))
    a.toml: parameters.m: found 'kgg'; expected a mass; write kg
    """

    def __init__(
        self, found: str, expected: str, cure: str, *, file: str = "", place: str = ""
    ) -> None:
        self.found, self.expected, self.cure = found, expected, cure
        self.file, self.place = file, place
        super().__init__(str(self))

    def __str__(self) -> str:
        where = [one_line(part) for part in (self.file, self.place) if part]
        found, expected, cure = map(one_line, (self.found, self.expected, self.cure))
        return ": ".join([*where, f"found {found}; expected {expected}; {cure}"])

    def at(self, *, file: str = "", place: str = "") -> InputError:
        """Return the same error with the file and the outer place that the caller knows."""
        inner = ": ".join(part for part in (place, self.place) if part)
        return type(self)(self.found, self.expected, self.cure, file=self.file or file, place=inner)


class ReadError(InputError):
    """A file that cannot be read or does not hold what it should."""


class ModelError(InputError):
    """Equations, names or units that make no model."""


class UnfinishedError(Exception):
    """What was asked for beside the answer, and could not be made; the answer stands."""


class NotConvergedError(Exception):
    """An iteration that ended before its answer."""
