"""What samples to leave out, as text: ``abs(q') < 1 mm/s``, ``F > 120 N``."""

from __future__ import annotations

import re

import numpy as np

from rotorid.errors import InputError
from rotorid.frozen import frozen
from rotorid.record import Booleans, Floats
from rotorid.units import to_si

_TEXT = re.compile(
    r"\s*(?:abs\(\s*(?P<inside>\w+)(?P<inside_dots>'{0,2})\s*\)|(?P<name>\w+)(?P<dots>'{0,2}))"
    r"\s*(?P<sign>[<>])\s*(?P<limit>\S.*?)\s*"
)
_PER_SECOND = ("{unit}", "{unit}/s", "{unit}/s^2")


@frozen
class Condition:
    """A comparison of a channel or of its derivative with a number.

    Parameters
    ----------
    text : str
        As it was given.
    channel : str
    order : int
        Of the derivative.
    absolute : bool
    below : bool
        Whether samples below the limit meet it, or those above.
    limit : float
        SI.
    """

    text: str
    channel: str
    order: int
    absolute: bool
    below: bool
    limit: float

    def met(self, values: Floats) -> Booleans:
        """Tell which samples meet the condition."""
        size = np.abs(values) if self.absolute else values
        return np.asarray(size < self.limit if self.below else size > self.limit)


def read_condition(text: str, units: dict[str, str]) -> Condition:
    """Return a condition from its text; `units` are the SI units of the channels.

    Raises
    ------
    InputError
        For another text, an unknown channel, and a limit in another unit.

    Examples
    --------
    >>> read_condition("abs(q') < 2 mm/s", {"q": "m"}).limit
    0.002
    """
    found = _TEXT.fullmatch(text)
    if found is None:
        raise InputError(
            f"the condition {text!r}",
            'a channel, < or >, and a quantity, such as "abs(q\') < 1 mm/s" or "F > 120 N"',
            "write it so; several conditions stand in a list",
            place="leave_out",
        )
    inside = found["inside"] is not None
    name = found["inside"] if inside else found["name"]
    order = len(found["inside_dots"] if inside else found["dots"])
    if name not in units:
        raise InputError(
            f"{name!r} in the condition {text!r}",
            f"a channel of the record: {', '.join(units)}",
            "name one, with ' for its velocity and '' for its acceleration",
            place="leave_out",
        )
    unit = _PER_SECOND[order].format(unit=units[name] or "1")
    try:
        limit = to_si(found["limit"], unit)
    except InputError as error:
        raise error.at(place="leave_out") from None
    return Condition(text.strip(), name, order, inside, found["sign"] == "<", limit)
