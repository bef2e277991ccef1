"""Records that a machine would give: for cures that are tried and for accuracy beforehand."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from rotorid.estimators.likelihood.assembly import assemble
from rotorid.estimators.likelihood.cost import Evaluation, Likelihood
from rotorid.estimators.likelihood.unknowns import Layout
from rotorid.observation import Observation
from rotorid.record import Complexes, Floats

SINGULAR = 1e10
"""|Z| |q| / |f| from which on a line is taken for singular, as at DC where the rotor floats: the
sharpest resonance of a machine with damping gives 1e4 or so, rounding leaves 1e16."""


def respond(likelihood: Likelihood, unknowns: Floats) -> Complexes:
    """Return the lines that the channels would hold without noise, shape (line, channel).

    The measured inputs are kept; the sensors read what the equations of motion make of them,
    through the calibration that the unknowns say.
    """
    return response(likelihood.evaluate(unknowns))


def response(at: Evaluation) -> Complexes:
    """Return the same as `respond`, from the machine at a point."""
    found = at.problem.data.copy()
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
    motion = _motion(stiffness, right)
    indirect = -(at.stiffness[:, equations : p.rows] @ motion[:, :, None])[:, :, 0]
    own = np.arange(p.rows - equations)  # the equation of a reading is scaled, as all are
    indirect /= at.inputs[:, equations + own, forces + own]
    reads = np.concatenate([indirect, motion @ p.sensing.reads.T], axis=1)
    return np.asarray(reads + at.state.readings[:, forces:])


def _motion(stiffness: Complexes, right: Complexes) -> Complexes:
    """Solve ``Z q = f`` on each line, (line, coordinate); the least q where Z is singular."""
    found: Complexes = np.full((len(right), stiffness.shape[2]), np.nan, dtype=np.complex128)
    if stiffness.shape[1] == stiffness.shape[2]:
        with suppress(np.linalg.LinAlgError):
            found = np.asarray(
                np.linalg.solve(stiffness, right[:, :, None])[:, :, 0], dtype=complex
            )
    with np.errstate(over="ignore", invalid="ignore"):  # a motion beyond all numbers is none
        size = np.linalg.norm(stiffness, axis=(1, 2)) * np.linalg.norm(found, axis=1)
    for line in np.flatnonzero(~(size <= SINGULAR * np.linalg.norm(right, axis=1))):
        found[line] = np.linalg.lstsq(stiffness[line], right[line], rcond=None)[0]
    return found


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
