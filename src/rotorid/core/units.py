"""Units and quantities: texts to SI at the border, and nowhere else.

The common spellings are read by a table, which a test holds against pint; pint itself reads what
is not in it. It takes longer to load than most records take to identify.

An angle counts as a number, as in SI, with one exception that would be wrong by 2 pi: a rate in
Hz is a number of revolutions per second, a rate in rad/s is not. So ``140 Hz`` is
``2 pi 140 rad/s`` where a speed is expected, and a bare ``1/s`` is refused there.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from fractions import Fraction
from functools import cache
from typing import TYPE_CHECKING, Any

from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen

if TYPE_CHECKING:
    import pint


MAX_LENGTH = 64
_POWER = re.compile(r"(?:\^|\*\*)\s*-?[1-9]\d?(?!\s*(?:\^|\*\*|[\d.]))")
# Possessive: a run of n letters taken apart in every way would take 2^n steps.
_FACTORS = re.compile(r"(?:[A-Za-z_°%µμΩ]++|\b1\b|[\s*/()])*+")
_SPELLING = str.maketrans({"·": "*", "⋅": "*", "²": "^2", "³": "^3"})

# SI symbols in the order in which they are written, with pint's name and what they are made of.
_SYMBOLS: dict[str, tuple[str, dict[str, int]]] = {
    "kg": ("gram", {"kg": 1}),
    "N": ("newton", {"kg": 1, "m": 1, "s": -2}),
    "Pa": ("pascal", {"kg": 1, "m": -1, "s": -2}),
    "J": ("joule", {"kg": 1, "m": 2, "s": -2}),
    "W": ("watt", {"kg": 1, "m": 2, "s": -3}),
    "V": ("volt", {"kg": 1, "m": 2, "s": -3, "A": -1}),
    "T": ("tesla", {"kg": 1, "s": -2, "A": -1}),
    "Wb": ("weber", {"kg": 1, "m": 2, "s": -2, "A": -1}),
    "H": ("henry", {"kg": 1, "m": 2, "s": -2, "A": -2}),
    "ohm": ("ohm", {"kg": 1, "m": 2, "s": -3, "A": -2}),
    "C": ("coulomb", {"A": 1, "s": 1}),
    "Hz": ("hertz", {"s": -1}),
    "A": ("ampere", {"A": 1}),
    "K": ("kelvin", {"K": 1}),
    "m": ("meter", {"m": 1}),
    "s": ("second", {"s": 1}),
    "rad": ("radian", {"rad": 1}),
}
ORDER = {symbol: rank for rank, symbol in enumerate(_SYMBOLS)}
_ATOMS = {name: symbol for symbol, (name, _) in _SYMBOLS.items()}
_BASE = {"[length]": "m", "[mass]": "kg", "[time]": "s", "[current]": "A", "[temperature]": "K"}
_PREFIXES = {"": 0, "n": -9, "u": -6, "µ": -6, "μ": -6, "m": -3, "k": 3, "M": 6, "G": 9}

_WORDS = re.compile(r"[A-Za-z_]+")
_MISTAKEN = {
    **dict.fromkeys(("grad", "Grad", "GRAD"), "deg for degrees, gon for a 400th of a turn"),
    **dict.fromkeys(("krad", "Mrad"), "rad"),
    **dict.fromkeys(("ton", "tons"), "t for 1000 kg"),
}
_COUNTS = re.compile(r"[kKMG]?i?(?:bits?|bytes?|B|baud|Bd|Bq|becquerel)")
"""Names that one language, or one trade, takes for something else than another: read the other way
they make angles of gigaradians. Counts, of bits or decays, are no quantity of a rotor either."""


@frozen
class Dimension:
    """Powers of kg, m, s, A and K; an angle is a number."""

    powers: frozenset[tuple[str, Fraction]] = frozenset()

    @classmethod
    def of(cls, powers: Mapping[str, float | Fraction]) -> Dimension:
        """Return the dimension with these powers."""
        exact = ((k, n if isinstance(n, Fraction) else Fraction(n)) for k, n in powers.items() if n)
        return cls(frozenset(exact))

    def __mul__(self, other: Dimension) -> Dimension:
        mine, others = dict(self.powers), dict(other.powers)
        return self.of({name: mine.get(name, 0) + others.get(name, 0) for name in mine | others})

    def __pow__(self, exponent: int | Fraction) -> Dimension:
        return self.of({name: power * exponent for name, power in self.powers})

    def __str__(self) -> str:
        parts = [symbol_power(name, power) for name, power in sorted(self.powers)]
        return " ".join(parts) or "plain numbers"


@frozen
class Unit:
    """A unit: what turns a value into SI, and SI symbols with their powers.

    Derived units are kept as they are written: N m is not J. A unit `turns` where its text counts
    revolutions: Hz.
    """

    factor: float
    atoms: Mapping[str, int]
    dimension: Dimension
    turns: bool


def symbol_power(symbol: str, power: object) -> str:
    """Return a symbol with its power, such as ``m^2``."""
    return symbol if power == 1 else f"{symbol}^{power}"


def base_powers(atoms: Mapping[str, int]) -> dict[str, int]:
    """Return the powers of kg, m, s, A, K and rad in a product of SI symbols."""
    total: Counter[str] = Counter()
    for atom, power in atoms.items():
        _, base = _SYMBOLS.get(atom, ("", {atom: 1}))
        for name, exponent in base.items():
            total[name] += exponent * power
    return {name: power for name, power in total.items() if power}


def with_force(base: Mapping[str, int]) -> dict[str, int]:
    """Write a mass over a time as a force: kg m/s^2 as N, kg/s as N s/m."""
    mass, time = base.get("kg", 0), base.get("s", 0)
    if abs(mass) != 1 or mass * time >= 0:
        return dict(base)
    force = {**base, "N": mass, "kg": 0, "m": base.get("m", 0) - mass, "s": time + 2 * mass}
    return {atom: power for atom, power in force.items() if power}


@cache
def read_unit(text: str) -> Unit:
    """Return the unit of a text; ValueError says why there is none."""
    spelled = text.translate(_SPELLING)
    if len(text) > MAX_LENGTH or not _FACTORS.fullmatch(_POWER.sub(" ", spelled)):
        raise ValueError("no product of units")
    for name in _WORDS.findall(spelled):
        if name in _MISTAKEN:
            raise ValueError(f"{name}: write {_MISTAKEN[name]}")
        if _COUNTS.fullmatch(name):
            raise ValueError(f"{name}: write 1 for a count")
    found = _by_table(spelled) or _by_pint(spelled)
    if found.turns and "rad" in found.atoms:
        raise ValueError("turns in a second, times an angle")
    return found


@cache
def _table() -> dict[str, tuple[float, int, dict[str, int]]]:
    """Return what each common name is: a factor, a power of ten, and powers of SI symbols."""
    table: dict[str, tuple[float, int, dict[str, int]]] = {
        "cm": (1.0, -2, {"m": 1}),
        "mil": (25.4, -6, {"m": 1}),
        "mils": (25.4, -6, {"m": 1}),
        "Nm": (1.0, 0, {"N": 1, "m": 1}),
        "min": (60.0, 0, {"s": 1}),
        "rev": (2 * math.pi, 0, {"rad": 1}),
        "rpm": (2 * math.pi / 60, 0, {"rad": 1, "s": -1}),
        "deg": (math.pi / 180, 0, {"rad": 1}),
        "%": (1.0, -2, {}),
    }
    for symbol in _SYMBOLS:
        stem, own = ("g", -3) if symbol == "kg" else (symbol, 0)
        for prefix, power in _PREFIXES.items():
            table[prefix + stem] = (1.0, power + own, {symbol: 1})
    return table


_NAME = r"[A-Za-zµμ%]+(?:\^-?[1-9]\d?)?"
_PRODUCT = rf"{_NAME}(?:(?:\s*\*\s*|\s+){_NAME})*"
_COMMON = re.compile(rf"({_PRODUCT}|1)(?:\s*/\s*(?:({_NAME})|\(\s*({_PRODUCT})\s*\)))?")


def _by_table(text: str) -> Unit | None:
    """Read a product of common names, over another or over nothing; ``None`` for anything else."""
    match = _COMMON.fullmatch(text.replace("**", "^"))
    if match is None:
        return None
    above, *below = match.groups(default="")
    factor, ten, atoms = 1.0, 0, Counter[str]()
    for part, sign in ((above, 1), ("".join(below), -1)):
        for name in re.findall(_NAME, part):
            stem, _, power = name.partition("^")
            if stem not in _table():
                return None
            exponent = sign * int(power or 1)
            size, tens, symbols = _table()[stem]
            factor, ten = factor * size**exponent, ten + tens * exponent
            for symbol, own in symbols.items():
                atoms[symbol] += own * exponent
    if abs(ten) > 99:  # pint says what is wrong with it
        return None
    present = {atom: power for atom, power in atoms.items() if power}
    powers = {name: power for name, power in base_powers(present).items() if name != "rad"}
    return Unit(factor * float(f"1e{ten}"), present, Dimension.of(powers), "Hz" in present)


@cache
def _registry() -> pint.UnitRegistry[float]:
    import pint  # only where the table does not do

    registry: pint.UnitRegistry[float] = pint.UnitRegistry()
    registry.define("newton_meter = newton * meter = Nm")  # pint: 1000 m/kg
    registry.define("@alias revolution = rev")
    registry.define("thousandth_inch = 0.001 * inch = mil = mils")  # pint: a mil is an angle
    return registry


def _by_pint(text: str) -> Unit:
    """Read any text.

    pint multiplies and exponentiates what it reads, so it gets unit names, the number 1 and
    powers of two digits at most.
    """
    from pint import UndefinedUnitError

    try:
        unit = _registry().parse_units(text)
        origin = _registry().Quantity(0.0, unit).to_base_units().magnitude
        size = float(_registry().Quantity(1.0, unit).to_base_units().magnitude)
    except UndefinedUnitError as error:
        raise ValueError(f"unknown name {''.join(error.unit_names)}") from None
    except Exception:  # pint's parser raises whatever its operators do
        raise ValueError("no product of units") from None
    if origin != 0.0:
        raise ValueError("its zero is not zero in SI")
    if not (size > 0 and math.isfinite(size)):
        raise ValueError("too large or too small")
    dimension = {_BASE.get(name, name): n for name, n in _powers(unit.dimensionality)}
    turns = "hertz" in {_split(name) for name in unit._units}
    return Unit(size, _atoms(unit), Dimension.of(dimension), turns)


def _split(name: str) -> str:
    """Return pint's name of a unit without its prefix."""
    candidates = _registry().parse_unit_name(name)
    return str(candidates[0][1]) if candidates else name


def _atoms(unit: pint.Unit) -> dict[str, int]:
    """Return the SI symbols of a unit and their powers, derived units kept as they are."""
    atoms: Counter[str] = Counter()
    for name, exponent in _powers(unit._units):
        base = _split(name)
        if base in _ATOMS:
            parts = {_ATOMS[base]: 1}
        else:
            made = _registry().Quantity(1.0, _registry().Unit(name)).to_base_units().units
            parts = with_force(
                {_ATOMS.get(_split(n), n): power for n, power in _powers(made._units)}
            )
        for atom, power in parts.items():
            atoms[atom] += power * exponent
    return {atom: power for atom, power in atoms.items() if power}


def _powers(powers: Mapping[str, Any]) -> Iterable[tuple[str, int]]:
    """Return pint's names and their powers; all are whole, see `_POWER`."""
    return [(name, int(float(power))) for name, power in powers.items()]


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
