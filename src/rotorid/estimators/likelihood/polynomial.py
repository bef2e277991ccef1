"""Monomials of the unknowns and their derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rotorid.record import Floats, Integers


@dataclass(frozen=True)
class Monomials:
    """Products of unknowns, ``mu_m = prod_j x_j^(n_mj)``.

    Parameters
    ----------
    factors : int array, shape (monomial, factor)
        Indices of the unknowns of each product, repeated for powers; the number of unknowns
        stands for the factor one.
    unknowns : int

    Examples
    --------
    >>> mu = Monomials.from_exponents([[1, 0], [1, 2]])
    >>> mu.values([2.0, 3.0])
    array([ 2., 18.])
    >>> mu.jacobian([2.0, 3.0])
    array([[ 1.,  0.],
           [ 9., 12.]])
    """

    factors: Integers
    unknowns: int

    @classmethod
    def from_exponents(cls, exponents: ArrayLike) -> Monomials:
        """Build from the exponents of each product, int array, shape (monomial, unknown)."""
        table = np.asarray(exponents, dtype=np.int64)
        count, unknowns = table.shape
        longest = int(table.sum(axis=1).max(initial=1))
        factors = np.full((count, longest), unknowns, dtype=np.int64)
        for row, powers in enumerate(table):
            flat = np.repeat(np.arange(unknowns), powers)
            factors[row, : len(flat)] = flat
        return cls(factors, unknowns)

    def _padded(self, x: ArrayLike) -> Floats:
        return np.append(np.asarray(x, dtype=float), 1.0)[self.factors]

    def values(self, x: ArrayLike) -> Floats:
        """Return mu, shape (monomial,)."""
        return np.asarray(self._padded(x).prod(axis=1))

    def jacobian(self, x: ArrayLike) -> Floats:
        """Return d mu / d x, shape (monomial, unknown); exact where unknowns are zero."""
        held = self._padded(x)
        jacobian = np.zeros((len(held), self.unknowns + 1))
        rows = np.arange(len(held))
        for j in range(held.shape[1]):
            others = np.delete(held, j, axis=1).prod(axis=1)
            np.add.at(jacobian, (rows, self.factors[:, j]), others)
        return jacobian[:, :-1]
