"""Polynomial relations between unknowns: exact, with a deviation, or as bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rotorid.estimators.likelihood.polynomial import Monomials
from rotorid.frozen import frozen
from rotorid.record import Floats, Integers

Polynomial = Mapping[tuple[int, ...], float]
"""``{exponents of the unknowns: coefficient}``."""


@frozen
class Relations:
    """Polynomials ``h(x)`` of the unknowns.

    An exact relation is h = 0; one with a deviation is a residual h, scaled to deviation one; a
    bound is h >= 0.

    Parameters
    ----------
    monomials : Monomials
    matrix : array, shape (relation, monomial)
    texts : sequence of str
        For messages.

    Examples
    --------
    >>> product = Relations.build([({(1, 1): 1.0, (0, 0): -6.0}, 1.0, "a*b = 6")], 2)
    >>> product.values(np.array([2.0, 3.0])), product.jacobian(np.array([2.0, 3.0]))
    (array([0.]), array([[3., 2.]]))
    """

    monomials: Monomials
    matrix: Floats
    texts: tuple[str, ...]

    @classmethod
    def build(
        cls, polynomials: Sequence[tuple[Polynomial, float, str]], unknowns: int
    ) -> Relations:
        """Build from (polynomial, divisor, text) of each relation."""
        distinct = sorted({m for polynomial, _, _ in polynomials for m in polynomial})
        where = {m: i for i, m in enumerate(distinct)}
        matrix = np.zeros((len(polynomials), len(distinct)))
        for row, (polynomial, divisor, _) in enumerate(polynomials):
            for monomial, coefficient in polynomial.items():
                matrix[row, where[monomial]] += coefficient / divisor
        table = np.array(distinct, dtype=np.int64).reshape(len(distinct), unknowns)
        return cls(
            Monomials.from_exponents(table), matrix, tuple(text for _, _, text in polynomials)
        )

    def __len__(self) -> int:
        return len(self.matrix)

    def subset(self, which: Integers) -> Relations:
        """Return some of the relations."""
        return Relations(self.monomials, self.matrix[which], tuple(self.texts[i] for i in which))

    def joined(self, other: Relations) -> Relations:
        """Return these relations and those of another set."""
        factors = (self.monomials.factors, other.monomials.factors)
        width = max(f.shape[1] for f in factors)
        padded = [
            np.pad(f, ((0, 0), (0, width - f.shape[1])), constant_values=self.monomials.unknowns)
            for f in factors
        ]
        matrix = np.zeros((len(self) + len(other), sum(len(f) for f in factors)))
        matrix[: len(self), : len(factors[0])] = self.matrix
        matrix[len(self) :, len(factors[0]) :] = other.matrix
        table = Monomials(np.concatenate(padded), self.monomials.unknowns)
        return Relations(table, matrix, self.texts + other.texts)

    def values(self, x: Floats) -> Floats:
        """Return h, shape (relation,)."""
        if not len(self.matrix):
            return np.zeros(0)
        return np.asarray(self.matrix @ self.monomials.values(x))

    def jacobian(self, x: Floats) -> Floats:
        """Return dh/dx, shape (relation, unknown)."""
        if not len(self.matrix):
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
