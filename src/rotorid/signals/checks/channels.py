"""Checks of single channels: dead, stuck, clipped, copied, lost samples (docs/signals.md).

What moves comes to rest by and by, and what drives rests where it drives nothing: a logger that
has lost a channel repeats its last value, or lets the last digit of it play.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from rotorid.core.distributions import median
from rotorid.core.notes import Note, Severity
from rotorid.core.values import Booleans, Complexes, Floats, frozen
from rotorid.data.record import Channel, PeriodicRecord, Record
from rotorid.signals.checks.registry import (
    NO_SCATTER,
    Seen,
    first_used,
    period_check,
    record_check,
    whole_check,
)

INPUT_UNITS = frozenset({"N", "N m", "A", "T", "V"})
"""Units of what drives a machine: such a channel may be quiet for good reason; a sensor may not."""
CLIPPED_RUN = 3
"""Equal samples in a row that make a flat top: a smooth signal has two, by symmetry, not three."""
CLIPPED_SAMPLES = 5
"""Samples in flat tops from which on a channel is called clipped: one touch bends no line."""
STEEP = 2.5
"""Steps of the converter within one sample beside a flat top; what comes to rest creeps in."""
TWO_LEVELS = 0.5
"""Part of the samples at the limits from which on the signal is one of two levels, not clipped."""
UNDITHERED = 0.3
"""Scatter over quantum below which rounding repeats in every period: at 0.3 the mean still holds a
sixth of its error, at 0.5 a hundredth (`repeated_rounding`)."""
COARSE = 20.0
"""Deviation over quantum below which the rounding, q / sqrt(12), is more than 1.5 % of it."""
COPY = 1e-9
"""Variance left of one channel without another, relative: two converters share no noise."""
TELLING = 3
"""Values that tell a copy, at the least: of two, less their mean, all channels are the same."""
WRITTEN, MANY_LEVELS = 0.25, 20
"""Steps within which all levels lie about their places where their counts were written with few
digits, and levels that do not lie so by chance."""
DITHER = 2.5
"""Steps within which the last digit plays that reads nothing: one up or down, and rounding."""
REFERENCE = "stuck reference"
"""The check of references that stop: what they do not hold counts as noise, and rejects nothing."""

_FEW = 1000
_PART = 4000  # samples from which the quantum is read: more of them tell nothing new
_ROUNDING = 1e-9  # differences of scaled counts are whole multiples up to this
_MOST_LEVELS = 2**20  # beyond 20 bits it is the rounding of single-precision floats


def is_input(channel: Channel) -> bool:
    return channel.hold or channel.drive is not None or channel.unit in INPUT_UNITS


def inputs_of(channels: Sequence[Channel]) -> list[int]:
    return [c for c, channel in enumerate(channels) if is_input(channel)]


def sensors_of(channels: Sequence[Channel]) -> list[int]:
    return [c for c, channel in enumerate(channels) if not is_input(channel)]


def _spread(samples: Floats) -> Floats:
    return samples[:: max(1, len(samples) // _PART)]


def quantum(samples: Floats) -> float:
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
        # Counts that were written with few digits are no multiples, but keep near their places.
        step = float(spacing.sum() / np.round(multiples).sum())
        off = np.cumsum(spacing) / step - np.cumsum(np.round(multiples))
        if len(spacing) < MANY_LEVELS or np.ptp(off) > WRITTEN:
            return 0.0
    return step if (levels[-1] - levels[0]) / step < _MOST_LEVELS else 0.0


def repeated_rounding(record: Record, periods: PeriodicRecord) -> Floats:
    """Return the variance that rounding gives to mean lines where it repeats, shape (channel,).

    Noise of s steps leaves ``h = sum_m exp(-(2 pi m s)^2) / (2 pi^2 m^2)`` squared steps of the
    rounding in the mean, 1/12 without noise, and ``s^2 + 1/12 - h`` in the scatter, which tells s
    (Widrow and Kollar, Quantization Noise, 2008). Samples on one step share an error, and so do
    those that lines of a common divisor repeat within the period.
    """
    noise, m = np.linspace(0.0, 1.0, 200), np.arange(1, 200)[:, None]
    held = (np.exp(-((2 * np.pi * m * noise) ** 2)) / (2 * np.pi**2 * m**2)).sum(axis=0)
    found, scatter = np.zeros(len(record.channels)), np.sqrt(periods.variance.mean(axis=0))
    path = np.abs(np.diff(periods.mean, axis=0, append=periods.mean[:1])).sum(axis=0)
    most = periods.samples // np.gcd.reduce([*periods.harmonics, periods.samples])
    for c, channel in enumerate(record.channels):
        step = 0.0 if channel.hold else quantum(record.samples[:, c])
        size = float(np.ptp(record.samples[:, c]))
        # What does not scatter is computed; what has two levels or three is no motion.
        if step and scatter[c] > NO_SCATTER * size and size > DITHER * step:
            variance = step**2 * np.interp((scatter[c] / step) ** 2, noise**2 + 1 / 12 - held, held)
            found[c] = variance / np.clip(path[c] / step, 1, most)
    return found


@record_check("dead", "every channel moves", whole=True)
def check_dead(seen: Seen) -> Iterator[Note]:
    """Refuse a still sensor where others scatter between periods: no sensor is without noise."""
    record, scatter = seen.part, seen.scatter
    if not len(record.samples):
        return
    # A channel that moves at once need not be read to its end.
    still = np.flatnonzero((record.samples[:_FEW] == record.samples[0]).all(axis=0))
    dead = [int(c) for c in still if (record.samples[:, c] == record.samples[0, c]).all()]
    sensors = sensors_of(record.channels)
    all_dead = bool(sensors) and set(sensors) <= set(dead)
    for c in dead:
        channel = record.channels[c]
        value = record.samples[0, c]
        severity: Severity
        if is_input(channel):
            text, severity = "it informs of nothing; ignore if intended", "says"
        elif all_dead or (scatter is not None and scatter[sensors].any()):
            text = "a sensor that never moves; check its cable, name another column or leave it out"
            severity = "refuses"
        else:
            text, severity = "right only if nothing moves there", "warns"
        yield Note(
            "dead", severity, f"{value + 0.0:.6g} in every sample: {text}", on=(channel.name,)
        )


@record_check("clipped", "no channel is cut at a limit", whole=True)
def check_clipped(seen: Seen) -> Iterator[Note]:
    """Find channels that are cut at a limit: flat tops that it meets at full slope."""
    record = seen.part
    if not len(record.samples):
        return
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
            "samples)"
        )
        cure = "lower the excitation or widen the range, and record again"
        yield Note("clipped", "warns", text, cure, on=(channel.name,))


def _flat(samples: Floats, value: float) -> int:
    at = samples == value
    if np.count_nonzero(at) < CLIPPED_RUN or at.mean() > TWO_LEVELS:
        return 0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], at.view(np.int8), [0]])))
    first, after = edges[::2], edges[1::2]
    # A command that is held for several samples is flat everywhere: its tops count when longer.
    held = len(samples) / (np.count_nonzero(np.diff(samples)) + 1)
    least = CLIPPED_RUN * max(1, round(held)) if held > 1.5 else CLIPPED_RUN
    # Where the record begins or ends in one it may stand still: what it was cut from is not seen.
    long = (after - first >= least) & (first > 0) & (after < len(samples))
    if not long.any():
        return 0
    before, behind = samples[np.maximum(first - 1, 0)], samples[np.minimum(after, len(samples) - 1)]
    steps = np.maximum(np.abs(before - value), np.abs(behind - value))[long]
    # What is written with so many digits is coarsest in the decade of its limit.
    decade = 10 ** (np.ceil(np.log10(abs(value) or 1.0)) - 1)
    near = samples[np.abs(samples) >= decade] if value else samples
    if median(steps) <= STEEP * max(quantum(samples), quantum(near)):
        return 0
    return int((after - first)[long].sum())


OF_SAMPLES = frozenset({"clipped", "stuck"})
"""Checks that doubt some samples of a record, the others being right."""


def doubtful_samples(record: Record) -> Booleans:
    """Return the samples in which some channel is flat at a limit or rests in the middle."""
    valid = np.ones(len(record.samples), dtype=bool) if record.valid is None else record.valid
    found = np.zeros(len(valid), dtype=bool)
    for samples in np.where(valid[:, None], record.samples, 0.0).T:
        for limit in (samples.min(), samples.max()):
            found |= (samples == limit) & (_flat(samples, float(limit)) >= CLIPPED_SAMPLES)
        if (rest := _longest(samples)) is not None:
            found[rest.first : rest.after] = True
        found[: _repeated(samples)] = True
    return found


@record_check("quantized", "no channel is too coarse", whole=True)
def check_quantized(seen: Seen) -> Iterator[Note]:
    record, scatter = seen.part, seen.scatter
    for c, channel in enumerate(record.channels):
        step = quantum(record.samples[:, c])
        if step == 0 or channel.hold:
            continue
        few = _spread(record.samples[:, c])
        size = float(few.std())
        if np.ptp(few) <= DITHER * step and np.ptp(record.samples[:, c]) <= DITHER * step:
            yield _last_digit(channel, float(median(few)), step)
            continue
        told = f"steps of {step:.3g} {channel.unit}, {size / step:.3g} of them to its rms"
        if repeats := scatter is not None and 0 < scatter[c] < UNDITHERED * step:
            told += f", {scatter[c] / step:.2g} to the scatter between periods: the rounding "
            told += "repeats in every period, no mean removes it, and deviations are wider by it"
        if repeats or size < COARSE * step:
            yield Note("quantized", "says", f"{told}: use a finer range", on=(channel.name,))


def _last_digit(channel: Channel, level: float, step: float) -> Note:
    text = f"{level:.6g} {channel.unit} in every sample, to its last digits of {step:.3g}"
    if is_input(channel):
        return Note("quantized", "says", f"{text}: it drives nothing", on=(channel.name,))
    text = f"{text}: it reads nothing; check its cable and its logger, or use a finer range"
    return Note("quantized", "warns", text, on=(channel.name,))


@record_check(
    "copied", "no two channels are the same", needs=lambda seen: seen.periods is None, whole=True
)
def _copied(seen: Seen) -> Iterator[Note]:
    """Tell of copies; of what is fitted whole none is refused: without noise sensors are alike."""
    part = seen.part
    for note in check_copied(part.channels, part.samples - part.samples.mean(axis=0)):
        yield note if seen.channels is None else replace(note, severity="warns")


@period_check("copied", "no two channels are the same")
def _copied_scatter(periods: PeriodicRecord) -> Iterator[Note]:
    """Compare what differs from period to period, where it is more than rounding."""
    z = periods.spectra - periods.mean_spectrum
    level = np.sqrt((np.abs(periods.spectra) ** 2).mean(axis=(0, 1)))
    noisy = np.sqrt((np.abs(z) ** 2).mean(axis=(0, 1))) > NO_SCATTER * level
    flat = np.where(noisy, z, 0.0).reshape(-1, z.shape[2])
    return check_copied(periods.channels, np.concatenate([flat.real, flat.imag]))


def check_copied(channels: Sequence[Channel], deviations: Floats) -> Iterator[Note]:
    """Find channels of the same deviations, (value, channel); each copy is told of the first."""
    power = np.sqrt((deviations**2).sum(axis=0))
    alive = power > 0
    unit = deviations / np.where(alive, power, 1.0)
    correlation = unit.T @ unit
    near = np.triu(np.abs(correlation) > 0.999, 1) & alive & alive[:, None]
    copies: set[int] = set()
    for i in range(len(channels)) if len(deviations) >= TELLING else ():
        for j in (int(k) for k in np.flatnonzero(near[i]) if not {i, int(k)} & copies):
            rest = unit[:, j] - correlation[i, j] * unit[:, i]
            if (rest**2).sum() > COPY:
                continue
            copies.add(j)
            factor = correlation[i, j] * power[j] / power[i]
            both_sensors = not is_input(channels[i]) and not is_input(channels[j])
            yield Note(
                "copied",
                "refuses" if both_sensors else "warns",
                f"{channels[j].name} is {factor:.6g} times {channels[i].name}, noise and all: "
                "one column read twice; name another",
                on=(channels[i].name, channels[j].name),
            )


STUCK = 0.02
"""Part of the record from which on one value is a stop: with 40 periods nearly one of them."""
FEWEST_STUCK = 50
"""Samples below which a stop is none: a coarse converter rests that long at a turning point."""
STUCK_BESIDE = 10.0
"""How much longer than any other rest of the channel a stop is: one of steps rests every time."""
FINE = 1e-4
"""Part of a channel's deviation that is its last digit without steps: no sensor has less noise."""
ABRUPT = 10.0
"""Last digits that a sensor moves within the one sample before a stop: a motion that ends, and be
it in ten samples a cycle, has less than three left."""
LEAP = 10.0
"""How much larger than those after it a step is that ends an old reading: motion gathers speed."""
MOVING = 0.5
"""Part of the samples outside its rest in which a drive changes: one of steps rests between."""
ASIDE = 0.2
"""Deviations from its mean at which a drive has stopped; chance puts one stop in six nearer."""

