"""Least squares, batch and sequential: three weightings of one solve."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from typing import ClassVar

import numpy as np

from rotorid.answer.estimate import Estimate
from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.values import Booleans, Floats
from rotorid.data.observation import Data, Observation, bind_all
from rotorid.linear.by_samples import SampledProblem, filtered_records, refuse_filtered
from rotorid.linear.family import LeastSquaresProblem, force_variance
from rotorid.linear.regression import Regression, driven_rows
from rotorid.linear.solve import Block, LeastSquaresSolution, pooled, solve
from rotorid.models import Model
from rotorid.models.constraints import Constraint
from rotorid.signals.spectrum import synthesize


@frozen
class LinearEstimator:
    method: ClassVar[str]
    # physical parameters (SI, or texts with units) that are substituted
    fixed: Mapping[str, float | str] = field(default_factory=dict, kw_only=True)
    # exact ones, linear in the base parameters
    constraints: tuple[Constraint, ...] = field(default=(), kw_only=True)

    def estimate(self, model: Model, records: Sequence[Data]) -> Estimate:
        """Return the estimate of the base parameters.

        Raises
        ------
        InputError
            For records that do not fit the model, or knowledge that only ml can use.
        """
        bound = bind_all(model, records)
        if filtered_records(bound):
            weight = self._weight_of_samples(bound)
            sampled = SampledProblem.of(bound, self.fixed, self.constraints)
            return replace(sampled, weight=weight).summarize(self.method)
        problem = LeastSquaresProblem.of(bound, self.fixed, self.constraints)
        return problem.summarize(self.method, self._solved)

    def _weight_of_samples(self, records: Sequence[Observation]) -> float | None:
        """Return the weight of rows without input; without one all rows count alike."""
        return None

    def _solved(self, problem: LeastSquaresProblem) -> LeastSquaresSolution:
        return solve(
            [
                Block(*problem.free_equations(r), self._variance(r), r.record)
                for r in problem.regressions
            ]
        )

    def _variance(self, regression: Regression) -> Floats:
        return np.ones(regression.rows)


@frozen
class LeastSquares(LinearEstimator):
    """``min |F theta - b|^2`` over all rows and samples alike.

    The derivatives in F are taken as free of noise. They are not: noise in the regressors
    attenuates the estimates, most in rows whose right side is zero, and on the paper's rotor this
    bias is nearly all of the error. The stated deviations cover the scatter, not the bias.

    Parameters
    ----------
    fixed : mapping of str to float
        Physical parameters (SI) that are substituted.
    constraints : sequence of Constraint
        Exact ones, linear in the base parameters.

    References
    ----------
    Levy and Arogeti, equations (2) and (3).

    Examples
    --------
    >>> LeastSquares(fixed={"L1": 0.3}).fixed
    {'L1': 0.3}
    """

    method = "ls"


@frozen
class Batch(LinearEstimator):
    """``min (F theta - b)' Sigma^-1 (F theta - b)``, Sigma diagonal, all rows at once.

    A row with a measured force has that force's variance at each sample; a row without has
    `free_weight` times the largest of them. The paper calls the free weight k and alpha. A large
    one takes bias away and adds variance.

    Parameters
    ----------
    free_weight : float
    fixed : mapping of str to float
        Physical parameters (SI) that are substituted.
    constraints : sequence of Constraint
        Exact ones, linear in the base parameters.

    References
    ----------
    Levy and Arogeti, equations (3), (4), (8) and (9). What (9) calls sigma is a variance.

    Examples
    --------
    >>> Batch(free_weight=10.0).free_weight
    10.0
    """

    method = "batch"
    free_weight: float = 100.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.free_weight) and self.free_weight > 0):
            raise InputError(
                f"free_weight {self.free_weight}",
                "a positive number",
                "take 100, as the paper does",
            )

    def _weight_of_samples(self, records: Sequence[Observation]) -> float:
        return self.free_weight

    def solve(
        self, model: Model, records: Sequence[Data]
    ) -> tuple[LeastSquaresProblem, LeastSquaresSolution]:
        """Return the regression and its solution, without statistics.

        Raises
        ------
        InputError
            As `estimate`.
        """
        problem = LeastSquaresProblem.of(bind_all(model, records), self.fixed, self.constraints)
        return problem, self._solved(problem)

    def _variance(self, regression: Regression) -> Floats:
        variance = force_variance(regression)
        largest = variance.max(axis=1, keepdims=True)
        free = ~regression.model.input_matrix.any(axis=1)
        return np.where(free, self.free_weight * np.where(largest > 0, largest, 1.0), variance)


@frozen
class Stage:
    """Rows that are solved together, and the unknowns that they determine."""

    rows: tuple[int, ...]
    unknowns: tuple[int, ...]


@frozen
class Sequential(LinearEstimator):
    """Weighted least squares in stages, no weight to choose.

    The first stage takes the rows with a measured input, ``D_1 theta_1 = b_1``; each later one the
    rows that share parameters with what is known, ``D_i theta_i = b_i - D_ij theta_j``, the right
    side being forces that the shaft transmits. Each stage is weighted by the variance over
    periods of its right side at each sample.

    Parameters
    ----------
    fixed : mapping of str to float
        Physical parameters (SI) that are substituted.
    constraints : sequence of Constraint
        Exact ones, linear in the base parameters.

    Notes
    -----
    The paper's (5) and (6) lack an inverse; its (10) has x2'' where x3'' belongs, its (11) I_p in
    the column of I_p. The stages here are derived from the model, whatever it is.

    References
    ----------
    Levy and Arogeti, equations (5), (6), (10) and (11).

    Examples
    --------
    >>> Sequential().fixed
    {}
    """

    method = "sequential"

    def _weight_of_samples(self, records: Sequence[Observation]) -> None:
        refuse_filtered(records, self.method)

    def _solved(self, problem: LeastSquaresProblem) -> LeastSquaresSolution:
        return _solve_stages(problem, plan_stages(problem))


def plan_stages(problem: LeastSquaresProblem) -> list[Stage]:
    """Derive the stages from which row holds which unknown.

    A stage whose rows cannot tell its unknowns apart takes in further rows that hold them.
    """
    first = problem.regressions[0]
    structure = problem.structure
    holds: Booleans = np.asarray((structure != 0).any(axis=0))  # (row, unknown)
    known: Booleans = np.zeros(holds.shape[1], dtype=bool)
    rows, left = driven_rows(problem.model), set(range(first.rows))
    stages = []
    while rows:
        unknowns = holds[rows].any(axis=0) & ~known
        while unknowns.any() and (more := _rows_that_help(structure, rows, unknowns, left)):
            rows = sorted({*rows, *more})
            unknowns = holds[rows].any(axis=0) & ~known
        if unknowns.any():
            stages.append(Stage(tuple(rows), tuple(int(u) for u in np.flatnonzero(unknowns))))
        left -= set(rows)
        known |= unknowns
        rows = sorted(r for r in left if (holds[r] & known).any())
    return stages


def _rows_that_help(
    structure: Floats, rows: Sequence[int], unknowns: Booleans, left: set[int]
) -> list[int]:
    """Return further rows with unknowns that the columns of these rows do not tell apart."""
    columns = structure[:, list(rows)][:, :, unknowns].reshape(-1, int(unknowns.sum()))
    _, singular, directions = np.linalg.svd(columns)
    rank = int((singular > 1e-12 * singular.max(initial=0.0)).sum())
    tangled = np.flatnonzero(unknowns)[(np.abs(directions[rank:]) > 1e-9).any(axis=0)]
    return sorted(r for r in left - set(rows) if structure[:, r][:, tangled].any())


def _solve_stages(problem: LeastSquaresProblem, stages: Sequence[Stage]) -> LeastSquaresSolution:
    """Solve stage by stage; the gains carry the error of each stage into the next."""
    count, holds = len(problem.names), (problem.structure != 0).any(axis=0)
    values = np.full(count, np.nan)
    equations = [problem.free_equations(r) for r in problem.regressions]
    gains = [np.zeros((count, *target.shape), dtype=complex) for _, target in equations]
    condition, directions = 1.0, np.zeros((count, 0))
    waiting: tuple[int, ...] = ()
    for planned in stages:
        # Rows whose unknowns the stage before left open wait for the rows of this one.
        rows = [*waiting, *planned.rows]
        own = np.flatnonzero(holds[rows].any(axis=0) & ~np.isfinite(values))
        known = np.flatnonzero(np.isfinite(values))
        designs = [design[:, rows] for design, _ in equations]
        blocks = [
            Block(
                design[:, :, own],
                target[:, rows] - design[:, :, known] @ values[known],
                _variance(problem, regression, rows, values),
                regression.record,
            )
            for regression, design, (_, target) in zip(
                problem.regressions, designs, equations, strict=True
            )
        ]
        solution = solve(blocks)
        # d theta_i = P_i (e_i - D_ij d theta_j), d theta_j as found before.
        response = sum(
            np.einsum("fkr,krj->fj", gain, design[:, :, known]).real
            for gain, design in zip(solution.gains, designs, strict=True)
        )
        for total, gain in zip(gains, solution.gains, strict=True):
            total[own] = -np.einsum("fj,jkr->fkr", response, total[known])
            total[np.ix_(own, np.arange(total.shape[1]), np.array(rows))] += gain
        values[own] = solution.values
        condition = max(condition, solution.condition_number)
        directions = np.zeros((count, solution.undetermined.shape[1]))
        directions[own] = solution.undetermined
        waiting = tuple(row for row in rows if (holds[row] & np.isnan(values))[own].any())
    return LeastSquaresSolution(values, tuple(gains), condition, directions)


def _variance(
    problem: LeastSquaresProblem, regression: Regression, rows: list[int], values: Floats
) -> Floats:
    """Return the variance over periods of a stage's right side, shape (sample, row)."""
    forced = (regression.model.input_matrix != 0).any(axis=1)[rows]
    variance = force_variance(regression)[:, rows]
    if forced.all():
        return variance
    base = problem.base(np.where(np.isfinite(values), values, 0.0))
    record = regression.record
    right = synthesize(
        -regression.period_residual(base)[..., rows], record.harmonics, record.samples
    )
    power = (right.mean(axis=0) ** 2).mean(axis=0)
    transmitted = pooled(right.var(axis=0, ddof=1), power, record.periods)
    return np.where(forced, variance, transmitted)
