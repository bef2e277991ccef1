"""Records that a machine would give: for cures that are tried and for accuracy beforehand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotorid.estimators.likelihood.assembly import assemble
from rotorid.estimators.likelihood.cost import Evaluation, Likelihood
from rotorid.estimators.likelihood.unknowns import Layout
from rotorid.observation import Observation
from rotorid.record import Complexes, Floats


def respond(likelihood: Likelihood, unknowns: Floats) -> Complexes:
    """Return the lines that the channels would hold without noise, shape (line, channel).

    The measured inputs are kept; the sensors read what the equations of motion make of them,
    through the calibration that the unknowns say.
    """
    at = likelihood.evaluate(unknowns)
    found = likelihood.data.copy()
    sensors = slice(at.forces, None)
    found[:, sensors] = predicted_readings(at) / at.state.factors[:, sensors]
    return found


def predicted_readings(at: Evaluation) -> Complexes:
    """Return what the sensors should read, ``y = C Z^-1 (B u + g) + r``, (line, sensor)."""
    p, equations, forces = at.problem, at.equations, at.forces
    true = at.state.factors * p.data
    true[:, :forces] -= at.state.readings[:, :forces]
    right = (at.inputs[:, :equations, :forces] @ true[:, :forces, None])[:, :, 0]
    right += (at.load @ at.mu)[:, :equations]
    if at.ends is not None:
        right += at.loose[:, :equations]
    stiffness = -at.stiffness[:, :equations]
    motion = np.stack(
        [np.linalg.lstsq(z, f, rcond=None)[0] for z, f in zip(stiffness, right, strict=True)]
    )
    indirect = -(at.stiffness[:, equations : p.rows] @ motion[:, :, None])[:, :, 0]
    reads = np.concatenate([indirect, motion @ p.sensing.reads.T], axis=1)
    return np.asarray(reads + at.state.readings[:, forces:])


def simulated(
    layout: Layout, observation: Observation, unknowns: Floats, number: int = 0
) -> Likelihood:
    """Return the likelihood of a record whose sensors read exactly what the unknowns say.

    Its inputs, lines, rotor angle and covariance are kept.
    """
    lines = observation.lines
    mean = np.empty_like(lines.mean)
    mean[:, list(observation.order)] = respond(assemble(layout, observation, number), unknowns)
    return assemble(layout, observation.with_lines(replace(lines, mean=mean)), number)
