"""Noise of mean lines: a factor of its covariance that is never singular."""

from __future__ import annotations

import numpy as np

from rotorid.frozen import frozen
from rotorid.record import Complexes, Floats
from rotorid.signals.covariance import LineCovariance

FLOOR = 1e-9
"""Least deviation of a mean line, relative to the size of its channels: rounding and no more."""


NOTHING = 1e-20
"""Size of channels that are all exactly zero, forces in passive bearings, in SI: with a floor that
any machine would notice, one of a vanishing scale would fit best."""


@frozen
class Noise:
    """Covariance C = F F^H of the mean lines.

    Parameters
    ----------
    factor : complex array, shape (line, channel, factor)
    dof : float
        Complex degrees of freedom of the estimate of C; infinite where C is known.
    shrunk : float
        Share of the diagonal that was mixed in, 0 where the periods suffice.
    apart : float
        Share of a line's noise that is not in its own covariance.
    shared : int
        How many lines have their covariance from one estimate.
    """

    factor: Complexes
    dof: float
    shrunk: float = 0.0
    apart: float = 1.0
    shared: int = 1


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
    """Least deviation of each channel; a channel without signal gets that of its kind."""
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
