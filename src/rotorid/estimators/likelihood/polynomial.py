"""Monomials of the unknowns and their derivatives."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from rotorid.frozen import frozen
from rotorid.record import Floats, Integers


@frozen
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

    @cached_property
    def _columns(self) -> Integers:
        """Factors as rows of columns, shape (factor, monomial)."""
        return np.ascontiguousarray(self.factors.T)

    @cached_property
    def _flat(self) -> Integers:
        """Place of each factor's derivative in the flattened Jacobian."""
        rows = np.arange(len(self.factors)) * (self.unknowns + 1)
        return (rows + self._columns).ravel()

    def _held(self, x: ArrayLike) -> Floats:
        padded = np.empty(self.unknowns + 1)
        padded[:-1], padded[-1] = x, 1.0
        return np.asarray(padded[self._columns])

    def values(self, x: ArrayLike) -> Floats:
        """Return mu, shape (monomial,)."""
        return np.asarray(np.multiply.reduce(self._held(x), axis=0))

    def jacobian(self, x: ArrayLike) -> Floats:
        """Return d mu / d x, shape (monomial, unknown); exact where unknowns are zero."""
        held = self._held(x)
        others = np.ones_like(held)
        for j in range(len(held)):
            others[:j] *= held[j]
            others[j + 1 :] *= held[j]
        width = self.unknowns + 1
        size = len(self.factors) * width
        flat = np.bincount(self._flat, weights=others.ravel(), minlength=size)
        return np.asarray(flat.reshape(-1, width)[:, :-1])
