"""What maximum likelihood makes of its own answer, beside the misfit: the gate, in its terms."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rotorid.errors import InputError
from rotorid.estimate import Estimate
from rotorid.estimators import gate
from rotorid.estimators.gate import Verdict
from rotorid.estimators.likelihood.few_lines import CLOSED, coherence, told_by_few
from rotorid.estimators.likelihood.fit import Fit
from rotorid.estimators.likelihood.halves import (
    LEAST_PERIODS,
    answers_of_parts,
    answers_of_windows,
)
from rotorid.estimators.likelihood.response_leads import growing_mode, lines_alike
from rotorid.estimators.likelihood.straying import against_angle
from rotorid.estimators.likelihood.table_leads import is_table, scale_of_time
from rotorid.estimators.likelihood.turning import told
from rotorid.models import Model

TOO_GOOD = 1e-6
"""Chance of a cost this low below which the noise was taken for more than it is."""
POWER = 12
"""Periods per sensor below which, in closed loop, the misfit test has no power: J / E[J] is .37
there for a right model, since what carries over between periods cancels in the mean."""
MISFIT = 1e-3
"""The p-value below which what neighbouring lines have in common may be the model's error."""
ORDERLY = 3.0
"""Deviations of a correlation from row to row beyond which rows are not independent."""
STILL = 1e-6
"""Scatter over a deviation below which no block tells a value: it is as known beforehand."""
BLOCKS = 8
"""Parts of a record whose scatter is told beside the stated deviations."""


def verdict(model: Model, estimate: Estimate, fit: Fit) -> Verdict:
    """Judge an answer: as a machine, against its halves, and where its cost is too good."""
    total = gate.physical(model, _of_one_record(model, estimate, fit))
    free, std = _free(fit)
    if estimate.status in ("ok", "rejected"):
        halves = answers_of_parts(fit.solution.point, fit.records, 2)
        if halves is not None:
            turning = {fit.prepared.layout.unknowns[i].name for i in fit.problem.affine}
            total += gate.agreement(free, halves, std, turning)
        windows = None if halves is not None else _windows(fit)
        if windows is not None:
            total += gate.agreement(free, *windows)
    total += _time(fit) + _against_its_angle(fit)
    if not any(
        suspect.term.startswith("speed") for suspect in estimate.suspects
    ):  # that says it better
        total += against_angle(fit.solution.point, fit.records)
    if fit.solution.converged and not fit.inference.null.shape[1]:
        layout, at = fit.prepared.layout, fit.solution.point.unknowns
        grows = growing_mode(layout, at, fit.covariance, fit.records)
        total += Verdict(faults=() if grows is None else (grows,))
        total += Verdict(doubts=tuple(told_by_few(fit.solution.point, fit.records)))
    doubts = (*_too_good(fit), *_few_periods(fit), *_scattered(estimate, fit), *_alike(fit))
    return total + Verdict(doubts=tuple(doubts))


def _windows(fit: Fit) -> tuple[np.ndarray, np.ndarray] | None:
    """Return how halves of whole records differ; None where a half is too short to be taken."""
    try:
        return answers_of_windows(fit.solution.point, fit.records)
    except (InputError, np.linalg.LinAlgError):
        return None


def _alike(fit: Fit) -> Iterator[str]:
    """Say where sensors or neighbouring lines are not independent; a misfit is alike too."""
    if fit.shared is not None:
        yield (
            f"{', '.join(fit.shared.names[:8])} share noise on each line, as of a force that was "
            "not measured, where each was stated by itself: deviations are widened by up to "
            f"{fit.shared.factor:.2g}, to what the lines scatter by"
        )
    point = fit.solution.point
    if fit.inference.expectation.p_value(point.cost) < MISFIT:
        return
    for record, at in zip(fit.records, point.records, strict=True):
        said = lines_alike(record, at)
        if said is not None:
            yield said


def _time(fit: Fit) -> Verdict:
    """Judge whether the speeds of tables are in the unit that they are said to be in."""
    point = fit.solution.point
    modes = bool(len(fit.problem.known.modes))
    found = scale_of_time(fit.prepared.layout, point.unknowns, fit.records, modes=modes)
    if found is None:
        return Verdict()
    said, sure = found
    return Verdict(faults=(said,)) if sure else Verdict(doubts=(said,))


def _against_its_angle(fit: Fit) -> Verdict:
    """Judge how the rotation moves against the angle that was given."""
    total = Verdict()
    for record, creep in zip(fit.records, fit.creeps, strict=True):
        if creep is not None and (creep.strays or creep.jumps):
            total += Verdict(faults=(told(record, creep),))
        elif creep is not None and creep.creeps:
            total += Verdict(doubts=(f"{told(record, creep)}; until then its angle is unsure",))
    return total


