"""What a machine at a point of the search reads and needs."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from rotorid.core.values import Complexes, Floats
from rotorid.data.observation import Observation, Records
from rotorid.likelihood.assembly import assemble
from rotorid.likelihood.cost import Evaluation, Likelihood
from rotorid.likelihood.layout import Layout
from rotorid.linear.regression import Predicted, lay_to_inputs

SINGULAR = 1e10
"""|Z| |q| / |f| from which on a line is taken for singular, as at DC where the rotor floats: the
sharpest resonance of a machine with damping gives 1e4 or so, rounding leaves 1e16."""


def responses(alike: Sequence[Evaluation]) -> list[Complexes]:
    """Return the lines without noise, (line, channel): inputs as measured, sensors by the model.

    Of machines that differ in what drives them, and is read, alone.
    """
    found: list[Complexes] = []
    if not alike:
        return found
    stiffness = -alike[0].stiffness[:, : alike[0].equations]
    motions = _motion(stiffness, np.stack([_pushed(at) for at in alike], axis=2))
    for at, motion in zip(alike, np.moveaxis(motions, 2, 0), strict=True):
        lines, sensors = at.problem.data.copy(), slice(at.forces, None)
        lines[:, sensors] = _readings(at, motion) / at.state.factors[:, sensors]
        found.append(lines)
    return found


def _pushed(at: Evaluation) -> Complexes:
    equations, forces = at.equations, at.forces
    true = at.state.factors[:, :forces] * at.problem.data[:, :forces]
    true -= at.state.readings[:, :forces]
    right = (at.inputs[:, :equations, :forces] @ true[:, :, None])[:, :, 0]
    return np.asarray(right + (at.loads + at.loose)[:, :equations])


def _readings(at: Evaluation, motion: Complexes) -> Complexes:
    return np.asarray(at.readings_of(motion) + at.state.readings[:, at.forces :])


def _motion(stiffness: Complexes, right: Complexes) -> Complexes:
    """Solve ``Z q = f`` on each line, (line, coordinate, f); the least q where Z is singular."""
    shape = (len(right), stiffness.shape[2], right.shape[2])
    found: Complexes = np.full(shape, np.nan, dtype=np.complex128)
    if stiffness.shape[1] == stiffness.shape[2]:
        with suppress(np.linalg.LinAlgError):
            found = np.asarray(np.linalg.solve(stiffness, right), dtype=complex)
    with np.errstate(over="ignore", invalid="ignore"):  # a motion beyond all numbers is none
        size = _length(stiffness.reshape(len(stiffness), -1, 1)) * _length(found)
    for line, column in np.argwhere(~(size <= SINGULAR * _length(right))):
        least = np.linalg.lstsq(stiffness[line], right[line, :, column], rcond=None)[0]
        found[line, :, column] = least
    return found


def _length(columns: Complexes) -> Floats:
    parts = np.ascontiguousarray(columns).view(float).reshape(*columns.shape, 2)
    return np.asarray(np.sqrt(np.einsum("krcp,krcp->kc", parts, parts)))


def simulated(layout: Layout, record: Observation, unknowns: Floats, number: int = 0) -> Likelihood:
    """Return the likelihood of a record whose sensors read exactly what the unknowns say."""
    lines = record.lines
    mean = np.empty_like(lines.mean)
    likelihood = assemble(layout, record, number)
    mean[:, likelihood.order] = responses([Evaluation(likelihood, unknowns)])[0]
    return assemble(layout, record.with_lines(replace(lines, mean=mean)), number)


def by_likelihood(records: Records, evaluations: Sequence[Evaluation]) -> list[Predicted]:
    """Predict inputs, or readings where a record hides a coordinate; linear models."""
    hidden = any(r.hidden or not r.inputs or r.lines.passive for r in records)
    predicted = _predicted_readings if hidden else _inputs
    return [predicted(*pair) for pair in zip(records, evaluations, strict=True)]


def _inputs(record: Observation, at: Evaluation) -> Predicted:
    p, equations, forces = at.problem, at.equations, at.forces
    true = at.state.factors * p.data - at.state.readings
    motion = true[:, p.inputs :] @ p.sensing.right.T
    left = (at.stiffness[:, :equations] @ motion[:, :, None])[:, :, 0]
    left += (at.loads + at.loose)[:, :equations]
    matrix = at.inputs[:, :equations, :forces]
    names = record.model.inputs
    units = tuple(channel.unit for channel in record.inputs)  # A, where a law makes the force
    predicted = lay_to_inputs(-left, matrix) if np.abs(matrix).any() else true[:, :forces]
    return Predicted(names, units, true[:, :forces], predicted, p.multiplicity)


def _predicted_readings(record: Observation, at: Evaluation) -> Predicted:
    """Return what the sensors should read, ``y = C Z^-1 (B u + g) + r``."""
    channels = [record.lines.channels[column] for column in at.problem.order[at.forces :]]
    measured = (at.state.factors * at.problem.data)[:, at.forces :]
    motion = _motion(-at.stiffness[:, : at.equations], _pushed(at)[:, :, None])
    readings = _readings(at, motion[:, :, 0])
    names, units = tuple(c.name for c in channels), tuple(c.unit for c in channels)
    return Predicted(names, units, measured, readings, at.problem.multiplicity)
