"""`Note`: the one message to the user, whatever it comes from."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Literal

from rotorid.core.frozen import frozen
from rotorid.core.values import grouped

Severity = Literal[
    "refuses",
    "unfinished",
    "open",
    "rejects",
    "doubts",
    "remarks",
    "warns",
    "assumes",
    "says",
    "passes",
]
VERDICTS: dict[Severity, str] = {
    "refuses": "refused",
    "warns": "warning",
    "assumes": "note",
    "says": "note",
    "passes": "ok",
}
"""How notes on the data and on what is taken as exact are called in tables and files."""


@frozen
class Note:
    """A message: what was looked at, what was found there, and what to do about it.

    Parameters
    ----------
    about : str
        The check, rival or doubt that it comes from; filter by it: "dead", "speed", "misfit",
        "not identifiable".
    severity : str
        Of an answer: "unfinished": the search did not arrive. "open": the data leave something
        undetermined. "rejects": the answer is wrong. "doubts": it may be wrong by more than its
        standard deviations. "remarks": to be read with it.
        Of the data, and of what is taken as exact: "refuses": no answer can come of it. "warns":
        an answer may be wrong by more than its standard deviations. "assumes": it was taken as
        exact, and an error of a plausible size would move the answer. "says": worth knowing.
        "passes": looked at and in order.
    found : str
        What was found, with figures.
    cure : str
        What to do about it.
    on : sequence of str
        The channels, parameters or records concerned; none for all.
    value : float, optional
        The figure that was found, in `unit`.
    unit : str
        SI; "1" for a plain number.
    drop : float, optional
        Of a possible cause of a misfit: how far the misfit falls with it.
    share : float, optional
        Share of the excess misfit that the possible cause explains.
    size : str
        Of what is assumed: the error that is plausible; `value` is what that would move the
        parameter in `on` by, in standard deviations.
    periods : sequence of int
        Of the data: the periods that it doubts, from 0, where it does not doubt all alike.

    Examples
    --------
    >>> note = Note("dead", "refuses", "0 in every sample", "check the cable", on=("x1",))
    >>> print(note)
    dead, x1: 0 in every sample; check the cable
    >>> note.text
    '0 in every sample; check the cable'
    """

    about: str
    severity: Severity
    found: str = ""
    cure: str = ""
    on: tuple[str, ...] = ()
    value: float | None = None
    unit: str = ""
    drop: float | None = None
    share: float | None = None
    size: str = ""
    periods: tuple[int, ...] = ()

    @property
    def text(self) -> str:
        """What was found and what to do, without what it is about."""
        return "; ".join(part for part in (self.found, self.cure) if part)

    @property
    def verdict(self) -> str:
        """The severity of a note on the data, as tables and files call it: "ok" to "refused"."""
        return VERDICTS[self.severity]

    @property
    def as_check(self) -> dict[str, str]:
        """A note on the data as files hold it."""
        channel = ", ".join(self.on)
        return {
            "check": self.about,
            "channel": channel,
            "found": self.text,
            "verdict": self.verdict,
        }

    def __str__(self) -> str:
        subject = ", ".join((self.about, *self.on))
        return f"{subject}: {self.text}"


_FIGURES = re.compile(r"[-+.\de]+(?= (?:%|(?:s|Hz|times|periods)\b))")


def remarks(about: str, texts: Iterable[str]) -> list[Note]:
    """Return texts as notes, those that differ in figures alone as one."""
    alike = told_once((_FIGURES.sub("", text), text) for text in dict.fromkeys(texts))
    return [Note(about, "remarks", text) for text in alike]


def told_once(texts: Iterable[tuple[object, str]]) -> list[str]:
    """Return the first text of each key, and how many more have that key."""
    alike = grouped(texts).values()
    return [first + f"; {len(more)} more like this" * bool(more) for first, *more in alike]


def worst(notes: Iterable[Note]) -> str:
    """Return the gravest verdict of notes on the data."""
    found = {note.severity for note in notes}
    return next((word for severity, word in VERDICTS.items() if severity in found), "ok")
