"""Least squares and batch on filtered records: solution, deviations by blocks, and what to say."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from rotorid.answer import machine_checks as gate
from rotorid.answer.estimate import Estimate
from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.notes import Note, Severity, remarks
from rotorid.core.values import Floats
from rotorid.data.observation import Observation
from rotorid.linear.equations import SampledRegression, predicted, relative_errors
from rotorid.linear.family import Findings, Posed, result, substitute
from rotorid.linear.solve import BLOCKS, Scatter, Solution, block_numbers, scatter_of_blocks, solve
from rotorid.models.priors import Constraint

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


@frozen
class SampleBlock:
    """Equations of one record: ``design @ free = target`` at samples, a deviation per row."""

    design: Floats  # (sample, row, free)
    target: Floats  # (sample, row)
    deviation: Floats  # (row,)

    def whitened(self) -> tuple[Floats, Floats]:
        """Return matrix and right side over deviations, rows flattened."""
        matrix = self.design / self.deviation[:, None]
        return matrix.reshape(-1, matrix.shape[2]), (self.target / self.deviation).reshape(-1)

    def line_gains(self, gains: Floats) -> Floats:
        """Return gains on whitened samples as they are."""
        return gains


def filtered_records(records: Sequence[Observation]) -> bool:
    """Tell whether records are filtered ones; refuse some of each kind."""
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


def estimate_by_samples(
    method: str,
    records: Sequence[Observation],
    fixed: Mapping[str, float | str],
    constraints: Sequence[Constraint],
    free_weight: float | None = None,
) -> Estimate:
    """Return the estimate from filtered records.

    Without `free_weight` every row counts alike; with it a row counts by the variance of what least
    squares leaves of it, and a row without input by `free_weight` times the largest of these.
    """
    posed = substitute(records, fixed, constraints)
    regressions = [SampledRegression(record.rebound(posed.model)) for record in records]
    fit = _fit(posed, regressions, free_weight)
    lower = [r.lowered(LOWER) for r in regressions]
    other = _fit(posed, lower, free_weight)
    late = _late(posed, fit, _fit(posed, regressions, free_weight, late=True))
    return _summary(method, posed, regressions, fit, [*_moved(posed, fit, other), *late])


@frozen
class _Fit:
    """A solution, with what its deviations come from."""

    solution: Solution
    scatter: Scatter
    values: Floats


def _fit(
    posed: Posed,
    regressions: Sequence[SampledRegression],
    weight: float | None,
    *,
    late: bool = False,
) -> _Fit:
    """Solve, weighting rows where a weight is given, and leave out blocks.

    `late`: with one unknown more, the time by which all forces come early.
    """
    deviations = [np.ones(len(posed.model.texts))] * len(regressions)
    blocks = _equations(posed, regressions, deviations, late)
    solution = solve(blocks)
    if weight is not None:
        deviations = _deviations(posed, regressions, solution, weight)
        blocks = _equations(posed, regressions, deviations, late)
        solution = solve(blocks)
    values = solution.values.copy()
    values[posed.unreached] = np.nan
    parts = [block.whitened() for block in blocks]
    matrix = np.concatenate([part[0] for part in parts])
    right = np.concatenate([part[1] for part in parts])
    rows = len(posed.model.texts)
    numbers = np.repeat(block_numbers([len(r.inputs) for r in regressions], BLOCKS), rows)
    gains = np.concatenate(solution.gains, axis=1)
    scatter = scatter_of_blocks(matrix, right - matrix @ (gains @ right), gains, numbers)
    return _Fit(solution, scatter, values)


def _equations(
    posed: Posed,
    regressions: Sequence[SampledRegression],
    deviations: Sequence[Floats],
    late: bool,
) -> list[SampleBlock]:
    basis, origin = posed.elimination.basis, posed.elimination.origin
    found = []
    for r, deviation in zip(regressions, deviations, strict=True):
        design = r.design @ basis
        if late:
            design = np.concatenate([design, r.force_rates[:, :, None]], axis=2)
        found.append(SampleBlock(design, r.target - r.design @ origin, deviation))
    return found


def _deviations(
    posed: Posed, regressions: Sequence[SampledRegression], solution: Solution, weight: float
) -> list[Floats]:
    """Return the deviation of each row's residual, record by record."""
    base = np.nan_to_num(posed.base(solution.values[: len(posed.names)]))
    free = ~posed.model.input_matrix.any(axis=1)
    found = []
    for regression in regressions:
        told = np.maximum(regression.told.sum(axis=0), 1)
        variance = (regression.residual(base) ** 2).sum(axis=0) / told
        floor = 1e-18 * (regression.target**2).mean(axis=0).max()
        variance = np.maximum(variance, floor if floor > 0 else 1.0)
        found.append(np.sqrt(np.where(free, weight * variance[~free].max(initial=0.0), variance)))
    return found


