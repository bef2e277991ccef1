"""Sequential processing: rows with actuators first, then those that what is known drives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.estimate import Estimate
from rotorid.estimators.by_samples import refuse_filtered
from rotorid.estimators.family import LinearEstimator, Problem, force_variance, pose
from rotorid.estimators.regression import Regression, driven_rows
from rotorid.estimators.weighted import Block, Solution, pooled, solve
from rotorid.frozen import frozen
from rotorid.models import Model
from rotorid.observation import Data, bind_all
from rotorid.record import Booleans, Complexes, Floats, Integers
from rotorid.signals.spectrum import synthesize


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

    def estimate(self, model: Model, records: Sequence[Data]) -> Estimate:
        """Return the estimate of the base parameters.

        Raises
        ------
        InputError
            For records that do not fit the model, or knowledge that only ml can use.
        """
        bound = bind_all(model, records)
        refuse_filtered(bound, "sequential")
        problem = pose(bound, self.fixed, self.constraints)
        stages = plan_stages(problem)
        return problem.summarize("sequential", lambda part: _solve_stages(part, stages))


def plan_stages(problem: Problem) -> list[Stage]:
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
    further = left - set(rows)
    return sorted(r for r in further if structure[:, r][:, tangled].any())


def _solve_stages(problem: Problem, stages: Sequence[Stage]) -> Solution:
    """Solve stage by stage; the gains carry the error of each stage into the next."""
    names, holds = problem.names, (problem.structure != 0).any(axis=0)
    values = np.full(len(names), np.nan)
    equations = [problem.free_equations(r) for r in problem.regressions]
    gains = [np.zeros((len(names), *target.shape), dtype=complex) for _, target in equations]
    condition, directions = 1.0, np.zeros((len(names), 0))
    waiting: tuple[int, ...] = ()
    for planned in stages:
        # Rows whose unknowns the stage before left open wait for the rows of this one.
        rows = [*waiting, *planned.rows]
        own = [int(u) for u in np.flatnonzero(holds[rows].any(axis=0) & ~np.isfinite(values))]
        stage = Stage(tuple(rows), tuple(own))
        known = np.asarray(np.isfinite(values).nonzero()[0], dtype=np.int64)
        blocks = [
            Block(
                regression.record,
                design[:, rows][:, :, own],
                target[:, rows] - design[:, rows][:, :, known] @ values[known],
                _variance(problem, regression, stage, values),
            )
            for regression, (design, target) in zip(problem.regressions, equations, strict=True)
        ]
        solution = solve(blocks)
        _carry(gains, solution.gains, equations, stage, known)
        values[own] = solution.values
        condition = max(condition, solution.condition_number)
        directions = np.zeros((len(names), solution.undetermined.shape[1]))
        directions[own] = solution.undetermined
        waiting = tuple(row for row in rows if (holds[row] & np.isnan(values))[own].any())
    return Solution(values, tuple(gains), condition, directions)


def _carry(
    gains: list[Complexes],
    own: Sequence[Complexes],
    equations: Sequence[tuple[Complexes, Complexes]],
    stage: Stage,
    known: Integers,
) -> None:
    """Add a stage's gains: d theta_i = P_i (e_i - D_ij d theta_j), d theta_j as found before."""
    rows, unknowns = list(stage.rows), list(stage.unknowns)
    response = sum(
        np.einsum("fkr,krj->fj", gain, design[:, rows][:, :, known]).real
        for gain, (design, _) in zip(own, equations, strict=True)
    )
    for total, gain in zip(gains, own, strict=True):
        total[unknowns] = -np.einsum("fj,jkr->fkr", response, total[known])
        for position, row in enumerate(rows):
            total[unknowns, :, row] += gain[:, :, position]


def _variance(problem: Problem, regression: Regression, stage: Stage, values: Floats) -> Floats:
    """Return the variance over periods of a stage's right side, shape (sample, row)."""
    rows = list(stage.rows)
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
