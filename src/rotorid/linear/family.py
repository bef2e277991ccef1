"""What least squares, batch and sequential share: substitution, elimination, summary.

What the misfit on lines is held against: theory, section 4.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from rotorid.answer import machine_checks
from rotorid.answer.derived import physical_from_base
from rotorid.answer.estimate import Estimate
from rotorid.answer.judge import OPEN, judge
from rotorid.answer.parts import Value
from rotorid.core.distributions import Expectation, line_moments
from rotorid.core.errors import InputError
from rotorid.core.linalg import column_lengths, whole_svd
from rotorid.core.notes import Note, remarks
from rotorid.core.values import Booleans, Complexes, Floats, frozen
from rotorid.data.observation import Data, Records, bind
from rotorid.linear.regression import Equations, Regression, relative_errors
from rotorid.linear.solve import POOLING_PERIODS, Block, LeastSquaresSolution, pooled
from rotorid.models import Model
from rotorid.models.expressions import symbol
from rotorid.models.knowledge import Constraint, Elimination, constraints_in_si, eliminate, in_si
from rotorid.signals.checks.periods import check_identical
from rotorid.signals.covariance import FLOOR, LineCovariance, choose_covariance

LEAST_PERIODS = 4
"""Periods from which the halves of a record have a scatter of their own, for their weights."""


Solver = Callable[[Any], LeastSquaresSolution]


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
        cls, records: Records, given: Mapping[str, float | str], constraints: Sequence[Constraint]
    ) -> Self:
        model = records[0].model
        fixed = in_si(given, model)
        reduced = model.substitute(fixed)
        if not reduced.base.names:
            raise InputError("every parameter fixed", "something to estimate", "free one")
        turning = any(symbol("phi") in signal.free_symbols for signal in reduced.signals)
        for record in records:
            file = record.lines.source
            if record.own:
                found = f"{', '.join(record.own)}, which differ between records"
                expected, place = "the same parameters in every record", "parameters"
                raise InputError(found, expected, "use ml", file=file, place=place)
            if turning and not record.lines.phase_known:
                found = "a rotor angle of unknown phase"
                raise InputError(found, "a known phase", "use ml", file=file)
        elimination = eliminate(reduced, constraints_in_si(constraints, model))
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

    @cached_property
    def stages(self) -> list[tuple[list[int], list[int]]]:
        """Rows that are solved together, from those driven on, and the unknowns they determine."""
        structure = self.structure
        holds: Booleans = np.asarray((structure != 0).any(axis=0))  # (row, unknown)
        known: Booleans = np.zeros(holds.shape[1], dtype=bool)
        driven = self.model.input_matrix.any(axis=1) | self.model.coefficients[1].any(axis=0)
        rows, left = np.flatnonzero(driven).tolist(), set(range(structure.shape[1]))
        stages = []
        while rows:
            while (unknowns := holds[rows].any(axis=0) & ~known).any():
                columns = structure[:, rows][:, :, unknowns].reshape(-1, int(unknowns.sum()))
                _, singular, directions = whole_svd(columns)
                rank = int((singular > 1e-12 * singular.max(initial=0.0)).sum())
                tangled = np.flatnonzero(unknowns)[(np.abs(directions[rank:]) > 1e-9).any(axis=0)]
                more = {r for r in left - {*rows} if structure[:, r][:, tangled].any()}
                if not more:  # no other row tells the unknowns of these apart
                    break
                rows = sorted({*rows, *more})
            if unknowns.any():
                stages.append((rows, np.flatnonzero(unknowns).tolist()))
            left -= set(rows)
            known |= unknowns
            rows = sorted(r for r in left if (holds[r] & known).any())
        return stages

    @property
    def unreached(self) -> list[int]:
        """Unknowns that no chain of equations ties to a measured input or a known term.

        Their equations have zero on the right side, which any multiple of a solution solves.
        """
        reached = {unknown for _, unknowns in self.stages for unknown in unknowns}
        return [i for i in range(len(self.names)) if i not in reached]

    def reached(self, solution: LeastSquaresSolution) -> Floats:
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

    def blocks(self, variance: Callable[[Any], Floats]) -> list[Block]:
        return [
            Block(*self.free_equations(r), variance(r), r.observation.periodic)
            for r in self.regressions
        ]

    def _told(self, undetermined: Floats) -> list[Note]:
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
        solution: LeastSquaresSolution,
        covariance: Floats,
        *,
        inflation: float = 1.0,
        unknown: Iterable[bool] = (),
    ) -> Estimate:
        """Return the base parameters as an `Estimate`, with the physical ones that follow.

        `covariance` is of the free unknowns; `inflation` of the deviations, where all of the misfit
        is taken for noise; of the `unknown` ones no deviation can be stated.
        """
        model, basis = self.model, self.elimination.basis
        base, covariance = self.base(self.reached(solution)), basis @ covariance @ basis.T
        found = np.isfinite(base)
        std = np.where(found, np.sqrt(np.diag(covariance).clip(0)), np.nan)
        stated = np.stack([std, std * inflation], axis=1).tolist()
        for i in np.flatnonzero((basis[:, list(unknown)] != 0).any(axis=1)):
            stated[i] = (None, None)
        named = zip(model.base.names, model.base.units, base.tolist(), stated, strict=True)
        parameters = [Value(name, unit, value, *both) for name, unit, value, both in named]
        units = self.full.parameter_units
        known, number = np.where(found, base, 0.0), solution.condition_number
        notes = (
            *remarks("record", (w for r in self.regressions for w in r.warnings)),
            *self._told(solution.undetermined),
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
            periods=1,
            notes=notes,
            condition_number=number if np.isfinite(number) else None,
        )


@frozen
class Fitted:
    regression: Regression
    design: Complexes  # (line, row, free)
    gains: Complexes  # (free, line, row): how the values answer to the targets
    base: Floats  # (base,): 0 for what is not determined

    @property
    def weight(self) -> Floats:
        return self.regression.record.multiplicity

    @cached_property
    def residual(self) -> Complexes:
        return np.asarray(self.regression.residual(self.base))

    @cached_property
    def periods(self) -> Complexes:
        """The residual of each period, (period, line, row)."""
        return self.regression.period_residual(self.base)

    @cached_property
    def scatter(self) -> LineCovariance:
        """Of the mean residual."""
        return choose_covariance(self.periods, self.periods)

    @cached_property
    def answers(self) -> Floats:
        """How the values answer to the residual of each period, (period, free)."""
        return np.asarray(np.einsum("fkr,pkr->pf", self.gains, self.periods).real)

    @property
    def size(self) -> Floats:
        """Of the terms of each equation, (row,): below `FLOOR` of it is rounding."""
        r = self.regression
        terms = np.abs(r.design) @ np.abs(self.base) + np.abs(r.target)
        return np.asarray(np.sqrt((terms**2).mean(axis=0)))


def sandwich(records: Sequence[Fitted]) -> Floats:
    """Return the covariance of values that answer to noise e by ``Re(sum gains e)``."""
    parts = []
    for record in records:
        by_line = np.moveaxis(record.gains, 1, 0)
        shared = by_line @ record.scatter.matrices @ by_line.conj().swapaxes(-1, -2)
        # On a complex line the real part of a circular number has half its variance.
        parts.append(np.tensordot(1 / record.weight, shared.real, axes=1))
    total = np.sum(parts, axis=0)
    return np.asarray((total + total.T) / 2)


def scatter_of_answers(records: Sequence[Fitted]) -> Floats:
    """Return the covariance of values from how they answer to the residual of each period.

    For models that are not linear in the motion: there the noise of one line is on others too,
    and `sandwich`, which takes lines as independent, is wrong by some tenths.
    """
    each = [record.answers[:, None].astype(np.complex128) for record in records]
    return np.asarray(sum(choose_covariance(a, a).matrices[0].real for a in each))


def _whitened(record: Fitted) -> tuple[NDArray[Any], ...]:
    """Return residual, design, gains and R of real equations of deviation one, line by line."""
    covariance, multiplicity = record.scatter.matrices, record.weight
    variance = np.einsum("krr->kr", covariance).real + (FLOOR * record.size) ** 2
    deviation = np.sqrt(np.where(variance > 0, variance, 1.0))
    scale = np.sqrt(multiplicity)[:, None] / deviation
    gains = np.moveaxis(record.gains, 0, -1).conj() / scale[..., None]
    equal = covariance / (deviation[:, :, None] * deviation[:, None, :])
    rows = np.arange(equal.shape[1])
    equal[:, rows, rows] = 1.0  # rounding is noise, too
    single = (multiplicity == 1)[:, None, None]  # DC, Nyquist: no imaginary part
    cross, back = (np.where(single, 0.0, part) for part in (equal.imag, equal.real))
    lines = scale * record.residual, scale[..., None] * record.design, gains
    residual, design, gains = (np.concatenate([x.real, x.imag], axis=1) for x in lines)
    return residual, design, gains, np.block([[equal.real, -cross], [cross, back]])


def misfit(records: Sequence[Fitted]) -> tuple[float, Expectation]:
    """Return the sum of squares of the residual over its scatter, and what noise makes of it."""
    parts = zip(*map(_whitened, records), strict=True)
    residual, design, gains, correlation = (np.concatenate(part) for part in parts)
    # A' A = I - U V' with U = (D, G') and V = (G', D - G' D' D), so that nothing n x n is formed.
    inner = np.tensordot(design, design, ([0, 1], [0, 1]))
    u = np.concatenate([design, gains], axis=2)
    v = np.concatenate([gains, design - gains @ inner], axis=2)
    moved = correlation @ u
    cross = np.tensordot(v, moved, ([0, 1], [0, 1]))
    equations = float(np.trace(correlation, axis1=1, axis2=2).sum())
    mean = equations - float(np.trace(cross))
    if mean <= FLOOR * equations:  # as many unknowns as equations: nothing is left to judge by
        return 0.0, Expectation(0.0, 0.0, 0)
    square = (correlation**2).sum() - 2 * ((correlation @ v) * moved).sum()
    square = max(float(square + (cross * cross.T).sum()), 1e-300)
    # Every deviation is itself from so many periods.
    dof = min(record.scatter.dof for record in records)
    of_one, spread = line_moments(np.ones(1), np.array([dof]), np.full(1, 2.0))
    freedom = max(round(mean**2 / square), 1)
    wider = float(spread[0]) / 4
    expected = Expectation(mean * float(of_one[0]) / 2, 2 * square * wider, freedom)
    return float((residual**2).sum()), expected


def inflation(records: Sequence[Fitted]) -> float:
    """Return by how much the residual exceeds its scatter over periods, at least 1."""
    misfit, noise, equations, count = 0.0, 0.0, 0.0, len(records[0].base)
    for record in records:
        weight = record.weight
        residual = weight @ np.abs(record.residual) ** 2
        expected = weight @ np.diagonal(record.scatter.matrices.real, axis1=1, axis2=2)
        noisy = expected > 1e-20 * (weight @ np.abs(record.regression.target) ** 2).max()
        misfit += float((residual[noisy] / expected[noisy]).sum())
        noise += float(noisy.sum())
        equations += float(weight.sum() * noisy.sum())
    if equations <= count:
        return 1.0
    return float(np.sqrt(max(1.0, misfit / noise / (1 - count / equations))))


def _noise(records: Sequence[Fitted]) -> dict[str, float]:
    """Return the share of each input that the scatter of the residual explains."""
    model = records[0].regression.model
    inverse = np.linalg.pinv(model.input_matrix)
    noise, size = np.zeros(len(model.inputs)), np.zeros(len(model.inputs))
    for record in records:
        scatter = record.scatter.matrices.real
        noise += record.weight @ np.einsum("ir,krs,is->ki", inverse, scatter, inverse)
        size += record.weight @ np.abs(record.regression.inputs) ** 2
    share = np.sqrt(noise.clip(0) / np.where(size > 0, size, 1.0))
    return dict(zip(model.inputs, share.tolist(), strict=True))


def force_variance(regression: Regression) -> Floats:
    """Return the variance of a row's force, (sample, row); inputs uncorrelated, the paper's (9)."""
    record, model = regression.record, regression.model
    channels = list(regression.observation.input_columns)
    power = (record.mean[:, channels] ** 2).mean(axis=0)
    variance = pooled(record.variance[:, channels], power, record.periods)
    return np.asarray(variance @ (model.input_matrix.T**2))


@frozen
class LeastSquaresProblem(Posed):
    """Regressions on the lines of all records, in the unknowns that exact constraints leave."""

    kind = Regression
    variance = staticmethod(force_variance)

    def summarize(self, method: str, solved: Solver) -> Estimate:
        solution, measured = solved(self), [r.record for r in self.regressions]
        values, fewest = self.reached(solution), min(r.periods for r in measured)
        base = np.nan_to_num(self.base(values))
        records = [
            Fitted(r, self.free_equations(r)[0], gains, base)
            for r, gains in zip(self.regressions, solution.gains, strict=True)
        ]
        nonlinear = self.model.nonlinear and fewest >= POOLING_PERIODS
        free = scatter_of_answers(records) if nonlinear else sandwich(records)
        wider = inflation(records) if np.isfinite(values).all() else 1.0
        hertz = tuple(sorted({float(f) for r in measured for f in r.frequency}))
        estimate = self.estimate(method, solution, free, inflation=wider)
        estimate = estimate.with_(lines_hz=hertz, periods=fewest)
        notes = machine_checks.physical(self.full, estimate)
        notes += machine_checks.prediction(estimate, _noise(records))
        if judge(notes) == "ok":  # one reason is enough
            notes += machine_checks.residual(*misfit(records))
        if fewest >= LEAST_PERIODS:
            each = [[replace(r, half=half) for r in self.regressions] for half in (1, 2)]
            halves = [solved(replace(self, regressions=tuple(half))).values for half in each]
            bias = np.mean(halves, axis=0) - values  # of half as many periods: twice as large
            spread = np.sqrt(np.diag(free).clip(0))
            if not any(not c.on for r in measured for c in check_identical(r)):
                notes += machine_checks.noise_bias(self.names, bias, spread)
            if fewest >= 2 * LEAST_PERIODS:  # below, deviations are too rough to hold them against
                # To first order: of what is hardly told the answers differ by more than a change.
                parted = np.zeros((2, len(values)))
                for answers in (record.answers for record in records):
                    half = np.split(answers, [len(answers) // 2])
                    parted += answers.mean(axis=0) - [part.mean(axis=0) for part in half]
                notes += machine_checks.agreement(self.names, parted, spread)
        return estimate.with_notes(*notes)


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
    """Return the information, the paper's (13), of a record about what an estimate left free.

    Rows without actuator have no variance, and are left out. ``None`` for ml, whose own covariance
    says all, and for samples, of unknown noise.
    """
    seen = bind(model, record)
    if estimate.method == "ml" or seen.hidden or seen.filtered is not None:
        return None
    model = model.substitute({v.name: v.value for v in estimate.parameters if v.fixed})
    regression = Regression(bind(model, seen))
    periodic, design, target = regression.record, regression.design, regression.target
    plain, _ = Block(design, target, np.ones(len(model.texts)), periodic).whitened()
    driven = list(np.flatnonzero((model.input_matrix != 0).any(axis=1)))
    variance = force_variance(regression)[:, driven] / periodic.periods
    weighted, _ = Block(design[:, driven], target[:, driven], variance, periodic).whitened()
    return Information(
        names=model.base.names,
        matrix=weighted.T @ weighted,
        condition_number=float(np.linalg.cond(plain)),
        scaled_condition_number=float(np.linalg.cond(plain / column_lengths(plain))),
    )
