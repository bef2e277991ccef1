"""Equations as sums of products: rational number x parameter monomial x signal."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import sympy as sp

from rotorid.errors import ModelError
from rotorid.models.evaluation import check_evaluable
from rotorid.models.expression import (
    MAX_EXPONENT,
    MAX_TERMS,
    RESERVED,
    Expression,
    check_number,
    parse,
    shown,
    symbol,
)

Monomial = tuple[int, ...]  # exponent of each parameter
DERIVATIVES = ("", "'", "''")


@dataclass(frozen=True)
class Names:
    """The declared names of a model, in order."""

    coordinates: tuple[str, ...]
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]

    @property
    def all(self) -> frozenset[str]:
        """Every name that an equation may hold."""
        motion = (q + dots for q in self.coordinates for dots in DERIVATIVES)
        return frozenset([*motion, *self.inputs, *self.parameters, *RESERVED])


@dataclass(frozen=True)
class Product:
    """``coefficient * monomial(parameters) * signal`` in one equation."""

    row: int
    monomial: Monomial
    coefficient: Fraction
    signal: Expression


@dataclass(frozen=True)
class Equations:
    """All equations: the sum of `left` in each row equals the sum of `right`.

    `left` holds no input; the signals of `right` are the symbols of the inputs.
    """

    left: tuple[Product, ...]
    right: tuple[Product, ...]


def split_equations(texts: Sequence[str], names: Names) -> Equations:
    """Expand equations into products."""
    left: list[Product] = []
    right: list[Product] = []
    for row, text in enumerate(texts):
        try:
            products = _products(row, text, names)
        except ModelError as error:
            raise error.at(place=f"equation {row + 1}") from None
        if len(left) + len(right) + len(products) > MAX_TERMS:
            raise ModelError(
                f"more than {MAX_TERMS} terms when expanded",
                f"{MAX_TERMS} in all equations at most",
                "simplify the model",
                place=f"equation {row + 1}",
            )
        inputs = {symbol(name) for name in names.inputs}
        forces = [p for p in products if p.signal in inputs]
        others = [p for p in products if p.signal not in inputs]
        sign = _orientation(others, forces)
        left += [_scaled(p, sign) for p in others]
        right += [_scaled(p, -sign) for p in forces]
    return Equations(tuple(left), tuple(right))


def _products(row: int, text: str, names: Names) -> list[Product]:
    linear = frozenset([*names.parameters, *names.inputs])
    value = sp.expand(parse(text, names=names.all, linear=linear, start="equation"))
    inputs = frozenset(symbol(name) for name in names.inputs)
    index = {symbol(name): i for i, name in enumerate(names.parameters)}
    gathered: dict[tuple[Monomial, Expression], Fraction] = defaultdict(Fraction)
    for term in sp.Add.make_args(value):
        monomial, signal, coefficient = _factors(term, index, inputs)
        gathered[monomial, signal] += coefficient
    products = [Product(row, m, c, s) for (m, s), c in gathered.items() if c != 0]
    motion = frozenset(symbol(q + dots) for q in names.coordinates for dots in DERIVATIVES)
    if not any(any(p.monomial) or p.signal.free_symbols & motion for p in products):
        raise ModelError(
            f"neither a coordinate nor a parameter in what remains of {text[:60]!r}",
            "an equation of motion",
            "leave it out, or write the term that moves",
        )
    if any(out_of_range(p.coefficient) for p in products):
        raise ModelError(
            "a coefficient too large or too small", f"1e+-{MAX_EXPONENT}", "scale the equation"
        )
    return sorted(products, key=lambda p: (_declaration(p.monomial), str(p.signal)))


def out_of_range(coefficient: Fraction) -> bool:
    """Tell a coefficient that is too large or too small to compute with."""
    return not 10**-MAX_EXPONENT < abs(coefficient) < 10**MAX_EXPONENT


def _factors(
    term: Expression, index: dict[Expression, int], inputs: frozenset[Expression]
) -> tuple[Monomial, Expression, Fraction]:
    exponents = [0] * len(index)
    coefficient, signal = Fraction(1), sp.Integer(1)
    for factor in sp.Mul.make_args(term):
        base, exponent = factor.as_base_exp()
        if factor.is_number:
            coefficient *= _fraction(factor)
        elif base in index:
            exponents[index[base]] += int(exponent)
        else:
            signal *= factor
    if (held := signal.free_symbols & inputs) and signal not in inputs:
        raise ModelError(
            f"the term {shown(term)} with the input {min(map(str, held))}",
            "inputs that stand alone, times numbers and parameters",
            "give the product an input of its own",
        )
    check_evaluable(signal)
    return tuple(exponents), signal, coefficient


def _fraction(number: Expression) -> Fraction:
    if number.is_Rational:
        return Fraction(int(number.p), int(number.q))
    check_number(number)
    return Fraction(repr(float(number)))  # pi, sqrt(2), ...


def _declaration(monomial: Monomial) -> tuple[int, ...]:
    """Return the index of each factor, as often as its power: the order of monomials."""
    return tuple(i for i, power in enumerate(monomial) for _ in range(power))


def sort_monomials(monomials: set[Monomial]) -> list[Monomial]:
    """Sort by the tuple of declaration indices, as `base` names them."""
    return sorted(monomials, key=_declaration)


def _orientation(others: list[Product], forces: list[Product]) -> int:
    inertia = [p for p in others if any(str(s).endswith("''") for s in p.signal.free_symbols)]
    if inertia:
        return 1 if inertia[0].coefficient > 0 else -1
    return 1 if not forces or forces[0].coefficient < 0 else -1


def _scaled(product: Product, sign: int) -> Product:
    return Product(product.row, product.monomial, sign * product.coefficient, product.signal)
