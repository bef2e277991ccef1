"""Rotor angle from an encoder or a pulse per revolution: a smooth rotation through a staircase.

Every reading says that the angle lies in an interval. A cubic spline of as few knots as the data
allow (Schwarz 1978) is fitted by likelihood, readings being interval-censored. Where they fall at
ever the same place of their intervals, a common offset is left open: the mean of its posterior is
taken, and its deviation told.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import ArrayLike

from rotorid.core.errors import InputError, naming
from rotorid.core.values import Booleans, Floats, Integers, frozen

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

LOST = 0.6
"""Step of a counter, in lines, that is a line lost or counted twice: rounding leaves 0.15."""
EXCURSION = 2.5
"""Lines by which a counter goes off and comes back that are taken out: jitter stays below."""
WINDOW = 64
"""Samples on each side of a step of the counter: means and slopes to an eighth of a line."""
OFF_BEAT = 0.15
"""Part of a revolution by which a pulse may be off: no speed changes by that in a revolution."""
MOST_FAULTS = 0.2
"""Part of the pulses that may be missing or too many: beyond it the count of turns is a guess."""

_START_PULSES = 25

PLATEAU = 0.02
"""Distance from low or high, over their difference, within which a sample shows no flank."""


@frozen
class MeasuredAngle:
    angle: Floats  # (sample,): phi in rad, continuous
    speed: float  # mean speed in rad/s, by regression over the whole record
    # deviation of an offset common to all samples, in rad: what sampling and jitter leave open
    angle_std: float = 0.0
    jitter: float = 0.0  # deviation in rad of one reading, its interval apart
    # lines or pulses that were lost, or counted twice, and set right
    missing: int = 0
    extra: int = 0


def _mean_speed(time: Floats, angle: Floats) -> float:
    fit = np.polynomial.Polynomial.fit(time, angle, min(2, len(time) - 1))
    return float(fit.deriv()((time[0] + time[-1]) / 2))


def encoder_angle(
    readings: ArrayLike,
    sample_rate: float,
    *,
    per_revolution: float = 2 * np.pi,
    lines: int | None = None,
    source: str = "",
) -> MeasuredAngle:
    """Return the angle from readings of an encoder or a resolver, which start afresh every turn.

    With `lines`, the steps of a turn, a rotation is fitted, lines lost or too many set right.
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
        return MeasuredAngle(angle, _mean_speed(time, angle))
    angle, missing, extra = _without_lost_lines(angle, step)
    middle, half = angle + step / 2, np.full(len(angle), step / 2)
    spline, std, noise = fit_rotation(AngleReadings(time, middle, half))
    smooth = np.asarray(spline(time))
    return MeasuredAngle(smooth, _mean_speed(time, smooth), std, noise, missing, extra)


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
        expected = "well below half a revolution"
        cure = "sample faster; or the unit of the angle is wrong"
        raise InputError(f"{np.degrees(most):.4g} degrees between two samples", expected, cure)
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
    """Return the times at which pulses rise half way, and half of what each leaves open, in s.

    A logic level, without samples on its flank, is placed in the middle between two samples.
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
    """Return the angle at `count` samples from pulses at phi = 2 pi n, each open by `half` s."""
    t = np.asarray(times, dtype=float)
    with naming(source):
        if len(t) < 4:
            cure = "record longer, or check the threshold and the column"
            raise InputError(f"{len(t)} pulses", "four or more", cure)
        kept, turns = _count_turns(t)
    open_ = np.broadcast_to(np.asarray(half, dtype=float), t.shape)[kept]
    missing = int(turns[-1] - turns[0] + 1 - len(turns))
    t, angle = t[kept], 2 * np.pi * turns
    speed = _mean_speed(t, angle)
    spline, std, noise = fit_rotation(AngleReadings(t, angle, abs(speed) * open_))
    time = np.arange(count) / sample_rate
    smooth = np.asarray(spline(np.clip(time, t[0], t[-1])))
    # Beyond the pulses the rotation goes on with the speed that it has there.
    for end, outside in ((t[0], time < t[0]), (t[-1], time > t[-1])):
        smooth[outside] += float(spline.derivative()(end)) * (time[outside] - end)
    extra = len(kept) - int(kept.sum())
    return MeasuredAngle(smooth, _mean_speed(time, smooth), std, noise, missing, extra)


def mark_angle(samples: Floats, sample_rate: float, *, source: str = "") -> MeasuredAngle:
    """Return the angle at each sample of a column of pulses, one per revolution."""
    times, half = pulse_edges(samples, sample_rate, source=source)
    return keyphasor_angle(times, len(samples), sample_rate, half=half, source=source)


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
        found = f"{int(faults)} pulses missing or too many, of {len(times)}"
        cure = "check the threshold and the column, or cut the record where they fail"
        raise InputError(found, "one pulse per revolution", cure)
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


KNOTS_PER_SECOND = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
"""Densities of knots that are tried: two a second follow what a drive's controller leaves of slow
variation; what changes eight times a second is vibration, not speed."""
READINGS_PER_KNOT = 6
"""Readings for each knot at least: fewer, and the spline follows each of them."""
NOISES = (32.0, 8.0, 2.0, 0.5, 0.15, 0.05, 0.015, 0.004)
"""Deviations of the reading's own error that are tried, over the half-width of an interval."""
READINGS = 4000
"""Readings that are used at most: the smooth angle of so many is known to a fortieth of one."""
INDEPENDENT = 2000
"""Readings of independent errors: an encoder's lines are off by the same in every revolution."""
AS_LIKELY = 1.0
"""Difference of log-likelihoods that says nothing: half of what chance gains in one case of six."""
PATIENCE = 2
"""Denser knots that must fail to help before no more are tried."""

