"""Monomials of the unknowns, and polynomial relations between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from rotorid.core.frozen import frozen
from rotorid.core.values import Floats, Integers


@frozen
class Monomials:
    """Products of unknowns, ``mu_m = prod_j x_j^(n_mj)``."""

    # (monomial, factor): indices of the unknowns of each product, repeated for powers; the number
    # of unknowns stands for the factor one
    factors: Integers
    unknowns: int

    @classmethod
    def from_exponents(cls, exponents: ArrayLike) -> Monomials:
        table = np.asarray(exponents, dtype=np.int64)
        unknowns = np.arange(table.shape[1])
        return cls.of([np.repeat(unknowns, powers).tolist() for powers in table], len(unknowns))

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
class Relations:
    """Polynomials ``h(x)``: relations h = 0, residuals h of deviation one, or bounds h >= 0."""

    monomials: Monomials
    matrix: Floats  # (relation, monomial)
    texts: tuple[str, ...]  # for messages

    @classmethod
    def build(
        cls, polynomials: Sequence[tuple[Polynomial, float, str]], unknowns: int
    ) -> Relations:
        distinct = sorted(
            {m for polynomial, _, _ in polynomials for m in polynomial},
            key=lambda product: [product.count(i) for i in range(unknowns)],
        )
        where = {m: i for i, m in enumerate(distinct)}
        matrix = np.zeros((len(polynomials), len(distinct)))
        for row, (polynomial, divisor, _) in enumerate(polynomials):
            for monomial, coefficient in polynomial.items():
                matrix[row, where[monomial]] += coefficient / divisor
        texts = tuple(text for _, _, text in polynomials)
        return cls(Monomials.of(distinct, unknowns), matrix, texts)

    def __len__(self) -> int:
        return len(self.matrix)

    def subset(self, which: Integers) -> Relations:
        return Relations(self.monomials, self.matrix[which], tuple(self.texts[i] for i in which))

    def joined(self, other: Relations) -> Relations:
        one, further = self.monomials.factors, other.monomials.factors
        count, longest = len(one) + len(further), max(one.shape[1], further.shape[1])
        factors = np.full((count, longest), self.monomials.unknowns)
        factors[: len(one), : one.shape[1]] = one
        factors[len(one) :, : further.shape[1]] = further
        matrix = np.zeros((len(self) + len(other), count))
        matrix[: len(self), : len(one)] = self.matrix
        matrix[len(self) :, len(one) :] = other.matrix
        table = Monomials(factors, self.monomials.unknowns)
        return Relations(table, matrix, self.texts + other.texts)

    def values(self, x: Floats) -> Floats:
        if not len(self):  # most problems have none, and each point asks
            return np.zeros(0)
        return np.asarray(self.matrix @ self.monomials.values(x))

    def jacobian(self, x: Floats) -> Floats:
        if not len(self):
            return np.zeros((0, self.monomials.unknowns))
        return np.asarray(self.matrix @ self.monomials.jacobian(x))

    def linear_in(self) -> list[int]:
        """Return the unknowns on which no relation depends but linearly, each by itself."""
        unknowns = self.monomials.unknowns
        products = [row[row < unknowns] for row in self.monomials.factors]
        entangled = {int(i) for row in products if len(row) > 1 for i in row}
        return [i for i in range(unknowns) if i not in entangled]

    def sizes(self, x: Floats) -> Floats:
        """Return the size of each relation's terms, shape (relation,); rounding scales with it."""
        return np.asarray(np.abs(self.matrix) @ np.abs(self.monomials.values(x)))
