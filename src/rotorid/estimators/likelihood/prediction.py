"""Prediction of a record from the cost of maximum likelihood at a point."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.estimators.likelihood.cost import Evaluation
from rotorid.estimators.likelihood.response import predicted_readings
from rotorid.estimators.prediction import Predicted, lay_to_inputs
from rotorid.observation import Observation


def by_likelihood(
    records: Sequence[Observation], evaluations: Sequence[Evaluation]
) -> list[Predicted]:
    """Predict inputs, or readings where a record hides a coordinate; linear models."""
    hidden = any(r.hidden or not r.inputs or r.lines.passive for r in records)
    return [
        (_readings if hidden else _inputs)(record, at)
        for record, at in zip(records, evaluations, strict=True)
    ]


def _inputs(record: Observation, at: Evaluation) -> Predicted:
    p, equations, forces = at.problem, at.equations, at.forces
    true = at.state.factors * p.data - at.state.readings
    motion = true[:, p.inputs :] @ p.sensing.right.T
    left = (at.stiffness[:, :equations] @ motion[:, :, None])[:, :, 0]
    left += at.loads[:, :equations]
    if at.ends is not None:
        left += at.loose[:, :equations]
    matrix = at.inputs[:, :equations, :forces]
    names = record.model.inputs
    units = tuple(channel.unit for channel in record.inputs)  # A, where a law makes the force
    predicted = lay_to_inputs(-left, matrix) if np.abs(matrix).any() else true[:, :forces]
    return Predicted(names, units, true[:, :forces], predicted, p.multiplicity)


def _readings(record: Observation, at: Evaluation) -> Predicted:
    channels = [s.channel for s in (*record.indirect, *record.direct)]
    measured = (at.state.factors * at.problem.data)[:, at.forces :]
    return Predicted(
        tuple(c.name for c in channels),
        tuple(c.unit for c in channels),
        measured,
        predicted_readings(at),
        at.problem.multiplicity,
    )
