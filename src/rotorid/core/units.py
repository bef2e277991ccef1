"""Units and quantities: texts to SI at the border, and nowhere else.

An angle counts as a number, but a rate in Hz is a number of revolutions per second: ``140 Hz`` is
``2 pi 140 rad/s`` where a speed is expected, and a bare ``1/s`` is refused there.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import field
from fractions import Fraction
from functools import cache, lru_cache
from numbers import Real

from rotorid.core.errors import InputError, WrongTypeError, shortened
from rotorid.core.frozen import frozen

MAX_LENGTH = 64
BITS = 1000
"""Of a factor to SI, exactly: its numerator or denominator; doubles hold as much."""
MAGNITUDE = 1e60
"""Of samples in SI, and one over it: no machine comes near, and the fourth powers of a million
samples, which variances of variances are made of, stay within what doubles hold (1e308)."""
_SPELLING = str.maketrans(
    {"·": "*", "⋅": "*", "²": "^2", "³": "^3", "µ": "u", "μ": "u", "Ω": "ohm"}
)
_JOINED = ((re.compile(r"(?<=[A-Za-z])\.(?=[A-Za-z])"), "*"), (re.compile("_per_"), "/"))  # N.m
_TOKEN = re.compile(
    r"\s*(?:(?P<name>[A-Za-z_°%]+|\b1\b)"
    r"|(?:\^|\*\*)\s*(?P<power>-?[1-9]\d?)(?![\d.])|(?P<sign>[*/()]))\s*"
)

# SI symbols in the order in which they are written, with their names and what they are made of.
_SYMBOLS: dict[str, tuple[str, dict[str, int]]] = {
    "kg": ("", {"kg": 1}),
    "N": ("N newton newtons", {"kg": 1, "m": 1, "s": -2}),
    "Pa": ("Pa pascal pascals", {"kg": 1, "m": -1, "s": -2}),
    "J": ("J joule joules", {"kg": 1, "m": 2, "s": -2}),
    "W": ("W watt watts", {"kg": 1, "m": 2, "s": -3}),
    "V": ("V volt volts", {"kg": 1, "m": 2, "s": -3, "A": -1}),
    "T": ("T tesla teslas", {"kg": 1, "s": -2, "A": -1}),
    "Wb": ("Wb weber webers", {"kg": 1, "m": 2, "s": -2, "A": -1}),
    "H": ("H henry henrys", {"kg": 1, "m": 2, "s": -2, "A": -2}),
    "ohm": ("ohm ohms", {"kg": 1, "m": 2, "s": -3, "A": -2}),
    "C": ("C coulomb coulombs", {"A": 1, "s": 1}),
    "Hz": ("Hz hertz hertzs", {"s": -1}),
    "A": ("A ampere amperes amp amps", {"A": 1}),
    "K": ("K kelvin kelvins", {"K": 1}),
    "m": ("m meter meters metre metres", {"m": 1}),
    "s": ("s second seconds sec secs", {"s": 1}),
    "rad": ("rad radian radians", {"rad": 1}),
}
ORDER = {symbol: rank for rank, symbol in enumerate(_SYMBOLS)}
PREFIXES = {
    **{"": 0, "p": -12, "n": -9, "u": -6, "m": -3, "c": -2, "d": -1},
    **{"da": 1, "h": 2, "k": 3, "M": 6, "G": 9, "T": 12, "nano": -9, "micro": -6},
    **{"milli": -3, "centi": -2, "deci": -1, "kilo": 3, "mega": 6, "giga": 9},
}
# Names of units, a number and what it counts; those of the first table take prefixes.
_PREFIXED = """
g gram grams = 1/1000 kg
Nm = 1 N m
Wh = 3600 J
VA = 1 V A
Ah = 3600 C
F farad farads = 1 C/V
S siemens = 1 1/ohm
l L liter liters litre litres = 1/1000 m^3
bar bars = 100000 Pa
"""
_ALONE = """
dimensionless count counts = 1
% percent = 1/100
ppm = 1/1000000
min minute minutes = 60 s
h hr hour hours = 60 min
d day days = 24 h
t tonne tonnes = 1000 kg
in inch inches = 0.0254 m
mil mils thou milliinch = 1/1000 in
uin uinch microinch = 1/1000 mil
ft foot feet = 12 in
yd yard yards = 3 ft
mi mile miles = 5280 ft
micron microns = 1 um
angstrom = 0.1 nm
gn g_n gravity standard_gravity = 9.80665 m/s^2
lb lbs lbm pound pounds = 0.45359237 kg
oz ounce ounces = 1/16 lb
lbf pound_force = 1 lb gn
ozf = 1/16 lbf
kip = 1000 lbf
slug slugs = 1 lbf s^2/ft
kgf kp = 1 kg gn
dyn dyne = 0.00001 N
psi = 1 lbf/in^2
ksi = 1000 psi
atm = 101325 Pa
torr = 1/760 atm
mmHg = 133.322387415 Pa
poise = 0.1 Pa s
cP = 1/1000 Pa s
hp horsepower = 550 ft lbf/s
PS = 75 m kgf/s
rev revolution revolutions turn turns cycle cycles = 6.2831853071795862 rad
deg ° degree degrees = 1/360 rev
gon = 1/400 rev
arcmin arcminute arcminutes = 1/60 deg
arcsec arcsecond arcseconds = 1/60 arcmin
rpm RPM cpm CPM = 1 rev/min
rps = 1 rev/s
delta_degC = 1 K
"""

_MISTAKEN = {
    **dict.fromkeys(("grad", "Grad", "GRAD"), "deg for degrees, gon for a 400th of a turn"),
    **dict.fromkeys(("krad", "Mrad"), "rad"),
    **dict.fromkeys(("U", "Umdr", "tr"), "rev for a revolution, rpm for one in a minute"),
    **dict.fromkeys(("ton", "tons"), "t for 1000 kg"),
    **dict.fromkeys(("G", "Gs", "gauss"), "1e-4 T for a gauss, gn for the acceleration of gravity"),
}
_USUAL = {"rad/s": "rpm", "m": "mm", "rad": "deg", "s": "ms"}
_COUNTS = re.compile(r"[kKMG]?i?(?:bits?|bytes?|B|baud|Bd|Bq|becquerel)")
"""Names that one language, or one trade, takes for something else than another: read the other way
they make angles of gigaradians. Counts, of bits or decays, are no quantity of a rotor either."""
_SHIFTED = {"degC", "degF", "°C", "°F", "celsius", "fahrenheit", "dB"}


@frozen
class Dimension:
    """Powers of kg, m, s, A and K; an angle is a number."""

    powers: frozenset[tuple[str, Fraction]] = frozenset()

    @classmethod
    def of(cls, powers: Mapping[str, float | Fraction]) -> Dimension:
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
    """A factor to SI and the powers of SI symbols as written: N m is not J."""

    size: Fraction = Fraction(1)
    atoms: Mapping[str, int] = field(default_factory=dict)

    def times(self, other: Unit, power: int = 1) -> Unit:
        size = self.size * other.size**power
        if max(size.numerator.bit_length(), size.denominator.bit_length()) > BITS:
            raise ValueError("too large or too small")
        atoms = Counter(self.atoms)
        for atom, own in other.atoms.items():
            atoms[atom] += own * power
        return Unit(size, {atom: n for atom, n in atoms.items() if n})

    @property
    def turns(self) -> bool:
        return "Hz" in self.atoms

    @property
    def dimension(self) -> Dimension:
        powers = base_powers(self.atoms)
        return Dimension.of({name: power for name, power in powers.items() if name != "rad"})


def symbol_power(symbol: str, power: object) -> str:
    return symbol if power == 1 else f"{symbol}^{power}"


def base_powers(atoms: Mapping[str, int]) -> dict[str, int]:
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
    if len(text) > MAX_LENGTH:
        raise ValueError("no product of units")
    text = text.translate(_SPELLING)
    for pattern, sign in _JOINED:
        text = pattern.sub(sign, text)
    tokens = _tokens(text)
    unit = _product(tokens)
    if tokens:
        raise ValueError("no product of units")
    if unit.turns and "rad" in unit.atoms:
        raise ValueError("turns in a second, times an angle")
    return unit


def _tokens(text: str) -> list[str]:
    """Return names, signs and powers (``^2``) of a text, the first one last."""
    found = list(_TOKEN.finditer(text))
    if "".join(match[0] for match in found) != text:
        raise ValueError("no product of units")
    return [f"^{m['power']}" if m["power"] else m["name"] or m["sign"] for m in found[::-1]]


def _product(tokens: list[str]) -> Unit:
    """Read factors from left to right, up to the end or a closing parenthesis."""
    total = _factor(tokens)
    while tokens and tokens[-1] != ")":
        sign = tokens.pop() if tokens[-1] in "*/" else "*"
        total = total.times(_factor(tokens), -1 if sign == "/" else 1)
    return total


def _factor(tokens: list[str]) -> Unit:
    token = tokens.pop() if tokens else ")"
    if token == "(":
        found = _product(tokens)
        if not tokens or tokens.pop() != ")":
            raise ValueError("no product of units")
    elif token in "*/)" or token.startswith("^"):
        raise ValueError("no product of units")
    else:
        found = _named(token)
    if tokens and tokens[-1].startswith("^"):
        return Unit().times(found, int(tokens.pop()[1:]))
    return found


def _named(name: str) -> Unit:
    if name in _MISTAKEN:
        raise ValueError(f"{name}: write {_MISTAKEN[name]}")
    if _COUNTS.fullmatch(name):
        raise ValueError(f"{name}: write 1 for a count")
    if name in _SHIFTED:
        raise ValueError("its zero is not zero in SI")
    # Amps, Volts: a symbol is shorter, or has no small letters.
    for spelling in (name, name.lower()) if len(name) > 3 and name.istitle() else (name,):
        if spelling in MADE:  # before a name with a prefix
            return _defined(MADE[spelling])
        for prefix, ten in PREFIXES.items():
            stem = spelling.removeprefix(prefix)
            if stem in STEMS and prefix + stem == spelling:
                return _defined(STEMS[stem]).times(Unit(Fraction(10)), ten)
    raise ValueError(f"unknown name {spelling}")


@cache
def _defined(made: str) -> Unit:
    """Return what a line of the tables says, force as N; or an SI symbol."""
    if made in _SYMBOLS:
        return Unit(atoms={made: 1})
    size, _, unit = made.partition(" ")
    found = _product(_tokens(unit)) if unit else Unit()
    return Unit(Fraction(size), with_force(base_powers(found.atoms))).times(Unit(found.size))


def _lines(table: str) -> dict[str, str]:
    """Return what each name of a table is made of."""
    found = (line.split(" = ") for line in table.strip().splitlines())
    return {name: made for names, made in found for name in names.split()}


STEMS = {name: symbol for symbol, (words, _) in _SYMBOLS.items() for name in words.split()}
STEMS |= _lines(_PREFIXED)
MADE = {"1": "1", "kg": "kg", **_lines(_ALONE)}
"""What each name is made of; those of the first table take prefixes."""


_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?(?![\d.,])")


def _bad(text: str, place: str, why: str = "") -> InputError:
    return InputError(
        f"unit {shortened(text, MAX_LENGTH)!r}" + (f" ({why})" if why else ""),
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
    if unit.turns:
        return "turns"
    return "angle" if "rad" in base_powers(unit.atoms) else "plain"


def si_factor(unit: str, expected: str | None = None, *, place: str = "") -> float:
    """Return the number that turns a value in a unit into SI, or into another unit."""
    found = _unit(unit, place)
    if expected is None:
        return float(found.size)
    wanted = _unit(expected, place)
    kinds = (_rate_kind(found), _rate_kind(wanted))
    rate = {name for name, _ in wanted.dimension.powers} == {"s"}
    ambiguous = rate and kinds == ("plain", "angle")
    if found.dimension != wanted.dimension or ambiguous:
        cure = f"write {_usual('{}', expected)}"
        if found.dimension == wanted.dimension:
            cure = f"convert the value, and {cure}"
        else:
            cure += ", or change what the quantity is (units of the model, reads, input)"
        raise InputError(f"unit {unit!r}", f"a unit that converts to {expected}", cure, place=place)
    turn = {("turns", "angle"): 2 * math.pi, ("angle", "turns"): 0.5 / math.pi}.get(kinds, 1.0)
    return float(found.size / wanted.size) * turn


@lru_cache(maxsize=4096)
def converts(unit: str, expected: str) -> bool:
    try:
        si_factor(unit, expected)
    except InputError:
        return False
    return True


def quantity(value: float | str, expected: str, *, place: str = "") -> float:
    """Return a number in SI as it is; a text, or a quantity of pint, in the expected unit."""
    if isinstance(value, str):
        return to_si(value, expected, place=place)
    if hasattr(value, "magnitude") and hasattr(value, "units"):
        return float(value.magnitude) * si_factor(f"{value.units:~}" or "1", expected, place=place)
    return value


def finite_speed(speed: float | str, place: str = "speed") -> float:
    """Return a speed in rad/s, of a number or a text with its unit."""
    found = quantity(speed, "rad/s", place=place)
    if not isinstance(found, Real):
        given, taken = type(speed).__name__, "a number in rad/s, or a text with a unit"
        raise WrongTypeError(given, taken, "write '6000 rpm'", place=place)
    if not math.isfinite(found):
        raise InputError(f"{speed}", "a finite speed", "give 0 at standstill", place=place)
    return float(found)


def number_and_unit(value: object) -> tuple[str, str] | None:
    """Return number and unit of a quantity as they are written; None of what is no quantity."""
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        return None
    text = value.strip() if isinstance(value, str) else repr(value)
    match = _NUMBER.match(text)
    return None if match is None else (match.group(), text[match.end() :].strip())


def to_si(value: object, expected: str, *, place: str = "") -> float:
    """Return a quantity, number and unit, in the expected SI unit; a bare one where that is 1."""
    written = number_and_unit(value)
    if written is None:
        raise _no_quantity(value, expected, place)
    number, unit = written
    if not unit and expected != "1":
        raise InputError(
            f"{number!r} without a unit",
            f"a number and a unit, such as {_usual(number + ' {}', expected)}",
            "write the unit",
            place=place,
        )
    found = float(number) * si_factor(unit or "1", expected, place=place)
    if not math.isfinite(found):
        raise _no_quantity(value, expected, place)
    return found


def _no_quantity(value: object, expected: str, place: str) -> InputError:
    example = (
        "a number"
        if expected == "1"
        else f"a number and a unit, such as {_usual('1 {}', expected)}"
    )
    return InputError(shortened(repr(value), MAX_LENGTH), example, "write it so", place=place)


def _usual(text: str, expected: str) -> str:
    """Return a text with the unit that people use, and with that of SI."""
    units = dict.fromkeys((_USUAL.get(expected, expected), expected))
    return " or ".join(repr(text.format(unit)) for unit in units)


def check_unit(text: str, *, place: str = "") -> str:
    """Return the SI unit of a declared unit: as it was written where that is SI already."""
    unit = _unit(text, place)
    text = " ".join(text.split())
    return text if unit.size == 1 and text else _write(unit.atoms, angle=True)


BRACKETS = {"]": "[", ")": "("}


def is_unit(text: str) -> bool:
    try:
        check_unit(text)
    except InputError:
        return False
    return True


def name_and_unit(text: str) -> tuple[str, str | None]:
    """Split the name of a column, ``x1 [um]``, at the unit in brackets that ends it."""
    opening = BRACKETS.get(text[-1:])
    if opening is None:
        return text, None
    begin = text.find(opening, max(text.rfind(text[-1], 0, -1), 0))
    name, unit = text[: max(begin, 0)].rstrip(), text[begin + 1 : -1].strip()
    states_none = unit in ("", "-", "1")  # iy[1] may be the first of several
    if name.strip() and (states_none or is_unit(unit)):
        return name, None if states_none else unit
    return text, None


def multiply_units(factors: Iterable[tuple[str, int]]) -> str:
    factors = [(unit, power) for unit, power in factors if power and unit != "1"]
    if len(factors) == 1 and factors[0][1] == 1:
        return check_unit(factors[0][0])
    product = Unit()
    for text, power in factors:
        product = product.times(_unit(text, ""), power)
    return _write(product.atoms, angle=False)


def _write(atoms: Mapping[str, int], *, angle: bool) -> str:
    if atoms == {"rad": 1}:
        return "rad"
    if not angle:
        atoms = {atom: power for atom, power in atoms.items() if atom != "rad"}
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


@lru_cache(maxsize=1000)
def dimension_of(unit: str) -> Dimension:
    return _unit(unit, "").dimension
