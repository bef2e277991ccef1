"""Covariance, null space and expected cost at a minimum.

How few periods widen deviations, what noise leaves of J, and how sensors share their noise stands
in docs/maximum-likelihood.md, sections 2 and 5. Where one size of the noise is shared by many
lines, as of whole records, nothing is widened: it is known far better than by one line, and the
weights hold what it adds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from rotorid.core.distributions import Expectation, line_moments
from rotorid.core.linalg import leave_out
from rotorid.core.values import Complexes, Floats, Integers, frozen
from rotorid.data.lines import Beside
from rotorid.data.observation import Observation, Records
from rotorid.likelihood.cost import Evaluation
from rotorid.likelihood.linear import Linearized
from rotorid.likelihood.problem import Point
from rotorid.signals.covariance import lag_one_correlation
from rotorid.signals.local_polynomial import LEAST, PER_CHANNEL

TAIL, NORMAL = 0.025, 1.959964
"""Chance beyond either end of an interval, and the deviations to there of a normal distribution."""
SUSPICIOUS = 1e-6  # below this p-value a minimum may be a local one
LEAST_DOF = 3.0
"""Degrees of freedom of a line's noise to which fewer are counted up: with two, E w^2 of weights is
infinite, and 25 lines scatter by as much as with three."""


def shared_variance(mean: Floats, left: Floats, at: Evaluation) -> Floats:
    """Return the variance of the costs of lines that share an estimate of C (section 12)."""
    noise = at.problem.noise
    alone = 2 * mean**2 / np.maximum(left, 1e-300)
    common = noise.shared * mean**2 / (noise.dof * at.problem.equations)
    return np.where(left > 0, alone + common, 0.0)


def effective_dof(at: Evaluation) -> Floats:
    """Return the degrees of freedom with which V is known on each line, shape (line,).

    Where C was mixed with its diagonal, ``(1 - a) C + a diag(C)``, more than C itself has. With
    V = V_0 + D the mean of ``V_0 V^-1`` is ``1 + D V_0^-1 D V_0^-1``, of trace ``e^2 / n`` where C
    is whole, and ``sum s_i^2 / n`` where it is diagonal, s_i the shares of the channels in V_0:
    the off-diagonal of C, times 1 - a, has ``(1 - a)^2`` of the former and leaves the rest of the
    latter. Shares are of sum e here; those of a C that is not whole come to more.
    """
    noise, count = at.problem.noise, at.problem.equations
    if noise.shrunk == 0:
        return np.full(at.problem.lines, noise.dof)
    share = at.channel_shares()
    kappa = (share**2).sum(axis=1) / share.sum(axis=1) ** 2
    kept = (1 - noise.shrunk) ** 2
    return np.asarray(np.maximum(noise.dof / (kept + (1 - kept) * kappa), count + 2.0))


@frozen
class RecordCost:
    means: Floats  # (line,): expected cost of each line
    variance: float
    unused: Floats  # (line,): t
    left: float  # real equations that parameters leave to it
    weights: Floats  # (row,): the share of the information of each that few periods leave


@frozen
class Inference:
    covariance: Floats  # (free, free): along the directions that the record determines
    linear: Linearized  # the problem there, with what it does not determine
    cost: float
    expectation: Expectation  # of the cost
    records: tuple[RecordCost, ...]
    bend: Floats  # (free,): by how much a bent valley has widened deviations

    @property
    def p_value(self) -> float:
        return self.expectation.p_value(self.cost)

    @property
    def explained(self) -> bool:
        return self.p_value >= SUSPICIOUS

    @property
    def std(self) -> Floats:
        return np.asarray(np.sqrt(np.diag(self.covariance).clip(0)))


def weights_of_rows(point: Point, costs: Sequence[RecordCost]) -> Floats:
    """Return the share of the information of each row that few periods leave, (row,)."""
    return np.concatenate([*(cost.weights for cost in costs), np.ones(len(point.known))])


def freedom(point: Point, costs: Sequence[RecordCost], shares: Floats) -> Floats:
    """Return by how many degrees of freedom the variance of sums of rows is known.

    `shares` of the rows in each, (row, sum): that of a line is known by its periods.
    """
    unsure = np.zeros(shares.shape[1])
    for at, rows, cost in zip(point.records, point.by_line(shares), costs, strict=True):
        if at.problem.noise.shared > 1:  # one size for all lines
            continue
        degrees = at.problem.multiplicity * np.maximum(effective_dof(at) - cost.unused + 1, 1.0)
        unsure += (rows.sum(axis=1) ** 2 / degrees[:, None]).sum(axis=0)
    return 1 / np.clip(unsure, 1e-9, 0.5)  # beyond a billion t is normal, and stdtrit imprecise


def _expected(at: Evaluation, leverage: Floats) -> RecordCost:
    """Return what noise leaves of a record's cost; `leverage` (line, row of a line)."""
    likelihood, taken = at.problem, leverage.sum(axis=1)
    if at.ends is not None:
        taken = taken + (at.ends.basis**2).reshape(len(taken), -1).sum(axis=1)
    c = likelihood.multiplicity
    t = likelihood.equations - taken / c
    left = c * np.maximum(t, 0.0)
    mean, variance = line_moments(t, effective_dof(at), c)
    # What is in a line's own covariance adds its expectation and no scatter: over a window
    # the residuals make up the covariance, sum E^H C^-1 E = n, whatever they are.
    apart = likelihood.noise.apart
    means = (1 - apart) * left + apart * mean
    if likelihood.noise.shared > 1:
        variance = shared_variance(mean, left, at)
    ratio = np.where(t > 1e-9, c * t / np.where(t > 1e-9, mean, 1.0), 1.0)
    if likelihood.noise.shrunk == 0:
        # Weights that scatter lose information: inverses w of sizes of q degrees of freedom have
        # E w^2 / (E w)^2 = (q - 1) / (q - 2), of which the mean tells q / (q - 1).
        q = np.maximum(likelihood.noise.dof - t + 1, LEAST_DOF)
        ratio = ratio * np.sqrt(1 - 1 / (q - 1) ** 2)
    weights = np.repeat(ratio, 2 * likelihood.equations)
    return RecordCost(means, apart * float(variance.sum()), t, float(left.sum()), weights)