_POINTS = 5  # of a rest that are looked at: of a moving channel chance puts no five within a digit
_TRIED = 3  # rests that are measured to their ends


@frozen
class _Rest:
    first: int
    after: int
    level: float
    digit: float
    tolerance: float

    def abrupt(self, samples: Floats) -> bool:
        return self.first > 0 and abs(samples[self.first - 1] - self.level) > ABRUPT * self.digit

    def aside(self, samples: Floats) -> bool:
        """Tell whether a drive that moves all the time otherwise rests where it does not belong."""
        moving = np.delete(samples, slice(self.first, self.after))
        if len(moving) < 2 or (np.abs(np.diff(moving)) > self.tolerance).mean() < MOVING:
            return False
        return bool(abs(self.level - moving.mean()) > ASIDE * moving.std())

    def alone(self, samples: Floats) -> bool:
        beside = max(2, int((self.after - self.first) / STUCK_BESIDE))
        parts = samples[: self.first], samples[self.after :]
        whole = (part[: len(part) // beside * beside].reshape(-1, beside) for part in parts)
        return all((np.ptp(each, axis=1) > self.tolerance).all() for each in whole)


@record_check("stuck", "no channel stops in the middle", whole=True)
def check_stuck(seen: Seen) -> Iterator[Note]:
    """Find channels that stop in the middle: one value for a good part of the record.

    What lies before the periods is not used, and may rest. Where the motion repeats, no rest
    belongs to it; otherwise a sensor has to stop out of full motion.
    """
    record, first = seen.record if seen.untorn else seen.part, 0
    if seen.periods is not None:
        first = max(0, first_used(record, seen.periods))
    for c, channel in enumerate(record.channels):
        samples = record.samples[first:, c]
        rest = _longest(samples)
        if rest is None:
            if seen.periods is None and not is_input(channel):
                yield from _stale(record, channel.name, samples)
            continue
        reference = channel.name in seen.references
        severity: Severity = "refuses"
        if reference or is_input(channel):
            severity = "warns" if rest.aside(samples) else "says"
        elif not rest.abrupt(samples) and (seen.periods is None or rest.tolerance > 0):
            severity = "says"
        start, rate = record.start + first / record.sample_rate, record.sample_rate
        stop, go = start + rest.first / rate, start + rest.after / rate
        how = "in every sample" if rest.tolerance == 0 else "to the last digit"
        text = (
            f"{rest.level:.6g} {how} from {stop:.4g} to {go:.4g} s, while it moves beside that: "
            "it informs of nothing there"
        )
        cure = "check its cable and its logger, use the part in which it moves (skip, until)"
        if severity == "says":
            cure = "right only if nothing was to move there"
        about = REFERENCE if reference else "stuck"
        yield Note(about, severity, text, cure, on=(channel.name,))


def _stale(record: Record, name: str, samples: Floats) -> Iterator[Note]:
    """Tell of a logger that repeats an old reading at first, and leaps when the next one comes."""
    if not (old := _repeated(samples)):
        return
    goes = f"{record.start + old / record.sample_rate:.6g} s"
    text = f"{samples[0]:.6g} in every sample until {goes}, then a leap to {samples[old]:.6g}"
    cure = f'an old reading, which the logger repeated: skip = "{goes}" or later'
    yield Note("stuck", "warns", text, cure, on=(name,))


def _repeated(samples: Floats) -> int:
    steps = np.abs(np.diff(samples))
    old = int(np.argmax(steps > 0)) + 1 if len(steps) else 0
    if old < CLIPPED_SAMPLES:
        return 0
    near = steps[old : 2 * old].max(initial=quantum(samples))
    return old if steps[old - 1] >= max(LEAP * near, steps[old:].max(initial=0.0)) else 0


@whole_check(REFERENCE)
def _idle(seen: Seen) -> Iterator[Note]:
    """Tell of references that never move; one that is zero belongs to an axis at rest."""
    text = "what it drove counts as noise, and widens deviations: name the column of the excitation"
    values = {name: seen.record.column(name) for name in seen.references}
    still = {name: samples[0] for name, samples in values.items() if np.ptp(samples) == 0}
    none_moves = len(still) == len(values)  # not an axis at rest: all of them
    for name, value in still.items():
        severity: Severity = "warns" if value or none_moves else "says"
        yield Note(REFERENCE, severity, f"{value:.6g} in every sample: {text}", on=(name,))


def _longest(samples: Floats) -> _Rest | None:
    """Return the longest rest of a channel that can be a stop, exact or to the last digit."""
    least = max(FEWEST_STUCK, int(np.ceil(STUCK * len(samples))))
    step = max(1, least // (_POINTS + 1))
    some = samples[::step]
    if len(some) < 2 * _POINTS or (some == some[0]).all():
        return None
    windows = np.ptp(sliding_window_view(some, _POINTS), axis=1)
    digit = max(quantum(samples), FINE * float(some.std()))
    for tolerance in (0.0, DITHER * digit):
        rests = list(_rests(samples, windows, step, digit, tolerance))
        best = max(rests, key=lambda rest: rest.after - rest.first, default=None)
        if best is None or not least <= best.after - best.first < len(samples):
            continue  # too short; or it never moves, which is told by itself
        if best.alone(samples):
            return best
    return None


def _rests(
    samples: Floats, windows: Floats, step: int, digit: float, tolerance: float
) -> Iterator[_Rest]:
    """Yield the rests that the longest runs of quiet windows belong to, measured to their ends."""
    quiet = np.flatnonzero(windows <= tolerance)
    if not len(quiet):
        return
    runs = np.split(quiet, np.flatnonzero(np.diff(quiet) > 1) + 1)
    for run in sorted(runs, key=len, reverse=True)[:_TRIED]:
        begin, end = int(run[0]) * step, (int(run[-1]) + _POINTS - 1) * step + 1
        part = samples[begin:end]
        if np.ptp(part) > tolerance:
            continue
        outside = (samples < part.max() - tolerance) | (samples > part.min() + tolerance)
        before, behind = np.flatnonzero(outside[:begin]), np.flatnonzero(outside[end:])
        first = int(before[-1]) + 1 if len(before) else 0
        after = end + int(behind[0]) if len(behind) else len(samples)
        level = float(median(samples[first:after]))
        yield _Rest(first, after, level, digit, tolerance)


LENGTHS = frozenset({"m", "rad"})
"""Units of what is smooth: a force may jump, and with it an acceleration."""
AROUND = 50
"""Samples on each side that tell what is usual there: a sweep through a resonance is no jump."""
SURE = 8.0
"""Times the usual size at which one sensor jumps: of 25,000 samples of noise the largest is 5."""
SHARE = 0.5
"""Part of the sensors that jump, at least, and two of them: one alone is a knock of its own."""


@whole_check("lost samples")
def check_jumps(seen: Seen) -> list[Note]:
    record = seen.record
    columns = [c for c in sensors_of(record.channels) if record.channels[c].unit in LENGTHS]
    if len(columns) < 2 or len(record.samples) < 4 * AROUND:
        return []
    jumps = np.stack([_jumps(record.samples[:, c]) for c in columns], axis=1) > SURE
    together = np.flatnonzero(jumps.sum(axis=1) >= max(2, SHARE * len(columns)))
    if not len(together):
        return []
    together = together[np.append(True, np.diff(together) > 2)]  # beside a jump is half of it
    at = record.start + (int(together[0]) + 0.5) / record.sample_rate
    more = len(together) - 1
    text = (
        f"{int(jumps[together[0]].sum())} positions jump within a sample at {at:.6g} s"
        f"{f' and at {more} more places' if more else ''}: samples are missing there or come "
        "twice; use the part before or behind (skip, until)"
    )
    return [Note("lost samples", "warns", text)]


def _jumps(samples: Floats) -> Floats:
    """Return by how much a channel moves from each sample to the next beyond what is usual."""
    steps = np.diff(samples)
    beyond = np.zeros(len(steps))
    beyond[1:-1] = np.abs(steps[1:-1] - (steps[:-2] + steps[2:]) / 2)
    power = beyond**2
    width = 2 * AROUND + 1
    near = scipy.ndimage.uniform_filter1d(power, width) * width
    near -= scipy.ndimage.uniform_filter1d(power, 3) * 3  # not of the jump itself
    usual = np.sqrt(np.maximum(near, 0.0) / (width - 3))
    usual = np.maximum(usual, 1e-12 * np.abs(samples).max(initial=0.0))
    return np.asarray(beyond / np.where(usual > 0, usual, np.inf))


LEAST_ROWS = 3
"""Rows that must agree to the last digit before a probe counts as stuck."""
ABOVE = 3.0
"""Deviations by which some row must rise above nothing."""
TURNS = 2.0
"""Revolutions beyond which no instrument counts a phase."""
LIKE_RADIANS = 1.5
"""Spread of phases, all within 2 pi degrees, from which on they look like radians: near a critical
speed phases pass through pi, far from one they keep their place."""


def check_probes(names: Sequence[str], phasors: Complexes, std: Floats | None) -> Iterator[Note]:
    """Find probes that read nothing, or ever the same; phasors of shape (row, probe)."""
    for k, name in enumerate(names):
        size = np.abs(phasors[:, k])
        if not size.any():
            text = "0 in every row: check its cable, or leave the channel out"
            yield Note("dead", "refuses", text, on=(name,))
        elif len(size) >= LEAST_ROWS and (phasors[:, k] == phasors[0, k]).all():
            text = f"the same in all {len(size)} rows: check its columns, or leave the channel out"
            yield Note("dead", "refuses", text, on=(name,))
        elif std is not None and (size < ABOVE * std[:, k]).all():
            text = f"no row rises above {ABOVE:g} times its std: check its cable and its unit"
            yield Note("silent", "warns", text, on=(name,))


def check_phases(name: str, phases: Floats, *, degrees: bool) -> Iterator[Note]:
    size, spread = float(np.abs(phases).max(initial=0.0)), float(np.ptp(phases))
    low, high = float(phases.min()), float(phases.max())
    if not degrees and size > TURNS * 2 * np.pi:
        text = f'phases up to {size:.4g} rad: if they are degrees, set phase_unit = "deg"'
        yield Note("phase unit", "refuses", text, on=(name,))
    elif degrees and size <= 2 * np.pi and spread > LIKE_RADIANS and len(phases) >= LEAST_ROWS:
        text = (
            f"phases from {low:.3g} to {high:.3g} degrees, no more: if they are radians, set "
            'phase_unit = "rad"'
        )
        yield Note("phase unit", "warns", text, on=(name,))
