"""What the cost should be, and how far off the estimate may be, with few periods.

C is estimated with n complex degrees of freedom, so V is too, and neither is J chi-squared nor
the inverse information the covariance. Line by line, ``e^H V^-1 e`` is Hotelling's T^2 of the
t dimensions that the parameters leave free: 2 n t / (n - t + 1) times an F variable with 2 t and
2 (n - t + 1) degrees of freedom, or half as many on a real line.

A deviation is known no better than the noise of the lines that tell its parameter. With h_k the
share of line k in its square, it has nu degrees of freedom,

    1 / nu = sum_k h_k^2 / (2 (n - t + 1))

(Satterthwaite), and the error over it is Student's t: damping, which few lines tell, left its 95 %
in 7.5 % of records of ten periods. So each is widened until 1.96 of it hold what they should. Where
one size of the noise is shared by many lines, as of whole records, nothing is widened: it is known
far better than by one line, and the weights hold what it adds.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotorid.distributions import t_limit
from rotorid.estimators.expectation import Expectation, line_moments
from rotorid.estimators.likelihood.cost import Evaluation
from rotorid.estimators.likelihood.problem import Point
from rotorid.estimators.likelihood.relations import Relations
from rotorid.estimators.likelihood.tangent import RANK, relation_jacobian, tangent_basis
from rotorid.frozen import frozen
from rotorid.linalg import whole_svd
from rotorid.record import Floats

IDLE = 1e-6
"""Deviations by which the residual moves with a parameter's whole value: fewer are rounding."""
ROUNDING = 1e-12
"""The same as a share of the largest such effect."""
TAIL, NORMAL = 0.025, 1.959964
"""Chance beyond either end of an interval, and the deviations to there of a normal distribution."""


def shared_variance(mean: Floats, left: Floats, at: Evaluation) -> Floats:
    """Return the variance of the costs of lines that share an estimate of C, of n degrees.

    Its error is common to them: ``tr(C_est^-1 C)`` scatters by ``1 / sqrt(n e)``, e the equations,
    and the sum of their costs with it; beside that each line is chi-squared.
    """
    noise = at.problem.noise
    alone = 2 * mean**2 / np.maximum(left, 1e-300)
    common = noise.shared * mean**2 / (noise.dof * at.problem.equations)
    return np.where(left > 0, alone + common, 0.0)


def effective_dof(at: Evaluation) -> Floats:
    """Return the degrees of freedom with which V is known on each line, shape (line,).

    Where C was mixed with its diagonal, ``(1 - a) C + a diag(C)``, more than C itself has: a
    quadratic form of V has the relative variance ``((1 - a)^2 + (1 - (1 - a)^2) kappa) / n``, kappa
    the sum of the squared shares of the channels in it, averaged over all forms.
    """
    noise, count = at.problem.noise, at.problem.equations
    if noise.shrunk == 0:
        return np.full(at.problem.lines, noise.dof)
    share = at.channel_shares()
    kappa = 2 * (share**2).sum(axis=1) / (count * (count + 1))
    kept = (1 - noise.shrunk) ** 2
    return np.asarray(np.maximum(noise.dof / (kept + (1 - kept) * kappa), count + 2.0))


@frozen
class Inference:
    """Covariance of the free unknowns and expectation of the cost.

    Parameters
    ----------
    covariance : array, shape (free, free)
        Along the directions that the record determines.
    null : array, shape (free, direction)
        Orthonormal in scaled unknowns: what it does not determine.
    scale : array, shape (free,)
        The scale of the unknowns there.
    expectation : Expectation
    condition_number : float
        Of the scaled Jacobian, over the determined directions.
    line_means : sequence of array, shape (line,)
        Expected cost of each line of each record.
    variances, left : sequence of float
        Variance of the cost of each record, and the real equations that parameters leave to it.
    """

    covariance: Floats
    null: Floats
    scale: Floats
    expectation: Expectation
    condition_number: float
    line_means: tuple[Floats, ...]
    variances: tuple[float, ...] = ()
    left: tuple[float, ...] = ()

    @property
    def undetermined(self) -> NDArray[np.bool_]:
        """Which free unknowns the records do not determine, shape (free,)."""
        return np.asarray((np.abs(self.null) > 1e-6).any(axis=1))


def _line_sums(point: Point, per_row: Floats) -> list[Floats]:
    """Sum real rows line by line; the last entry holds the relations, unsummed."""
    sums, first = [], 0
    for likelihood in point.problem.likelihoods:
        size = likelihood.lines * 2 * likelihood.equations
        sums.append(per_row[first : first + size].reshape(likelihood.lines, -1).sum(axis=1))
        first += size
    return [*sums, per_row[first:]]


def along_relations(point: Point, exact: Relations) -> tuple[Floats, Floats, Floats]:
    """Return the scaled Jacobian along the exact relations, the scale and the basis.

    A column that is rounding is zero: scaled to length one, it would count as information. What
    shifts (a phase, a delay) may well be zero itself; its column counts all the same.
    """
    layout = point.problem.layout
    free = layout.free
    shifting = np.array([layout.unknowns[i].additive for i in free], dtype=bool)
    jacobian = point.jacobian
    with np.errstate(over="ignore"):
        size = np.sqrt((jacobian**2).sum(axis=0))
    if not np.isfinite(size).all():
        raise np.linalg.LinAlgError("a derivative beyond all bounds")
    typical = np.where(point.unknowns[free] != 0, np.abs(point.unknowns[free]), 1.0)
    effect = size * typical
    seen = (effect > IDLE) & (effect > ROUNDING * effect.max(initial=0.0))
    seen |= shifting & (size > 0)
    scale = np.where(seen, 1 / np.where(seen, size, 1.0), typical)
    jacobian = np.where(seen, jacobian, 0.0)
    basis = np.eye(len(free))
    if len(exact):
        basis = tangent_basis(relation_jacobian(exact, point) * scale)
    return jacobian * scale @ basis, scale, basis


