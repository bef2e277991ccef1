"""Units at the border: texts such as ``"8400 rpm"`` to SI numbers, by one pint registry.

An angle counts as a number, as in SI, with one exception that would be wrong by 2 pi: a rate in
Hz is a number of revolutions per second, a rate in rad/s is not. So ``140 Hz`` is
``2 pi 140 rad/s`` where a speed is expected, and a bare ``1/s`` is refused there.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from functools import cache
from typing import Any

import pint

from rotorid.errors import InputError

MAX_LENGTH = 64
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?(?![\d.,])")
_POWER = re.compile(r"(?:\^|\*\*)\s*-?[1-9]\d?(?!\s*(?:\^|\*\*|[\d.]))")
_FACTORS = re.compile(r"(?:[A-Za-z_°%µμΩ]+|\b1\b|[\s*/()])*")
_SPELLING = str.maketrans({"·": "*", "⋅": "*", "²": "^2", "³": "^3"})
# Atoms of SI texts, in the order in which they are written.
_ATOMS = {
    "gram": "kg",
    "newton": "N",
    "pascal": "Pa",
    "joule": "J",
    "watt": "W",
    "volt": "V",
    "tesla": "T",
    "weber": "Wb",
    "henry": "H",
    "ohm": "ohm",
    "coulomb": "C",
    "hertz": "Hz",
    "ampere": "A",
    "kelvin": "K",
    "meter": "m",
    "second": "s",
    "radian": "rad",
}
_BASE = {"[length]": "m", "[mass]": "kg", "[time]": "s", "[current]": "A", "[temperature]": "K"}
_ORDER = {symbol: rank for rank, symbol in enumerate(_ATOMS.values())}

Dimension = pint.util.UnitsContainer  # powers of [length], [mass], [time], ...


@cache
def _registry() -> pint.UnitRegistry[float]:
    registry: pint.UnitRegistry[float] = pint.UnitRegistry()
    registry.define("newton_meter = newton * meter = Nm")  # pint: 1000 m/kg
    registry.define("@alias revolution = rev")
    return registry


def _bad(text: str, place: str, why: str = "") -> InputError:
    shown = text if len(text) <= MAX_LENGTH else text[:MAX_LENGTH] + "..."
    return InputError(
        f"unit {shown!r}" + (f" ({why})" if why else ""),
        "a unit such as N, um, N s/m, kg m^2",
        "write factors of SI units and their multiples, ^ for powers, / once",
        place=place,
    )


@cache
def _parse(text: str) -> pint.Unit:
    """Return the unit of a text; ValueError says why there is none.

    pint multiplies and exponentiates what it reads, so it gets unit names, the number 1 and
    powers of two digits at most.
    """
    spelled = text.translate(_SPELLING)
    if len(text) > MAX_LENGTH or not _FACTORS.fullmatch(_POWER.sub(" ", spelled)):
        raise ValueError("no product of units")
    try:
        unit = _registry().parse_units(spelled)
        origin = _registry().Quantity(0.0, unit).to_base_units().magnitude
        size = _factor(unit)
    except pint.UndefinedUnitError as error:
        raise ValueError(f"unknown name {''.join(error.unit_names)}") from None
    except Exception:  # pint's parser raises whatever its operators do
        raise ValueError("no product of units") from None
    if origin != 0.0:
        raise ValueError("its zero is not zero in SI")
    if not (size > 0 and math.isfinite(size)):
        raise ValueError("too large or too small")
    return unit


def _unit(text: str, place: str) -> pint.Unit:
    if not text.strip():
        raise _bad(text, place, "no text; a plain number has the unit 1")
    try:
        return _parse(text.strip())
    except ValueError as error:
        raise _bad(text, place, str(error)) from None


def _factor(unit: pint.Unit) -> float:
    return float(_registry().Quantity(1.0, unit).to_base_units().magnitude)


def _rate_kind(unit: pint.Unit) -> str:
    """Tell whether a rate counts revolutions (Hz), radians, or nothing that is said."""
    if "hertz" in {_split(name) for name in unit._units}:
        return "turns"
    base = _registry().Quantity(1.0, unit).to_base_units().units
    return "angle" if "radian" in base._units else "plain"


def si_factor(unit: str, expected: str | None = None, *, place: str = "") -> float:
    """Return the number that turns a value in a unit into SI, or into another unit."""
    found = _unit(unit, place)
    if expected is None:
        return _factor(found)
    wanted = _unit(expected, place)
    kinds = (_rate_kind(found), _rate_kind(wanted))
    ambiguous = kinds == ("plain", "angle") and set(wanted.dimensionality) == {"[time]"}
    if found.dimensionality != wanted.dimensionality or ambiguous:
        raise InputError(
            f"unit {unit!r}",
            f"a unit that converts to {expected}",
            f"convert the value, and write {expected}",
            place=place,
        )
    turn = {("turns", "angle"): 2 * math.pi, ("angle", "turns"): 0.5 / math.pi}.get(kinds, 1.0)
    return _factor(found) / _factor(wanted) * turn


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
    return text if _factor(unit) == 1.0 and text else _write(_atoms(unit), angle=True)


def multiply_units(factors: Iterable[tuple[str, int]]) -> str:
    """Return the SI unit of a product of powers of units."""
    factors = [(unit, power) for unit, power in factors if power and unit != "1"]
    if len(factors) == 1 and factors[0][1] == 1:
        return check_unit(factors[0][0])
    product: dict[str, int] = {}
    for text, power in factors:
        for atom, exponent in _atoms(_unit(text, "")).items():
            product[atom] = product.get(atom, 0) + exponent * power
    return _write(product, angle=False)


def _split(name: str) -> str:
    """Return pint's name of a unit without its prefix."""
    candidates = _registry().parse_unit_name(name)
    return str(candidates[0][1]) if candidates else name


