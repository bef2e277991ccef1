"""Equations as sums of products: rational number x parameter monomial x signal."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

from rotorid.errors import ModelError
from rotorid.frozen import frozen
from rotorid.models import cost
from rotorid.models.expression import (
    MAX_EXPONENT,
    MAX_TERMS,
    RESERVED,
    Expression,
    Monomial,
    Terms,
    product,
    symbol,
)
from rotorid.models.plain import Polynomial, read_plain

DERIVATIVES = ("", "'", "''")


@frozen
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


@frozen
class Product:
    """``coefficient * monomial(parameters) * signal`` in one equation."""

    row: int
    monomial: Monomial
    coefficient: Fraction
    signal: Expression


@frozen
class Equations:
    """All equations: the sum of `left` in each row equals the sum of `right`.

    `left` holds no input; the signals of `right` are the symbols of the inputs.
    """

    left: tuple[Product, ...]
    right: tuple[Product, ...]


def split_equations(texts: Sequence[str], names: Names) -> Equations:
    """Expand equations into products."""
    with cost.bounded():
        return _split(texts, names)


def _split(texts: Sequence[str], names: Names) -> Equations:
    """Do the work of `split_equations`, within its bound."""
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
    value = read_plain(text, names=names.all, linear=linear, start="equation")
    gathered = None if value is None else _plain_terms(value, names)
    if gathered is None:
        from rotorid.models.symbolic import equation_terms  # sympy: where polynomials do not do

        gathered = equation_terms(text, names.all, names.parameters, names.inputs)
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


def _plain_terms(value: Polynomial, names: Names) -> Terms | None:
    """Split plain terms into monomials and signals; ``None`` where an input has company."""
    index = {symbol(name): i for i, name in enumerate(names.parameters)}
    inputs = frozenset(symbol(name) for name in names.inputs)
    gathered: Terms = {}
    for powers, coefficient in value.items():
        exponents, signal = [0] * len(index), []
        for base, power in powers:
            if base in index:
                exponents[index[base]] = power
            else:
                signal.append((base, Fraction(power)))
        term = product(signal)
        if term.free_symbols & inputs and term not in inputs:
            return None
        gathered[tuple(exponents), term] = coefficient
    return gathered


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


def polynomial(text: str, names: Sequence[str]) -> dict[Monomial, Fraction]:
    """Return the coefficients of a polynomial by the powers of its names."""
    with cost.bounded(cost.COMBINATION):
        return _polynomial(text, names)


def _polynomial(text: str, names: Sequence[str]) -> dict[Monomial, Fraction]:
    """Do the work of `polynomial`, within its bound."""
    known = frozenset(names)
    value = read_plain(text, names=known, linear=known)
    if value is None:
        from rotorid.models.symbolic import polynomial_terms  # sympy: as in `_products`

        return polynomial_terms(text, names)
    found = {}
    for powers, coefficient in value.items():
        by_name = {str(base): power for base, power in powers}
        found[tuple(by_name.get(name, 0) for name in names)] = coefficient
    return dict(sorted(found.items(), reverse=True)) or {(0,) * len(names): Fraction(0)}
