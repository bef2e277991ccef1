"""How estimates from parts of a record differ from that of the whole, to first order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.estimators.likelihood.assembly import assemble
from rotorid.estimators.likelihood.cost import Evaluation
from rotorid.estimators.likelihood.inference import along_relations
from rotorid.estimators.likelihood.problem import Point
from rotorid.estimators.likelihood.tangent import RANK
from rotorid.lines import PeriodicClock
from rotorid.observation import Observation
from rotorid.record import Complexes, Floats

TELLING = 1e-6
"""Singular values of a half's scaled Jacobian below this share of the largest tell nothing."""
LEAST_PERIODS = 4
"""Periods of a part from which it is held against others."""


def answers_of_parts(point: Point, records: Sequence[Observation], parts: int) -> Floats | None:
    """Return how the free unknowns of each part of the periods differ, (part, free).

    The change of the mean residual over the periods of a part, its loads by the rotor angle in that
    part, taken back through the Jacobian.
    ``None`` where a record has too few periods.
    """
    if not records or any(r.lines.periods < parts * LEAST_PERIODS for r in records):
        return None
    columns = [
        _changes(record, at, parts) + _turned(point, number, record, parts)
        for number, (record, at) in enumerate(zip(records, point.records, strict=True))
    ]
    relations = np.zeros((len(point.known), parts))
    changes = np.concatenate([*columns, relations])
    jacobian, scale, basis = along_relations(point, point.problem.exact)
    solved = np.linalg.lstsq(jacobian, changes, rcond=RANK)[0]
    return np.asarray(-(scale[:, None] * (basis @ solved)).T)


def answers_of_windows(
    point: Point, records: Sequence[Observation]
) -> tuple[Floats, Floats] | None:
    """Return how the free unknowns of each half of whole records differ, and how they may.

    Shapes (half, free) and (free,): one step of Gauss-Newton from the answer with the lines of that
    half alone, and the deviation that half the difference has; zero where a half does not tell it.
    ``None`` where a record was not taken whole.
    """
    if not records or any(r.lines.parts is None for r in records):
        return None
    halves = [r.lines.parts(2) if r.lines.parts else [] for r in records]
    steps, variances = [], []
    for half in range(2):
        likelihoods = []
        for number, record in enumerate(records):
            lines = halves[number][half]
            if lines.names != record.lines.names:
                return None
            likelihoods.append(assemble(point.problem.layout, record.with_lines(lines), number))
        here = replace(point.problem, likelihoods=tuple(likelihoods)).at(point.unknowns)
        jacobian, scale, basis = along_relations(here, point.problem.exact)
        left, values, right = np.linalg.svd(jacobian, full_matrices=False)
        told = values > TELLING * values.max(initial=0.0)
        directions = scale[:, None] * (basis @ right.T)
        root = directions[:, told] / values[told]
        lost = (np.abs(directions[:, ~told]) > TELLING * scale[:, None]).any(axis=1)
        steps.append(-root @ (left[:, told].T @ here.residual))
        variances.append(np.where(lost, np.nan, (root**2).sum(axis=1)))
    std = np.sqrt(sum(variances)) / 2
    return np.array(steps), np.where(np.isfinite(std), std, 0.0)


def _changes(record: Observation, at: Evaluation, parts: int) -> Floats:
    """Return the change of the whitened residual in each part, (real equation, part)."""
    scatter: Complexes | None = record.lines.scatter
    assert scatter is not None
    every = at.period_residual(scatter[:, :, list(record.order)])
    mean = every.mean(axis=0)
    means = [part.mean(axis=0) - mean for part in np.array_split(every, parts)]
    return at.stacked(np.stack(means, axis=2))


def _turned(point: Point, number: int, record: Observation, parts: int) -> Floats:
    """Return the change that the loads make in each part, (real equation, part).

    Where the rotation is not synchronous with the periods they turn from part to part, as the data
    do if the speed is the one stated.
    """
    at, clock = point.records[number], record.lines.clock
    changes = np.zeros((len(at.residual), parts))
    if not isinstance(clock, PeriodicClock) or len(clock.grid(timed=False)[0]) == 1:
        return changes
    whole = at.problem
    for k, part in enumerate(np.array_split(np.arange(len(clock.time)), parts)):
        shorter = replace(clock, time=clock.time[part], angle=clock.angle[part])
        lines = replace(record.lines, clock=shorter)
        own = assemble(point.problem.layout, record.with_lines(lines), number)
        if own.load.shape != whole.load.shape:
            return np.zeros_like(changes)
        moved = np.tensordot(at.state.phase, own.load - whole.load, 1) @ at.load_factors
        read = own.calibration.at(at.unknowns).readings - at.state.readings
        rows = -(at.plain @ read[:, :, None])[:, :, 0]
        rows[:, : whole.rows] += moved
        changes[:, k] = at.whiten(rows[:, :, None])[:, 0]
    return changes
