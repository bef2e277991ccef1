"""What the loose ends of a window add to the equations: polynomials in i omega, eliminated.

``s = .. + sum_p tau_p (i omega / omega_0)^p``, tau real, one for each power of each equation and
record. They enter linearly, so that at each point they are at their best for all the others: the
whitened residual and its derivatives are taken orthogonal to their whitened columns.
"""

from __future__ import annotations

import numpy as np

from rotorid.frozen import frozen
from rotorid.record import Complexes, Floats, Integers

RANK = 1e-8
"""Whitened columns below this share of the largest are combinations of others: what ends do to a
hidden coordinate is partly that of other rows (20 of 24 count for the rotor of three masses)."""


@frozen
class Transient:
    """The columns of the loose ends of one record.

    Parameters
    ----------
    row, power : int array, shape (term,)
    powers : complex array, shape (line, power)
        ``(i omega / omega_0)^p``.
    """

    row: Integers
    power: Integers
    powers: Complexes

    @classmethod
    def of(cls, orders: Integers, omega: Floats) -> Transient:
        """Build from the order of the polynomial of each row, -1 for none."""
        pairs = [(row, p) for row, order in enumerate(orders) for p in range(order + 1)]
        row, power = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        reach = omega / max(float(omega.max(initial=0.0)), 1e-300)
        powers = (1j * reach[:, None]) ** np.arange(max(int(orders.max(initial=0)), 0) + 1)
        return cls(row, power, np.asarray(powers))

    def columns(self, unit_rows: Complexes) -> Complexes:
        """Return the columns, given what stands for a one in each row, (line, any, row)."""
        return np.asarray(unit_rows[:, :, self.row] * self.powers[:, None, self.power])

    def rows(self, tau: Floats, count: int) -> Complexes:
        """Return ``sum tau (i omega / omega_0)^p`` in each row, (line, row) or more behind."""
        total = np.zeros((len(self.powers), count, *tau.shape[1:]), dtype=np.complex128)
        for row, power, value in zip(self.row, self.power, tau, strict=True):
            total[:, row] += np.multiply.outer(self.powers[:, power], value)
        return total


@frozen
class Ends:
    """The whitened columns of a transient at one point.

    Parameters
    ----------
    basis : array, shape (real equation, rank)
        Orthonormal.
    solve : array, shape (term, rank)
        From parts along the basis to tau.
    """

    basis: Floats
    solve: Floats

    @classmethod
    def of(cls, columns: Floats) -> Ends:
        """Build from whitened columns, shape (real equation, term)."""
        size = np.sqrt((columns**2).sum(axis=0))
        scale = 1 / np.where(size > 0, size, 1.0)
        orthogonal, triangle = np.linalg.qr(columns * scale)
        left, values, right = np.linalg.svd(triangle)
        kept = values > RANK * values.max(initial=0.0)
        solve = scale[:, None] * (right[kept].T / values[kept])
        return cls(np.asarray(orthogonal @ left[:, kept]), np.asarray(solve))

    def tau(self, rows: Floats) -> Floats:
        """Return the tau that take most of some whitened columns away, (term, column)."""
        return np.asarray(-self.solve @ (self.basis.T @ rows))

    def rest(self, rows: Floats) -> Floats:
        """Return what no tau can take away."""
        return np.asarray(rows - self.basis @ (self.basis.T @ rows))
