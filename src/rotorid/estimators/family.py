"""What ls, batch and sequential share: from records to free unknowns, and back to an estimate."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace

import numpy as np

from rotorid.errors import InputError
from rotorid.estimate import Estimate
from rotorid.estimators import gate
from rotorid.estimators.knowledge import (
    Constraint,
    Elimination,
    constraints_in_si,
    eliminate,
    in_si,
)
from rotorid.estimators.regression import Regression, driven_rows
from rotorid.estimators.residual import Fitted, misfit
from rotorid.estimators.summary import describe_open_directions, summarize
from rotorid.estimators.weighted import (
    POOLING_PERIODS,
    Solution,
    pooled,
    sandwich,
    scatter_of_answers,
)
from rotorid.frozen import frozen
from rotorid.models import Model
from rotorid.models.expression import symbol
from rotorid.observation import Observation
from rotorid.record import Complexes, Floats
from rotorid.signals.checks_scatter import check_identical
from rotorid.signals.covariance import LineCovariance

LEAST_PERIODS = 4
"""Periods from which the halves of a record have a scatter of their own, for their weights."""


@frozen
class Posed:
    """A model in the unknowns that fixed values and exact constraints leave.

    Parameters
    ----------
    full : Model
        As given.
    fixed : mapping of str to float
        Substituted values.
    model : Model
        After substitution.
    elimination : Elimination
    """

    full: Model
    fixed: Mapping[str, float]
    model: Model
    elimination: Elimination

    @property
    def names(self) -> list[str]:
        """Names of the free unknowns: base parameters that no constraint eliminates."""
        return [self.model.base.names[i] for i in self.elimination.kept]

    @property
    def structure(self) -> Floats:
        """What each row holds of each unknown, shape (signal, row, unknown)."""
        return self.model.coefficients[0] @ self.elimination.basis

    @property
    def unreached(self) -> list[int]:
        """Unknowns that no chain of equations ties to a measured input or a known term.

        Their equations have zero on the right side, which any multiple of a solution solves.
        """
        holds = (self.structure != 0).any(axis=0)
        rows = set(driven_rows(self.model))
        reached = holds[sorted(rows)].any(axis=0)
        while more := {int(r) for r in np.flatnonzero(holds[:, reached].any(axis=1))} - rows:
            rows |= more
            reached = holds[sorted(rows)].any(axis=0)
        return [int(i) for i in np.flatnonzero(~reached)]

    def base(self, free: Floats) -> Floats:
        """Return the base parameters, shape (base,), NaN where a free one is."""
        known = np.isfinite(free)
        values = self.elimination.origin + self.elimination.basis[:, known] @ free[known]
        values[self.elimination.basis[:, ~known].any(axis=1)] = np.nan
        return np.asarray(values)

    def told(self, undetermined: Floats) -> list[str]:
        """Say what is wrong with the units, and what the equations leave open, with a cure."""
        unreached = [
            f"{self.names[i]} is in no row that a measured input or a known parameter drives"
            for i in self.unreached
        ]
        opened = describe_open_directions(self.names, undetermined)
        cures = ["fix one of them, excite more lines, or measure more"] if opened else []
        return [*self.full.unit_faults, *unreached, *opened, *cures]


@frozen
class Problem(Posed):
    """Regressions of all records, in the unknowns that exact constraints leave.

    Parameters
    ----------
    regressions : sequence of Regression
        With the model after substitution.
    """

    regressions: tuple[Regression, ...]

    def free_equations(self, regression: Regression) -> tuple[Complexes, Complexes]:
        """Return design (line, row, free) and target (line, row) of one record."""
        design = regression.design @ self.elimination.basis
        return design, regression.target - regression.design @ self.elimination.origin

    def halves(self) -> tuple[Problem, Problem]:
        """Return the problems of the first and of the last half of the periods of each record.

        Their answers tell a change, by how they differ; and what noise in the regressors does:
        its power in a mean of half as many periods is twice as large, and so is the bias it leaves.
        """
        middles = [r.record.periods // 2 for r in self.regressions]
        parts = [((None, middle), (middle, None)) for middle in middles]
        first, last = (
            tuple(replace(r, kept=part) for r, part in zip(self.regressions, half, strict=True))
            for half in zip(*parts, strict=True)
        )
        return replace(self, regressions=first), replace(self, regressions=last)

    def summarize(self, method: str, solve: Callable[[Problem], Solution]) -> Estimate:
        """Return the estimate that a way of solving gives, with the sandwich for its covariance."""
        solution = solve(self)
        values = solution.values.copy()
        values[self.unreached] = np.nan
        base = self.base(values)
        determined = np.where(np.isfinite(base), base, 0.0)
        scatters = [r.residual_covariance(determined) for r in self.regressions]
        spreads = [scatter.matrices for scatter in scatters]
        records = [r.record for r in self.regressions]
        if self.model.nonlinear and min(r.periods for r in records) >= POOLING_PERIODS:
            residuals = [r.period_residual(determined) for r in self.regressions]
            free = scatter_of_answers(solution.gains, residuals)
        else:
            free = sandwich(solution.gains, spreads, records)
        basis = self.elimination.basis
        estimate = summarize(
            method,
            self.full,
            self.fixed,
            self.regressions,
            base,
            basis @ free @ basis.T,
            spreads,
            solution.condition_number,
            self.told(solution.undetermined),
        )
        verdict = gate.physical(self.full, estimate)
        verdict += gate.prediction(estimate, self._noise(spreads))
        if not verdict.faults:  # one reason is enough
            verdict += gate.residual(*misfit(self._fitted(solution, determined, scatters)))
        fewest = min(r.periods for r in records)
        if fewest >= LEAST_PERIODS:
            halves = np.array([solve(half).values for half in self.halves()]) - values
            spread = np.sqrt(np.diag(free).clip(0))
            if not any(c.channel == "" for r in records for c in check_identical(r)):
                verdict += gate.noise_bias(self.names, halves.mean(axis=0), spread)
            if fewest >= 2 * LEAST_PERIODS:  # below, deviations are too rough to hold them against
                parted = self._parted(solution, determined)
                verdict += gate.agreement(self.names, parted, spread)
        return gate.passed(estimate, verdict)

    def _parted(self, solution: Solution, base: Floats) -> Floats:
        """Return by how much the answers of both halves differ from that of all, to first order.

        Of parameters that are hardly told the answers themselves differ by more than a change.
        """
        parted = np.zeros((2, len(self.names)))
        for gain, regression in zip(solution.gains, self.regressions, strict=True):
            residual = regression.period_residual(base)
            middle = len(residual) // 2
            for half, part in enumerate((residual[:middle], residual[middle:])):
                change = part.mean(axis=0) - residual.mean(axis=0)
                parted[half] -= np.einsum("fkr,kr->f", gain, change).real
        return parted

    def _fitted(
        self, solution: Solution, base: Floats, scatters: Sequence[LineCovariance]
    ) -> list[Fitted]:
        """Return the equations of every record at an answer."""
        fitted = []
        for regression, gains, scatter in zip(
            self.regressions, solution.gains, scatters, strict=True
        ):
            terms = np.abs(regression.design) @ np.abs(base) + np.abs(regression.target)
            fitted.append(
                Fitted(
                    regression.residual(base),
                    self.free_equations(regression)[0],
                    gains,
                    scatter.matrices,
                    np.sqrt((terms**2).mean(axis=0)),
                    regression.record.multiplicity,
                    scatter.dof,
                )
            )
        return fitted

    def _noise(self, spreads: Sequence[Complexes]) -> dict[str, float]:
        """Return the share of each input that the scatter of the residual explains."""
        inverse = np.linalg.pinv(self.model.input_matrix)
        noise, size = np.zeros(len(self.model.inputs)), np.zeros(len(self.model.inputs))
        for regression, spread in zip(self.regressions, spreads, strict=True):
            weight = regression.record.multiplicity
            each = np.einsum("ir,krs,is->ki", inverse, spread.real, inverse)
            noise += weight @ each
            size += weight @ np.abs(regression.inputs.mean(axis=0)) ** 2
        share = np.sqrt(noise.clip(0) / np.where(size > 0, size, 1.0))
        return dict(zip(self.model.inputs, share.tolist(), strict=True))


def pose(
    records: Sequence[Observation],
    given: Mapping[str, float | str],
    constraints: Sequence[Constraint],
) -> Problem:
    """Write the regressions of records, with what is fixed and constrained taken out."""
    posed = substitute(records, given, constraints)
    regressions = tuple(Regression(record.rebound(posed.model)) for record in records)
    return Problem(posed.full, posed.fixed, posed.model, posed.elimination, regressions)


def substitute(
    records: Sequence[Observation],
    given: Mapping[str, float | str],
    constraints: Sequence[Constraint],
) -> Posed:
    """Substitute what is fixed, and eliminate what is constrained."""
    model = records[0].model
    fixed = in_si(given, model)
    reduced = model.substitute(fixed)
    if not reduced.base.names:
        raise InputError("every parameter fixed", "something to estimate", "free one")
    turning = any(symbol("phi") in signal.free_symbols for signal in reduced.signals)
    for record in records:
        if record.own:
            raise InputError(
                f"{', '.join(record.own)}, which differ between records",
                "the same parameters in every record",
                "use ml",
                file=record.lines.source,
                place="parameters",
            )
        if turning and not record.lines.phase_known:
            raise InputError(
                "a rotor angle of unknown phase",
                "a known phase",
                "use ml",
                file=record.lines.source,
            )
    elimination = eliminate(reduced, constraints_in_si(constraints, model), fixed)
    if not elimination.kept:
        raise InputError("every parameter constrained", "something to estimate", "free one")
    return Posed(model, dict(fixed), reduced, elimination)


def force_variance(regression: Regression) -> Floats:
    """Return the variance of each row's force at each sample, shape (sample, row).

    The inputs count as uncorrelated, as in the paper's (9).
    """
    record, model = regression.record, regression.model
    channels = list(regression.observation.input_columns)
    power = (record.mean[:, channels] ** 2).mean(axis=0)
    variance = pooled(record.variance[:, channels], power, record.periods)
    return np.asarray(variance @ (model.input_matrix.T**2))


@frozen
class LinearEstimator:
    """What every estimator of the family takes.

    Parameters
    ----------
    fixed : mapping of str to float or str
        Physical parameters (SI, or texts with units) that are substituted.
    constraints : sequence of Constraint
        Exact ones, linear in the base parameters.
    """

    fixed: Mapping[str, float | str] = field(default_factory=dict, kw_only=True)
    constraints: tuple[Constraint, ...] = field(default=(), kw_only=True)
