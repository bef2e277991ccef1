"""The steps to a whitened residual: noise, scales, projection, and the transient of a window.

Everything after it is free of units: rows and coordinates, divided by their scales, are about one.

``s = .. + sum_p tau_p (i omega / omega_0)^p``, tau real, one for each power of each equation and
record, at their best for all the other unknowns: the whitened residual and its derivatives are
taken orthogonal to their whitened columns.

What the equations say without the coordinates that no sensor reads is N^H, with N^H P H = 0, by the
QR factorization of P H. Of many hidden coordinates, as in a rotor from its drawing, N is made from
the reflections, and Q itself is never formed, which takes a third of the time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from rotorid.core.linalg import column_lengths, thin_qr
from rotorid.core.values import Complexes, Floats, Integers, frozen
from rotorid.signals.covariance import FLOOR, LineCovariance

NOTHING = 1e-20
"""Size of channels that are all exactly zero, forces in passive bearings, in SI: with a floor that
any machine would notice, one of a vanishing scale would fit best."""


@frozen
class Noise:
    """Covariance C = F F^H of the mean lines."""

    factor: Complexes  # (line, channel, factor)
    dof: float  # complex degrees of freedom of the estimate of C; infinite where C is known
    shrunk: float = 0.0  # share of the diagonal that was mixed in, 0 where the periods suffice
    apart: float = 1.0  # share of a line's noise that is not in its own covariance
    shared: int = 1  # how many lines have their covariance from one estimate


def noise_factor(covariance: LineCovariance, data: Complexes, inputs: int, equations: int) -> Noise:
    """Factor the covariance of mean lines.

    Below ``2 * equations`` degrees of freedom V would be estimated too badly to whiten with: C is
    mixed with its own diagonal, ``(1 - a) C + a diag(C)``, with a = 1 - dof / (2 * equations).
    """
    dof = float(covariance.dof)
    share = max(0.0, 1.0 - dof / (2 * equations))
    if covariance.kind == "coherence":  # variances alone were estimated, each by itself
        share = 1.0
    matrices = covariance.matrices
    if share > 0:
        diagonal = matrices * np.eye(matrices.shape[1])
        matrices = (1 - share) * matrices + share * diagonal
    factor = _factor(matrices, _floor(data, inputs))
    return Noise(factor, dof, share, covariance.apart, covariance.shared)


def _floor(data: Complexes, inputs: int) -> Floats:
    size = np.sqrt((np.abs(data) ** 2).mean(axis=0))
    for part in (slice(0, inputs), slice(inputs, None)):
        kind = size[part]
        kind[kind < 1e-6 * kind.max(initial=0.0)] = kind.max(initial=0.0)
    return FLOOR * np.where(size > 0, size, NOTHING)


def _factor(matrices: Complexes, floor: Floats) -> Complexes:
    variance = np.einsum("kii->ki", matrices).real + floor**2
    deviation = np.sqrt(variance)
    correlation = matrices / (deviation[:, :, None] * deviation[:, None, :])
    diagonal = np.arange(matrices.shape[1])
    correlation[:, diagonal, diagonal] = 1.0
    values, vectors = np.linalg.eigh(correlation)
    root = np.sqrt(np.maximum(values, 1e-14))
    return np.asarray(deviation[:, :, None] * vectors * root[:, None, :])


@frozen
class Sizes:
    """Typical size of each equation's terms and of each coordinate."""

    rows: Floats
    coordinates: Floats


SEEN = 3.0  # size, in deviations of noise, from which on a row's force or a reading is a signal
BORROWED = 1e-3  # weight of a size that is borrowed: it decides only where nothing else does


