"""How well an answer of the least-squares family fits its own equations, by their scatter.

With D the design and G the gains of the answer (it answers to noise n of the targets by G n), the
residual of a right model is ``e = (I - D G) n``. Each equation of each line over its own deviation,
which the scatter over periods tells, the sum of squares of e has

    mean      tr(A' A R),        variance  2 tr((A' A R)^2),        A = I - D G,

R the correlation of the noise between the equations of a line. Unlike a likelihood, whose residual
is the smallest there is, this takes any weights: what they leave is in the mean.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.estimators.expectation import Expectation, line_moments
from rotorid.estimators.likelihood.noise import FLOOR
from rotorid.frozen import frozen
from rotorid.record import Complexes, Floats


@frozen
class Fitted:
    """Equations of one record at the answer, on its lines.

    Parameters
    ----------
    residual : complex array, shape (line, row)
    design : complex array, shape (line, row, free)
    gains : complex array, shape (free, line, row)
        Of the answer to the targets.
    covariance : complex array, shape (line, row, row)
        Of the mean residual.
    size : array, shape (row,)
        Of the terms of each equation: below `FLOOR` of it is rounding.
    multiplicity : array, shape (line,)
    dof : float
        Complex degrees of freedom of the covariance.
    """

    residual: Complexes
    design: Complexes
    gains: Complexes
    covariance: Complexes
    size: Floats
    multiplicity: Floats
    dof: float

    def whitened(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Return residual, design, gains and R of real equations of deviation one, line by line."""
        variance = np.einsum("krr->kr", self.covariance).real + (FLOOR * self.size) ** 2
        deviation = np.sqrt(np.where(variance > 0, variance, 1.0))
        scale = np.sqrt(self.multiplicity)[:, None] / deviation
        gains = np.moveaxis(self.gains, 0, -1).conj() / scale[..., None]
        equal = self.covariance / (deviation[:, :, None] * deviation[:, None, :])
        rows = np.arange(equal.shape[1])
        equal[:, rows, rows] = 1.0  # rounding is noise, too
        single = (self.multiplicity == 1)[:, None, None]  # DC, Nyquist: no imaginary part
        cross, back = (np.where(single, 0.0, part) for part in (equal.imag, equal.real))
        correlation = np.block([[equal.real, -cross], [cross, back]])
        return (
            _parts(scale * self.residual),
            _parts(scale[..., None] * self.design),
            _parts(gains),
            correlation,
        )


def _parts(lines: Complexes) -> Floats:
    """Return real and imaginary parts of the rows of each line, one after the other."""
    return np.concatenate([lines.real, lines.imag], axis=1)


def misfit(records: Sequence[Fitted]) -> tuple[float, Expectation]:
    """Return the sum of squares of the residual over its scatter, and what noise makes of it."""
    # A' A = I - U V' with U = (D, G') and V = (G', D - G' D' D), so that nothing n x n is formed.
    parts = [record.whitened() for record in records]
    cost = sum(float((residual**2).sum()) for residual, *_ in parts)
    free = parts[0][1].shape[2]
    inner, shared = np.zeros((free, free)), np.zeros((2 * free, 2 * free))
    for _, design, _, _ in parts:
        inner += np.tensordot(design, design, ([0, 1], [0, 1]))
    mean = square = 0.0
    for _, design, gains, correlation in parts:
        u = np.concatenate([design, gains], axis=2)
        v = np.concatenate([gains, design - gains @ inner], axis=2)
        moved = correlation @ u
        cross = np.tensordot(v, moved, ([0, 1], [0, 1]))
        mean += float(np.trace(correlation, axis1=1, axis2=2).sum() - np.trace(cross))
        square += float((correlation**2).sum() - 2 * ((correlation @ v) * moved).sum())
        shared += cross
    square += float((shared * shared.T).sum())
    # Every deviation is itself from so many periods.
    dof = min(record.dof for record in records)
    of_one, spread = line_moments(np.ones(1), np.array([dof]), np.full(1, 2.0))
    mean, square = max(mean, 0.0), max(square, 1e-300)
    freedom = max(round(mean**2 / square), 1)
    wider = float(spread[0]) / 4
    return cost, Expectation(mean * float(of_one[0]) / 2, 2 * square * wider, freedom)
