"""Whether a reduced rotor stands for the whole one: what the estimate would move by.

On each line the whole rotor's other coordinates follow exactly from those that are kept. What the
forces on the kept coordinates then differ by, whitened, is a change of the residual, and moves the
estimate like any other: to first order by ``-C J^T dr``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from rotorid.estimators.likelihood.cost import Evaluation
from rotorid.estimators.likelihood.problem import Point
from rotorid.estimators.modes import Mode
from rotorid.models import Model
from rotorid.models.linear import LinearForm
from rotorid.observation import Observation, bind
from rotorid.record import Complexes, Floats, Integers

SHARE = 1e-6
"""Shapes that come to less of the largest are left out at first: records tell no more digits."""
FINER = 1e-2
"""By how much smaller shapes are taken too, where the reduced rotor is not near enough."""
SMALLEST = 1e-13
"""Shapes below are rounding: where these do not do, the whole rotor is solved."""
NEGLIGIBLE = 0.1
"""Deviations that the reduction may move any parameter by: it then adds 1 % to none of them."""
LINES = 200
"""Lines on which the whole rotor is solved: they stand for the others."""


@dataclass(frozen=True)
class Reduced:
    """Records bound to a reduced model, and the share of the shapes that were left out."""

    records: tuple[Observation, ...]
    share: float

    @property
    def model(self) -> Model:
        """The reduced model."""
        return self.records[0].model

    def finer(self, values: Mapping[str, float]) -> Reduced:
        """Return the records bound to a model with more shapes, taken at these values."""
        return reduced(self.records, values, share=FINER * self.share)


def reduced(
    records: Sequence[Observation],
    values: Mapping[str, float],
    modes: Sequence[Mode] = (),
    share: float = SHARE,
) -> Reduced:
    """Bind records to a model with fewer coordinates, where that pays; `modes` were measured."""
    model = records[0].model
    if modes:  # of other configurations, and beyond the band
        return Reduced(tuple(records), share)
    reads = {model.coordinates[t.coordinate] for r in records for s in r.sensors for t in s.terms}
    for record in records:
        for channel in record.inputs:
            reads |= set() if channel.drive is None else set(channel.drive.position)
    omega, speed = (
        np.concatenate([getattr(r.lines, name) for r in records]) for name in ("omega", "speed")
    )
    smaller = model.reduced(reads, omega, speed, values, share if share > SMALLEST else 0.0)
    if smaller is model:
        return Reduced(tuple(records), share)
    return Reduced(tuple(moved(r, smaller) for r in records), share)


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
    whole, basis = getattr(record.model, "whole", None), getattr(record.model, "reduction", None)
    if whole is not None and basis is not None:
        values = point.unknowns[point.problem.layout.of_record(number).held]
        count = at.problem.lines
        chosen = np.unique(np.linspace(0, count - 1, min(count, LINES)).round().astype(np.int64))
        motion = at.corrected()[1][chosen] * at.problem.scales.coordinates
        lines = record.lines
        missing = _missing_force(
            whole.require_linear(),
            record.model.require_linear(),
            basis.kept,
            np.setdiff1d(np.arange(len(basis.transform)), basis.kept),
            values,
            lines.omega[chosen],
            lines.speed[chosen],
            motion,
        )
        kept = len(basis.kept)
        scaled = missing / at.problem.scales.rows[:kept]
        rows[chosen, :kept, 0] = -scaled * (count / len(chosen))
    return at.whiten(rows)[:, 0]


def _missing_force(
    whole: LinearForm,
    small: LinearForm,
    kept: Integers,
    inner: Integers,
    values: Floats,
    omega: Floats,
    speed: Floats,
    motion: Complexes,
) -> Complexes:
    """Return what the whole rotor asks for at the kept coordinates more than the reduced one."""
    found = np.zeros((len(omega), len(kept)), dtype=np.complex128)
    for value in np.unique(speed):
        for k in np.flatnonzero(speed == value):
            stiffness = whole.dynamic_stiffness(omega[k : k + 1], values, float(value))[0]
            less = small.dynamic_stiffness(omega[k : k + 1], values, float(value))[0]
            here = motion[k]
            follow = -stiffness[np.ix_(inner, kept)] @ here[: len(kept)]
            there = _banded(stiffness[np.ix_(inner, inner)], follow)
            force = stiffness[np.ix_(kept, kept)] @ here[: len(kept)]
            force += stiffness[np.ix_(kept, inner)] @ there
            found[k] = force - (less @ here)[: len(kept)]
    return found


def _banded(matrix: Complexes, right: Complexes) -> Complexes:
    """Solve with a matrix whose entries stand near its diagonal, as those of a shaft do."""
    if not len(matrix):
        return right
    size = 1 / np.sqrt(np.abs(np.diag(matrix)))
    scaled = size[:, None] * matrix * size
    row, column = np.nonzero(scaled)
    width = int(np.abs(row - column).max())
    bands = np.zeros((2 * width + 1, len(matrix)), dtype=np.complex128)
    bands[width + row - column, column] = scaled[row, column]
    solved = scipy.linalg.solve_banded((width, width), bands, size * right)
    return np.asarray(size * solved)