def find_scales(
    stiffness: Complexes,
    forces: Complexes,
    sensors: Floats,
    readings: Complexes,
    force_noise: Floats,
    reading_noise: Floats,
) -> Sizes:
    """Fit ``|Z_rc| ~ row_r / coordinate_c`` in the logarithms, tied to what was measured.

    The tie: rows with a force are as large as the force, and a coordinate that a sensor reads by
    itself is as large as its reading. The fit follows every change of units exactly.

    A force or a reading that does not rise above its noise (rms over the lines) ties nothing: its
    row would be granted errors no larger than noise, whose best fit is a rotor without mass. Where
    it is all that a part of the machine has, its row is as large as the largest that is driven.
    """
    rows, coordinates = stiffness.shape[1:]
    top = np.abs(stiffness).max(axis=0, initial=0.0)
    shares = np.abs(stiffness) / np.where(top > 0, top, 1.0)  # squares of which cannot overflow
    size = top * np.sqrt((shares**2).mean(axis=0))
    r, c = np.nonzero(size)
    fit = np.zeros((len(r), rows + coordinates))
    fit[np.arange(len(r)), r] = 1.0
    fit[np.arange(len(r)), rows + c] = -1.0
    tied: list[tuple[int, float, float]] = []
    amounts = _rms(forces)
    for row in np.flatnonzero(amounts > 0).tolist():
        seen = amounts[row] > SEEN * force_noise[row]
        tied.append((row, amounts[row], 1.0) if seen else (row, amounts.max(), BORROWED))
    amounts = _rms(readings)
    for s, row in enumerate(sensors):
        if (row != 0).sum() == 1 and amounts[s] > SEEN * reading_noise[s]:
            coordinate = int(row.nonzero()[0][0])
            tied.append((rows + coordinate, amounts[s] / abs(row[coordinate]), 1.0))
    which, amount, weight = np.array(tied).reshape(-1, 3).T
    tie = weight[:, None] * np.eye(rows + coordinates)[which.astype(int)]
    values = weight * np.log(amount)
    # The shortest solution serves what nothing ties (a rotor at rest without any force).
    logs = np.linalg.lstsq(
        np.concatenate([fit, tie]), np.concatenate([np.log(size[r, c]), values]), rcond=1e-10
    )[0]
    return Sizes(np.exp(logs[:rows]), np.exp(logs[rows:]))


def _rms(lines: Complexes) -> Floats:
    return np.asarray(np.sqrt((np.abs(lines) ** 2).mean(axis=0)))


RANK = 1e-8
"""Whitened columns below this share of the largest are combinations of others: what ends do to a
hidden coordinate is partly that of other rows (20 of 24 count for the rotor of three masses)."""


@frozen
class Transient:
    """The columns of the loose ends of one record."""

    # (term,)
    row: Integers
    power: Integers
    powers: Complexes  # (line, power): ``(i omega / omega_0)^p``

    @classmethod
    def of(cls, orders: Integers, omega: Floats) -> Transient:
        pairs = [(row, p) for row, order in enumerate(orders) for p in range(order + 1)]
        row, power = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        reach = omega / max(float(omega.max(initial=0.0)), 1e-300)
        powers = (1j * reach[:, None]) ** np.arange(max(int(orders.max(initial=0)), 0) + 1)
        return cls(row, power, np.asarray(powers))

    def columns(self, unit_rows: Complexes) -> Complexes:
        """Return the columns, given what a one in each row becomes, (line, any, row)."""
        return np.asarray(unit_rows[:, :, self.row] * self.powers[:, None, self.power])

    def rows(self, tau: Floats, count: int) -> Complexes:
        """Return ``sum tau (i omega / omega_0)^p`` in each row, (line, row) or more behind."""
        total = np.zeros((len(self.powers), count, *tau.shape[1:]), dtype=np.complex128)
        for row, power, value in zip(self.row, self.power, tau, strict=True):
            total[:, row] += np.multiply.outer(self.powers[:, power], value)
        return total


