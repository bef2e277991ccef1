"""What the cost of a whole record should be, by the equation errors beside each line.

At the estimate they hold no motion. Whitened by their own windows, of half the width, they have a
sum K whose mean and variance docs/maximum-likelihood.md derives: J is as far off as K says.

*Notation*: e equations, w lines in a window, n the rank of P, which takes the references out of it,
p_k = (P)_kk of the line itself, T = sum_k P_k / n the weight of every pair of lines in the noise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotorid.core.distributions import Expectation
from rotorid.core.values import Complexes, Floats, Integers
from rotorid.data.lines import Beside
from rotorid.data.observation import Records
from rotorid.likelihood.cost import Evaluation
from rotorid.likelihood.inference import Inference
from rotorid.likelihood.problem import Point
from rotorid.signals.local_polynomial import LEAST, PER_CHANNEL

SLIGHT = 0.1
"""Share by which an expectation moves at most: noise bends by a few percent. More is motion in C,
which makes deviations too wide, or wrong equations: the cost is then held against C as it is."""
FEW = 400
"""Lines that tell the noise of the channels."""
ROUNDS = 10
"""Rounds in which it is told: of .31 % by which K was low three leave .14, ten .10, thirty .09."""
CHUNK = 256
"""Windows at a time, so that memory stays that of the lines."""


def by_equation_errors(inference: Inference, point: Point, records: Records) -> Inference:
    costs = []
    for record, at, cost in zip(records, point.records, inference.records, strict=True):
        beside, expected = record.lines.beside, float(cost.means.sum())
        found = None if beside is None else _sum_of(at, beside, at.problem.order)
        if found is not None and expected > 0:
            own, mean, variance = found
            share = cost.left / (at.problem.multiplicity.sum() * at.problem.equations)
            moved, variance = at.cost * mean * share / own / expected, variance * share
            means = cost.means
            if abs(moved - 1) <= SLIGHT:
                means = means * moved
                variance *= (at.cost / own) ** 2
            cost = replace(cost, means=means, variance=variance)
        costs.append(cost)
    before, pairs = inference.expectation, list(zip(costs, inference.records, strict=True))
    mean = before.mean + sum(float(new.means.sum() - old.means.sum()) for new, old in pairs)
    variance = before.variance + sum(new.variance - old.variance for new, old in pairs)
    told = Expectation(mean, variance, before.dof)
    return replace(inference, expectation=told, records=tuple(costs))


def _sum_of(at: Evaluation, beside: Beside, order: list[int]) -> tuple[float, float, float] | None:
    """Return K of one record, its mean and its variance; None with too few lines, or no noise."""
    count = at.problem.equations
    try:
        errors, noise = _whitened(at, beside, order)
    except np.linalg.LinAlgError:
        return None
    columns = beside.columns.shape[1]
    half = -(-(max(PER_CHANNEL * count, LEAST) + columns - 1) // 2)
    width = 2 * half + 1
    centre = beside.centre
    chosen = np.flatnonzero((centre >= half) & (centre < len(noise) - half))
    if len(chosen) < width:
        return None
    costs, own = np.zeros(len(chosen)), np.zeros(len(chosen))
    # T, (line, distance): the distance from - 2 half to 2 half
    paired = np.zeros((len(noise), 4 * half + 1), dtype=np.complex128)
    for start in range(0, len(chosen), CHUNK):
        part = slice(start, start + CHUNK)
        lines = chosen[part]
        window = centre[lines, None] + np.arange(-half, half + 1)
        found = _window_costs(beside, window, noise[window], errors[lines], paired)
        if found is None:
            return None
        costs[part], own[part] = found
    c = at.problem.multiplicity[chosen]
    n = width - columns
    gain, twice = n / (n - count), float((np.abs(paired) ** 2).sum())
    if beside.noise is None:
        mean = count * (own + (1 - own) * gain)
        diagonal = paired[centre[chosen], paired.shape[1] // 2].real
        spread = gain**2 * float(twice + (1 - 2 * diagonal).sum())  # tr (1 - T)^2
        pairs = len(chosen) * count / (3 * width)
    else:
        mean = np.full(len(chosen), count * gain)
        spread = gain**2 * (len(chosen) + twice)
        pairs = len(chosen) * count * (1 + 4 * width / (3 * n)) / n
    weight = at.problem.multiplicity.sum() / c.sum()  # lines without a whole window beside them
    variance = float((c**2).mean()) * count * (spread + pairs)
    total = float(c @ costs) * weight
    return (total, float(c @ mean) * weight, variance * weight**2) if total > 0 else None


def _whitened(at: Evaluation, beside: Beside, order: list[int]) -> tuple[Complexes, Complexes]:
    """Return the errors of the record and those that tell the noise, about one on every line."""
    turns = _turns(at)
    rows, errors = at.columns, at.errors()
    if at.null_h is not None and turns is not None:
        rows = turns @ (at.null_h @ rows)
        errors = (turns @ errors[:, :, None])[:, :, 0]
    told = np.flatnonzero(beside.ordinary[beside.centre])
    told = told[:: max(1, len(told) // FEW)]
    start = (np.abs(at.problem.noise.factor) ** 2).sum(axis=2).mean(axis=0)
    variance = _channel_noise(rows[told], errors[told], start)
    lower = np.linalg.cholesky((rows * variance) @ rows.conj().transpose(0, 2, 1))
    white: Complexes = np.asarray(np.linalg.solve(lower, errors[:, :, None])[:, :, 0])
    if beside.noise is None:
        return white, white
    # The loads of a quiet record are in its errors, and leak into every line: they tell no noise.
    noise = (rows[beside.where] @ beside.noise[:, order, None])[:, :, 0]
    return white, np.asarray(np.linalg.solve(lower[beside.where], noise[:, :, None])[:, :, 0])


def _channel_noise(rows: Complexes, errors: Complexes, start: Floats) -> Floats:
    """Return variances of the channels, the same on all lines, of which errors come, (channel,).

    By expectation and maximization (Dempster, Laird, Rubin 1977): what part of each error is that
    of a channel, given the variances, tells the variances anew.
    """
    variance = start
    for _ in range(ROUNDS):
        spread = rows * variance
        matrices = spread @ rows.conj().transpose(0, 2, 1)
        gains = np.linalg.solve(matrices, spread).conj().transpose(0, 2, 1)
        parts = (gains @ errors[:, :, None])[:, :, 0]
        taken = (gains * rows.transpose(0, 2, 1)).sum(axis=2).real
        found = (np.abs(parts) ** 2 + variance * (1 - taken)).mean(axis=0)
        variance = np.maximum(found, 1e-6 * start)
    return variance


def _turns(at: Evaluation) -> Complexes | None:
    """Return the unitary matrices that align N of every line with that of the line before."""
    if at.null_h is None:
        return None
    steps = at.null_h[:-1] @ at.null_h[1:].conj().transpose(0, 2, 1)
    left, _, right = np.linalg.svd(steps)
    steps, count = left @ right, at.null_h.shape[1]
    turns = np.empty((len(steps) + 1, count, count), dtype=np.complex128)
    turns[0] = np.eye(count)
    for k, step in enumerate(steps):
        turns[k + 1] = turns[k] @ step
    return turns


def _window_costs(
    beside: Beside, window: Integers, noise: Complexes, errors: Complexes, paired: Complexes
) -> tuple[Floats, Floats] | None:
    """Return each line's cost and p_k, and add its P / n to T; None where V is singular."""
    kept = beside.ordinary[window]
    design = beside.columns[window] * kept[:, :, None]
    size = np.sqrt((np.abs(design) ** 2).sum(axis=1, keepdims=True))
    orthogonal, _ = np.linalg.qr(design / np.where(size > 0, size, 1.0))
    data = noise * kept[:, :, None]
    left = data - orthogonal @ (orthogonal.conj().transpose(0, 2, 1) @ data)
    degrees = np.maximum(kept.sum(axis=1) - design.shape[2], errors.shape[1] + 1)
    matrices = left.transpose(0, 2, 1) @ left.conj() / degrees[:, None, None]
    scale = np.sqrt(np.diagonal(matrices, axis1=1, axis2=2).real)
    if not (scale > 0).all():
        return None
    scaled = errors / scale
    matrices = matrices / (scale[:, :, None] * scale[:, None, :])
    try:
        solved = np.linalg.solve(matrices, scaled[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        return None
    projector = -(orthogonal @ orthogonal.conj().transpose(0, 2, 1))
    each = np.arange(window.shape[1])
    projector[:, each, each] += kept
    half = len(each) // 2
    own = projector[:, half, half].real.copy()
    _add(paired, window, projector / degrees[:, None, None])
    return (scaled.conj() * solved).sum(axis=1).real, own


def _add(paired: Complexes, window: Integers, weights: Complexes) -> None:
    distance = np.arange(window.shape[1])
    across = distance[None, :] - distance[:, None] + len(distance) - 1
    flat = (window[:, :, None] * paired.shape[1] + across).ravel()
    first = int(window.min()) * paired.shape[1]
    length = (int(window.max()) + 1) * paired.shape[1] - first
    into = paired.reshape(-1)[first : first + length]
    for view, part in ((into.real, weights.real), (into.imag, weights.imag)):
        view += np.bincount(flat - first, part.ravel(), length)
