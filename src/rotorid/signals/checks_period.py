"""Check of the period: whether the record repeats after one, or only after two or three of them."""

from __future__ import annotations

import numpy as np

from rotorid.record import Check, Floats, PeriodicRecord, Record
from rotorid.signals.checks_samples import is_input

MULTIPLES = (2, 3)
"""Multiples of the period that are tried: half the line spacing given is the usual mistake."""

BETTER = 4.0
"""How many times less two periods must differ than one, for the record to repeat after two: noise
and drift make both differ alike."""

UNLIKE = 0.01
"""Part of the power in which successive periods must differ at least: below it nothing is at
stake."""

SYNCHRONOUS = 0.05
"""Distance from whole turns, in so many periods, within which the rotation explains it."""

_MOST = 1 << 15  # samples looked at


def check_multiple(record: Record, periods: PeriodicRecord) -> list[Check]:
    """Find a fundamental that is two or three times the true one."""
    size = periods.samples
    first = round(periods.begin * record.sample_rate)
    count = min(len(record.samples) - first, max(_MOST, 8 * size)) // size
    inputs = [c for c, channel in enumerate(record.channels) if is_input(channel)]
    chosen = inputs or list(range(len(record.channels)))
    if count < 2 * max(MULTIPLES):
        return []
    samples = record.samples[first : first + count * size, chosen]
    samples = samples.reshape(count, size, len(chosen))
    power = np.asarray(samples.var(axis=(0, 1)))
    alone = _difference(samples, 1, power)
    turns = record.speed / (2 * np.pi * periods.fundamental)
    for multiple in MULTIPLES:
        turned = abs(multiple * turns - round(multiple * turns)) < SYNCHRONOUS
        if turned and abs(turns - round(turns)) > SYNCHRONOUS:
            samples = _without_orders(samples, turns, multiple)
            alone = _difference(samples, 1, power)
        apart = _difference(samples, multiple, power)
        clear = (alone > UNLIKE) & (alone > BETTER * apart)
        if clear.any():
            names = ", ".join(record.names[chosen[c]] for c in np.flatnonzero(clear))
            true = periods.fundamental / multiple
            text = (
                f"the record repeats after {multiple} periods, not after one: the fundamental is "
                f"{true:.6g} Hz, not {periods.fundamental:.6g}; multiply the harmonics by "
                f"{multiple}"
            )
            return [Check("multiple period", names, text, "warning")]
    return []


def _without_orders(samples: Floats, turns: float, multiple: int) -> Floats:
    """Return the samples without the orders of the rotation, which explain themselves.

    Shape (period, sample, channel); the rotation makes so many turns a period, and a whole number
    of them in a multiple.
    """
    count, size, channels = samples.shape
    used = count - count % multiple
    joined = samples[:used].reshape(-1, multiple * size, channels)
    lines = np.fft.rfft(joined, axis=1)
    once = round(abs(turns) * multiple)
    lines[:, once :: max(once, 1)] = 0.0
    left = np.fft.irfft(lines, n=multiple * size, axis=1)
    return np.asarray(left.reshape(used, size, channels))


def _difference(samples: Floats, lag: int, power: Floats) -> Floats:
    """Return half the power of what differs between periods so far apart, over that of all."""
    change = samples[lag:] - samples[:-lag]
    return np.asarray((change**2).mean(axis=(0, 1)) / (2 * np.maximum(power, 1e-300)))