def infer(point: Point) -> Inference:
    linear = point.linear
    costs = tuple(map(_expected, point.records, point.by_line(linear.leverage)))
    rest = 1 - point.of_known(linear.leverage)
    absorbed = sum(at.ends.basis.shape[1] for at in point.records if at.ends is not None)
    dof = point.problem.real_equations - linear.rank - absorbed
    weighted = linear.determined.weighted(weights_of_rows(point, costs))
    degrees = freedom(point, costs, weighted.told_by().T)
    widening = -scipy.special.stdtrit(degrees, TAIL) / NORMAL
    with np.errstate(over="ignore", invalid="ignore"):  # far from any minimum
        wider = widening[:, None] * weighted.root
        along = weighted.directions
        root = linear.scale[:, None] * (along @ (along.T @ (wider / linear.scale[:, None])))
        covariance = root @ root.T  # exact relations stay exact
    mean = float(sum(cost.means.sum() for cost in costs) + rest.sum())
    variance = sum(cost.variance for cost in costs) + max(2 * float(rest.sum()), 0.0)
    expectation = Expectation(max(mean, 0.0), variance, dof)
    return Inference(covariance, linear, point.cost, expectation, costs, np.ones(len(covariance)))


ALIKE = 0.2
"""Correlation of the residuals of neighbouring lines from which they are not independent: those of
a Hann window have .44, independent ones .1 at most where there are a hundred."""
ENOUGH = 50  # lines below which chance makes neighbours as alike
HANN = (4 / 9, 1 / 36)
"""Correlations of responses through a Hann window with the next line and the second next: squares
of those of a spectrum."""


def likeness(at: Evaluation, record: Observation) -> float:
    """Return the correlation of the residuals of neighbouring lines of a response, 0 by chance."""
    if record.lines.analyser is None or len(at.whitened) < ENOUGH:
        return 0.0
    found = lag_one_correlation(at.whitened[:, :, None])
    return found if found >= ALIKE else 0.0


def in_common(point: Point, inference: Inference, records: Records) -> Inference:
    """Add to covariance and spread of the misfit what responses have in common.

    Lines that a Hann window made their noise, pooled ones a size that is not their own.
    """
    linear, added = point.linear, np.zeros((point.linear.rank,) * 2)
    variance = inference.expectation.variance
    every = zip(point.records, records, point.by_line(linear.range), inference.records, strict=True)
    for at, record, told, cost in every:
        times, made = 1.0, record.lines.analyser
        if made is not None and made.averages is not None:
            # 1 / power of the force, in all sensors of a line: of relative variance 1 / (n - 2),
            # but for the part that the line's own size makes of the pooled one
            own = (made.averages - 1) / at.problem.noise.dof
            times += (1 - own) ** 2 * (at.problem.equations + 1) / max(made.averages - 2, 1)
        alike = likeness(at, record) > 0
        variance += cost.variance * (times * (1 + 2 * alike * float(np.square(HANN).sum())) - 1)
        if not alike:
            continue
        real, imaginary = np.split(told, 2, axis=1)
        noise = at.whitened_columns() @ at.problem.noise.factor
        along = noise.conj().swapaxes(1, 2) @ (real + 1j * imaginary)
        for lag, correlation in enumerate(HANN, start=1):
            both = np.einsum("kcf,kcg->fg", along[:-lag].conj(), along[lag:]).real
            added += correlation * (both + both.T)
    more = linear.root @ added @ linear.root.T
    expectation = replace(inference.expectation, variance=variance)
    covariance = inference.covariance + more
    return replace(inference, covariance=covariance, expectation=expectation)


