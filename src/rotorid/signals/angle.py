"""Rotor angle from an encoder or from a pulse once per revolution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import interpolate

from rotorid.errors import InputError
from rotorid.record import Floats

_END_PULSES = 12


@dataclass(frozen=True)
class MeasuredAngle:
    """Rotor angle at each sample, and how the rotor turns.

    Parameters
    ----------
    angle : array, shape (sample,)
        phi in rad, continuous.
    speed : float
        Mean speed in rad/s, by regression over the whole record.
    drift : float
        Change of the speed in rad/s^2, by the same regression.
    scatter : float
        Root mean square of what the regression leaves, in rad: jitter, counting, wandering.
    """

    angle: Floats
    speed: float
    drift: float
    scatter: float


def _regression(time: Floats, angle: Floats) -> tuple[float, float, float]:
    """Return mean speed, drift and scatter of angles at some times."""
    middle, half = (time[0] + time[-1]) / 2, max((time[-1] - time[0]) / 2, 1e-300)
    s = (time - middle) / half
    degree = min(2, len(time) - 1)
    fit = np.polynomial.polynomial.polyfit(s, angle, degree)
    left = angle - np.polynomial.polynomial.polyval(s, fit)
    drift = 2 * fit[2] / half**2 if degree == 2 else 0.0
    return float(fit[1] / half), float(drift), float(np.sqrt(np.mean(left**2)))


def encoder_angle(
    readings: ArrayLike,
    sample_rate: float,
    *,
    per_revolution: float = 2 * np.pi,
    lines: int | None = None,
    source: str = "",
) -> MeasuredAngle:
    """Return the angle from readings of an encoder or a resolver, one per sample.

    A counter shows the last line that has passed, half a line less than the angle on average;
    with `lines` that half is added. Readings may start afresh at every revolution.

    Parameters
    ----------
    readings : array, shape (sample,)
        Angle or counts.
    sample_rate : float
        Hz.
    per_revolution : float
        Reading after one revolution: 2 pi, 360, or the counts.
    lines : int, optional
        Steps of a revolution that the reading can show.
    source : str
        For messages.

    Returns
    -------
    MeasuredAngle

    Raises
    ------
    InputError
        For a reading that is not finite, an encoder that runs backwards or turns around, and one
        that moves by half a revolution or more between samples.

    Examples
    --------
    >>> counts = np.floor(1024 * 14.0 * np.arange(1000) / 1000.0) % 1024
    >>> turning = encoder_angle(counts, 1000.0, per_revolution=1024, lines=1024)
    >>> round(turning.speed / (2 * np.pi), 3)
    14.0
    """
    raw = np.asarray(readings, dtype=float)
    bad = np.flatnonzero(~np.isfinite(raw))
    if raw.ndim != 1 or len(raw) < 3 or bad.size:
        found = f"{raw[bad[0]]} in sample {bad[0]}" if bad.size else f"shape {raw.shape}"
        raise InputError(found, "finite angles, one per sample", "correct the column", file=source)
    step = 2 * np.pi / lines if lines else 0.0
    angle = np.unwrap(raw * (2 * np.pi / per_revolution))
    speed, drift, scatter = _regression(np.arange(len(angle)) / sample_rate, angle)
    _require_forward(angle, speed, sample_rate, step, source)
    return MeasuredAngle(angle + step / 2, speed, drift, scatter)


def _require_forward(
    angle: Floats, speed: float, sample_rate: float, step: float, source: str
) -> None:
    per_sample = np.diff(angle)
    most = np.abs(per_sample).max()
    # Half a revolution between samples reads the same forwards and backwards.
    if most > 0.9 * np.pi or abs(speed) / sample_rate > 0.8 * np.pi:
        raise InputError(
            f"{np.degrees(most):.4g} degrees between two samples",
            "well below half a revolution",
            "sample faster; or the unit of the angle is wrong",
            file=source,
        )
    if speed < 0:
        raise InputError(
            f"an encoder that runs backwards ({speed / (2 * np.pi):.6g} revolutions/s)",
            "an angle that grows with time",
            "exchange its channels, or give the column the scale -1",
            file=source,
        )
    fall = np.maximum.accumulate(angle) - angle
    tolerated = max(2.5 * step, np.radians(2.0))
    back = np.flatnonzero(fall > tolerated)
    if back.size:
        raise InputError(
            f"an encoder that runs backwards {back[0] / sample_rate:.6g} s after the first sample, "
            f"by {np.degrees(fall.max()):.4g} degrees",
            "an angle that grows with time",
            "check the encoder for lost or double counts, or cut the record there",
            file=source,
        )


def pulse_times(
    samples: ArrayLike, sample_rate: float, *, threshold: float | None = None, source: str = ""
) -> Floats:
    """Return the times at which pulses rise, between samples where their flanks allow.

    The threshold is half way between low and high. A flank that has no sample on it (a logic
    level) is placed in the middle between the two samples beside it.

    Parameters
    ----------
    samples : array, shape (sample,)
    sample_rate : float
        Hz.
    threshold : float, optional
    source : str
        For messages.

    Returns
    -------
    array, shape (pulse,)
        s after the first sample.

    Raises
    ------
    InputError
        For a column without pulses.

    Examples
    --------
    >>> pulse_times([0, 0, 0.25, 0.75, 1, 1, 0, 0], 1000.0)
    array([0.0025])
    """
    raw = np.asarray(samples, dtype=float)
    low, high = (np.percentile(raw, q) for q in (0.5, 99.5)) if len(raw) else (0.0, 0.0)
    if not high - low > 0:
        low, high = (raw.min(), raw.max()) if len(raw) else (0.0, 0.0)
    if not high > low:
        raise InputError(
            "a column without a pulse", "one pulse per revolution", "name another", file=source
        )
    level = (low + high) / 2 if threshold is None else threshold
    # Noise on a flank crosses the threshold again: a pulse counts once it has been low.
    above, armed = raw >= level, raw < level - 0.2 * (high - low)
    state = np.zeros(len(raw), dtype=bool)
    marks = np.flatnonzero(above | armed)
    state[marks] = above[marks]
    last = np.maximum.accumulate(np.where(above | armed, np.arange(len(raw)), 0))
    state = state[last]
    rises = np.flatnonzero(~state[:-1] & state[1:])
    before, after = raw[rises], raw[rises + 1]
    flank = (before < level) & (after > before)
    part = np.where(flank, (level - before) / np.where(flank, after - before, 1.0), 0.5)
    sharp = (before <= low + 0.02 * (high - low)) & (after >= high - 0.02 * (high - low))
    return np.asarray((rises + np.where(sharp, 0.5, part)) / sample_rate)


def keyphasor_angle(
    times: ArrayLike, count: int, sample_rate: float, *, source: str = ""
) -> MeasuredAngle:
    """Return the angle at each sample from the times of pulses, at which phi = 2 pi n.

    Between pulses by a cubic spline, before the first and after the last by a parabola through the
    dozen there.

    Parameters
    ----------
    times : array, shape (pulse,)
        s after the first sample.
    count : int
        Samples of the record.
    sample_rate : float
        Hz.
    source : str
        For messages.

    Returns
    -------
    MeasuredAngle

    Raises
    ------
    InputError
        For fewer than four pulses, a missing one, or one too many.

    Examples
    --------
    >>> turning = keyphasor_angle(0.01 + np.arange(20) / 50.0, 400, 1000.0)
    >>> round(turning.speed / (2 * np.pi), 6), turning.angle[10:12].round(6)
    (50.0, array([0.      , 0.314159]))
    """
    t = np.asarray(times, dtype=float)
    if len(t) < 4:
        raise InputError(
            f"{len(t)} pulses",
            "four or more",
            "record longer, or check the threshold and the column",
            file=source,
        )
    _require_every_pulse(t, source)
    turns = 2 * np.pi * np.arange(len(t), dtype=float)
    speed, drift, scatter = _regression(t, turns)
    spline = interpolate.make_interp_spline(t, turns, k=3)
    time = np.arange(count) / sample_rate
    angle = spline(np.clip(time, t[0], t[-1]))
    for outside, few in (
        (time < t[0], slice(_END_PULSES)),
        (time > t[-1], slice(-_END_PULSES, None)),
    ):
        fit = np.polynomial.Polynomial.fit(t[few], turns[few], 2)
        angle[outside] = fit(time[outside])
    return MeasuredAngle(np.asarray(angle), speed, drift, scatter)


def _require_every_pulse(times: Floats, source: str) -> None:
    """Compare each interval with those beside it."""
    spacing = np.diff(times)
    reach = min(2, len(spacing) - 1)
    padded = np.pad(spacing, reach, mode="reflect")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
    beside = np.median(np.delete(around, reach, axis=1), axis=1)
    for fault, what, cure in (
        (spacing > 1.5 * beside, "a missing pulse", "lower the threshold, or cut the record there"),
        (spacing < 0.6 * beside, "a pulse too many", "raise the threshold, or filter the column"),
    ):
        if fault.any():
            at = int(np.argmax(fault))
            raise InputError(
                f"{what} between {times[at]:.6g} s and {times[at + 1]:.6g} s, "
                f"{int(fault.sum())} such in all",
                f"pulses about {beside[at]:.6g} s apart",
                cure,
                file=source,
            )
