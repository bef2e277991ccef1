"""Checks of single channels, sample by sample: dead, clipped, quantized, copied."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.record import Channel, Check, Floats, Record, Verdict
from rotorid.signals.sums import median

INPUT_UNITS = frozenset({"N", "N m", "A", "T", "V"})
"""Units of what drives a machine: such a channel may be quiet for good reason; a sensor may not."""

CLIPPED_RUN = 3
"""Equal samples in a row that make a flat top: a smooth signal has two, by symmetry, not three."""

CLIPPED_SAMPLES = 5
"""Samples in flat tops from which on a channel is called clipped: one touch bends no line."""

STEEP = 2.5
"""Steps of the converter within one sample that a clipped signal has beside its flat top; one
that comes to rest there creeps in by single steps."""

TWO_LEVELS = 0.5
"""Part of the samples at the limits from which on the signal is one of two levels, not clipped."""

UNDITHERED = 0.3
"""Scatter over quantum below which rounding repeats in every period and no mean removes it: at
0.3 the mean still holds a sixth of the rounding error, at 0.5 a hundredth (exp(-2 pi^2 (s/q)^2),
the characteristic function of the noise at the staircase's first harmonic)."""

COARSE = 20.0
"""Standard deviation of a channel over its quantum below which the rounding, q / sqrt(12), is more
than about 1.5 % of the signal."""

COPY = 1e-9
"""What is left of one channel when another is taken off, over its variance, below which the two
are the same column: two converters share no noise."""

DITHER = 2.5
"""Steps of a converter within which the last digit of a channel plays that reads nothing: one up
or down, and what rounding makes of it."""

_FEW = 1000
_PART = 4000  # samples from which the quantum is read: more of them tell nothing new
_ROUNDING = 1e-9  # differences of scaled counts are whole multiples up to this
_MOST_LEVELS = 2**20  # beyond 20 bits it is the rounding of single-precision floats


def is_input(channel: Channel) -> bool:
    """Tell whether a channel drives the machine, by how it was recorded and its unit."""
    return channel.hold or channel.drive is not None or channel.unit in INPUT_UNITS


def _spread(samples: Floats) -> Floats:
    return samples[:: max(1, len(samples) // _PART)]


def quantum(samples: Floats) -> float:
    """Return the step between the levels of a channel; 0 where there are no levels."""
    levels = np.sort(_spread(samples))
    spacing = np.diff(levels)
    spacing = spacing[spacing > 0]
    if not len(spacing):
        return 0.0
    step = float(median(spacing[spacing <= 1.5 * spacing.min()]))
    largest = max(abs(levels[0]), abs(levels[-1]))
    if step <= np.finfo(float).eps * largest:
        return 0.0  # no converter has so many
    multiples = spacing / step
    rounding = _ROUNDING + 4 * np.finfo(float).eps * largest / step
    if np.abs(multiples - np.round(multiples)).max() > max(rounding * multiples.max(), 1e-3):
        return 0.0
    return step if (levels[-1] - levels[0]) / step < _MOST_LEVELS else 0.0


def check_dead(record: Record, scatter: Floats | None = None) -> list[Check]:
    """Find channels that say nothing: the same value in every sample.

    Parameters
    ----------
    record : Record
    scatter : array, shape (channel,), optional
        Standard deviation of a sample between periods: where the others have some, it is measured,
        and no sensor is without.
    """
    if not len(record.samples):
        return []
    # A channel that moves at once need not be read to its end.
    still = np.flatnonzero((record.samples[:_FEW] == record.samples[0]).all(axis=0))
    dead = [int(c) for c in still if (record.samples[:, c] == record.samples[0, c]).all()]
    sensors = [c for c, channel in enumerate(record.channels) if not is_input(channel)]
    all_dead = bool(sensors) and set(sensors) <= set(dead)
    found = []
    for c in dead:
        channel = record.channels[c]
        value = record.samples[0, c]
        verdict: Verdict
        if is_input(channel):
            text, verdict = "it drives nothing; right if so meant", "note"
        elif all_dead or (scatter is not None and scatter[sensors].any()):
            text = "a sensor that never moves; check its cable, name another column or leave it out"
            verdict = "refused"
        else:
            text, verdict = "right only if nothing moves there", "warning"
        found.append(
            Check("dead", channel.name, f"{value + 0.0:.6g} in every sample: {text}", verdict)
        )
    return found


def check_clipped(record: Record) -> list[Check]:
    """Find channels that are cut at a limit: flat tops that it meets at full slope."""
    found = []
    if not len(record.samples):
        return []
    for c, channel in enumerate(record.channels):
        samples = np.ascontiguousarray(record.samples[:, c])
        limits = samples.min(), samples.max()
        touched = max(np.count_nonzero(samples == limit) for limit in limits)
        # Most channels touch their extremes once: there is nothing more to look at.
        if limits[0] == limits[1] or touched < CLIPPED_RUN:
            continue
        counts = {float(limit): _flat(samples, float(limit)) for limit in limits}
        if sum(counts.values()) < CLIPPED_SAMPLES:
            continue
        where = " and ".join(
            f"{count} at {value:.4g} {channel.unit}".strip()
            for value, count in counts.items()
            if count
        )
        text = (
            f"flat tops of {where} ({100 * sum(counts.values()) / len(samples):.2g} % of the "
            "samples): lower the excitation or widen the range, and record again"
        )
        found.append(Check("clipped", channel.name, text, "warning"))
    return found


def _flat(samples: Floats, value: float) -> int:
    """Return how many samples lie in flat tops at this value."""
    at = samples == value
    if np.count_nonzero(at) < CLIPPED_RUN or at.mean() > TWO_LEVELS:
        return 0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], at.view(np.int8), [0]])))
    first, after = edges[::2], edges[1::2]
    # A command that is held for several samples is flat everywhere: its tops count when longer.
    held = len(samples) / (np.count_nonzero(np.diff(samples)) + 1)
    least = CLIPPED_RUN * max(1, round(held)) if held > 1.5 else CLIPPED_RUN
    long = after - first >= least
    if not long.any():
        return 0
    before, behind = samples[np.maximum(first - 1, 0)], samples[np.minimum(after, len(samples) - 1)]
    steps = np.maximum(np.abs(before - value), np.abs(behind - value))[long]
    if median(steps) <= STEEP * quantum(samples):
        return 0
    return int((after - first)[long].sum())