def _of_one_record(model: Model, estimate: Estimate, fit: Fit) -> Estimate:
    """Return an estimate as one of the first record, where records differ in parameters."""
    whole = fit.prepared.layout
    if whole.named == whole.parameters:
        return estimate
    layout = whole.of_record(0)
    names = [whole.unknowns[i].name for i in layout.held]
    found = {v.name: v for v in estimate.parameters}
    values = [
        replace(found[name], name=parameter)
        for name, parameter in zip(names, model.parameter_names, strict=True)
    ]
    free = [int(i) for i in layout.held if not whole.unknowns[i].fixed]
    return estimate.with_(
        parameters=tuple(values),
        nuisance=(),
        derived=(),
        covariance=fit.covariance[np.ix_(free, free)],
    )


def _free(fit: Fit) -> tuple[list[str], np.ndarray]:
    """Return names and deviations of the free unknowns."""
    layout = fit.prepared.layout
    names = [layout.unknowns[i].name for i in layout.free]
    return names, np.sqrt(np.diag(fit.inference.covariance).clip(0))


def _too_good(fit: Fit) -> Iterator[str]:
    cost, expectation = fit.solution.point.cost, fit.inference.expectation
    if not fit.records:  # measured modes alone: their deviations are what the user stated
        return
    if expectation.dof > 0 and 1 - expectation.p_value(cost) < TOO_GOOD:
        if all(record.lines.covariance.kind == "stated" for record in fit.records):
            yield (
                f"the misfit is {cost:.4g} where {expectation.mean:.4g} is expected: the stated "
                f"std is too large, {np.sqrt(cost / expectation.mean):.2g} times as much would do, "
                "and deviations are too wide"
            )
            return
        yield (
            f"the misfit is {cost:.4g} where {expectation.mean:.4g} is expected, too good to be "
            "chance: the scatter that was taken for noise holds more than noise (settling, drift, "
            "motion that carries over between periods), and deviations are too wide; skip more, "
            "record longer, or look at the record with rotorid inspect"
        )


def _scattered(estimate: Estimate, fit: Fit) -> Iterator[str]:
    """Say where what is left of rejected tables has no order: then noise was understated."""
    if estimate.status != "rejected" or not all(is_table(record) for record in fit.records):
        return
    order, count = 0.0, 0.0
    for at in fit.solution.point.records:
        left = at.problem.data - at.corrected()[0]
        size = np.sqrt((np.abs(left) ** 2).mean(axis=0))
        left = left[:, size > 0] / size[size > 0]
        order += float((left[1:] * left[:-1].conj()).real.sum())
        count += left[1:].size
    # Independent rows give a correlation of zero within 1 / sqrt(2 numbers).
    if abs(order) < ORDERLY * np.sqrt(count / 2):
        times = np.sqrt(fit.solution.point.cost / fit.inference.expectation.mean)
        yield (
            "what the model leaves has no order from row to row: perhaps it is noise, and the "
            f"stated std is too small ({times:.2g} times as much would do), or the speeds are "
            "rounded"
        )


def _few_periods(fit: Fit) -> Iterator[str]:
    for record in fit.records:
        periods, sensors = record.lines.periods, len(record.sensors)
        white = record.lines.covariance.kind == "white"
        if record.lines.scatter is None or not white or periods >= POWER * sensors:
            continue
        if coherence(record) > CLOSED:
            yield (
                f"{periods} periods for {sensors} sensors in closed loop: below {POWER * sensors} "
                "the misfit hardly tells a wrong model from a right one, and deviations are too "
                "wide; record more periods"
            )


def block_scatter(fit: Fit) -> str | None:
    """Say how much the answers of blocks of the record scatter, against the stated deviations."""
    most = min((r.lines.periods // LEAST_PERIODS for r in fit.records), default=0)
    parts = min(BLOCKS, most)
    answers = answers_of_parts(fit.solution.point, fit.records, parts) if parts >= 3 else None
    if answers is None:
        return None
    _, std = _free(fit)
    with np.errstate(over="ignore"):  # blocks of an estimate astray may end anywhere
        spread = answers.std(axis=0, ddof=1) / np.sqrt(parts)
    stated = (std > 0) & np.isfinite(std) & (spread > STILL * std) & np.isfinite(spread)
    ratio = spread[stated] / std[stated]
    if not ratio.size:
        return None
    return (
        f"between {parts} blocks of the record the answers scatter by {ratio.min():.2g} to "
        f"{ratio.max():.2g} times the stated deviations: that is how well this record repeats "
        "itself, not how right the model is"
    )
