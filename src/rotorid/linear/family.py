"""What least squares, batch and sequential share: substitution, elimination, summary."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace

import numpy as np

from rotorid.answer import machine_checks as gate
from rotorid.answer.derived import physical_from_base
from rotorid.answer.estimate import Estimate
from rotorid.answer.judge import OPEN, judge
from rotorid.answer.parts import Prediction, Value
from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.notes import Note, remarks
from rotorid.core.values import Booleans, Complexes, Floats
from rotorid.data.observation import Data, Observation, bind
from rotorid.linear.equations import Regression, by_regression, driven_rows, relative_errors
from rotorid.linear.solve import (
    POOLING_PERIODS,
    Block,
    Fitted,
    Solution,
    misfit,
    pooled,
    sandwich,
    scatter_of_answers,
)
from rotorid.models import Model
from rotorid.models.priors import Constraint, Elimination, constraints_in_si, eliminate, in_si
from rotorid.models.text import symbol
from rotorid.signals.checks.periods import check_identical
from rotorid.signals.covariance import LineCovariance


def summarize(
    method: str,
    full: Model,
    fixed: Mapping[str, float],
    regressions: Sequence[Regression],
    base: Floats,
    covariance: Floats,
    spreads: Sequence[Complexes],
    condition_number: float,
    notes: Sequence[Note],
) -> Estimate:
    """Return the `Estimate` of base parameters and their covariance, from regressions on lines."""
    model = regressions[0].model
    records = [r.record for r in regressions]
    known = np.where(np.isfinite(base), base, 0.0)
    findings = Findings(
        base=base,
        covariance=covariance,
        inflation=_inflation(regressions, base, spreads),
        prediction=relative_errors([by_regression(r, known) for r in regressions]),
        condition_number=condition_number,
        notes=(*remarks("record", (w for r in records for w in r.warnings)), *notes),
        lines_hz=tuple(sorted({float(f) for r in records for f in r.frequency})),
        periods=min(r.periods for r in records),
    )
    return result(method, full, fixed, model, findings)


@frozen
class Findings:
    """What a regression found, as an `Estimate` states it."""

    base: Floats  # (base,)
    covariance: Floats  # (base, base)
    inflation: float  # of the deviations, where all of the misfit is taken for noise
    prediction: dict[str, Prediction | None]
    condition_number: float
    notes: tuple[Note, ...]
    lines_hz: tuple[float, ...] = ()
    periods: int = 1
    # bool array, shape (base,): parameters of which no deviation can be stated
    unknown_spread: Booleans | None = None


def result(
    method: str, full: Model, fixed: Mapping[str, float], model: Model, findings: Findings
) -> Estimate:
    """Return the `Estimate` of base parameters, with the physical ones that follow."""
    base, covariance = findings.base, findings.covariance
    determined = np.isfinite(base)
    std = np.where(determined, np.sqrt(np.diag(covariance).clip(0)), np.nan)
    found = zip(
        model.base.names, model.base.units, base, std, std * findings.inflation, strict=True
    )
    parameters = [
        Value(name, unit, float(value), float(s), float(i)) for name, unit, value, s, i in found
    ]
    if findings.unknown_spread is not None:
        parameters = [
            replace(p, std=None, std_inflated=None) if unknown else p
            for p, unknown in zip(parameters, findings.unknown_spread, strict=True)
        ]
    units = {p.name: p.unit for p in full.parameters}
    held = [Value(name, units[name], value, 0.0, 0.0, True) for name, value in fixed.items()]
    number = findings.condition_number
    return Estimate(
        model=full.name,
        method=method,
        status=judge(findings.notes),
        parameters=(*parameters, *held),
        derived=physical_from_base(model, base, covariance),
        covariance=covariance,
        prediction=findings.prediction,
        lines_hz=findings.lines_hz,
        periods=findings.periods,
        notes=findings.notes,
        condition_number=number if np.isfinite(number) else None,
    )


def _inflation(
    regressions: Sequence[Regression], base: Floats, spreads: Sequence[Complexes]
) -> float:
    """Return by how much the residual exceeds its scatter over periods, at least 1.

    Each row counts alike. What the periods repeat, a misfit of the model or a bias, is in the
    residual and not in the scatter.
    """
    if not np.isfinite(base).all():
        return 1.0
    misfit, noise, equations = 0.0, 0.0, 0.0
    for regression, spread in zip(regressions, spreads, strict=True):
        weight = regression.record.multiplicity
        residual = weight @ np.abs(regression.residual(base)) ** 2
        expected = weight @ np.diagonal(spread.real, axis1=1, axis2=2)
        noisy = expected > 1e-20 * (weight @ np.abs(regression.target) ** 2).max()
        misfit += float((residual[noisy] / expected[noisy]).sum())
        noise += float(noisy.sum())
        equations += float(weight.sum() * noisy.sum())
    if equations <= len(base):
        return 1.0
    return float(np.sqrt(max(1.0, misfit / noise / (1 - len(base) / equations))))


def open_directions(names: Sequence[str], directions: Floats) -> list[Note]:
    """Say which combinations are left open."""
    found = []
    for direction in directions.T:
        large = np.flatnonzero(np.abs(direction) > 1e-3 * np.abs(direction).max())
        members = tuple(names[int(i)] for i in large)
        what = "are determined only together" if len(large) > 1 else "is not determined"
        found.append(Note(OPEN, "open", f"{', '.join(members)} {what}", on=members))
    return found


LEAST_PERIODS = 4
"""Periods from which the halves of a record have a scatter of their own, for their weights."""


@frozen
class Posed:
    """A model in the unknowns that fixed values and exact constraints leave."""

    full: Model  # as given
    fixed: Mapping[str, float]  # substituted values
    model: Model  # after substitution
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

    def told(self, undetermined: Floats) -> list[Note]:
        """Say what is wrong with the units, and what the equations leave open, with a cure."""
        unreached = [
            Note(
                OPEN,
                "open",
                f"{self.names[i]} is in no row that a measured input or a known parameter drives",
                on=(self.names[i],),
            )
            for i in self.unreached
        ]
        opened = open_directions(self.names, undetermined)
        units = [Note("units", "doubts", fault) for fault in self.full.unit_faults]
        cure = Note(OPEN, "open", cure="fix one of them, excite more lines, or measure more")
        return [*units, *unreached, *opened, *([cure] if opened else [])]


@frozen
class Problem(Posed):
    """Regressions of all records, in the unknowns that exact constraints leave."""

    regressions: tuple[Regression, ...]  # with the model after substitution

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
        notes = gate.physical(self.full, estimate)
        notes += gate.prediction(estimate, self._noise(spreads))
        if judge(notes) == "ok":  # one reason is enough
            notes += gate.residual(*misfit(self._fitted(solution, determined, scatters)))
        fewest = min(r.periods for r in records)
        if fewest >= LEAST_PERIODS:
            halves = np.array([solve(half).values for half in self.halves()]) - values
            spread = np.sqrt(np.diag(free).clip(0))
            if not any(not c.on for r in records for c in check_identical(r)):
                notes += gate.noise_bias(self.names, halves.mean(axis=0), spread)
            if fewest >= 2 * LEAST_PERIODS:  # below, deviations are too rough to hold them against
                parted = self._parted(solution, determined)
                notes += gate.agreement(self.names, parted, spread)
        return estimate.with_notes(*notes)

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
    """What every estimator of the family takes."""

    # physical parameters (SI, or texts with units) that are substituted
    fixed: Mapping[str, float | str] = field(default_factory=dict, kw_only=True)
    # exact ones, linear in the base parameters
    constraints: tuple[Constraint, ...] = field(default=(), kw_only=True)


@frozen
class Information:
    """Information of the rows with a measured force."""

    names: tuple[str, ...]  # base parameters
    # (base, base): ``F' Sigma^-1 F``, Sigma the variance of the mean force at each sample
    matrix: Floats
    # of F, as the paper's robots have it: neither rows nor columns are scaled
    condition_number: float
    # of F with its columns scaled to length one; it does not change with the units
    scaled_condition_number: float


def information_of(model: Model, estimate: Estimate, record: Data) -> Information | None:
    """Return the information of a record about what an estimate left free.

    ``None`` for an estimate by maximum likelihood, whose own covariance says all there is to say,
    and for filtered samples, whose noise nobody knows beforehand.

    Raises
    ------
    InputError
        As `information`.
    """
    seen = bind(model, record)
    if estimate.method == "ml" or seen.hidden or seen.filtered is not None:
        return None
    held = {value.name: value.value for value in estimate.parameters if value.fixed}
    return information(model.substitute(held), seen)


def information(model: Model, data: Data) -> Information:
    """Return the information matrix and the condition numbers of a record.

    The paper's (13) calls ``F' Sigma^-1 F`` a covariance; it is an information matrix. Nor is its
    inverse the covariance of an estimate: the noise in F is left out, and rows without actuator
    have no variance, so that they are left out here. Use it to compare records; the deviations
    of an estimate are in its own covariance.
    """
    regression = Regression(bind(model, data))
    record = regression.record
    ones = np.ones((record.samples, regression.rows))
    plain, _ = Block(record, regression.design, regression.target, ones).whitened()
    driven = list(np.flatnonzero((model.input_matrix != 0).any(axis=1)))
    variance = force_variance(regression)[:, driven] / record.periods
    block = Block(record, regression.design[:, driven], regression.target[:, driven], variance)
    weighted, _ = block.whitened()
    length = np.sqrt((plain**2).sum(axis=0))
    return Information(
        names=model.base.names,
        matrix=weighted.T @ weighted,
        condition_number=float(np.linalg.cond(plain)),
        scaled_condition_number=float(np.linalg.cond(plain / np.where(length > 0, length, 1.0))),
    )
