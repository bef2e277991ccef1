"""Samples shifted in time by local interpolation."""

from __future__ import annotations

import numpy as np
from scipy import signal

from rotorid.record import Floats

_TAPS = 16


def shifted(samples: Floats, steps: float, period: int | None = None) -> Floats:
    """Return samples of a signal `steps` sample periods later, by local interpolation."""
    whole = int(np.floor(steps + 1e-9))
    part = steps - whole
    if abs(steps) < 1e-9:
        return samples
    offsets = np.arange(1 - _TAPS // 2, 1 + _TAPS // 2)
    if abs(part) < 1e-9:
        offsets = np.zeros(1, dtype=int)
    weights = [np.prod([(part - o) / (k - o) for o in offsets if o != k]) for k in offsets]
    first, last = whole + offsets[0], whole + offsets[-1]
    whole_signal = extended(samples, max(-first, 0), max(last, 0), period)
    begin = max(first, 0)
    window = whole_signal[begin : begin + len(samples) + last - first]
    return np.asarray(signal.correlate(window, weights, mode="valid"))


def extended(samples: Floats, before: int, after: int, period: int | None) -> Floats:
    """Continue a signal beyond its ends: from a period away, or turned about its last value."""
    count = len(samples)
    if period is not None and period + max(before, after) <= count:
        head = samples[period - before : period]
        tail = samples[count - period : count - period + after]
    elif max(before, after) < count:
        head = 2 * samples[0] - samples[before:0:-1]
        tail = 2 * samples[-1] - samples[-2 : -after - 2 : -1]
    else:
        head, tail = np.full(before, samples[0]), np.full(after, samples[-1])
    return np.concatenate([head, samples, tail])