APART = frozenset({"stated", "coherence"})  # covariances that hold no cross terms between channels
CHANCE = 1e-6  # chance of correlations of independent residuals below which sensors share noise
ALONE = 0.05  # what other lines must tell of every direction beside one line, for it to be left out
TINY = np.finfo(float).tiny
FEWEST = 12  # lines below which their scatter tells deviations no better than to a third


@frozen
class SharedNoise:
    covariance: Floats  # (free, free)
    factor: float  # by which it widens the deviation that it widens most
    names: tuple[str, ...]  # the sensors that share it


def shared_noise(point: Point, inference: Inference, records: Records) -> SharedNoise | None:
    """Return the covariance that the scatter of the lines shows; None where it shows no more.

    Only lines of records whose noise was stated channel by channel count so; that of other records,
    and of what is known beforehand, stays what it is.
    """
    apart = [r.lines.covariance.kind in APART and len(r.sensors) > 1 for r in records]
    if not any(apart) or inference.linear.null.shape[1]:
        return None
    every = zip(records, point.records, apart, strict=True)
    if not any(each and _sensors_alike(record, at) for record, at, each in every):
        return None
    scores, shares, certain = _by_line(point, apart)
    free, count = len(certain), len(scores)
    if not free or count < max(FEWEST, free + 2):
        return None
    # of the unknowns in units of their deviations: unit covariance
    parts = [leave_out(*each, ALONE) for each in zip(shares, scores, strict=True)]
    if any(untold.size for _, untold in parts):
        return None
    alone = np.array([change for change, _ in parts])
    sizes, along = np.linalg.eigh(alone.T @ alone + certain)
    root = point.linear.root @ along * np.sqrt(np.maximum(sizes, 1.0))
    covariance = root @ root.T
    before = np.diag(inference.covariance)
    widened = np.diag(covariance)[before > 0] / before[before > 0]
    factor = float(np.sqrt(widened.max(initial=1.0)))
    told = [r for r, each in zip(records, apart, strict=True) if each]
    names = tuple(dict.fromkeys(s.channel.name for r in told for s in r.sensors))
    return SharedNoise(covariance, factor, names)


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
    left = (at.problem.data - at.corrected()[0])[:, [at.problem.order.index(c) for c in sensors]]
    left = left / np.sqrt(variance)
    turned = left * np.where(data == 0, 1.0, data.conj() / np.maximum(np.abs(data), TINY))
    pairs = len(sensors) * (len(sensors) - 1) / 2
    for each in (left, turned):
        each = each / np.sqrt((np.abs(each) ** 2).mean(axis=0)).clip(TINY)
        common = np.abs(each.T @ each.conj()) ** 2 / len(each)
        if scipy.special.gammaincc(pairs, np.triu(common, 1).sum()) < CHANCE:
            return True
    return False


def _by_line(point: Point, apart: Sequence[bool]) -> tuple[Floats, Floats, Floats]:
    """Return scores (line, free), shares of the information (line, free, free), and the rest's.

    Of the lines whose noise was stated by channels; the last is what all other rows tell.
    """
    told = point.linear.range
    known = point.of_known(told)
    scores, shares, certain = [], [], known.T @ known
    residuals = point.by_line(point.residual)
    for rows, residual, each in zip(point.by_line(told), residuals, apart, strict=True):
        share = np.einsum("krf,krg->kfg", rows, rows)
        if each:
            scores.append(np.einsum("kr,krf->kf", residual, rows))
            shares.append(share)
        else:
            certain += share.sum(axis=0)
    return np.concatenate(scores), np.concatenate(shares), certain


SLIGHT = 0.1
"""Share by which an expectation moves at most: noise bends by a few percent. More is motion in C,
which makes deviations too wide, or wrong equations: the cost is then held against C as it is."""
FEW = 400  # lines that tell the noise of the channels
ROUNDS = 10  # rounds in which it is told: of .31 % by which K was low 3 leave .14, 10 .10, 30 .09
CHUNK = 256  # windows at a time, so that memory stays that of the lines


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
