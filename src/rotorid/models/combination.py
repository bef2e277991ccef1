"""Linear combinations of named quantities, as text: what a sensor reads."""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from rotorid.errors import InputError
from rotorid.models.expression import parse, symbol


def linear_combination(text: str, names: Sequence[str], *, place: str = "") -> dict[str, float]:
    """Return the coefficients of a linear combination."""
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
