"""Records that a machine would give: for cures that are tried and for accuracy beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.estimators.likelihood.assembly import assemble, channel_order
from rotorid.estimators.likelihood.cost import Likelihood
from rotorid.estimators.likelihood.unknowns import Layout
from rotorid.record import Channel, Complexes, Floats, PeriodicRecord
from rotorid.signals.covariance import LineCovariance


def respond(likelihood: Likelihood, unknowns: Floats) -> Complexes:
    """Return the lines that the channels would hold without noise, shape (line, channel).

    The measured inputs are kept; the sensors read what the equations of motion make of them,
    through the calibration that the unknowns say.
    """
    at = likelihood.evaluate(unknowns)
    p, inputs = likelihood, likelihood.inputs
    force = at.state.factors[:, :inputs] * p.data[:, :inputs]
    right = (at.inputs[:, : p.rows] @ force[:, :, None])[:, :, 0] + at.load @ at.mu
    stiffness = -at.stiffness[:, : p.rows]
    motion = np.stack(
        [np.linalg.lstsq(z, f, rcond=None)[0] for z, f in zip(stiffness, right, strict=True)]
    )
    reading = (motion @ p.sensing.reads.T + at.state.runout) / at.state.factors[:, inputs:]
    return np.concatenate([p.data[:, :inputs], reading], axis=1)


def simulated(
    layout: Layout,
    record: PeriodicRecord,
    covariance: LineCovariance,
    unknowns: Floats,
    number: int = 0,
) -> Likelihood:
    """Return the likelihood of a record whose sensors read exactly what the unknowns say."""
    order = channel_order(layout.model, record)
    blank = assemble(layout, record, covariance, number)
    spectra = np.empty((1, len(record.harmonics), len(record.channels)), dtype=np.complex128)
    spectra[0][:, order] = respond(blank, unknowns)
    return assemble(layout, replace(record, spectra=spectra), covariance, number)


def at_speed(record: PeriodicRecord, speed: float) -> PeriodicRecord:
    """Return the record's plan at another speed in rad/s."""
    return replace(record, speed=speed, angle=speed * record.time, phase_known=True)


def with_sensor(
    record: PeriodicRecord, covariance: LineCovariance, channel: Channel, beside: Sequence[int]
) -> tuple[PeriodicRecord, LineCovariance]:
    """Return the record's plan with one more sensor, as noisy as those `beside` on average."""
    lines, count = len(record.harmonics), len(record.channels)
    extra = np.zeros((record.periods, lines, 1), dtype=np.complex128)
    matrices = np.zeros((lines, count + 1, count + 1), dtype=np.complex128)
    matrices[:, :count, :count] = covariance.matrices
    variance = np.diagonal(covariance.matrices, axis1=1, axis2=2).real[:, list(beside)].mean(axis=1)
    matrices[:, count, count] = variance
    samples = np.zeros((record.samples, 1))
    longer = replace(
        record,
        channels=(*record.channels, channel),
        spectra=np.concatenate([record.spectra, extra], axis=2),
        variance=np.concatenate([record.variance, samples], axis=1),
        mean=np.concatenate([record.mean, samples], axis=1),
    )
    return longer, replace(covariance, matrices=matrices)
