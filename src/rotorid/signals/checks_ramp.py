"""Offsets that drift: no scatter between periods shows them, so they are taken out, and told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotorid.record import Check, Floats, PeriodicRecord, Record

RAMP = 1.0
"""A ramp's line over the deviation of the mean line from which on it biases as much as noise."""
LEAST = 6
"""Periods below which a beginning, a middle and an end say little."""
BENT = 0.2
"""Distance of the middle from the straight line, over the rise, from which on it is no ramp."""
ROUNDING = 1e-9
"""A ramp's line over the channel's own below which it is rounding."""


def ramps(record: Record, periods: PeriodicRecord) -> Floats:
    """Return by how much the offset of each channel rises in a period, 0 where that is no matter.

    A ramp within every period is the same in each, and falls on all lines: on line k of one that
    rises by d in a period d / (2 pi k).
    """
    none = np.zeros(len(record.channels))
    size, count = periods.samples, periods.periods
    first = round((periods.begin - record.start) * record.sample_rate)
    lines = periods.harmonics > 0
    whole = (len(record.samples) - first) // size
    if record.valid is not None or whole != count or count < LEAST or not lines.any():
        return none
    middle = count // 2
    at = first + size * np.array([0, middle, count - 1])
    begin, half, end = (record.samples[k : k + size].mean(axis=0) for k in at)
    rise = (end - begin) / (count - 1)
    power = np.abs(periods.spectra - periods.mean_spectrum)[:, lines] ** 2
    std = np.sqrt(power.sum(axis=0) / (count - 1) / count)
    line = np.abs(rise) / (2 * np.pi * periods.harmonics[lines, None])
    level = np.sqrt((np.abs(periods.mean_spectrum) ** 2).mean(axis=0))
    told = (line > np.maximum(RAMP * std, ROUNDING * level)).any(axis=0)
    straight = np.abs(half - begin - middle * rise) <= BENT * (count - 1) * np.abs(rise)
    return np.where(told & straight, rise, 0.0)


def without_ramps(record: Record, periods: PeriodicRecord, rise: Floats) -> Record:
    """Return a record without its ramps; its mean stays."""
    place = (np.arange(len(record.samples)) - len(record.samples) / 2) / periods.samples
    return replace(record, samples=record.samples - place[:, None] * rise)


def ramp_notes(periods: PeriodicRecord, rise: Floats) -> tuple[Check, ...]:
    """Say which offsets drift."""
    return tuple(
        Check(
            "drift",
            channel.name,
            f"the offset drifts by {abs(d) * (periods.periods - 1):.3g} {channel.unit} over the "
            "record: a straight line was taken out",
            "note",
        )
        for channel, d in zip(periods.channels, rise, strict=True)
        if d
    )
