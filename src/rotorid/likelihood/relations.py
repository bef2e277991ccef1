"""Monomials of the unknowns, and polynomial relations between them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from rotorid.core.values import Floats, Integers, frozen


@frozen
class Monomials:
    """Products of unknowns, ``mu_m = prod_j x_j^(n_mj)``."""

    # (monomial, factor): indices of the unknowns of each product, repeated for powers; the number
    # of unknowns stands for the factor one
    factors: Integers
    unknowns: int

    @classmethod
    def of(cls, products: Sequence[Sequence[int]], unknowns: int) -> Monomials:
        longest = max((len(product) for product in products), default=1)
        padded = [[*product, *[unknowns] * (longest - len(product))] for product in products]
        return cls(np.array(padded, dtype=np.int64).reshape(len(padded), longest), unknowns)

    @cached_property
    def _columns(self) -> Integers:
        return np.ascontiguousarray(self.factors.T)

    @cached_property
    def _flat(self) -> Integers:
        """Place of each factor's derivative in the flattened Jacobian."""
        rows = np.arange(len(self.factors)) * (self.unknowns + 1)
        return (rows + self._columns).ravel()

    @cached_property
    def _others(self) -> Integers:
        """Places of the other factors beside each, shape (factor, factor - 1)."""
        count = self.factors.shape[1]
        places = np.tile(np.arange(count), (count, 1))
        return places[~np.eye(count, dtype=bool)].reshape(count, max(count - 1, 0))

    def _held(self, x: ArrayLike) -> Floats:
        padded = np.empty(self.unknowns + 1)
        padded[:-1], padded[-1] = x, 1.0
        return np.asarray(padded[self._columns])

    def values(self, x: ArrayLike) -> Floats:
        return np.asarray(np.multiply.reduce(self._held(x), axis=0))

    def jacobian(self, x: ArrayLike) -> Floats:
        """Return d mu / d x, shape (monomial, unknown); exact where unknowns are zero."""
        others = np.multiply.reduce(self._held(x)[self._others], axis=1)
        width = self.unknowns + 1
        size = len(self.factors) * width
        flat = np.bincount(self._flat, weights=others.ravel(), minlength=size)
        return np.asarray(flat.reshape(-1, width)[:, :-1])


Polynomial = Mapping[tuple[int, ...], float]
"""``{unknowns of the product, ascending, repeated for powers: coefficient}``."""


@frozen
class Limit:
    expression: str
    way: float  # 1 of a lower bound, -1 of an upper one
    value: float  # SI

    def __str__(self) -> str:
        return f"{self.expression} {'>=' if self.way > 0 else '<='} {self.value:g}"


@frozen
class Relation:
    """A polynomial, what it was stated as, for messages, and its deviation: 0 of one that holds."""

    polynomial: Polynomial
    stated: str | Limit
    std: float = 0.0


@frozen
class Relations:
    """Polynomials ``h(x)``: relations h = 0, residuals h of deviation one, or bounds h >= 0."""

    rows: tuple[Relation, ...]
    unknowns: int

    @cached_property
    def _products(self) -> list[tuple[int, ...]]:
        return sorted({product for row in self.rows for product in row.polynomial})

    @cached_property
    def monomials(self) -> Monomials:
        return Monomials.of(self._products, self.unknowns)

    @cached_property
    def matrix(self) -> Floats:
        """Coefficients, shape (relation, monomial)."""
        rows = [
            [row.polynomial.get(product, 0.0) / (row.std or 1.0) for product in self._products]
            for row in self.rows
        ]
        return np.array(rows).reshape(len(self.rows), len(self._products))

    @property
    def texts(self) -> tuple[str, ...]:
        return tuple(str(row.stated) for row in self.rows)

    def __len__(self) -> int:
        return len(self.rows)

    def joined(self, rows: Iterable[Relation]) -> Relations:
        return replace(self, rows=(*self.rows, *rows))

    def where(self, chosen: Callable[[Relation], bool]) -> Relations:
        return replace(self, rows=tuple(filter(chosen, self.rows)))

    @cached_property
    def _linear(self) -> tuple[Floats, Floats] | None:
        """Slopes and constants, where all polynomials are linear, as most are at every point."""
        if self.holds(2):
            return None
        nowhere = np.zeros(self.unknowns)
        slopes, constants = self.monomials.jacobian(nowhere), self.monomials.values(nowhere)
        return self.matrix @ slopes, self.matrix @ constants

    def values(self, x: Floats) -> Floats:
        if self._linear is None:
            return np.asarray(self.matrix @ self.monomials.values(x))
        slopes, constants = self._linear
        return np.asarray(slopes @ x + constants)

    def jacobian(self, x: Floats) -> Floats:
        if self._linear is None:
            return np.asarray(self.matrix @ self.monomials.jacobian(x))
        return self._linear[0]

    def holds(self, least: int = 1) -> set[int]:
        """Return the unknowns in products of so many factors."""
        return {i for product in self._products if len(product) >= least for i in product}

    def sizes(self, x: Floats) -> Floats:
        """Return the size of each relation's terms, shape (relation,); rounding scales with it."""
        if self._linear is None:
            return np.asarray(np.abs(self.matrix) @ np.abs(self.monomials.values(x)))
        slopes, constants = self._linear
        return np.asarray(np.abs(slopes) @ np.abs(x) + np.abs(constants))
