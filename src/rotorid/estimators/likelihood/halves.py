"""How estimates from parts of a record differ from that of the whole, to first order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.estimators.likelihood.cost import Evaluation
from rotorid.estimators.likelihood.inference import along_relations
from rotorid.estimators.likelihood.problem import Point
from rotorid.estimators.likelihood.tangent import RANK
from rotorid.observation import Observation
from rotorid.record import Complexes, Floats

LEAST_PERIODS = 4
"""Periods of a part from which it is held against others."""


def answers_of_parts(point: Point, records: Sequence[Observation], parts: int) -> Floats | None:
    """Return how the free unknowns of each part of the periods differ, (part, free).

    The change of the mean residual over the periods of a part, taken back through the Jacobian.
    ``None`` where a record has too few periods.
    """
    if not records or any(r.lines.periods < parts * LEAST_PERIODS for r in records):
        return None
    columns = [
        _changes(record, at, parts) for record, at in zip(records, point.records, strict=True)
    ]
    relations = np.zeros((len(point.known), parts))
    changes = np.concatenate([*columns, relations])
    jacobian, scale, basis = along_relations(point, point.problem.exact)
    solved = np.linalg.lstsq(jacobian, changes, rcond=RANK)[0]
    return np.asarray(-(scale[:, None] * (basis @ solved)).T)


def _changes(record: Observation, at: Evaluation, parts: int) -> Floats:
    """Return the change of the whitened residual in each part, (real equation, part)."""
    scatter: Complexes | None = record.lines.scatter
    assert scatter is not None
    every = at.period_residual(scatter[:, :, list(record.order)])
    mean = every.mean(axis=0)
    means = [part.mean(axis=0) - mean for part in np.array_split(every, parts)]
    return at.stacked(np.stack(means, axis=2))
