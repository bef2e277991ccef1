"""Whether a reduced rotor stands for the whole one: what the estimate would move by.

On each line the whole rotor's other coordinates follow exactly from those that are kept. What the
forces on the kept coordinates then differ by, whitened, is a change of the residual, and moves the
estimate like any other: to first order by ``-C J^T dr``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotorid.estimators.likelihood.cost import Evaluation
from rotorid.estimators.likelihood.problem import Point
from rotorid.estimators.likelihood.unknowns import linear_form
from rotorid.estimators.modes import Mode
from rotorid.models import Model
from rotorid.models.rotor.model import RotorModel
from rotorid.models.rotor.reduction import Banded
from rotorid.observation import Observation, bind, combined
from rotorid.record import Complexes, Floats, Integers

ROUGH = 1e-4
"""Shapes that come to less of the largest are left out on the way to the minimum."""
SHARE = 1e-6
"""The same at the minimum, at first: records tell no more digits."""
FINER = 1e-2
"""By how much smaller shapes are taken too, where those at the minimum are not near enough."""
SMALLEST = 1e-13
"""Shapes below are rounding: where these do not do, the whole rotor is solved."""
NEGLIGIBLE = 0.01
"""Deviations that the reduction may move any parameter by: nothing that is printed shows it."""
LINES = 200
"""Lines on which the whole rotor is solved: they stand for the others."""


def reduced(
    records: Sequence[Observation],
    values: Mapping[str, float],
    modes: Sequence[Mode] = (),
    share: float = SHARE,
) -> tuple[Observation, ...]:
    """Bind records to a model with fewer coordinates, where that pays; `modes` were measured."""
    model = records[0].model
    if modes:  # of other configurations, and beyond the band
        return tuple(records)
    reads = {model.coordinates[t.coordinate] for r in records for s in r.sensors for t in s.terms}
    for record in records:
        for channel in record.inputs:
            position = {} if channel.drive is None else channel.drive.position
            terms = combined(position, model, "a force law at", channel.name)
            reads |= {model.coordinates[t.coordinate] for t in terms}
    omega, speed = (
        np.concatenate([getattr(r.lines, name) for r in records]) for name in ("omega", "speed")
    )
    smaller = model.reduced(reads, omega, speed, values, share if share > SMALLEST else 0.0)
    return tuple(records) if smaller is model else tuple(moved(r, smaller) for r in records)


def moved(record: Observation, model: Model) -> Observation:
    """Return a record bound to a model with the same channels and other coordinates."""
    return replace(bind(model, record.lines), periodic=record.periodic, own=record.own)


def shift_by_reduction(point: Point, covariance: Floats, records: Sequence[Observation]) -> float:
    """Return the deviations by which the whole rotor would move the parameter that it moves most.

    `covariance` is that of the free unknowns.
    """
    pairs = zip(point.records, records, strict=True)
    parts = [_change(at, record, point, number) for number, (at, record) in enumerate(pairs)]
    known = np.zeros(len(point.known))
    change = point.jacobian.T @ np.concatenate([*parts, known])
    std = np.sqrt(np.diag(covariance).clip(0))
    shift = covariance @ change
    return float(np.max(np.abs(shift[std > 0]) / std[std > 0], initial=0.0))


def _change(at: Evaluation, record: Observation, point: Point, number: int) -> Floats:
    """Return what the whitened residual of a record changes by, as if all lines were solved."""
    rows = np.zeros((at.problem.lines, at.problem.all_rows, 1), dtype=np.complex128)
    model = record.model
    if isinstance(model, RotorModel) and model.whole is not None and model.reduction is not None:
        held = point.problem.layout.of_record(number).held
        count, kept = at.problem.lines, model.reduction.kept
        chosen = np.unique(np.linspace(0, count - 1, min(count, LINES)).round().astype(np.int64))
        motion = at.corrected()[1][chosen] * at.problem.scales.coordinates
        values, lines = point.unknowns[held], record.lines
        named = dict(zip(model.parameter_names, values.tolist(), strict=True))
        whole, missing = (
            Banded.of(model.whole.pieces, named),
            _force(record, values, chosen, motion),
        )
        for k, line in enumerate(chosen.tolist()):
            omega, speed = float(lines.omega[line]), float(lines.speed[line])
            missing[k] = whole.force(kept, motion[k, : len(kept)], omega, speed) - missing[k]
        scaled = missing / at.problem.scales.rows[: len(kept)]
        rows[chosen, : len(kept), 0] = -scaled * (count / len(chosen))
    return at.whiten(rows)[:, 0]


def _force(record: Observation, values: Floats, chosen: Integers, motion: Complexes) -> Complexes:
    """Return the forces on the kept coordinates by which a reduced rotor moves so, (line, kept)."""
    model, lines = record.model, record.lines
    assert isinstance(model, RotorModel)
    assert model.reduction is not None
    count = len(model.reduction.kept)
    found = np.zeros((len(chosen), count), dtype=np.complex128)
    for speed in np.unique(lines.speed[chosen]):
        here = lines.speed[chosen] == speed
        omega = lines.omega[chosen[here]]
        stiffness = linear_form(model).dynamic_stiffness(omega, values, float(speed))
        found[here] = (stiffness[:, :count] @ motion[here][:, :, None])[:, :, 0]
    return found
