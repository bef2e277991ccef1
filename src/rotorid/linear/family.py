"""What least squares, batch and sequential share: substitution, elimination, summary."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar, Self

import numpy as np

from rotorid.answer import machine_checks
from rotorid.answer.derived import physical_from_base
from rotorid.answer.estimate import Estimate, Value
from rotorid.answer.judge import OPEN, judge
from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.linalg import column_lengths
from rotorid.core.notes import Note, remarks
from rotorid.core.values import Booleans, Complexes, Floats
from rotorid.data.observation import Data, Observation, bind
from rotorid.linear.regression import (
    Equations,
    Regression,
    driven_rows,
    relative_errors,
)
from rotorid.linear.solve import (
    POOLING_PERIODS,
    Block,
    Fitted,
    LeastSquaresSolution,
    misfit,
    pooled,
    sandwich,
    scatter_of_answers,
)
from rotorid.models import Model
from rotorid.models.constraints import Constraint, Elimination, constraints_in_si, eliminate, in_si
from rotorid.models.expressions import symbol
from rotorid.signals.checks.periods import check_identical
from rotorid.signals.covariance import LineCovariance, choose_covariance

LEAST_PERIODS = 4
"""Periods from which the halves of a record have a scatter of their own, for their weights."""


@frozen
class Posed:
    """A model in the unknowns that fixed values and exact constraints leave."""

    kind: ClassVar[type[Equations]]
    full: Model  # as given
    fixed: Mapping[str, float]  # substituted values
    model: Model  # after substitution
    elimination: Elimination
    regressions: tuple[Any, ...]  # of all records, with the model after substitution

    @classmethod
    def of(
        cls,
        records: Sequence[Observation],
        given: Mapping[str, float | str],
        constraints: Sequence[Constraint],
    ) -> Self:
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
                found, file = "a rotor angle of unknown phase", record.lines.source
                raise InputError(found, "a known phase", "use ml", file=file)
        elimination = eliminate(reduced, constraints_in_si(constraints, model), fixed)
        if not elimination.kept:
            raise InputError("every parameter constrained", "something to estimate", "free one")
        regressions = tuple(cls.kind(replace(record, model=reduced)) for record in records)
        return cls(model, dict(fixed), reduced, elimination, regressions)

    @property
    def names(self) -> list[str]:
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

    def reached(self, solution: LeastSquaresSolution) -> Floats:
        """Return the values of a solution, NaN where no chain of equations reaches them."""
        values = solution.values.copy()
        values[self.unreached] = np.nan
        return values

    def base(self, free: Floats) -> Floats:
        known = np.isfinite(free)
        values = self.elimination.origin + self.elimination.basis[:, known] @ free[known]
        values[self.elimination.basis[:, ~known].any(axis=1)] = np.nan
        return np.asarray(values)

    def free_equations(self, equations: Equations) -> tuple[Complexes, Complexes]:
        """Return design (line, row, free) and target (line, row) of one record."""
        design = equations.design @ self.elimination.basis
        return design, equations.target - equations.design @ self.elimination.origin

    def _told(self, undetermined: Floats) -> list[Note]:
        """Say what is wrong with the units, and what the equations leave open, with a cure."""
        names = self.names
        told = [Note("units", "doubts", fault) for fault in self.full.unit_faults]
        for i in self.unreached:
            text = f"{names[i]} is in no row that a measured input or a known parameter drives"
            told.append(Note(OPEN, "open", text, on=(names[i],)))
        for direction in undetermined.T:
            large = np.flatnonzero(np.abs(direction) > 1e-3 * np.abs(direction).max())
            members = tuple(names[int(i)] for i in large)
            what = "are determined only together" if len(large) > 1 else "is not determined"
            told.append(Note(OPEN, "open", f"{', '.join(members)} {what}", on=members))
        if undetermined.size:
            cure = "fix one of them, excite more lines, or measure more"
            told.append(Note(OPEN, "open", cure=cure))
        return told

    def estimate(
        self,
        method: str,
        values: Floats,
        covariance: Floats,
        solution: LeastSquaresSolution,
        notes: Sequence[Note] = (),
        *,
        inflation: float = 1.0,
        unknown: Booleans | None = None,
        lines_hz: tuple[float, ...] = (),
        periods: int = 1,
    ) -> Estimate:
        """Return the base parameters as an `Estimate`, with the physical ones that follow.

        `values` and `covariance` are of the free unknowns; `inflation` of the deviations, where
        all of the misfit is taken for noise; of the `unknown` ones no deviation can be stated.
        """
        model, basis = self.model, self.elimination.basis
        base, covariance = self.base(values), basis @ covariance @ basis.T
        found = np.isfinite(base)
        std = np.where(found, np.sqrt(np.diag(covariance).clip(0)), np.nan)
        columns = base.tolist(), std.tolist(), (std * inflation).tolist()
        named = zip(model.base.names, model.base.units, *columns, strict=True)
        parameters = [Value(*row) for row in named]
        if unknown is not None:
            unstated = (basis[:, unknown] != 0).any(axis=1)
            parameters = [
                replace(p, std=None, std_inflated=None) if none else p
                for p, none in zip(parameters, unstated, strict=True)
            ]
        units = self.full.parameter_units
        known, number = np.where(found, base, 0.0), solution.condition_number
        notes = (
            *remarks("record", (w for r in self.regressions for w in r.record.warnings)),
            *self._told(solution.undetermined),
            *notes,
        )
        return Estimate(
            model=self.full.name,
            method=method,
            status=judge(notes),
            parameters=(
                *parameters,
                *(Value(n, units[n], value, 0.0, 0.0, True) for n, value in self.fixed.items()),
            ),
            derived=physical_from_base(model, base, covariance),
            covariance=covariance,
            prediction=relative_errors([r.predicted(known) for r in self.regressions]),
            lines_hz=lines_hz,
            periods=periods,
            notes=notes,
            condition_number=number if np.isfinite(number) else None,
        )


@frozen
class LeastSquaresProblem(Posed):
    """Regressions on the lines of all records, in the unknowns that exact constraints leave."""

    kind = Regression

    def halves(self) -> tuple[LeastSquaresProblem, LeastSquaresProblem]:
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

    def summarize(
        self, method: str, solve: Callable[[LeastSquaresProblem], LeastSquaresSolution]
    ) -> Estimate:
        """Return the estimate that a way of solving gives, with the sandwich for its covariance."""
        solution, records = solve(self), [r.record for r in self.regressions]
        values, fewest = self.reached(solution), min(r.periods for r in records)
        base = np.nan_to_num(self.base(values))
        residuals = [r.period_residual(base) for r in self.regressions]
        scatters = [choose_covariance(residual, residual) for residual in residuals]
        if self.model.nonlinear and fewest >= POOLING_PERIODS:
            free = scatter_of_answers(solution.gains, residuals)
        else:
            free = sandwich(solution.gains, [s.matrices for s in scatters], records)
        estimate = self.estimate(
            method,
            values,
            free,
            solution,
            inflation=self._inflation(self.base(values), scatters),
            lines_hz=tuple(sorted({float(f) for r in records for f in r.frequency})),
            periods=fewest,
        )
        notes = machine_checks.physical(self.full, estimate)
        notes += machine_checks.prediction(estimate, self._noise(scatters))
        if judge(notes) == "ok":  # one reason is enough
            notes += machine_checks.residual(*misfit(self._fitted(solution, base, scatters)))
        if fewest >= LEAST_PERIODS:
            halves = np.array([solve(half).values for half in self.halves()]) - values
            spread = np.sqrt(np.diag(free).clip(0))
            if not any(not c.on for r in records for c in check_identical(r)):
                notes += machine_checks.noise_bias(self.names, halves.mean(axis=0), spread)
            if fewest >= 2 * LEAST_PERIODS:  # below, deviations are too rough to hold them against
                notes += machine_checks.agreement(
                    self.names, self._parted(solution, residuals), spread
                )
        return estimate.with_notes(*notes)

    def _inflation(self, base: Floats, scatters: Sequence[LineCovariance]) -> float:
        """Return by how much the residual exceeds its scatter over periods, at least 1.

        Each row counts alike. What the periods repeat, a misfit of the model or a bias, is in the
        residual and not in the scatter.
        """
        if not np.isfinite(base).all():
            return 1.0
        misfit, noise, equations = 0.0, 0.0, 0.0
        for regression, scatter in zip(self.regressions, scatters, strict=True):
            weight = regression.record.multiplicity
            residual = weight @ np.abs(regression.residual(base)) ** 2
            expected = weight @ np.diagonal(scatter.matrices.real, axis1=1, axis2=2)
            noisy = expected > 1e-20 * (weight @ np.abs(regression.target) ** 2).max()
            misfit += float((residual[noisy] / expected[noisy]).sum())
            noise += float(noisy.sum())
            equations += float(weight.sum() * noisy.sum())
        if equations <= len(base):
            return 1.0
        return float(np.sqrt(max(1.0, misfit / noise / (1 - len(base) / equations))))

    def _parted(self, solution: LeastSquaresSolution, residuals: Sequence[Complexes]) -> Floats:
        """Return by how much the answers of both halves differ from that of all, to first order.

        Of parameters that are hardly told the answers themselves differ by more than a change.
        """
        parted = np.zeros((2, len(self.names)))
        for gain, residual in zip(solution.gains, residuals, strict=True):
            answers = -np.einsum("fkr,pkr->pf", gain, residual).real
            halves = np.split(answers, [len(answers) // 2])
            parted += [half.mean(axis=0) - answers.mean(axis=0) for half in halves]
        return parted

    def _fitted(
        self, solution: LeastSquaresSolution, base: Floats, scatters: Sequence[LineCovariance]
    ) -> list[Fitted]:
        return [
            Fitted(
                r.residual(base),
                self.free_equations(r)[0],
                gains,
                scatter.matrices,
                np.sqrt(((np.abs(r.design) @ np.abs(base) + np.abs(r.target)) ** 2).mean(axis=0)),
                r.record.multiplicity,
                scatter.dof,
            )
            for r, gains, scatter in zip(self.regressions, solution.gains, scatters, strict=True)
        ]

    def _noise(self, scatters: Sequence[LineCovariance]) -> dict[str, float]:
        """Return the share of each input that the scatter of the residual explains."""
        inverse = np.linalg.pinv(self.model.input_matrix)
        noise, size = np.zeros(len(self.model.inputs)), np.zeros(len(self.model.inputs))
        for regression, scatter in zip(self.regressions, scatters, strict=True):
            weight = regression.record.multiplicity
            noise += weight @ np.einsum("ir,krs,is->ki", inverse, scatter.matrices.real, inverse)
            size += weight @ np.abs(regression.inputs.mean(axis=0)) ** 2
        share = np.sqrt(noise.clip(0) / np.where(size > 0, size, 1.0))
        return dict(zip(self.model.inputs, share.tolist(), strict=True))


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
class Information:
    names: tuple[str, ...]  # base parameters
    # (base, base): ``F' Sigma^-1 F``, Sigma the variance of the mean force at each sample
    matrix: Floats
    # of F, as the paper's robots have it: neither rows nor columns are scaled
    condition_number: float
    # of F with its columns scaled to length one; it does not change with the units
    scaled_condition_number: float


def information_of(model: Model, estimate: Estimate, record: Data) -> Information | None:
    """Return the information of a record about what an estimate left free.

    ``None`` for ml, whose own covariance says all, and for samples, of unknown noise.
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
    record, design, target = regression.record, regression.design, regression.target
    plain, _ = Block(design, target, np.ones(len(model.texts)), record).whitened()
    driven = list(np.flatnonzero((model.input_matrix != 0).any(axis=1)))
    variance = force_variance(regression)[:, driven] / record.periods
    weighted, _ = Block(design[:, driven], target[:, driven], variance, record).whitened()
    return Information(
        names=model.base.names,
        matrix=weighted.T @ weighted,
        condition_number=float(np.linalg.cond(plain)),
        scaled_condition_number=float(np.linalg.cond(plain / column_lengths(plain))),
    )
