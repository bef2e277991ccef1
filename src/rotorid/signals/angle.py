"""Rotor angle from an encoder or a pulse per revolution: a smooth rotation through a staircase."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import ArrayLike

from rotorid.core.errors import InputError, naming
from rotorid.core.frozen import frozen
from rotorid.core.values import Booleans, Floats
from rotorid.signals.rotation_fit import AngleReadings, fit_rotation

LOST = 0.6
"""Step of a counter, in lines, that is a line lost or counted twice: rounding leaves 0.15."""

EXCURSION = 2.5
"""Lines by which a counter goes off and comes back before that is taken out: jitter and rounding
stay below, a line or two that are lost for less than a revolution do little."""

WINDOW = 64
"""Samples before and behind a step of the counter that are compared: their means and slopes are
known to an eighth of a line."""

OFF_BEAT = 0.15
"""Part of a revolution by which a pulse may come early or late: what is further off is no pulse of
the mark, and the speed does not change by that in a revolution."""

MOST_FAULTS = 0.2
"""Part of the pulses that may be missing or too many: beyond it the count of turns is a guess."""

_START_PULSES = 25

PLATEAU = 0.02
"""Distance from low or high, over their difference, within which a sample shows no flank."""


@frozen
class MeasuredAngle:
    angle: Floats  # (sample,): phi in rad, continuous
    speed: float  # mean speed in rad/s, by regression over the whole record
    drift: float  # change of the speed in rad/s^2, by the same regression
    scatter: float  # root mean square of what the regression leaves, in rad: wandering of the speed
    # deviation of an offset common to all samples, in rad: what sampling and jitter leave open
    angle_std: float = 0.0
    jitter: float = 0.0  # deviation in rad of one reading, its interval apart
    # lines or pulses that were lost, or counted twice, and set right
    missing: int = 0
    extra: int = 0


def _regression(time: Floats, angle: Floats) -> tuple[float, float, float]:
    fit = np.polynomial.Polynomial.fit(time, angle, min(2, len(time) - 1))
    speed, middle = fit.deriv(), (time[0] + time[-1]) / 2
    scatter = np.sqrt(np.mean((angle - fit(time)) ** 2))
    return float(speed(middle)), float(speed.deriv()(middle)), float(scatter)


def encoder_angle(
    readings: ArrayLike,
    sample_rate: float,
    *,
    per_revolution: float = 2 * np.pi,
    lines: int | None = None,
    source: str = "",
) -> MeasuredAngle:
    """Return the angle from readings of an encoder or a resolver, one per sample.

    With `lines`, the steps of a revolution, each reading is an interval: a smooth rotation is
    fitted, lines lost or counted twice are set right. Readings may start afresh every
    `per_revolution`: 2 pi, 360, or the counts. Backwards the speed is negative.
    """
    raw = np.asarray(readings, dtype=float)
    bad = np.flatnonzero(~np.isfinite(raw))
    step = 2 * np.pi / lines if lines else 0.0
    with naming(source):
        if raw.ndim != 1 or len(raw) < 3 or bad.size:
            raise InputError(
                f"{raw[bad[0]]} in sample {bad[0]}" if bad.size else f"shape {raw.shape}",
                "finite angles, one per sample",
                "name the column that holds the angle, and cut off the samples without one",
            )
        angle = np.unwrap(raw * (2 * np.pi / per_revolution))
        _require_steady(angle, sample_rate, step)
    time = np.arange(len(raw)) / sample_rate
    if not step:  # an angle without steps is taken as it is
        return MeasuredAngle(angle, *_regression(time, angle))
    angle, missing, extra = _without_lost_lines(angle, step)
    fit = fit_rotation(AngleReadings(time, angle + step / 2, np.full(len(angle), step / 2)))
    smooth = np.asarray(fit.spline(time))
    return MeasuredAngle(smooth, *_regression(time, smooth), fit.std, fit.noise, missing, extra)


def _without_lost_lines(angle: Floats, step: float) -> tuple[Floats, int, int]:
    count = len(angle)
    if count < 4 * WINDOW:
        return angle, 0, 0
    lines = _without_excursions(angle / step)
    place = np.arange(WINDOW) - (WINDOW - 1) / 2
    total = np.convolve(lines, np.ones(WINDOW), mode="valid") / WINDOW
    slope = np.convolve(lines, place[::-1], mode="valid") / (place @ place)
    # Means of the windows behind and before each sample, less the way between their middles.
    jump = total[WINDOW:] - total[:-WINDOW]
    jump -= WINDOW * (slope[WINDOW:] + slope[:-WINDOW]) / 2
    limit = max(LOST, 8 * float(np.median(np.abs(jump))) / 0.6745)
    corrected = lines.copy()
    missing = extra = 0
    sign = np.sign(lines[-1] - lines[0])
    while True:
        worst = int(np.argmax(np.abs(jump)))
        if abs(jump[worst]) < limit:
            return corrected * step, missing, extra
        size = round(jump[worst]) or int(np.sign(jump[worst]))
        corrected[worst + WINDOW :] -= size
        missing += max(0, int(-size * sign))
        extra += max(0, int(size * sign))
        jump[max(0, worst - 2 * WINDOW) : worst + 2 * WINDOW] = 0.0


def _without_excursions(lines: Floats) -> Floats:
    """Take out what comes back by itself: lines that are lost until the next index."""
    trend = np.linspace(lines[0], lines[-1], len(lines))
    usual = scipy.ndimage.median_filter(lines - trend, 4 * WINDOW + 1, mode="nearest")
    left = np.abs(lines - trend - usual)
    away = left > max(EXCURSION, 8 * float(np.median(left)) / 0.6745)
    return np.asarray(np.where(away, trend + usual, lines))


def _require_steady(angle: Floats, sample_rate: float, step: float) -> None:
    per_sample = np.diff(angle)
    most = np.abs(per_sample).max()
    speed = (angle[-1] - angle[0]) / (len(angle) - 1)
    # Half a revolution between samples reads the same forwards and backwards.
    if most > 0.9 * np.pi or abs(speed) > 0.8 * np.pi:
        raise InputError(
            f"{np.degrees(most):.4g} degrees between two samples",
            "well below half a revolution",
            "sample faster; or the unit of the angle is wrong",
        )
    ahead = angle if speed >= 0 else -angle
    fall = np.maximum.accumulate(ahead) - ahead
    tolerated = max(2.5 * step, np.radians(2.0))
    back = np.flatnonzero(fall > tolerated)
    if back.size:
        raise InputError(
            f"an encoder that turns around {back[0] / sample_rate:.6g} s after the first sample, "
            f"by {np.degrees(fall.max()):.4g} degrees",
            "one direction of rotation",
            "cut the record there, or check the encoder",
        )


def pulse_edges(
    samples: ArrayLike, sample_rate: float, *, source: str = ""
) -> tuple[Floats, Floats]:
    """Return the times at which pulses rise, and half the time that each leaves open, in s.

    The threshold is half way between low and high. A flank with samples on it is known by
    interpolation, and leaves nothing open; a logic level may have risen anywhere between two
    samples, and is placed in the middle.
    """
    raw = np.asarray(samples, dtype=float)
    low, high = (np.percentile(raw, q) for q in (0.5, 99.5)) if len(raw) else (0.0, 0.0)
    if not high - low > 0:
        low, high = (raw.min(), raw.max()) if len(raw) else (0.0, 0.0)
    if not high > low:
        raise InputError(
            "a column without a pulse", "one pulse per revolution", "name another", file=source
        )
    level = (low + high) / 2
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
    # With one sample on the flank, or none, its corner lies anywhere beside that sample.
    margin = PLATEAU * (high - low)
    beside = (before <= low + margin) | (after >= high - margin)
    times = rises + np.where(beside, 0.5, part)
    return np.asarray(times / sample_rate), np.asarray(np.where(beside, 0.5, 0.0) / sample_rate)


def keyphasor_angle(
    times: ArrayLike,
    count: int,
    sample_rate: float,
    *,
    half: ArrayLike = 0.0,
    source: str = "",
) -> MeasuredAngle:
    """Return the angle at each of `count` samples from the times of pulses, at which phi = 2 pi n.

    The rhythm tells those missing or too many; `half` is half the time in s that each leaves open.
    """
    t = np.asarray(times, dtype=float)
    with naming(source):
        if len(t) < 4:
            raise InputError(
                f"{len(t)} pulses",
                "four or more",
                "record longer, or check the threshold and the column",
            )
        kept, turns = _count_turns(t)
    open_ = np.broadcast_to(np.asarray(half, dtype=float), t.shape)[kept]
    missing = int(turns[-1] - turns[0] + 1 - len(turns))
    t, angle = t[kept], 2 * np.pi * turns
    speed, _, _ = _regression(t, angle)
    fit = fit_rotation(AngleReadings(t, angle, abs(speed) * open_))
    time = np.arange(count) / sample_rate
    smooth = np.asarray(fit.spline(np.clip(time, t[0], t[-1])))
    # Beyond the pulses the rotation goes on with the speed that it has there.
    for end, outside in ((t[0], time < t[0]), (t[-1], time > t[-1])):
        rate = float(fit.spline.derivative()(end))
        smooth[outside] += rate * (time[outside] - end)
    extra = len(kept) - int(kept.sum())
    return MeasuredAngle(smooth, *_regression(time, smooth), fit.std, fit.noise, missing, extra)


def _count_turns(times: Floats) -> tuple[Booleans, Floats]:
    spacing = np.diff(times)
    period = _rhythm(spacing)
    near = np.flatnonzero(np.abs(spacing / period - 1) < OFF_BEAT)
    first = int(near[0]) if near.size else 0
    turns = np.full(len(times), np.nan)
    turns[first] = 0.0
    _follow(times, turns, range(first + 1, len(times)), first, period)
    _follow(times, turns, range(first - 1, -1, -1), first, period)
    kept = np.isfinite(turns)
    number = np.nanmax(turns) - np.nanmin(turns)
    faults = len(times) + number + 1 - 2 * kept.sum()
    if faults > MOST_FAULTS * len(times) + 1 or kept.sum() < 4:
        raise InputError(
            f"{int(faults)} pulses missing or too many, of {len(times)}",
            "one pulse per revolution",
            "check the threshold and the column, or cut the record where they fail",
        )
    return kept, turns[kept] - np.nanmin(turns)


def _follow(times: Floats, turns: Floats, order: range, last: int, period: float) -> None:
    """Give numbers to pulses that come whole periods after, or before, the last that counted."""
    for i in order:
        passed = (times[i] - times[last]) / period
        whole = round(passed)
        if whole == 0 or abs(passed - whole) > OFF_BEAT:
            continue
        turns[i] = turns[last] + whole
        period += 0.5 * ((times[i] - times[last]) / whole - period)
        last = i


def _rhythm(spacing: Floats) -> float:
    """Return the time between pulses at the start: the one that most spacings agree with."""
    few = spacing[:_START_PULSES]
    agree = np.abs(few[:, None] / few[None, :] - 1) < OFF_BEAT
    best = few[int(np.argmax(agree.sum(axis=0)))]
    return float(np.median(few[np.abs(few / best - 1) < OFF_BEAT]))
