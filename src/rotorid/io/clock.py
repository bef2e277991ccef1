"""Sample times: the rate that they tell, and samples put on a uniform grid where they jitter."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rotorid.errors import ReadError
from rotorid.frozen import frozen
from rotorid.io.table import Rate
from rotorid.record import Complexes, Floats

LATE, EARLY = 1.75, 0.25
"""Steps, in units of the median step, from which on a sample is missing, or one too many.

Between 1.5, a sample half a step late, and 2, one that was dropped: halfway.
"""
SAME_RATE = 1e-4
"""Relative difference of two statements of one sample rate that does not matter.

It moves a mass by twice as much, .02 %, less than the deviation that the best records leave.
"""
BEARABLE = 1e-3
"""Error of the interpolation, relative to a line, up to which samples are put on a grid."""
NEGLIGIBLE = 1e-4
"""Error of a line, relative, that times off their grid may leave without being put right.

A tenth of `BEARABLE`: below the noise of any line, and of what an interpolation may leave. On the
highest line that is asked for, or, where that is not known, at half the sample rate.
"""
_ROUNDED = 0.6  # of the last digit of the stamps: half a digit, and what a line fitted to them adds
_TAPS = 12  # of the interpolation: 1e-4 at a quarter of the sample rate, for a jitter of a tenth
_BLOCK = 1 << 16


@frozen
class Clock:
    """What sample times tell.

    Parameters
    ----------
    rate : Rate
    even : bool
        The steps are equal but for the digits in which the times are written.
    jitter : float
        Root mean square of the deviation from equal steps, in s.
    """

    rate: Rate
    even: bool
    jitter: float


def read_clock(time: Floats) -> Clock:
    """Judge sample times in s.

    Raises
    ------
    ReadError
        Where samples are missing, or times stand still or run backward.
    """
    if len(time) < 2 or not np.all(np.isfinite(time)):
        raise ReadError(
            "sample times that are not finite" if len(time) > 1 else "a single sample",
            "equidistant sample times",
            "give sample_rate in place of the time column",
            place="time",
        )
    steps = np.diff(time)
    step = float(np.median(steps))
    wrong = np.flatnonzero(~((steps < LATE * step) & (steps > EARLY * step)))
    if wrong.size or step <= 0:
        raise _gap(time, step, wrong)
    count = len(time)
    span = float(time[-1] - time[0])
    index = np.arange(count) - (count - 1) / 2
    centred = time - time.mean()
    slope = float(index @ centred / (index @ index))
    deviation = centred - slope * index
    resolution = _resolution(time)
    furthest = float(np.abs(deviation).max())
    even = furthest <= max(NEGLIGIBLE * slope / np.pi, _spacing(time)) or (
        resolution <= slope / 2 and furthest <= _ROUNDED * resolution
    )
    rate = Rate((count - 1) / span, max(resolution, furthest) / span)
    return Clock(rate, even, float(np.sqrt(np.mean(deviation**2))))


def error_as_they_are(time: Floats, rate: float, frequency: float) -> float:
    """Return the most that a wave is off, relative, where samples count as taken on a grid.

    A shift common to all is none; the rest, at most half the range, is an angle of the wave.
    """
    off = time - time[0] - np.arange(len(time)) / rate
    return float(np.pi * frequency * np.ptp(off))


def even_rate(time: Floats) -> Rate | None:
    """Return the rate of equidistant times, and none for others."""
    try:
        clock = read_clock(time)
    except ReadError:
        return None
    return clock.rate if clock.even else None


def _gap(time: Floats, step: float, wrong: np.ndarray) -> ReadError:
    """Return the error for missing samples, with the longest stretch that has none."""
    first = int(wrong[0]) if wrong.size else 0
    size = time[first + 1] - time[first]
    cure = "leave time out and give sample_rate, if only the time stamps are wrong"
    ends = np.concatenate([[-1], wrong, [len(time) - 1]])
    longest = int(np.argmax(np.diff(ends)))
    begin, end = int(ends[longest]) + 1, int(ends[longest + 1])
    if step > 0 and size >= LATE * step and end > begin:
        stretch = [] if begin == 0 else [f'skip = "{time[begin] - time[0]:.6g} s"']
        if end < len(time) - 1:
            stretch.append(f'until = "{time[end] - time[0] + step / 2:.6g} s"')
        cure = f"use the longest stretch without: {' and '.join(stretch)}; or {cure}"
    return ReadError(
        f"a step of {size:.6g} s after sample {first} (t = {time[first]:.9g} s)"
        + (f", {wrong.size} such in all" if wrong.size > 1 else ""),
        f"steps of {step:.6g} s: no dropped samples",
        cure,
        place="time",
    )


def _spacing(time: Floats) -> float:
    """Return what the arithmetic that led to times may have rounded."""
    return 4 * float(np.spacing(np.abs(time).max()))


def _resolution(time: Floats) -> float:
    """Return the decimal digit to which times are written, or else that of their numbers."""
    least = _spacing(time)
    some = np.concatenate([time[:500], time[-500:]])  # a digit that a thousand lack is in none
    for digit in 10.0 ** np.arange(0, -13, -1):
        if digit < least:
            break
        if np.abs(some / digit - np.round(some / digit)).max() * digit < least:
            return float(digit)
    return least


def onto_grid(
    time: Floats, samples: Floats, rate: float, highest: float | None
) -> tuple[Floats, float, float]:
    """Interpolate samples to equal steps.

    By polynomials through the `_TAPS` samples around each instant. The error is that of a wave of
    the frequency `highest`, sampled at these times, and so holds for every line below it.

    Parameters
    ----------
    time : array, shape (sample,)
        In s, increasing.
    samples : array, shape (sample, channel)
    rate : float
        Of the grid, in Hz; it starts at the first sample.
    highest : float or None
        In Hz; None: the highest frequency that bears it.

    Returns
    -------
    samples : array, shape (sample, channel)
    error : float
        Root mean square, relative to the wave.
    highest : float
    """
    count = int(np.floor((time[-1] - time[0]) * rate * (1 + 1e-12) + 1e-6)) + 1
    offset = time - time[0]
    grid = np.minimum(np.arange(count) / rate, offset[-1])
    if highest is None:
        highest = rate / 2
        while interpolation_error(offset, grid, highest) > BEARABLE and highest > rate / 100:
            highest *= 0.8
    found = np.empty((count, samples.shape[1]))
    for part, first, weights in _weights(offset, grid):
        for channel in range(samples.shape[1]):
            column = samples[:, channel]
            found[part, channel] = sum(
                weights[:, tap] * column[first + tap] for tap in range(weights.shape[1])
            )
    return found, interpolation_error(offset, grid, highest), highest


def interpolation_error(time: Floats, grid: Floats, frequency: float) -> float:
    """Return the error of a wave of that frequency, interpolated from times to a grid."""
    total, count = 0.0, 0
    for part, first, weights in _weights(time, grid):
        wave: Complexes = np.zeros(len(first), dtype=complex)
        for tap in range(weights.shape[1]):
            wave += weights[:, tap] * np.exp(
                2j * np.pi * frequency * (time[first + tap] - grid[part])
            )
        total += float((np.abs(wave - 1) ** 2).sum())
        count += len(first)
    return float(np.sqrt(total / count))


def _weights(time: Floats, grid: Floats) -> Iterator[tuple[slice, np.ndarray, Floats]]:
    """Yield parts of the grid, the first sample that each of its points takes, and the weights."""
    taps = min(_TAPS, len(time))
    for begin in range(0, len(grid), _BLOCK):
        part = slice(begin, min(begin + _BLOCK, len(grid)))
        points = grid[part]
        nearest = np.searchsorted(time, points, side="right")
        first = np.clip(nearest - taps // 2, 0, len(time) - taps)
        nodes = np.stack([time[first + tap] for tap in range(taps)], axis=1)
        weights = np.ones_like(nodes)
        for tap in range(taps):
            for other in range(taps):
                if other != tap:
                    span = nodes[:, tap] - nodes[:, other]
                    weights[:, tap] *= (points - nodes[:, other]) / span
        yield part, first, weights