@frozen
class Ends:
    """The whitened columns of a transient at one point."""

    basis: Floats  # (real equation, rank): orthonormal
    solve: Floats  # (term, rank): from parts along the basis to tau

    @classmethod
    def of(cls, columns: Floats) -> Ends:
        scale = 1 / column_lengths(columns)
        orthogonal, triangle = thin_qr(columns * scale)
        left, values, right = np.linalg.svd(triangle)
        kept = values > RANK * values.max(initial=0.0)
        solve = scale[:, None] * (right[kept].T / values[kept])
        return cls(np.asarray(orthogonal @ left[:, kept]), np.asarray(solve))

    def tau(self, rows: Floats) -> Floats:
        """Return the tau that take most of some whitened columns away, (term, column)."""
        return np.asarray(-self.solve @ (self.basis.T @ rows))

    def rest(self, rows: Floats) -> Floats:
        return np.asarray(rows - self.basis @ (self.basis.T @ rows))


MANY = 12  # hidden coordinates from which on Q is not formed: with fewer that takes no less time
BLOCK = 32  # columns that LAPACK takes at once


@frozen
class Projection:
    """What is left of rows, and the hidden motion that explains the rest."""

    null_h: Complexes  # N^H, shape (line, equation, row)
    # q = H w with ``P q + left = 0``, (line, coordinate), of a left in the range of P H
    motion: Callable[[Complexes], Complexes]


def by_qr(stiffness: Complexes, hidden: Floats) -> Projection:
    basis, triangle = np.linalg.qr(stiffness @ hidden, mode="complete")
    adjoint, count = basis.conj().transpose(0, 2, 1), hidden.shape[1]

    def motion(left: Complexes) -> Complexes:
        found = np.linalg.solve(triangle[:, :count], adjoint[:, :count] @ left[:, :, None])
        return as_complex(-found[:, :, 0] @ hidden.T)

    return Projection(adjoint[:, count:], motion)


def by_reflections(stiffness: Complexes, hidden: Floats) -> Projection:
    """Factor P H line by line, and keep the reflections as LAPACK has them."""
    from scipy.linalg.lapack import zgeqrf, ztrtrs, zunmqr  # where needed: it takes its time

    rows, count = stiffness.shape[1], hidden.shape[1]
    where = np.abs(hidden).argmax(axis=0)
    alone = np.count_nonzero(hidden) == count  # a product takes as long as the factorization
    columns = stiffness[:, :, where] * hidden[where, range(count)] if alone else stiffness @ hidden
    last = np.eye(rows, dtype=np.complex128, order="F")[:, count:]
    null_h = np.zeros((len(stiffness), rows - count, rows), dtype=np.complex128)
    factors = []
    for line, into in zip(as_complex(columns), null_h, strict=True):
        reflected, sizes, _, failed = zgeqrf(line, lwork=BLOCK * rows)
        null, _, lost = zunmqr("L", "N", reflected, sizes, last, BLOCK * rows)
        if failed or lost:
            raise np.linalg.LinAlgError("no QR factorization")
        into[:] = null.T
        factors.append((reflected, sizes))

    def motion(left: Complexes) -> Complexes:
        found = np.zeros((len(left), count), dtype=np.complex128)
        for (reflected, sizes), right, into in zip(factors, left, found, strict=True):
            turned, *_ = zunmqr("L", "C", reflected, sizes, right[:, None], BLOCK * rows)
            solved, singular = ztrtrs(reflected[:count], turned[:count])
            if singular:
                raise np.linalg.LinAlgError("Singular matrix")
            into[:] = solved[:, 0]
        return as_complex(-found @ hidden.T)

    return Projection(np.conj(null_h, out=null_h), motion)


def projection(stiffness: Complexes, hidden: Floats) -> Projection | None:
    """Project hidden coordinates, of an orthonormal basis (coordinate, hidden), out of P."""
    if not hidden.shape[1]:
        return None
    many = hidden.shape[1] >= MANY and np.isfinite(stiffness).all()
    return by_reflections(stiffness, hidden) if many else by_qr(stiffness, hidden)


def as_complex(array: Any) -> Complexes:
    return np.asarray(array, dtype=np.complex128)
