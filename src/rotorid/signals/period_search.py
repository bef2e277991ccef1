"""The period of a record, found from its samples alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.core.values import Floats, frozen
from rotorid.signals.spectrum import top_of

_MIDDLE = 0.15  # of the record left out at each end: approach and return are no part of a period
_OVERLAP = 0.25  # of the middle that a shift must leave to compare
_LEAST = 0.75  # correlation below which the ringing of a machine may be taken for a period
_HELD = 0.85  # of the first correlation that every multiple keeps where there is a period
_AS_GOOD = 1.5  # times the least unexplained part, plus the next: a shorter period as good as it
_MARGIN = 0.01
_ALONE = 0.95  # of what repeats that one wave holds: it is the rotation, or hum
_NICE = 4  # digits of a frequency that somebody typed
_MOST = 1 << 21  # samples looked at


@frozen
class Period:
    samples: float  # its length in samples
    accuracy: float  # how far, in samples, it may be off
    correlation: float  # of the record with itself, one period later: 1 without noise

    def fundamental(self, rate: float) -> float | None:
        """Return the frequency of few digits within the accuracy that is whole in samples."""
        found = rate / self.samples
        for digits in range(1, _NICE + 1):
            frequency = float(f"{found:.{digits - 1}e}")
            size = rate / frequency
            near = abs(size - self.samples) <= max(self.accuracy, 0.5)
            if near and abs(size - round(size)) <= 1e-6 * size:
                return frequency
        return None


def find_period(samples: Floats) -> Period | None:
    """Return the shortest period of a signal, or none: its middle is compared with itself."""
    middle = _middle(samples)
    size = len(middle)
    if size < 16 or not np.ptp(middle):
        return None
    centred = middle - middle.mean()
    lags = round((1 - _OVERLAP) * size)
    padded = 1 << (size + lags).bit_length()
    products = np.fft.irfft(np.abs(np.fft.rfft(centred, padded)) ** 2, padded)[: lags + 1]
    power = np.concatenate([[0.0], np.cumsum(centred**2)])
    shift = np.arange(lags + 1)
    both = (power[size - shift] * (power[size] - power[shift])) ** 0.5
    correlation = np.asarray(products / np.maximum(both, 1e-9 * power[size]))
    # The first hill is the signal beside itself.
    below = np.flatnonzero(correlation < 0.5 * correlation[0])
    if not below.size:
        return None
    inner = correlation[1:-1]
    peaks = 1 + np.flatnonzero((inner >= correlation[:-2]) & (inner > correlation[2:]))
    peaks = peaks[peaks > below[0]]
    if not peaks.size or correlation[peaks].max() < _LEAST:
        return None
    unexplained = 1 - correlation[peaks]
    first = int(peaks[unexplained <= _AS_GOOD * unexplained.min() + _MARGIN][0])
    return _refined(correlation, first)


def common_period(
    columns: Sequence[Floats], turning: bool = True
) -> tuple[Period, list[int]] | None:
    """Return the period that most columns share, and which repeat, the clearest first; or none.

    There is none where all that repeats is one wave, in some columns, while others move without a
    period. So it is where a rotor turns while one axis is swept: the wave is its unbalance. What
    somebody repeats on purpose holds several lines, or is in all columns. Nor is there one that
    half of the columns of several lines do not have: motions under control come back by and by,
    each in its own time. The counter of a rotor angle, which repeats best of all, is one of many.
    Where nothing turns, a single wave is motion like others, and repeats with them or none does.
    """
    moving = [k for k, column in enumerate(columns) if np.ptp(column)]
    found = {k: p for k in moving if (p := find_period(columns[k])) is not None}
    several = {k: p for k, p in found.items() if not _is_one_wave(columns[k], p)}
    if not found or (not several and len(found) < len(moving)):
        return None
    several = several or found

    def shared(k: int) -> tuple[bool, int, int, float]:
        one = several[k]
        times = [round(one.samples / p.samples) for p in several.values() if _divides(p, one)]
        return times.count(1) > 1, len(times), times.count(1), one.correlation

    best = max(several, key=shared)
    waves = () if turning else (p for k, p in found.items() if k not in several)
    apart = any(not _divides(wave, several[best]) for wave in waves)
    if apart or 2 * shared(best)[1] <= len(several):
        return None
    return several[best], [best, *(k for k in found if k != best)]


def _divides(period: Period, longer: Period) -> bool:
    count = round(longer.samples / period.samples)
    off = abs(longer.samples - count * period.samples)
    return count > 0 and off <= longer.accuracy + count * period.accuracy + 1


def _is_one_wave(column: Floats, period: Period) -> bool:
    middle = _middle(column)
    window = np.hanning(len(middle))
    power = np.abs(np.fft.rfft((middle - middle.mean()) * window)) ** 2
    top = int(np.argmax(power))
    alone = power[max(top - 3, 0) : top + 4].sum()
    return bool(alone > _ALONE * period.correlation * power.sum())


def _middle(samples: Floats) -> Floats:
    count = min(len(samples), _MOST)
    return samples[round(_MIDDLE * count) : count - round(_MIDDLE * count)]


def _refined(correlation: Floats, first: int) -> Period | None:
    """Follow the peak to its multiples, the last of which tells the period best.

    What rings, or sweeps through a resonance, is like itself one wave later, and less so two.
    """

    def top(place: int) -> float:
        return place + top_of(*correlation[place - 1 : place + 2])

    period, multiple = top(first), 1
    while (expected := period * (multiple + 1)) < len(correlation) - 2:
        reach = max(1, round(0.02 * period))
        low = max(round(expected) - reach, 1)
        place = low + int(np.argmax(correlation[low : round(expected) + reach + 1]))
        if place >= len(correlation) - 1:
            break
        if correlation[place] < _HELD * correlation[first]:
            return None
        multiple += 1
        period = top(place) / multiple
    return Period(period, 1.0 / multiple, float(correlation[first]))
