"""Equations and readings as sums of rational x monomial x signal."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

from rotorid.core.errors import InputError, ModelError, naming
from rotorid.core.frozen import frozen
from rotorid.core.units import Dimension, dimension_of
from rotorid.models.expressions import (
    FUNCTIONS,
    RESERVED,
    Expression,
    Monomial,
    product,
    symbol,
)
from rotorid.models.parser import COMBINATION, MAX_TERMS, Work, read, shown

DERIVATIVES = ("", "'", "''")
MAX_NAMES = 500
_NAME = re.compile(r"[^\W\d]\w{0,63}")


def check_names(**tables: Iterable[str]) -> None:
    """Refuse names that are reserved, declared twice, or no names; by the table they stand in."""
    taken = {*RESERVED, "pi", *FUNCTIONS}
    for table, members in tables.items():
        for name in members:
            found = f"the name {name[:60]!r}"
            if not _NAME.fullmatch(name):
                expected = "a letter, then letters, digits and _, 64 in all at most"
                raise ModelError(found, expected, "rename it", place=table)
            if name in taken:
                reserved = ", ".join([*RESERVED, "pi", *FUNCTIONS])
                expected = f"a name used once and not reserved ({reserved})"
                raise ModelError(f"{found} again", expected, "rename it", place=table)
            taken.add(name)


@frozen
class Product:
    """``coefficient * monomial(parameters) * signal`` in one equation."""

    row: int
    monomial: Monomial
    coefficient: Fraction
    signal: Expression


def split_equations(
    texts: Sequence[str],
    coordinates: Sequence[str],
    inputs: Sequence[str],
    parameters: Sequence[str],
) -> tuple[Product, ...]:
    """Expand equations into products: of the left sides, then of the right, all inputs there."""
    left: list[Product] = []
    right: list[Product] = []
    forced, work = frozenset(map(symbol, inputs)), Work()
    motion = frozenset(q + dots for q in coordinates for dots in DERIVATIVES)
    for row, text in enumerate(texts):
        with naming(place=f"equation {row + 1}"):
            products = _products(row, text, motion, forced, parameters, work)
            if len(left) + len(right) + len(products) > MAX_TERMS:
                found = f"more than {MAX_TERMS} terms when expanded"
                expected = f"{MAX_TERMS} in all equations at most"
                raise ModelError(found, expected, "simplify the model")
        forces = [p for p in products if p.signal in forced]
        others = [p for p in products if p.signal not in forced]
        inertia = [p for p in others if any(str(s).endswith("''") for s in p.signal.free_symbols)]
        right_way = not forces or forces[0].coefficient < 0
        sign = 1 if (inertia[0].coefficient > 0 if inertia else right_way) else -1
        left += [replace(p, coefficient=sign * p.coefficient) for p in others]
        right += [replace(p, coefficient=-sign * p.coefficient) for p in forces]
    return (*left, *right)


def _products(
    row: int,
    text: str,
    motion: frozenset[str],
    inputs: frozenset[Expression],
    parameters: Sequence[str],
    work: Work,
) -> list[Product]:
    own = {symbol(name) for name in parameters}
    linear = frozenset([*parameters, *map(str, inputs)])
    products = []
    names = motion | linear | {*RESERVED}
    for powers, coefficient in read(text, names, linear, equation=True, work=work).items():
        of_base = dict(powers)
        monomial = tuple(int(of_base.get(symbol(name), 0)) for name in parameters)
        signal = product((base, Fraction(n)) for base, n in powers if base not in own)
        if (held := signal.free_symbols & inputs) and signal not in inputs:
            told = f"the term {shown(signal)} with the input {min(map(str, held))}"
            expected = "inputs that stand alone, times numbers and parameters"
            raise ModelError(told, expected, "give the product an input of its own")
        products.append(Product(row, monomial, coefficient, signal))
    moving = frozenset(map(symbol, motion))
    if not any(any(p.monomial) or p.signal.free_symbols & moving for p in products):
        told = f"neither a coordinate nor a parameter in what remains of {text[:60]!r}"
        cure = "leave it out, or write the term that moves"
        raise ModelError(told, "an equation of motion", cure)
    return sorted(products, key=lambda p: (_declaration(p.monomial), str(p.signal)))


def _declaration(monomial: Monomial) -> tuple[int, ...]:
    """Return the index of each factor, as often as its power: the order of monomials."""
    return tuple(i for i, power in enumerate(monomial) for _ in range(power))


def sort_monomials(monomials: set[Monomial]) -> list[Monomial]:
    return sorted(monomials, key=_declaration)


def polynomial(text: str, names: Sequence[str]) -> dict[Monomial, Fraction]:
    known = frozenset(names)
    found = {}
    for powers, coefficient in read(text, known, known, work=Work(COMBINATION)).items():
        by_name = {str(base): int(power) for base, power in powers}
        found[tuple(by_name.get(name, 0) for name in names)] = coefficient
    return dict(sorted(found.items(), reverse=True)) or {(0,) * len(names): Fraction(0)}


@frozen
class SensorTerm:
    """``coefficient * parameters^powers * d^order q / dt^order`` of one coordinate."""

    coordinate: int
    order: int
    powers: tuple[int, ...]  # of each parameter of the model
    coefficient: float


def sensor_terms(
    text: str, coordinates: Sequence[str], parameters: Sequence[str] = (), *, place: str = ""
) -> tuple[SensorTerm, ...]:
    """Return the terms of a combination such as ``x1'' - L_a*theta_y``."""
    moving = [name + dots for name in coordinates for dots in DERIVATIVES]
    with naming(place=place):
        terms = polynomial(text, [*moving, *parameters])
    found = []
    for powers, coefficient in terms.items():
        motion, rest = powers[: len(moving)], powers[len(moving) :]
        if sum(motion) != 1:
            expected = "a linear combination of coordinates, such as x2 - 0.02*theta_y or x1''"
            cure = "write a sum of coordinates, each once in a term, without a constant"
            raise InputError(repr(text[:60]), expected, cure, place=place)
        where = divmod(motion.index(1), len(DERIVATIVES))
        found.append(SensorTerm(*where, rest, float(coefficient)))
    return tuple(found)


def linear_combination(
    text: str,
    names: Sequence[str],
    parameters: Sequence[str] = (),
    *,
    derivatives: bool = False,
    place: str = "",
) -> dict[str, float]:
    """Return the coefficients of names, of what multiplies them too: ``L_a*theta_y``, ``x''``."""
    found = {}
    for term in sensor_terms(text, names, parameters, place=place):
        if term.order and not derivatives:
            told = f"{text[:60]!r}, which holds a derivative"
            expected = "a combination of positions here"
            raise InputError(told, expected, "leave the derivative out", place=place)
        powers = zip(parameters, term.powers, strict=True)
        levers = [name for name, power in powers for _ in range(power)]
        product = [*levers, names[term.coordinate] + DERIVATIVES[term.order]]
        found["*".join(product)] = term.coefficient
    return found


def combination_text(parts: Mapping[str, float]) -> str:
    """Write a linear combination as it is read: ``x - 0.2*theta_y``."""
    text = ""
    for name, factor in parts.items():
        size = "" if abs(factor) == 1 else repr(float(abs(factor))).removesuffix(".0") + "*"
        signs = (" + ", " - ") if text else ("", "-")
        text += signs[factor < 0] + size + name
    return text


_NUMBER = Dimension()


def product_dimensions(
    products: Sequence[Product],
    parameter_units: Sequence[str],
    units: Mapping[str, str],
    coordinates: Sequence[str],
) -> list[Dimension | None]:
    """Return the dimension of each product; ``None`` where it cannot be told."""
    second = dimension_of("s")
    symbols = {name: dimension_of(unit) for name, unit in units.items()}
    for name in coordinates:
        for order, dots in enumerate(DERIVATIVES):
            symbols[name + dots] = symbols[name] * second**-order
    symbols |= {"t": second, "Omega": second**-1, "phi": _NUMBER}
    parameters = [dimension_of(unit) for unit in parameter_units]
    monomials = {m: _times(zip(parameters, m, strict=True)) for m in {p.monomial for p in products}}
    signals = {s: _signal_dimension(s, symbols) for s in {p.signal for p in products}}
    return [_times([(monomials[p.monomial], 1), (signals[p.signal], 1)]) for p in products]


def unit_faults(
    products: Sequence[Product], dimensions: Sequence[Dimension | None]
) -> Iterator[str]:
    """Name equations of unlike units; terms with 9.81 or 0.4, which may have one, do not count."""
    found: dict[int, dict[Dimension, None]] = {}
    for p, dimension in zip(products, dimensions, strict=True):
        plain = p.coefficient.denominator == 1 and abs(p.coefficient) <= 4
        if dimension is not None and plain:
            found.setdefault(p.row, {})[dimension] = None
    for row in sorted(found):
        if len(found[row]) > 1:
            shown = " and in ".join(map(str, found[row]))
            yield f"equation {row + 1} adds terms in {shown}: check it"


def _times(powers: Iterable[tuple[Dimension | None, int | Fraction]]) -> Dimension | None:
    total = _NUMBER
    for unit, power in powers:
        if unit is None:
            return None
        if power:
            total = total * unit**power
    return total


def _signal_dimension(signal: Expression, symbols: Mapping[str, Dimension]) -> Dimension | None:
    if signal.kind == "name":
        return symbols[str(signal)]
    if signal.kind != "sum":
        return _signal_dimension(signal.inner[0], symbols) if signal.kind == "abs" else _NUMBER
    terms = {
        _times((_signal_dimension(base, symbols), n) for base, n in factors)
        for factors, _ in signal.parts
    }
    return terms.pop() if len(terms) == 1 else None