def _atoms(unit: pint.Unit) -> dict[str, int]:
    """Return the SI symbols of a unit and their powers, derived units kept as they are."""
    atoms: dict[str, int] = {}
    for name, exponent in _powers(unit).items():
        base = _split(name)
        if base in _ATOMS:
            parts = {_ATOMS[base]: 1}
        else:
            parts = _with_force(_base_symbols(_registry().Unit(name)))
        for atom, power in parts.items():
            atoms[atom] = atoms.get(atom, 0) + power * exponent
    return {atom: power for atom, power in atoms.items() if power}


def _base_symbols(unit: pint.Unit) -> dict[str, int]:
    base = _registry().Quantity(1.0, unit).to_base_units().units
    return {_ATOMS.get(_split(name), name): exponent for name, exponent in _powers(base).items()}


def _powers(unit: Any) -> dict[str, int]:
    """Return pint's names in a unit and their powers; all are whole, see `_POWER`."""
    return {name: int(float(power)) for name, power in unit._units.items()}


def _with_force(base: dict[str, int]) -> dict[str, int]:
    """Write a mass over a time as a force: kg m/s^2 as N, kg/s as N s/m."""
    mass, time = base.get("kg", 0), base.get("s", 0)
    if abs(mass) != 1 or mass * time >= 0:
        return base
    force = {**base, "N": mass, "kg": 0, "m": base.get("m", 0) - mass, "s": time + 2 * mass}
    return {atom: power for atom, power in force.items() if power}


def _write(atoms: dict[str, int], *, angle: bool) -> str:
    atoms = {atom: power for atom, power in atoms.items() if power}
    if atoms == {"rad": 1}:
        return "rad"
    if not angle:
        atoms.pop("rad", None)
    text = " * ".join(f"{atom}^{power}" for atom, power in atoms.items())
    canonical = _with_force(_base_symbols(_registry().parse_units(text or "1")))
    if len(canonical) < len(atoms):
        atoms = canonical
    ordered = sorted(atoms.items(), key=lambda item: _ORDER.get(item[0], len(_ORDER)))
    above = [_symbol(atom, power) for atom, power in ordered if power > 0]
    below = [_symbol(atom, -power) for atom, power in ordered if power < 0]
    if not below:
        return " ".join(above) or "1"
    denominator = below[0] if len(below) == 1 else f"({' '.join(below)})"
    return f"{' '.join(above) or '1'}/{denominator}"


def _symbol(atom: str, power: object) -> str:
    return atom if power == 1 else f"{atom}^{power}"


def dimension_of(unit: str) -> Dimension:
    """Return the dimension of a unit; an angle is a number."""
    return _unit(unit, "").dimensionality


def dimension_text(dimension: Dimension) -> str:
    """Return a dimension in SI base units, such as ``kg m s^-2``."""
    powers = {_BASE.get(name, name): power for name, power in dimension.items()}
    parts = [_symbol(atom, power) for atom, power in sorted(powers.items())]
    return " ".join(parts) or "plain numbers"
