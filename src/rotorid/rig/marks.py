"""Columns of the rotor angle: a counter of an encoder's lines, a keyphasor's pulses."""

from __future__ import annotations

import numpy as np

from rotorid.errors import InputError
from rotorid.record import Floats
from rotorid.rig.parts import Encoder, Keyphasor
from rotorid.rig.speed import Rotation
from rotorid.signals.angle import MeasuredAngle, encoder_angle, keyphasor_angle, pulse_times


def encoder_counts(
    encoder: Encoder, rotation: Rotation, time: Floats, rng: np.random.Generator
) -> Floats:
    """Return the counter at times in s, afresh at every revolution."""
    angle = rotation.angle_at(time) + encoder.jitter * rng.normal(size=len(time))
    return np.asarray(np.floor(angle * (encoder.lines / (2 * np.pi))) % encoder.lines)


def keyphasor_pulses(
    mark: Keyphasor, rotation: Rotation, time: Floats, rng: np.random.Generator
) -> Floats:
    """Return the sampled pulses: high from phi = 2 pi n, with flanks of two samples."""
    step = time[1] - time[0]
    turns = rotation.angle_at(time[[0, -1]]) / (2 * np.pi)
    speeds = rotation.speed_at(time)
    if speeds.min() <= 0:
        raise InputError(
            f"a keyphasor at {speeds.min():.4g} rad/s", "a rotor that turns", "leave it out"
        )
    shortest = 2 * np.pi * min(mark.width, 1 - mark.width) / speeds.max()
    if shortest < 4 * step:
        raise InputError(
            f"pulses of {shortest / step:.3g} samples",
            "four or more, so that their flanks can be seen",
            "sample faster, or make the mark wider",
            place="keyphasor",
        )
    numbers = np.arange(np.floor(turns[0]) - 1, np.ceil(turns[1]) + 2)
    rise = _times_of(numbers, rotation, time) + mark.jitter * rng.normal(size=len(numbers))
    fall = _times_of(numbers + mark.width, rotation, time)
    knots = np.stack([rise - step, rise + step, fall - step, fall + step], axis=1).ravel()
    level = np.interp(time, knots, np.tile([0.0, 1.0, 1.0, 0.0], len(numbers)))
    return np.asarray(level + mark.noise * rng.normal(size=len(level)))


def _times_of(turns: Floats, rotation: Rotation, time: Floats) -> Floats:
    """Return when the rotor has made so many turns (Newton's method on the angle)."""
    mean = (rotation.angle_at(time[-1]) - rotation.angle_at(time[0])) / (time[-1] - time[0])
    t = time[0] + (2 * np.pi * turns - rotation.angle_at(time[0])) / mean
    for _ in range(20):
        t = t - (rotation.angle_at(t) - 2 * np.pi * turns) / rotation.speed_at(t)
    return np.asarray(t)


def read_mark(
    mark: Encoder | Keyphasor | None, column: Floats | None, sample_rate: float
) -> MeasuredAngle | None:
    """Return what a reader makes of the column of the angle, if there is one."""
    if column is None:
        return None
    if isinstance(mark, Encoder):
        return encoder_angle(column, sample_rate, per_revolution=mark.lines, lines=mark.lines)
    return keyphasor_angle(pulse_times(column, sample_rate), len(column), sample_rate)