def _late(posed: Posed, fit: _Fit, freed: _Fit) -> Iterator[Note]:
    """Judge whether forces and motion come at one time: `freed` has the lag as an unknown.

    ``u(t - lag) = u - lag u'``: what elastic parts and filters do looks like a lag too.
    """
    lag = -float(freed.values[-1])
    std = float(np.sqrt(max(freed.scatter.covariance[-1, -1], 0.0)))
    shares = _shares(fit, freed.values[:-1] - fit.values)
    if not np.isfinite(lag) or abs(lag) <= DOUBTFUL * std or shares.max() <= MOVED:
        return
    worst = int(shares.argmax())
    name, unit = posed.names[worst], posed.model.base.units[posed.elimination.kept[worst]]
    text = (
        f"the forces come as if {abs(lag) * 1e3:.3g} ms {'late' if lag > 0 else 'early'} "
        f"({abs(lag) / std if std > 0 else np.inf:.3g} deviations), and {name} is "
        f"{freed.values[worst]:.5g} {unit} without that: give the delay of the channels, or look "
        "for filters before the logger, or for something elastic that the equations leave out"
    )
    sure = abs(lag) > SURE * std and shares.max() > gate.SURE
    severity: Severity = "rejects" if sure else "doubts"
    yield Note("delay", severity, text, on=(name,), value=lag, unit="s")


def _moved(posed: Posed, fit: _Fit, other: _Fit) -> Iterator[Note]:
    """Judge whether a lower cut-off moves a parameter by more than its deviations."""
    change = other.values - fit.values
    clear = np.abs(change) > CLEAR * _spread_of_change(fit.scatter, other.scatter)
    shares = np.where(clear, _shares(fit, change), 0.0)
    if not shares.size or shares.max() <= MOVED:
        return
    worst = int(shares.argmax())
    name, unit = posed.names[worst], posed.model.base.units[posed.elimination.kept[worst]]
    text = (
        f"a cut-off lower by {100 * (1 - LOWER):.0f} % moves {name} by {change[worst]:+.3g} {unit}"
        f", {shares[worst]:.2g} deviations: noise in the motion pulls the answer towards zero, or "
        "the motion reaches up to the cut-off; the deviations do not cover that: try other cut-offs"
    )
    severity: Severity = "rejects" if shares.max() > SURE else "doubts"
    yield Note("cut-off", severity, text, on=(name,), value=float(change[worst]), unit=unit)


def _shares(fit: _Fit, change: Floats) -> Floats:
    """Return a change of the values in deviations, zero for what is not known, shape (free,)."""
    spread = np.sqrt(np.diag(fit.scatter.covariance).clip(0))
    known = np.isfinite(change) & (spread > 0) & ~fit.scatter.alone
    return np.where(known, np.abs(change) / np.where(spread > 0, spread, 1.0), 0.0)


def _spread_of_change(first: Scatter, second: Scatter) -> Floats:
    """Return the deviation of the difference of two answers from the same blocks, shape (free,)."""
    parts = [first.shifts, second.shifts]
    count = min(len(part) for part in parts)
    merged = [
        np.add.reduceat(part, np.arange(count) * len(part) // count, axis=0) for part in parts
    ]
    return np.asarray(np.sqrt(((merged[0] - merged[1]) ** 2).sum(axis=0)))


def _summary(
    method: str,
    posed: Posed,
    regressions: Sequence[SampledRegression],
    fit: _Fit,
    ways: Sequence[Note],
) -> Estimate:
    base, basis = posed.base(fit.values), posed.elimination.basis
    free = fit.scatter.covariance
    known = np.where(np.isfinite(base), base, 0.0)
    findings = Findings(
        base=base,
        covariance=basis @ free @ basis.T,
        inflation=1.0,
        prediction=relative_errors([predicted(r, known) for r in regressions]),
        condition_number=fit.solution.condition_number,
        notes=(
            *remarks("record", (w for r in regressions for w in r.record.warnings)),
            *posed.told(fit.solution.undetermined),
            *_alone(posed, fit),
            *_memory(fit),
        ),
        unknown_spread=np.asarray((basis[:, fit.scatter.alone] != 0).any(axis=1)),
    )
    estimate = result(method, posed.full, posed.fixed, posed.model, findings)
    halves, spread = fit.scatter.halves()
    return estimate.with_notes(
        *_said(regressions, fit.scatter),
        *gate.physical(posed.full, estimate),
        *ways,
        *gate.prediction(estimate, {}),
        *gate.agreement(posed.names, halves, spread),
    )


def _alone(posed: Posed, fit: _Fit) -> Iterator[Note]:
    """Say of which parameters no deviation can be stated."""
    names = tuple(n for n, alone in zip(posed.names, fit.scatter.alone, strict=True) if alone)
    if names:
        text = (
            f"a single one of {fit.scatter.blocks} blocks of the record tells {', '.join(names)}: "
            "no deviation can be stated"
        )
        yield Note("blocks", "doubts", text, "excite it more than once", on=names)


def _memory(fit: _Fit) -> Iterator[Note]:
    """Say where blocks are not long enough."""
    if fit.scatter.memory:
        text = (
            f"{fit.scatter.blocks} blocks of the record still depend on one another: deviations "
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
