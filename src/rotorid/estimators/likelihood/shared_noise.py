"""Noise that the sensors of one line share, where it was stated channel by channel.

Deviations and coherences tell the noise of each response, and nothing of what several have in
common: a force that nobody measured moves all accelerometers of a test. Each line then tells less
than its sensors do by themselves. By the scores of the lines, u_k what the residual of line k does
to the unknowns, their covariance is

    sum_k v_k v_k^T,   v_k = (1 - S_k)^-1 u_k,

S_k the share of line k in the information: what it was without line k (White's estimator, a cluster
for each line, by the jackknife), whatever is common to the rows of a line. It is used where the
residuals of sensors are alike, and in no direction is anything taken off.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.distributions import gamma_tail
from rotorid.estimators.likelihood.cost import Evaluation
from rotorid.estimators.likelihood.inference import Inference, along_relations
from rotorid.estimators.likelihood.problem import Point
from rotorid.frozen import frozen
from rotorid.linalg import whole_svd
from rotorid.observation import Observation
from rotorid.record import Floats

APART = frozenset({"stated", "coherence"})
"""Covariances that hold no cross terms between channels."""
CHANCE = 1e-6
"""Chance of correlations of independent residuals below which sensors share their noise."""
ALONE = 0.05
"""What other lines must tell of every direction beside one line, for it to be left out."""
TINY = np.finfo(float).tiny
LEAST = 12
"""Lines below which their scatter tells deviations no better than to a third."""
RANK = 1e-10
"""Singular values of the scaled Jacobian below this share of the largest are rounding."""


@frozen
class Shared:
    """What shared noise makes of the deviations.

    Parameters
    ----------
    covariance : array, shape (free, free)
    factor : float
        By which it widens the deviation that it widens most.
    names : sequence of str
        The sensors that share it.
    """

    covariance: Floats
    factor: float
    names: tuple[str, ...]


def shared_noise(
    point: Point, inference: Inference, records: Sequence[Observation]
) -> Shared | None:
    """Return the covariance that the scatter of the lines shows; None where it shows no more.

    Only lines of records whose noise was stated channel by channel count so; that of other records,
    and of what is known beforehand, stays what it is.
    """
    apart = [r.lines.covariance.kind in APART and len(r.sensors) > 1 for r in records]
    if not any(apart) or inference.null.shape[1]:
        return None
    every = zip(records, point.records, apart, strict=True)
    if not any(each and _sensors_alike(record, at) for record, at, each in every):
        return None
    scaled, scale, basis = along_relations(point, point.problem.exact)
    left, values, right = whole_svd(scaled)
    kept = values > RANK * values.max(initial=0.0)
    whitened = left[:, kept]  # the unknowns in units of their deviations: unit covariance
    scores, shares, certain = _by_line(point, whitened, apart)
    free, count = whitened.shape[1], len(scores)
    if not free or count < max(LEAST, free + 2):
        return None
    without = np.eye(free) - shares
    if np.linalg.eigvalsh(without).min() < ALONE:
        return None
    alone = np.linalg.solve(without, scores[:, :, None])[:, :, 0]
    sizes, along = np.linalg.eigh(alone.T @ alone + certain)
    directions = (scale[:, None] * (basis @ right[kept].T)) / values[kept] @ along
    root = directions * np.sqrt(np.maximum(sizes, 1.0))
    covariance = root @ root.T
    before = np.diag(inference.covariance)
    widened = np.diag(covariance)[before > 0] / before[before > 0]
    factor = float(np.sqrt(widened.max(initial=1.0)))
    told = [r for r, each in zip(records, apart, strict=True) if each]
    names = tuple(dict.fromkeys(s.channel.name for r in told for s in r.sensors))
    return Shared(covariance, factor, names)


def _sensors_alike(record: Observation, at: Evaluation) -> bool:
    """Tell whether the residuals of two sensors are correlated, in phase or as the readings are.

    The squares of n independent correlations over as many lines are a gamma variable.
    """
    noise = record.lines.covariance.matrices
    sensors = [s.column for s in record.sensors]
    if np.abs(noise[:, list(record.input_columns)]).any():
        return False  # noise of inputs is in all sensors by itself
    variance = np.einsum("kii->ki", noise).real[:, sensors]
    data = record.lines.mean[:, sensors]
    left = (at.problem.data - at.corrected()[0])[:, [record.order.index(c) for c in sensors]]
    left = left / np.sqrt(variance)
    turned = left * np.where(data == 0, 1.0, data.conj() / np.maximum(np.abs(data), TINY))
    pairs = len(sensors) * (len(sensors) - 1) / 2
    for each in (left, turned):
        each = each / np.sqrt((np.abs(each) ** 2).mean(axis=0)).clip(TINY)
        common = np.abs(each.T @ each.conj()) ** 2 / len(each)
        if gamma_tail(float(np.triu(common, 1).sum()), pairs) < CHANCE:
            return True
    return False


def _by_line(
    point: Point, whitened: Floats, apart: Sequence[bool]
) -> tuple[Floats, Floats, Floats]:
    """Return scores (line, free), shares of the information (line, free, free), and the rest's.

    Of the lines whose noise was stated by channels; the last is what all other rows tell.
    """
    scores, shares, first = [], [], 0
    certain = np.zeros((whitened.shape[1],) * 2)
    for at, each in zip(point.records, apart, strict=True):
        lines = at.problem.lines
        size = lines * 2 * at.problem.equations
        rows = whitened[first : first + size].reshape(lines, -1, whitened.shape[1])
        if each:
            residual = at.residual.reshape(lines, -1)
            scores.append(np.einsum("kr,krf->kf", residual, rows))
            shares.append(np.einsum("krf,krg->kfg", rows, rows))
        else:
            certain += np.einsum("krf,krg->fg", rows, rows)
        first += size
    rest = whitened[first:]
    return np.concatenate(scores), np.concatenate(shares), certain + rest.T @ rest
