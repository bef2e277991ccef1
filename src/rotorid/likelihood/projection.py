"""What the equations say without the coordinates that no sensor reads: N^H, with N^H P H = 0.

By reflections, the QR factorization of P H. Of many hidden coordinates, as in a rotor from its
drawing, N is only a few of the columns of Q: they are made from the reflections one by one, and Q
itself is never formed, which takes a third of the time.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.core.values import Complexes, Floats

MANY = 12
"""Hidden coordinates from which on Q is not formed: with fewer that takes no less time."""
BLOCK = 32
"""Columns that LAPACK takes at once."""


class Projection(Protocol):
    """What is left of rows, and the hidden motion that explains the rest."""

    @property
    def null_h(self) -> Complexes:
        """N^H, shape (line, equation, row)."""

    def motion(self, left: Complexes) -> Complexes:
        """Return q = H w with ``P q + left = 0``, (line, coordinate), left in the range of P H."""


@frozen
class Reflections:
    """By the QR factorization of P H: ``adjoint`` and ``triangle`` are those of its range."""

    null_h: Complexes
    adjoint: Complexes
    triangle: Complexes
    basis: Floats

    @classmethod
    def of(cls, stiffness: Complexes, hidden: Floats) -> Reflections:
        """Factor P H."""
        basis, triangle = np.linalg.qr(stiffness @ hidden, mode="complete")
        adjoint, count = basis.conj().transpose(0, 2, 1), hidden.shape[1]
        return cls(adjoint[:, count:], adjoint[:, :count], triangle[:, :count], hidden)

    def motion(self, left: Complexes) -> Complexes:
        """Return q = H w with ``P q + left = 0``."""
        found = np.linalg.solve(self.triangle, self.adjoint @ left[:, :, None])[:, :, 0]
        return _complex(-found @ self.basis.T)


@frozen
class Reflectors:
    """By the reflections themselves, line by line as LAPACK has them."""

    null_h: Complexes
    factors: tuple[tuple[Complexes, Complexes], ...]
    basis: Floats

    @classmethod
    def of(cls, stiffness: Complexes, hidden: Floats) -> Reflectors:
        """Factor P H."""
        from scipy.linalg.lapack import zgeqrf, zunmqr  # where it is needed: it takes its time

        rows, count = stiffness.shape[1], hidden.shape[1]
        columns = _complex(stiffness @ hidden)
        last = np.eye(rows, dtype=np.complex128, order="F")[:, count:]
        null_h = np.zeros((len(stiffness), rows - count, rows), dtype=np.complex128)
        factors = []
        for line, into in zip(columns, null_h, strict=True):
            reflected, sizes, _, failed = zgeqrf(line, lwork=BLOCK * rows)
            null, _, lost = zunmqr("L", "N", reflected, sizes, last, BLOCK * rows)
            if failed or lost:
                raise np.linalg.LinAlgError("no QR factorization")
            into[:] = null.T
            factors.append((reflected, sizes))
        return cls(np.conj(null_h, out=null_h), tuple(factors), hidden)

    def motion(self, left: Complexes) -> Complexes:
        """Return q = H w with ``P q + left = 0``."""
        from scipy.linalg.lapack import ztrtrs, zunmqr

        count = self.basis.shape[1]
        found = np.zeros((len(left), count), dtype=np.complex128)
        for (reflected, sizes), right, into in zip(self.factors, left, found, strict=True):
            turned, *_ = zunmqr("L", "C", reflected, sizes, right[:, None], BLOCK * len(right))
            solved, singular = ztrtrs(reflected[:count], turned[:count])
            if singular:
                raise np.linalg.LinAlgError("Singular matrix")
            into[:] = solved[:, 0]
        return _complex(-found @ self.basis.T)


def projection(stiffness: Complexes, hidden: Floats) -> Projection | None:
    """Project hidden coordinates out of P, shape (line, row, coordinate); None where none is.

    hidden, shape (coordinate, hidden), is an orthonormal basis of what no sensor reads.
    """
    if not hidden.shape[1]:
        return None
    if hidden.shape[1] >= MANY and np.isfinite(stiffness).all():
        return Reflectors.of(stiffness, hidden)
    return Reflections.of(stiffness, hidden)


def _complex(array: Any) -> Complexes:
    return np.asarray(array, dtype=np.complex128)
