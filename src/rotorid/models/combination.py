"""Linear combinations of named quantities, as text: what a sensor reads."""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from rotorid.errors import InputError
from rotorid.models.expression import parse, symbol


def linear_combination(text: str, names: Sequence[str], *, place: str = "") -> dict[str, float]:
    """Return the coefficients of a linear combination.

    Parameters
    ----------
    text : str
        Such as ``"x2 - 0.02*theta_y"``.
    names : sequence of str
        What may stand in it.
    place : str
        Where the text stands, for the message.

    Returns
    -------
    dict of str to float

    Raises
    ------
    InputError
        For text that is none.

    Examples
    --------
    >>> linear_combination("x2 - 0.02*theta_y", ["x2", "theta_y"])
    {'x2': 1.0, 'theta_y': -0.02}
    """
    try:
        value = sp.expand(parse(text, names=frozenset(names), linear=frozenset(names)))
    except InputError as error:
        raise error.at(place=place) from None
    terms = sp.Poly(value, *map(symbol, names)).terms()
    if any(sum(powers) != 1 for powers, _ in terms):
        raise InputError(
            repr(text[:60]),
            "a linear combination, such as x2 - 0.02*theta_y",
            "correct it",
            place=place,
        )
    return {names[powers.index(1)]: float(c) for powers, c in terms}
