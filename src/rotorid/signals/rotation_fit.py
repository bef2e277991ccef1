"""A smooth rotation through what an encoder or a pulse tells of it, with its uncertainty.

Every reading says that the angle lies in an interval: a counter within one line, a logic level
between two samples. Reading errors are taken as Gaussian besides. The angle is a cubic spline, its
coefficients those of largest likelihood (interval-censored regression, by Newton's method on a
concave function), its knots as few as the data allow (Schwarz 1978). Where the readings fall at
ever the same place of their intervals, as with a whole number of samples per revolution, a common
offset is left open: it is found as the mean of its posterior, and its deviation is that of a
uniform distribution, width / sqrt(12), where nothing else limits it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from rotorid.core.frozen import frozen
from rotorid.core.values import Booleans, Floats, Integers

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

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
"""Readings whose errors are granted to be independent: an encoder's lines are off by the same in
every revolution."""

AS_LIKELY = 1.0
"""Difference of log-likelihoods that says nothing: half of what one parameter more gains by chance
in one case of six."""

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


@frozen
class RotationFit:
    spline: BSpline  # phi in rad at times in s
    std: float  # deviation in rad of an offset common to all times
    noise: float  # deviation in rad of a reading besides its interval


def fit_rotation(readings: AngleReadings) -> RotationFit:
    used = readings.some(READINGS)
    best: tuple[float, scipy.interpolate.BSpline, float, int] | None = None
    failed = 0
    # The simplest first: a constant speed.
    readings_, span = len(used.time), float(used.time[-1] - used.time[0])
    tried = [(degree, 0) for degree in (1, 2, 3) if degree < readings_]
    knots = dict.fromkeys(round(density * span) for density in KNOTS_PER_SECOND)
    tried += [(3, k) for k in knots if 0 < k <= readings_ // READINGS_PER_KNOT - 4]
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
    return RotationFit(spline, float(max(np.sqrt(np.mean(squares)), least)), noise)


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

    Noises that explain the readings as well as the likeliest one cannot be told apart. They differ
    in where they put the offset, and the least of them leaves the whole interval open.
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
