"""Weighted least squares on line-filtered samples, by SVD, and the sandwich of its covariance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

from rotorid.frozen import frozen
from rotorid.record import Complexes, Floats, PeriodicRecord
from rotorid.signals.covariance import choose_covariance
from rotorid.signals.spectrum import synthesize

POOLING_PERIODS = 30
RANK_TOLERANCE = 1e-11


def pooled(variance: Floats, power: Floats, periods: int) -> Floats:
    """Make variances over periods, the paper's (8), fit to be weights.

    Below `POOLING_PERIODS` periods they are pooled over the samples of a channel: from two or
    three periods a variance per sample comes close to zero by chance and its weight takes over.
    They are floored, so that samples without noise can be weighted too.
    """
    mean = np.broadcast_to(variance.mean(axis=0), variance.shape)
    raised = mean if periods < POOLING_PERIODS else np.maximum(variance, 1e-3 * mean)
    floor = 1e-18 * np.where(power > 0, power, power.max(initial=0.0) or 1.0)
    return np.asarray(np.maximum(raised, floor))


@frozen
class Block:
    """Equations of one record: ``design @ free = target`` on lines, weighted by sample.

    Parameters
    ----------
    record : PeriodicRecord
        For its harmonics and samples.
    design : complex array, shape (line, row, free)
    target : complex array, shape (line, row)
    variance : array, shape (sample, row)
    """

    record: PeriodicRecord
    design: Complexes
    target: Complexes
    variance: Floats

    def whitened(self) -> tuple[Floats, Floats]:
        """Return matrix and right side in samples over deviations, rows flattened."""
        record, (lines, rows, free) = self.record, self.design.shape
        columns = synthesize(
            self.design.reshape(lines, rows * free), record.harmonics, record.samples
        ).reshape(record.samples, rows, free)
        right = synthesize(self.target, record.harmonics, record.samples)
        deviation = np.sqrt(self.variance)
        return (
            (columns / deviation[..., None]).reshape(-1, free),
            (right / deviation).reshape(-1),
        )

    def line_gains(self, gains: Floats) -> Complexes:
        """Turn gains on whitened samples, (free, sample x row), into gains on lines.

        ``d free = Re(sum_k,r gains[:, k, r] d target[k, r])``; shape (free, line, row).
        """
        record = self.record
        weighted = gains.reshape(len(gains), record.samples, -1) / np.sqrt(self.variance)
        transformed = np.fft.rfft(weighted, axis=1)[:, record.harmonics]
        return np.asarray(record.multiplicity[:, None] * transformed.conj())


class Equations(Protocol):
    """Equations of one record: of its lines, or of its samples."""

    def whitened(self) -> tuple[Floats, Floats]:
        """Return matrix and right side over deviations, (equation, free) and (equation,)."""
        ...

    def line_gains(self, gains: Floats) -> NDArray[Any]:
        """Return the gains of whitened equations as those of what was measured."""
        ...


@frozen
class Solution:
    """What least squares gives.

    Parameters
    ----------
    values : array, shape (free,)
        NaN where the equations do not determine them.
    gains : sequence of array, shape (free, line, row)
        Of each block: how the values answer to its targets.
    condition_number : float
        Of the whitened matrix with columns scaled to length one.
    undetermined : array, shape (free, n)
        Directions, in scaled parameters, that the equations leave open.
    """

    values: Floats
    gains: tuple[NDArray[Any], ...]
    condition_number: float
    undetermined: Floats


def solve(blocks: Sequence[Equations]) -> Solution:
    """Solve ``min sum |whitened(design @ free - target)|^2``, the paper's (2) and (3).

    The paper prints ``(F' S^-1 F) F' S^-1 u`` in (5) and (6); the inverse of the first factor is
    meant. Here no normal equations are formed: the whitened columns are scaled, then decomposed
    by QR and SVD.
    """
    whitened = [block.whitened() for block in blocks]
    matrix = np.concatenate([m for m, _ in whitened])
    right = np.concatenate([r for _, r in whitened])
    length = np.sqrt((matrix**2).sum(axis=0))
    scale = np.where(length > 0, length, 1.0)
    orthogonal, triangle = np.linalg.qr(matrix / scale)
    left, singular, directions = np.linalg.svd(triangle)
    rank = int((singular > RANK_TOLERANCE * max(singular.max(initial=0.0), 1e-300)).sum())
    if not right.any():
        rank = 0  # zero solves it, and any multiple of what else does
    open_directions = directions[rank:].T
    inverse = (directions[:rank].T / singular[:rank]) @ left[:, :rank].T
    gains = (inverse / scale[:, None]) @ orthogonal.T
    values = gains @ right
    unknown = (np.abs(open_directions) > 1e-6).any(axis=1)
    values[unknown] = np.nan
    split = np.split(gains, np.cumsum([len(r) for _, r in whitened])[:-1], axis=1)
    condition = singular[0] / singular[-1] if 0 < rank == len(values) else np.inf
    return Solution(
        values,
        tuple(b.line_gains(g) for b, g in zip(blocks, split, strict=True)),
        float(condition),
        _separated(open_directions),
    )


def _separated(directions: Floats) -> Floats:
    """Return a basis of the same directions in which each has a parameter of its own."""
    if not directions.size:
        return directions
    _, _, order = scipy.linalg.qr(directions.T, mode="economic", pivoting=True)
    own = directions[np.sort(order[: directions.shape[1]])]
    return np.asarray(np.linalg.solve(own.T, directions.T).T)


def sandwich(
    gains: Sequence[Complexes], covariances: Sequence[Complexes], records: Sequence[PeriodicRecord]
) -> Floats:
    """Return the covariance of values that answer to noise e by ``Re(sum gains e)``.

    Notes
    -----
    The paper's (13), ``F' S^-1 F``, is an information matrix; nor is its inverse the covariance:
    rows without actuator carry a weight, not a variance, and the noise of the regressors
    dominates.
    """
    free = gains[0].shape[0]
    total = np.zeros((free, free))
    for gain, matrices, record in zip(gains, covariances, records, strict=True):
        # On a complex line the real part of a circular number has half its variance.
        share = 1.0 / record.multiplicity
        by_line = np.moveaxis(gain, 1, 0)
        shared = by_line @ matrices @ by_line.conj().swapaxes(-1, -2)
        total += np.tensordot(share, shared.real, axes=1)
    return (total + total.T) / 2


def scatter_of_answers(gains: Sequence[Complexes], residuals: Sequence[Complexes]) -> Floats:
    """Return the covariance of values from how they answer to the residual of each period.

    For models that are not linear in the motion: there the noise of one line is on others too,
    and `sandwich`, which takes lines as independent, is wrong by some tenths.
    """
    free = gains[0].shape[0]
    total = np.zeros((free, free))
    for gain, residual in zip(gains, residuals, strict=True):
        answers = np.einsum("fkr,pkr->pf", gain, residual).real[:, None] + 0j
        total += choose_covariance(answers, answers).matrices[0].real
    return total