def check_quantized(record: Record, scatter: Floats | None = None) -> list[Check]:
    """Find channels whose steps are so coarse that their rounding does not average out.

    Parameters
    ----------
    record : Record
    scatter : array, shape (channel,), optional
        Standard deviation of a sample between periods.
    """
    found = []
    for c, channel in enumerate(record.channels):
        step = quantum(record.samples[:, c])
        if step == 0 or channel.hold:
            continue
        few = _spread(record.samples[:, c])
        size = float(few.std())
        if np.ptp(few) <= DITHER * step and np.ptp(record.samples[:, c]) <= DITHER * step:
            found.append(_last_digit(channel, float(median(few)), step))
            continue
        told = f"steps of {step:.3g} {channel.unit}, {size / step:.3g} of them to its rms"
        if scatter is not None and 0 < scatter[c] < UNDITHERED * step:
            text = (
                f"{told}, {scatter[c] / step:.2g} to the scatter between periods: the rounding "
                "repeats in every period and no mean removes it; use a finer range"
            )
            verdict: Verdict = "warning" if size < COARSE * step else "note"
            found.append(Check("quantized", channel.name, text, verdict))
        elif size < COARSE * step:
            found.append(Check("quantized", channel.name, f"{told}: use a finer range", "note"))
    return found


def _last_digit(channel: Channel, level: float, step: float) -> Check:
    """Tell of a channel whose last digit is all that moves."""
    text = f"{level:.6g} {channel.unit} in every sample, to its last digits of {step:.3g}"
    if is_input(channel):
        return Check("quantized", channel.name, f"{text}: it drives nothing", "note")
    text = f"{text}: it reads nothing; check its cable and its logger, or use a finer range"
    return Check("quantized", channel.name, text, "warning")


def check_copied(channels: Sequence[Channel], deviations: Floats) -> list[Check]:
    """Find pairs of channels whose noise is the same: one column read twice.

    Parameters
    ----------
    channels : sequence of Channel
    deviations : array, shape (value, channel)
        What chance makes of each channel: deviations from the mean over periods, or, where there
        are no periods, the samples less their mean.
    """
    power = np.sqrt((deviations**2).sum(axis=0))
    alive = power > 0
    unit = deviations / np.where(alive, power, 1.0)
    correlation = unit.T @ unit
    found = []
    for i in range(len(channels)):
        for j in range(i + 1, len(channels)):
            if not (alive[i] and alive[j] and abs(correlation[i, j]) > 0.999):
                continue
            rest = unit[:, j] - correlation[i, j] * unit[:, i]
            if (rest**2).sum() > COPY:
                continue
            factor = correlation[i, j] * power[j] / power[i]
            both_sensors = not is_input(channels[i]) and not is_input(channels[j])
            found.append(
                Check(
                    "copied",
                    f"{channels[i].name}, {channels[j].name}",
                    f"{channels[j].name} is {factor:.6g} times {channels[i].name}, noise and all: "
                    "one column read twice; name another",
                    "refused" if both_sensors else "warning",
                )
            )
    return found
