"""Least squares and batch on filtered records: solution, deviations by blocks, and what to say."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from rotorid.answer import machine_checks
from rotorid.answer.estimate import Estimate
from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.notes import Note, Severity
from rotorid.core.values import Floats
from rotorid.data.observation import Observation
from rotorid.linear.family import Posed
from rotorid.linear.regression import SampledRegression
from rotorid.linear.solve import (
    BLOCKS,
    Block,
    LeastSquaresSolution,
    Scatter,
    block_numbers,
    scatter_of_blocks,
    solve,
)

LOWER = 0.7
"""Share of the cut-off at which the answer is found again: half the noise of an acceleration is
gone by then, and half of what motion lies between."""
MOVED = 1.0
"""Deviations by which the lower cut-off may move a parameter before a warning tells of it: a bias
of one leaves 83 % of intervals right where 95 % are promised."""
CLEAR = 3.0
"""Deviations of the move itself by which it is more than chance."""

DOUBTFUL, SURE = 4.0, 6.0
"""Deviations of a lag between forces and motion from which on it is told, where it moves a
parameter by more than `MOVED`, and from which on the answer is turned away, where it moves one by
what the gate is sure of. Deviations from 32 blocks are an eighth off, from eight a quarter. A lower
cut-off that moves a parameter by the second turns the answer away too: the bias is larger still."""


def filtered_records(records: Sequence[Observation]) -> bool:
    found = [record.filtered is not None for record in records]
    if any(found) and not all(found):
        raise InputError(
            "records with a cut-off beside others",
            "all of one kind",
            "give every record a cut-off (cutoff, rid.filtered), or none",
            file=records[found.index(False)].lines.source,
        )
    return all(found)


def refuse_filtered(records: Sequence[Observation], method: str) -> None:
    """Refuse filtered records for a method that needs lines."""
    for record in records:
        if record.filtered is not None:
            raise InputError(
                f"a filtered record (cutoff) for {method}",
                "ls or batch for samples, lines for this method",
                "use ls; or give the fundamental, or for ml and a linear model the band, in place "
                "of the cut-off",
                file=record.lines.source,
            )


@frozen
class _Fit:
    solution: LeastSquaresSolution
    scatter: Scatter
    values: Floats

    def shares(self, change: Floats) -> Floats:
        """Return a change of the values in deviations, (free,), zero for what is not known."""
        spread = np.sqrt(np.diag(self.scatter.covariance).clip(0))
        known = np.isfinite(change) & (spread > 0) & ~self.scatter.alone
        return np.where(known, np.abs(change) / np.where(spread > 0, spread, 1.0), 0.0)


@frozen
class SampledProblem(Posed):
    """Regressions on the samples of all records, in the unknowns that exact constraints leave.

    Without a weight every row counts alike; with it a row counts by the variance of what least
    squares leaves of it, and a row without input by `weight` times the largest of these.
    """

    kind = SampledRegression
    weight: float | None = None

    def summarize(self, method: str) -> Estimate:
        fit = self.fit()
        scatter, doubts = fit.scatter, list(_doubted(self.names, fit.scatter))
        given = fit.values, scatter.covariance, fit.solution, doubts
        estimate = self.estimate(method, *given, unknown=scatter.alone)
        return estimate.with_notes(
            *_said(self.regressions, scatter),
            *machine_checks.physical(self.full, estimate),
            *self.moved(fit),
            *self.late(fit),
            *machine_checks.prediction(estimate, {}),
            *machine_checks.agreement(self.names, *scatter.halves()),
        )

    def fit(self, *, late: bool = False) -> _Fit:
        """Solve, and leave out blocks; `late`: with one unknown more, how early all forces come."""
        rows = len(self.model.texts)
        blocks = [self._block(r, np.ones(rows), late) for r in self.regressions]
        solution = solve(blocks)
        if self.weight is not None:
            base = np.nan_to_num(self.base(solution.values[: len(self.names)]))
            blocks = [self._block(r, self._variance(r, base), late) for r in self.regressions]
            solution = solve(blocks)
        parts = zip(*(block.whitened() for block in blocks), strict=True)
        matrix, right = (np.concatenate(part) for part in parts)
        counts = [len(r.inputs) for r in self.regressions]
        numbers = np.repeat(block_numbers(counts, BLOCKS), rows)
        gains = np.concatenate(solution.gains, axis=1)
        scatter = scatter_of_blocks(matrix, right - matrix @ (gains @ right), gains, numbers)
        return _Fit(solution, scatter, self.reached(solution))

    def _block(self, regression: SampledRegression, variance: Floats, late: bool) -> Block:
        design, target = self.free_equations(regression)
        if late:
            design = np.concatenate([design, regression.force_rates[:, :, None]], axis=2)
        return Block(design, target, variance)

    def _variance(self, regression: SampledRegression, base: Floats) -> Floats:
        free = ~self.model.input_matrix.any(axis=1)
        told = np.maximum(regression.told.sum(axis=0), 1)
        variance = (regression.residual(base) ** 2).sum(axis=0) / told
        floor = 1e-18 * (regression.target**2).mean(axis=0).max()
        variance = np.maximum(variance, floor if floor > 0 else 1.0)
        assert self.weight is not None
        largest = float(variance[~free].max(initial=0.0))
        return np.asarray(np.where(free, self.weight * largest, variance))

    def late(self, fit: _Fit) -> Iterator[Note]:
        """Judge whether forces and motion come at one time, with the lag for an unknown.

        ``u(t - lag) = u - lag u'``: what elastic parts and filters do looks like a lag too.
        """
        freed = self.fit(late=True)
        lag = -float(freed.values[-1])
        std = float(np.sqrt(max(freed.scatter.covariance[-1, -1], 0.0)))
        shares = fit.shares(freed.values[:-1] - fit.values)
        if not np.isfinite(lag) or abs(lag) <= DOUBTFUL * std or shares.max() <= MOVED:
            return
        worst = int(shares.argmax())
        text = (
            f"the forces come as if {abs(lag) * 1e3:.3g} ms {'late' if lag > 0 else 'early'} "
            f"({abs(lag) / std if std > 0 else np.inf:.3g} deviations), and {self.names[worst]} is "
            f"{freed.values[worst]:.5g} {self._unit(worst)} without that: give the delay of the "
            "channels, or look for filters before the logger, or for something elastic that the "
            "equations leave out"
        )
        sure = abs(lag) > SURE * std and shares.max() > machine_checks.SURE
        severity: Severity = "rejects" if sure else "doubts"
        yield Note("delay", severity, text, on=(self.names[worst],), value=lag, unit="s")

    def moved(self, fit: _Fit) -> Iterator[Note]:
        """Judge whether a lower cut-off moves a parameter by more than its deviations."""
        lower = tuple(r.lowered(LOWER) for r in self.regressions)
        other = replace(self, regressions=lower).fit()
        change = other.values - fit.values
        clear = np.abs(change) > CLEAR * _spread_of_change(fit.scatter, other.scatter)
        shares = np.where(clear, fit.shares(change), 0.0)
        if shares.max(initial=0.0) <= MOVED:
            return
        worst = int(shares.argmax())
        name, unit, by = self.names[worst], self._unit(worst), float(change[worst])
        text = (
            f"a cut-off lower by {100 * (1 - LOWER):.0f} % moves {name} by {by:+.3g} "
            f"{unit}, {shares[worst]:.2g} deviations: noise in the motion pulls the answer towards "
            "zero, or the motion reaches up to the cut-off; the deviations do not cover that: try "
            "other cut-offs"
        )
        severity: Severity = "rejects" if shares.max() > SURE else "doubts"
        yield Note("cut-off", severity, text, on=(name,), value=by, unit=unit)

    def _unit(self, free: int) -> str:
        return self.model.base.units[self.elimination.kept[free]]


def _spread_of_change(first: Scatter, second: Scatter) -> Floats:
    """Return the deviation of the difference of two answers from the same blocks, shape (free,)."""
    parts = [first.shifts, second.shifts]
    count = min(len(part) for part in parts)
    one, other = (
        np.add.reduceat(part, np.arange(count) * len(part) // count, axis=0) for part in parts
    )
    return np.asarray(np.sqrt(((one - other) ** 2).sum(axis=0)))


def _doubted(names: Sequence[str], scatter: Scatter) -> Iterator[Note]:
    alone = tuple(name for name, alone in zip(names, scatter.alone, strict=True) if alone)
    if alone:
        text = (
            f"a single one of {scatter.blocks} blocks of the record tells {', '.join(alone)}: "
            "no deviation can be stated"
        )
        yield Note("blocks", "doubts", text, "excite it more than once", on=alone)
    if scatter.memory:
        text = (
            f"{scatter.blocks} blocks of the record still depend on one another: deviations "
            "are too small"
        )
        yield Note("blocks", "doubts", text, "record longer")


def _said(regressions: Sequence[SampledRegression], scatter: Scatter) -> tuple[Note, ...]:
    """Say what was filtered, and where the deviations come from."""
    seconds = sum(r.record.duration for r in regressions)
    told = (
        f"deviations from {scatter.blocks} blocks of {seconds / scatter.blocks:.3g} s, each left "
        "out in turn; they cover the scatter, not the bias that noise in the motion leaves"
    )
    checks = dict.fromkeys(check for r in regressions for check in r.record.checks)
    rests = dict.fromkeys(r.left_out for r in regressions if r.left_out)
    at_rest = [Note("at rest", "says", rest) for rest in rests]
    return (*checks, *at_rest, Note("blocks", "says", told))