_STEPS = 25  # of Newton's method; five to ten are used
_GRID = 61  # offsets of the posterior
_ZOOMS = 4  # from the whole interval to a posterior 1e-4 of it wide
_RESOLVED = 8  # steps of the grid in a deviation: of a uniform distribution to 3 %


@frozen
class AngleReadings:
    """Intervals of the angle: at time t it lies within middle +- half."""

    # (reading,): s, rad, rad; half is 0 for a reading without steps
    time: Floats
    middle: Floats
    half: Floats

    def some(self, most: int) -> AngleReadings:
        """Return at most so many, at irregular places: regular ones could keep step."""
        count = len(self.time)
        if count <= most:
            return self
        golden = np.arange(most) * 0.6180339887498949 % 1.0
        return self.at(((np.arange(most) + golden) * (count / most)).astype(int))

    def at(self, places: Integers | Booleans) -> AngleReadings:
        return AngleReadings(self.time[places], self.middle[places], self.half[places])


def fit_rotation(readings: AngleReadings) -> tuple[BSpline, float, float]:
    """Return phi over time, the deviation of an offset common to all times, and of a reading."""
    used = readings.some(READINGS)
    best: tuple[float, scipy.interpolate.BSpline, float, int] | None = None
    failed = 0
    # The simplest first: a constant speed.
    all_, span = len(used.time), float(used.time[-1] - used.time[0])
    tried = [(degree, 0) for degree in (1, 2, 3) if degree < all_]
    knots = dict.fromkeys(round(density * span) for density in KNOTS_PER_SECOND)
    tried += [(3, k) for k in knots if 0 < k <= all_ // READINGS_PER_KNOT - 4]
    for degree, count in tried:
        least = (count + degree + 1) * np.log(len(used.time))
        # Chances are at most 1: where even that would not pay, nothing denser does.
        if best is not None and used.half.all() and least >= best[0]:
            break
        spline, noise, likelihood = _fit(used, count, degree)
        price = least - 2 * likelihood
        if best is None or price < best[0]:
            best, failed = (price, spline, noise, count), 0
        elif (failed := failed + 1) == PATIENCE:
            break
    assert best is not None
    _, spline, noise, count = best
    offset = _offset(used, spline, noise)[0]
    spline = scipy.interpolate.BSpline(spline.t, spline.c + offset, spline.k)
    # What the readings between two knots leave to a local offset, on average; and no less than what
    # independent errors, uniform within their intervals, leave to so many coefficients.
    part = np.searchsorted(np.linspace(used.time[0], used.time[-1], count + 2)[1:-1], used.time)
    parts = (used.at(part == j) for j in np.unique(part))
    squares = [_offset(some, spline, noise)[1] ** 2 for some in parts]
    alone = float(np.sqrt((used.half**2).mean() / 3 + noise**2))
    least = alone * np.sqrt(len(spline.c) / min(len(used.time), INDEPENDENT))
    return spline, float(max(np.sqrt(np.mean(squares)), least)), noise


def _fit(readings: AngleReadings, count: int, degree: int) -> tuple[BSpline, float, float]:
    """Return the spline with so many knots, the noise and the logarithm of the likelihood."""
    time = readings.time
    inner = np.linspace(time[0], time[-1], count + 2)[1:-1]
    spline = _least_squares(readings, readings.middle, np.ones_like(time), inner, degree)
    left = readings.middle - spline(time)
    width = float(readings.half.max())
    if width == 0:
        noise = max(float(np.sqrt((left**2).mean())), _floor(readings))
        return spline, noise, _likelihood(readings, spline, noise)
    tried: list[tuple[BSpline, float, float]] = []
    for part in _noises(left, width):
        spline, likelihood = _newton(readings, spline, part * width, inner, degree)
        tried.append((spline, part * width, likelihood))
    highest = max(t[2] for t in tried)
    # Of fits that are as likely, that of the largest noise lies in the middle of its intervals.
    return next(t for t in tried if t[2] > highest - AS_LIKELY)


def _noises(left: Floats, width: float) -> tuple[float, ...]:
    """Return the noises worth trying: none far beyond what the readings scatter."""
    most = max(1.0, 4.0 * float(np.sqrt((left**2).mean())) / width)
    return tuple(part for part in NOISES if part <= most)


def _floor(readings: AngleReadings) -> float:
    return float(1e-12 * max(1.0, np.abs(readings.middle).max()))


def _least_squares(
    readings: AngleReadings, values: Floats, weights: Floats, inner: Floats, degree: int
) -> BSpline:
    # Values relative to a straight line, so that thousands of radians cost no figures.
    line = np.polynomial.Polynomial.fit(readings.time, readings.middle, 1)
    rest = values - line(readings.time)
    knots, coefficients, _ = scipy.interpolate.splrep(
        readings.time, rest, w=weights, t=inner, k=degree, task=-1
    )
    spline = scipy.interpolate.BSpline(knots, coefficients[: len(knots) - degree - 1], degree)
    # The line has B-spline coefficients at the averages of the knots (Greville).
    places = np.array([knots[i + 1 : i + degree + 1].mean() for i in range(len(spline.c))])
    return scipy.interpolate.BSpline(knots, spline.c + line(places), degree)


def _newton(
    readings: AngleReadings, spline: BSpline, noise: float, inner: Floats, degree: int
) -> tuple[BSpline, float]:
    """Raise the likelihood by Newton's method; each step is a weighted least-squares spline."""
    value = _likelihood(readings, spline, noise)
    for _ in range(_STEPS):
        score, curvature = _slopes(readings, spline, noise)
        at = spline(readings.time)
        # Readings deep inside their interval say nothing: a small weight keeps the fit defined.
        curvature = np.maximum(curvature, 1e-4)
        goal = at + noise * score / curvature
        step = _least_squares(readings, goal, np.sqrt(curvature), inner, degree)
        for part in (1.0, 0.5, 0.25, 0.1, 0.02):
            coefficients = (1 - part) * spline.c + part * step.c
            trial = scipy.interpolate.BSpline(step.t, coefficients, degree)
            gained = _likelihood(readings, trial, noise) - value
            if gained > 0:
                break
        else:
            break
        spline, value = trial, value + gained
        if gained < 1e-3:
            break
    return spline, value


def _likelihood(readings: AngleReadings, spline: BSpline, noise: float) -> float:
    left = readings.middle - spline(readings.time)
    return float(_log_chance(left, readings.half, noise).sum())


def _log_chance(left: Floats, half: Floats, noise: float) -> Floats:
    """Return log P(|left + error| < half), or the density where half is 0."""
    high, low = (left + half) / noise, (left - half) / noise
    # In the tail where both are of one sign, the differences of small numbers are kept.
    side = np.where(left > 0, -1.0, 1.0)
    top, bottom = np.maximum(side * high, side * low), np.minimum(side * high, side * low)
    first, second = scipy.special.log_ndtr(top), scipy.special.log_ndtr(bottom)
    with np.errstate(divide="ignore"):
        inside = first + np.log1p(-np.exp(np.minimum(second - first, -1e-16)))
    density = -0.5 * (left / noise) ** 2 - np.log(noise * np.sqrt(2 * np.pi))
    return np.asarray(np.where(half > 0, inside, density))


def _slopes(readings: AngleReadings, spline: BSpline, noise: float) -> tuple[Floats, Floats]:
    left = readings.middle - spline(readings.time)
    high, low = (left + readings.half) / noise, (left - readings.half) / noise
    chance = _log_chance(left, readings.half, noise)
    root = np.log(np.sqrt(2 * np.pi))
    at_high = np.exp(np.clip(-0.5 * high**2 - root - chance, -700, 50))
    at_low = np.exp(np.clip(-0.5 * low**2 - root - chance, -700, 50))
    score = at_low - at_high
    curvature = score**2 + high * at_high - low * at_low
    plain = readings.half == 0
    score = np.where(plain, left / noise, score)
    return score, np.where(plain, 1.0, np.clip(curvature, 0.0, 1.0))


def _offset(readings: AngleReadings, spline: BSpline, noise: float) -> tuple[float, float]:
    """Return mean and deviation of the offset that the readings leave, whatever their noise.

    Of noises that explain them as well, the least leaves the whole interval open.
    """
    used = readings.some(INDEPENDENT)
    left, width = used.middle - spline(used.time), float(used.half.max())
    if width == 0:
        return 0.0, float(noise / np.sqrt(len(left)))
    found = np.array([_posterior(left, used.half, part * width) for part in _noises(left, width)])
    likely = found[found[:, 2] > found[:, 2].max() - AS_LIKELY]
    std = float(np.hypot(likely[:, 1].max(), likely[:, 0].std()))
    return float(likely[:, 0].mean()), max(std, _floor(readings))


def _posterior(left: Floats, half: Floats, noise: float) -> tuple[float, float, float]:
    """Return mean and deviation of an offset for one noise, and the highest log-likelihood."""
    mean, reach = 0.0, float(half.max()) + 4 * noise
    for _ in range(_ZOOMS):  # from the whole interval to where the posterior lies
        offsets = mean + np.linspace(-1, 1, _GRID) * reach
        logs = np.array([_log_chance(left - c, half, noise).sum() for c in offsets])
        weight = np.exp(logs - logs.max())
        weight /= weight.sum()
        mean = float(weight @ offsets)
        std = float(np.sqrt(weight @ (offsets - mean) ** 2))
        step = 2 * reach / (_GRID - 1)
        if std > _RESOLVED * step:
            break
        reach = max(3 * std, 2 * step)
    return mean, std, float(logs.max())