def _of_ends(point: Point) -> Floats:
    """Return what the loose ends of each record take up of every real equation."""
    parts = [
        np.zeros(at.problem.lines * 2 * at.problem.equations)
        if at.ends is None
        else (at.ends.basis**2).sum(axis=1)
        for at in point.records
    ]
    return np.concatenate([*parts, np.zeros(len(point.known))])


def projected_jacobian(point: Point) -> Floats:
    """Return the scaled Jacobian of the residual, exact relations eliminated."""
    return along_relations(point, point.problem.exact)[0]


def _widening(point: Point, influence: Floats, left: list[Floats]) -> Floats:
    """Return by how much few periods widen each deviation, shape (free,).

    `influence` is what each real row does to the unknowns, shape (free, row); `left` is t.
    """
    size = (influence**2).sum(axis=1)
    power = influence**2 / np.where(size > 0, size, 1.0)[:, None]
    unsure, first = np.zeros(len(power)), 0
    for at, t in zip(point.records, left, strict=True):
        problem, noise = at.problem, at.problem.noise
        width = problem.lines * 2 * problem.equations
        parts = power[:, first : first + width].reshape(len(power), problem.lines, -1)
        first += width
        if noise.shared > 1:  # one size for all lines
            continue
        freedom = problem.multiplicity * np.maximum(effective_dof(at) - t + 1, 1.0)
        unsure += (parts.sum(axis=2) ** 2 / freedom).sum(axis=1)
    freedom = 1 / np.clip(unsure, 1e-9, 0.5)  # beyond a billion t is normal, and stdtrit imprecise
    return t_limit(TAIL, freedom) / NORMAL


@frozen
class _Expected:
    """What noise leaves of the cost, record by record: see `Inference`.

    Parameters
    ----------
    means, unused : list of array, shape (line,)
        Expected cost of each line, and t.
    variances, left : list of float
    weights : list of array
        The share of the information of each real row that few periods leave.
    """

    means: list[Floats]
    unused: list[Floats]
    variances: list[float]
    left: list[float]
    weights: list[Floats]


def _expected(point: Point, leverage: list[Floats]) -> _Expected:
    """Return what noise leaves of each record's cost; `leverage` is what the unknowns take up."""
    found = _Expected([], [], [], [], [])
    for at, taken in zip(point.records, leverage, strict=False):
        likelihood = at.problem
        c = likelihood.multiplicity
        t = likelihood.equations - taken / c
        mean, variance = line_moments(t, effective_dof(at), c)
        # What is in a line's own covariance adds its expectation and no scatter: over a window
        # the residuals make up the covariance, sum E^H C^-1 E = n, whatever they are.
        apart = likelihood.noise.apart
        found.means.append((1 - apart) * c * np.maximum(t, 0.0) + apart * mean)
        if likelihood.noise.shared > 1:
            variance = shared_variance(mean, c * np.maximum(t, 0.0), at)
        found.variances.append(apart * float(variance.sum()))
        found.left.append(float((c * np.maximum(t, 0.0)).sum()))
        ratio = np.where(t > 1e-9, c * t / np.where(t > 1e-9, mean, 1.0), 1.0)
        found.weights.append(np.repeat(ratio, 2 * likelihood.equations))
        found.unused.append(t)
    return found


def infer(point: Point, exact: Relations) -> Inference:
    """Return covariance, null space and expected cost at a minimum."""
    scaled, scale, basis = along_relations(point, exact)
    left, values, right = whole_svd(scaled)
    top = values.max(initial=0.0)
    kept = values > RANK * top
    leverage = _line_sums(point, (left[:, kept] ** 2).sum(axis=1) + _of_ends(point))
    noise, rest = _expected(point, leverage), 1 - leverage[-1]
    absorbed = sum(at.absorbed for at in point.records)
    dof = point.problem.real_equations - int(kept.sum()) - absorbed
    determined = right[kept].T
    weights = np.concatenate([*noise.weights, np.ones(len(rest))])
    along, spread, turned = np.linalg.svd(
        weights[:, None] * (scaled @ determined), full_matrices=False
    )
    with np.errstate(over="ignore", invalid="ignore"):  # far from any minimum
        open_ = basis @ determined
        root = scale[:, None] * (open_ @ turned.T) / spread
        wider = _widening(point, root @ along.T, noise.unused)[:, None] * root / scale[:, None]
        root = scale[:, None] * (open_ @ (open_.T @ wider))  # exact relations stay exact
        covariance = root @ root.T
    return Inference(
        covariance,
        basis @ right[~kept].T,
        scale,
        Expectation(
            max(float(sum(mean.sum() for mean in noise.means) + rest.sum()), 0.0),
            sum(noise.variances) + max(2 * float(rest.sum()), 0.0),
            dof,
        ),
        float(top / values[kept].min()) if kept.any() else np.inf,
        tuple(noise.means),
        tuple(noise.variances),
        tuple(noise.left),
    )
