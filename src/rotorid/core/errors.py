"""The errors that a user sees, and what of other people's text may stand in a line.

Such text may hold escape sequences of terminals, newlines, marks of direction, and any length.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from math import inf
from typing import Self, TypeVar

LINE = 590  # characters of a message: what is read as one line, and below what a log cuts
PART = 240  # of one part of it, so that a long one leaves room for the others
CELL = 300  # of a cell of a table: longer than any honest name or finding
SENTENCE = 4_000  # of a sentence between tables: a warning may list fifty names
NAMES, NAME_CHARACTERS = 500, 100
"""Names, and their characters, among which the nearest is sought: two of ten letters take 10 us."""
_GAP = " ... "
Kind = TypeVar("Kind")


def printable(text: str, *, keep: str = "") -> str:
    """Return a text, what is not printable and not to be kept written as Python writes it."""
    if text.isprintable():
        return text
    return "".join(
        c if c.isprintable() or c in keep else c.encode("unicode_escape").decode("ascii")
        for c in text
    )


def shortened(text: str, most: int) -> str:
    """Return a text of at most `most` characters: its beginning and its end."""
    if len(text) <= most:
        return text
    end = (most - len(_GAP)) // 2
    return text[: most - len(_GAP) - end] + _GAP + text[len(text) - end :]


def one_line(text: str, most: int = PART) -> str:
    # What is far too long is cut first: escaping it all would take its time.
    return shortened(printable(" ".join(shortened(text, 8 * most).split())), most)


def nearest(name: str, there: Sequence[str], otherwise: str = "take a name from there") -> str:
    """Return the cure for a misspelt name: the likest of those that are there."""
    from difflib import get_close_matches

    likely = [other for other in there[:NAMES] if max(len(name), len(other)) <= NAME_CHARACTERS]
    near = get_close_matches(name, likely, n=1)
    if near and "\\" in near[0]:
        return f"did you mean {near[0]}? In TOML write a backslash in single quotes: '{near[0]}'"
    return f"did you mean {near[0]}?" if near else otherwise


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

    def at(self, *, file: str = "", place: str = "") -> Self:
        """Return the same error with the file and the outer place that the caller knows."""
        inner = ": ".join(part for part in (place, self.place) if part)
        return type(self)(self.found, self.expected, self.cure, file=self.file or file, place=inner)


def require_names(
    names: Iterable[str],
    there: Iterable[str],
    found: str = "{}",
    cure: str = "",
    *,
    file: str = "",
    place: str = "",
) -> None:
    """Refuse a name not there; `found` has a place for it; without a cure, the nearest is one."""
    known = list(there)
    for name in names:
        if name not in known:
            told, cure = found.format(shortened(repr(name), 62)), cure or nearest(name, known)
            raise InputError(told, f"one of {', '.join(known)}", cure, file=file, place=place)


class WrongTypeError(InputError, TypeError):
    """A value of a type that is not taken: an `InputError`, and a `TypeError` too."""


MAKES = {
    "Estimate": "rid.identify or rid.load_estimate(path) gives one",
    "Model": "rid.load_model(name or path) gives one",
    "Record": "rid.read_record(path) or rid.Record.from_frame(frame) gives one",
    "PeriodicRecord": "rid.average(record, fundamental) gives one",
    "str": "give a path; a data frame is a record by rid.Record.from_frame(frame)",
}
"""What gives a value of a type, to tell whoever gave another."""


def require_type(value: object, *taken: type, place: str) -> None:
    """Refuse a value of another type with what was given, what is taken, and what gives that."""
    if not isinstance(value, taken):
        names = [kind.__name__ for kind in taken]
        cure = "; ".join(MAKES[name] for name in names if name in MAKES)
        raise WrongTypeError(_given(value), " or ".join(names), cure, place=place)


def require_each(values: Iterable[Kind], taken: type, *, place: str) -> tuple[Kind, ...]:
    """Return values as a tuple; refuse what is no sequence of that type."""
    if isinstance(values, str) or not isinstance(values, Iterable):
        raise WrongTypeError(_given(values), f"a list of {taken.__name__}", "", place=place)
    found = tuple(values)
    for number, value in enumerate(found):
        require_type(value, taken, place=f"{place}[{number}]")
    return found


def _given(value: object) -> str:
    given = one_line(repr(value), 40) if isinstance(value, str | float | int) else ""
    return f"{type(value).__name__} {given}".rstrip().replace("NoneType", "None")


def require_positive(
    value: float, unit: str, cure: str, *, found: str = "{}", place: str = ""
) -> None:
    """Refuse a number that is not above 0, or not finite; `found` has a place for it."""
    if not 0 < value < inf:
        told = found.format(f"{value} {unit}")
        raise InputError(told, f"more than 0 {unit}", cure, place=place)


@contextmanager
def naming(file: str = "", *, place: str = "") -> Iterator[None]:
    """Put the file, where they name none, and the outer place in it into errors of what is done."""
    try:
        yield
    except InputError as error:
        raise error.at(file=file, place=place) from None


class ReadError(InputError):
    """A file that cannot be read or does not hold what it should."""


class ModelError(InputError):
    """Equations, names or units that make no model."""


class UnfinishedError(Exception):
    """What was asked for beside the answer, and could not be made; the answer stands."""


class NotConvergedError(Exception):
    """An iteration that ended before its answer."""
