"""Combinations of coordinates, as text: what a sensor reads."""

from __future__ import annotations

from collections.abc import Sequence

from rotorid.errors import InputError
from rotorid.frozen import frozen
from rotorid.models.terms import DERIVATIVES, polynomial


@frozen
class SensorTerm:
    """``coefficient * parameters^powers * d^order q / dt^order`` of one coordinate.

    Parameters
    ----------
    coordinate, order : int
    powers : tuple of int
        Of each parameter of the model.
    coefficient : float
    """

    coordinate: int
    order: int
    powers: tuple[int, ...]
    coefficient: float


def sensor_terms(
    text: str, coordinates: Sequence[str], parameters: Sequence[str] = (), *, place: str = ""
) -> tuple[SensorTerm, ...]:
    """Return the terms of a combination such as ``x1'' - L_a*theta_y``."""
    moving = [name + dots for name in coordinates for dots in DERIVATIVES]
    try:
        terms = polynomial(text, [*moving, *parameters])
    except InputError as error:
        raise error.at(place=place) from None
    found = []
    for powers, coefficient in terms.items():
        motion, rest = powers[: len(moving)], powers[len(moving) :]
        if sum(motion) != 1:
            raise InputError(
                repr(text[:60]),
                "a linear combination of coordinates, such as x2 - 0.02*theta_y or x1''",
                "write a sum of coordinates, each once in a term, without a constant",
                place=place,
            )
        where = motion.index(1)
        found.append(
            SensorTerm(
                where // len(DERIVATIVES), where % len(DERIVATIVES), rest, float(coefficient)
            )
        )
    return tuple(found)


def linear_combination(text: str, names: Sequence[str], *, place: str = "") -> dict[str, float]:
    """Return the coefficients of a combination of positions."""
    terms = sensor_terms(text, names, place=place)
    moving = [t for t in terms if t.order]
    if moving:
        raise InputError(
            f"{text[:60]!r}, which holds a derivative",
            "a combination of positions here",
            "leave the derivative out",
            place=place,
        )
    return {names[t.coordinate]: t.coefficient for t in terms}
