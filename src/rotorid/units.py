"""Units at the border: texts such as ``"8400 rpm"`` to SI numbers.

An angle counts as a number, as in SI, with one exception that would be wrong by 2 pi: a rate in
Hz is a number of revolutions per second, a rate in rad/s is not. So ``140 Hz`` is
``2 pi 140 rad/s`` where a speed is expected, and a bare ``1/s`` is refused there.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping

from rotorid.errors import InputError
from rotorid.unit_text import (
    MAX_LENGTH,
    ORDER,
    Dimension,
    Unit,
    base_powers,
    read_unit,
    symbol_power,
    with_force,
)

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?(?![\d.,])")


def _bad(text: str, place: str, why: str = "") -> InputError:
    shown = text if len(text) <= MAX_LENGTH else text[:MAX_LENGTH] + "..."
    return InputError(
        f"unit {shown!r}" + (f" ({why})" if why else ""),
        "a unit such as N, um, N s/m, kg m^2",
        "write factors of SI units and their multiples, ^ for powers, / once",
        place=place,
    )


def _unit(text: str, place: str) -> Unit:
    if not text.strip():
        raise _bad(text, place, "no text; a plain number has the unit 1")
    try:
        return read_unit(text.strip())
    except ValueError as error:
        raise _bad(text, place, str(error)) from None


def _rate_kind(unit: Unit) -> str:
    """Tell whether a rate counts revolutions (Hz), radians, or nothing that is said."""
    if unit.turns:
        return "turns"
    return "angle" if "rad" in base_powers(unit.atoms) else "plain"


def si_factor(unit: str, expected: str | None = None, *, place: str = "") -> float:
    """Return the number that turns a value in a unit into SI, or into another unit."""
    found = _unit(unit, place)
    if expected is None:
        return found.factor
    wanted = _unit(expected, place)
    kinds = (_rate_kind(found), _rate_kind(wanted))
    rate = {name for name, _ in wanted.dimension.powers} == {"s"}
    ambiguous = rate and kinds == ("plain", "angle")
    if found.dimension != wanted.dimension or ambiguous:
        raise InputError(
            f"unit {unit!r}",
            f"a unit that converts to {expected}",
            f"convert the value, and write {expected}",
            place=place,
        )
    turn = {("turns", "angle"): 2 * math.pi, ("angle", "turns"): 0.5 / math.pi}.get(kinds, 1.0)
    return found.factor / wanted.factor * turn


def quantity(value: float | str, expected: str, *, place: str = "") -> float:
    """Return a number in SI as it is, and a text with a unit as a number in the expected unit."""
    return to_si(value, expected, place=place) if isinstance(value, str) else value


def to_si(value: object, expected: str, *, place: str = "") -> float:
    """Return a quantity, written as number and unit, as a number in the expected SI unit.

    Parameters
    ----------
    value : str or number
        ``"8400 rpm"``. A bare number is taken where `expected` is ``"1"`` only.
    expected : str
        SI unit.
    place : str
        Where the quantity stands, for the message.

    Returns
    -------
    float

    Raises
    ------
    InputError
        For text that is no number with a unit, a missing unit, or a wrong one.

    Examples
    --------
    >>> to_si("0.5 mm", "m")
    0.0005
    >>> to_si("8400 rpm", "rad/s") == to_si("140 Hz", "rad/s")
    True
    """
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise _no_quantity(value, expected, place)
    text = value.strip() if isinstance(value, str) else repr(value)
    match = _NUMBER.match(text)
    if match is None:
        raise _no_quantity(value, expected, place)
    unit = text[match.end() :].strip()
    if not unit and expected != "1":
        raise InputError(
            f"{text!r} without a unit",
            f"a number and a unit, such as '{match.group()} {expected}'",
            "write the unit",
            place=place,
        )
    number = float(match.group()) * si_factor(unit or "1", expected, place=place)
    if not math.isfinite(number):
        raise _no_quantity(value, expected, place)
    return number


def _no_quantity(value: object, expected: str, place: str) -> InputError:
    shown = repr(value)
    example = "a number" if expected == "1" else f"a number and a unit, such as '1 {expected}'"
    return InputError(
        shown if len(shown) <= MAX_LENGTH else shown[:MAX_LENGTH] + "...",
        example,
        "write it so",
        place=place,
    )


def check_unit(text: str, *, place: str = "") -> str:
    """Return the SI unit of a declared unit: as it was written where that is SI already."""
    unit = _unit(text, place)
    text = " ".join(text.split())
    return text if unit.factor == 1.0 and text else _write(unit.atoms, angle=True)


def multiply_units(factors: Iterable[tuple[str, int]]) -> str:
    """Return the SI unit of a product of powers of units."""
    factors = [(unit, power) for unit, power in factors if power and unit != "1"]
    if len(factors) == 1 and factors[0][1] == 1:
        return check_unit(factors[0][0])
    product: dict[str, int] = {}
    for text, power in factors:
        for atom, exponent in _unit(text, "").atoms.items():
            product[atom] = product.get(atom, 0) + exponent * power
    return _write(product, angle=False)


def _write(atoms: Mapping[str, int], *, angle: bool) -> str:
    atoms = {atom: power for atom, power in atoms.items() if power}
    if atoms == {"rad": 1}:
        return "rad"
    if not angle:
        atoms.pop("rad", None)
    canonical = with_force(base_powers(atoms))
    if len(canonical) < len(atoms):
        atoms = canonical
    ordered = sorted(atoms.items(), key=lambda item: ORDER.get(item[0], len(ORDER)))
    above = [symbol_power(atom, power) for atom, power in ordered if power > 0]
    below = [symbol_power(atom, -power) for atom, power in ordered if power < 0]
    if not below:
        return " ".join(above) or "1"
    denominator = below[0] if len(below) == 1 else f"({' '.join(below)})"
    return f"{' '.join(above) or '1'}/{denominator}"


def dimension_of(unit: str) -> Dimension:
    """Return the dimension of a unit."""
    return _unit(unit, "").dimension
