"""Samples shifted in time by local interpolation."""

from __future__ import annotations

import numpy as np
import scipy

from rotorid.record import Floats

_HALF = 64
_BETA = 18.9  # 180 dB beside the lines
"""A sinc over 128 samples under Kaiser's window: right to 1e-9 up to 0.45 of the sample rate."""


def shifted(samples: Floats, steps: float, period: int | None = None) -> Floats:
    """Return samples of a signal `steps` sample periods later, by local interpolation.

    Lines up to 0.45 of the sample rate are right to 1e-9; the last sixty-four samples at each end
    as far as the signal goes on there as it is thought to.
    """
    whole = int(np.floor(steps + 1e-9))
    part = steps - whole
    if abs(steps) < 1e-9:
        return samples
    offsets = np.arange(1 - _HALF, 1 + _HALF)
    if abs(part) < 1e-9:
        offsets = np.zeros(1, dtype=int)
    away = offsets - part if len(offsets) > 1 else np.zeros(1)
    weights = np.sinc(away) * np.i0(_BETA * np.sqrt(np.maximum(1 - (away / _HALF) ** 2, 0.0)))
    weights /= weights.sum()
    first, last = whole + offsets[0], whole + offsets[-1]
    whole_signal = extended(samples, max(-first, 0), max(last, 0), period)
    begin = max(first, 0)
    window = whole_signal[begin : begin + len(samples) + last - first]
    return np.asarray(scipy.signal.correlate(window, weights, mode="valid"))


def extended(samples: Floats, before: int, after: int, period: int | None) -> Floats:
    """Continue a signal beyond its ends: from a period away, or turned about its last value."""
    count = len(samples)
    if period is not None and period <= count:
        head = samples[:period][np.arange(-before, 0) % period]
        tail = samples[count - period :][np.arange(after) % period]
    elif max(before, after) < count:
        head = 2 * samples[0] - samples[before:0:-1]
        tail = 2 * samples[-1] - samples[-2 : -after - 2 : -1]
    else:
        head, tail = np.full(before, samples[0]), np.full(after, samples[-1])
    return np.concatenate([head, samples, tail])
