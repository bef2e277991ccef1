"""Whole periods of a record averaged, in memory or block by block."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from numbers import Real
from typing import Any

import numpy as np

from rotorid.core.errors import InputError, naming, require_each, require_positive, require_type
from rotorid.core.notes import Note
from rotorid.core.units import quantity
from rotorid.core.values import Booleans, Complexes, Floats, Integers, frozen
from rotorid.data.record import (
    Channel,
    PeriodicRecord,
    Record,
    RotationLine,
    Steady,
    changed,
    check_samples,
    some_periods,
)
from rotorid.signals.checks.channels import OF_SAMPLES, doubtful_samples, repeated_rounding
from rotorid.signals.checks.periods import LOOKED_AT, ramp_notes, ramps, without_ramps
from rotorid.signals.checks.registry import check_periods, check_record
from rotorid.signals.spectrum import line_spectra, lines_within, transfer_of_recording
from rotorid.signals.turning import (
    LEAST,
    SURE,
    Turning,
    also_kept,
    orders_apart,
    plausible_slip,
    scattered,
    slip,
    turning,
)

KEYS = frozenset({"fundamental", "period_samples", "harmonics", "band", "skip"})
"""What an error of this module is about, by the place that it names."""
_LOOKED_AT = 1 << 14
"""Samples of a long record whose channels are checked one by one."""


def average(
    record: Record,
    fundamental: float | str | None = None,
    *,
    period_samples: int | None = None,
    harmonics: Sequence[int] | None = None,
    band: tuple[float | str, float | str] | None = None,
    skip: float | str = 0.0,
) -> PeriodicRecord:
    """Cut a record into whole periods and keep the chosen lines of each.

    Parameters
    ----------
    record : Record
    fundamental : float or str, optional
        Hz; the sample rate is a whole multiple of it. Or `period_samples`.
    period_samples : int, optional
        Samples of a period.
    harmonics : sequence of int, optional
        Lines to keep, as multiples of the fundamental; 0 is DC. Or `band`.
    band : (float, float), optional
        Hz; keeps every harmonic in it, both ends included.
    skip : float or str
        Settling to drop, in s. Whole periods after it are used, what is left over is not.

    Returns
    -------
    PeriodicRecord

    Raises
    ------
    InputError
        For a period that is no whole number of samples, fewer than two periods, lines beyond
        the Nyquist frequency, and options that contradict one another.

    Examples
    --------
    >>> from rotorid.data.record import Channel
    >>> wave = np.cos(2 * np.pi * np.arange(40) / 10)[:, None]
    >>> periodic = average(Record([Channel("x")], wave, 100.0), 10.0, harmonics=[1])
    >>> periodic.periods, periodic.mean_spectrum.real.round(12)
    (4, array([[0.5]]))
    """
    require_type(record, Record, place="record")
    hertz = None if fundamental is None else quantity(fundamental, "Hz")
    ends = None if band is None else (quantity(band[0], "Hz"), quantity(band[1], "Hz"))
    with naming(record.source):
        sums = _begun(record, hertz, period_samples, harmonics, ends)
        begin, size = quantity(skip, "s"), sums.size
        first = _first_sample(record.sample_rate, begin, record.start)
        whole = _whole_periods(max(len(record.samples) - first, 0), size)
        used = slice(first, first + whole * size)
        kept, warnings = _kept_periods(record, used, size)
        samples = record.samples[used].reshape(whole, size, -1)
        samples = samples if kept.all() else samples[kept]
        sums.add(samples)
    even, mark = Steady(first, (whole, size), record.sample_rate, record.start), None
    if record.angle is not None:
        mark = record.angle[used].reshape(whole, size)[kept]
    found, sums = _with_rotation(
        sums,
        lambda: np.array_split(samples, range(_LEAST, len(samples), _LEAST)),
        even if kept.all() else even()[kept],
        mark,
        speed=record.speed,
        phase_known=record.phase_known,
        phase_std=record.phase_std,
        source=record.source,
        warnings=warnings,
    )
    rise = ramps(record, found, sums.offsets)
    if rise.any():
        flat = without_ramps(record, found, rise)
        again = average(flat, period_samples=size, harmonics=sums.lines.tolist(), skip=skip)
        return changed(again, checks=(*again.checks, *ramp_notes(again, rise)))
    excerpt = _excerpt(record, first, size)
    seen = check_record(record, found, excerpt=excerpt)
    if any(note.about in OF_SAMPLES for note in seen if note.severity == "warns"):
        doubtful = doubtful_samples(record)[used].reshape(whole, size)[kept].any(axis=1)
        in_part = () if doubtful.all() else tuple(np.flatnonzero(doubtful).tolist())
        seen = tuple(replace(n, periods=in_part) if n.about in OF_SAMPLES else n for n in seen)
    return _rounded(found, excerpt, seen)


def _rounded(periods: PeriodicRecord, excerpt: Record, seen: tuple[Note, ...]) -> PeriodicRecord:
    """Return checked periods that scatter by the rounding too that repeats in all of them."""
    checks = (*seen, *check_periods(periods, seen), *periods.checks)
    transfer = transfer_of_recording(periods.channels, periods.frequency, periods.sample_rate)
    std = transfer * np.sqrt(repeated_rounding(excerpt, periods))
    lag = max(1, periods.periods // len(periods.channels))  # converters err by themselves
    each = [np.roll(scattered(s, periods.periods), c * lag, axis=0) for c, s in enumerate(std.T)]
    return changed(periods, spectra=periods.spectra + np.stack(each, axis=-1), checks=checks)


def _excerpt(record: Record, first: int, size: int) -> Record:
    """Return periods of start, middle and end: what a channel does in every period shows in any."""
    count, few = len(record.samples), size * max(1, _LOOKED_AT // (3 * size))
    if record.valid is not None or count <= max(_LOOKED_AT, 3 * few):
        return record
    middle = first + size * ((count - first) // (2 * size))
    end = first + size * ((count - first) // size)
    parts = [slice(0, few), slice(middle - few, middle), slice(end - few, end)]
    samples = np.concatenate([record.samples[part] for part in parts])
    return replace(record, samples=samples, angle=None, valid=None)


def _kept_periods(record: Record, used: slice, size: int) -> tuple[Booleans, tuple[str, ...]]:
    if record.valid is None:
        return np.ones((used.stop - used.start) // size, dtype=bool), ()
    kept: Booleans = np.all(record.valid[used].reshape(-1, size), axis=1)
    left = int(kept.sum())
    if left < 2:
        found = f"{left} of {len(kept)} periods without a sample that the mask leaves out"
        raise InputError(found, "at least two", "record longer, or leave out less")
    told = f"{len(kept) - left} of {len(kept)} periods hold samples that are masked: left out"
    return kept, () if left == len(kept) else (told,)


@frozen
class RecordBlocks:
    channels: tuple[Channel, ...]
    sample_rate: float  # Hz
    # rad/s, and the rotor angle in rad at the file's first sample
    speed: float
    phase: float
    source: str
    # returns an iterator over blocks of samples in SI, shape (sample, channel)
    read: Callable[[], Iterator[Floats]]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(channel.name for channel in self.channels)


def average_blocks(
    blocks: RecordBlocks,
    fundamental: float | None = None,
    *,
    period_samples: int | None = None,
    harmonics: Sequence[int] | None = None,
    band: tuple[float, float] | None = None,
    skip: float = 0.0,
    phase_known: bool = True,
) -> PeriodicRecord:
    """As `average`, of a record while it is read: what is kept grows with periods x lines only."""
    rate = blocks.sample_rate
    with naming(blocks.source):
        sums = _begun(blocks, fundamental, period_samples, harmonics, band)
        first = _first_sample(rate, skip)
    # Channels are looked at in blocks 0, 1, 3, 7 and so on, and in the last.
    excerpt: list[Floats] = []
    for number, periods in enumerate(_periods_of(blocks, first, sums.size)):
        sums.add(periods)
        if number & (number - 1) and len(excerpt) > 1:
            excerpt.pop()
        few = max(1, (2048 if number else LOOKED_AT) // sums.size)
        excerpt.append(periods[:few].reshape(-1, len(blocks.channels)).copy())
    with naming(blocks.source):
        _whole_periods(sums.count * sums.size, sums.size)
    found, _ = _with_rotation(
        sums,
        lambda: _periods_of(blocks, first, sums.size),
        Steady(first, (sums.count, sums.size), rate),
        None,
        blocks.phase,
        speed=blocks.speed,
        phase_known=phase_known,
        phase_std=0.0,
        source=blocks.source,
    )
    looked = Record(blocks.channels, np.concatenate(excerpt), rate)
    return _rounded(found, looked, check_record(looked, found))


def _periods_of(blocks: RecordBlocks, first: int, size: int) -> Iterator[Floats]:
    passed, rest = 0, np.empty((0, len(blocks.channels)))
    for block in blocks.read():
        begin = min(max(first - passed, 0), len(block))
        used = block[begin:]
        check_samples(blocks.names, used, blocks.source, first=passed + begin)
        passed += len(block)
        joined = np.concatenate([rest, used]) if len(rest) else used
        whole = len(joined) // size
        if whole:
            yield joined[: whole * size].reshape(whole, size, -1)
        rest = joined[whole * size :].copy()


def _begun(
    source: Record | RecordBlocks,
    fundamental: float | None,
    period_samples: int | None,
    harmonics: Sequence[int] | None,
    band: tuple[float, float] | None,
) -> PeriodSums:
    rate, channels = source.sample_rate, source.channels
    with naming(place="period_samples" if fundamental is None else "fundamental"):
        size = _period_size(rate, fundamental, period_samples)
    lines = _lines_of(rate, size, harmonics, band)
    corrected = [c.name for c in channels if c.hold or c.delay or c.delay_std]
    if corrected and 2 * lines[-1] == size:  # its phase is not in the samples
        found = f"the Nyquist line with the hold or delay of {corrected[0]}"
        expected = "lines below the Nyquist frequency"
        raise InputError(found, expected, "leave that line out", place="harmonics")
    return PeriodSums(channels, rate, size, lines)


def _period_size(rate: float, fundamental: float | None, samples: int | None) -> int:
    if (fundamental is None) == (samples is None):
        cure = "give the fundamental frequency or the samples of a period"
        raise InputError("neither or both of fundamental and period_samples", "one of them", cure)
    exact, source = float(samples or 0), ""
    if fundamental is not None:
        cure = "set fundamental to the repetition frequency"
        require_positive(fundamental, "Hz", cure, found="a fundamental of {}")
        exact, source = rate / fundamental, f" (rate {rate:g} Hz, fundamental {fundamental:g} Hz)"
    size = round(exact) if math.isfinite(exact) else 0
    if not math.isfinite(exact) or (size >= 2 and abs(exact - size) > 1e-6 * exact):
        expected = "a whole number of samples"
        cure = "give a lower common fundamental and multiply the harmonics, or resample"
        raise InputError(f"a period of {exact:.6g} samples{source}", expected, cure)
    if size < 2:
        cure = "is the time column in ms? give its unit; or set fundamental to the true one"
        raise InputError(f"a period of {exact:.3g} samples{source}", "2 or more", cure)
    return size


def _lines_of(
    rate: float, size: int, harmonics: Sequence[int] | None, band: tuple[float, float] | None
) -> Integers:
    if (band is None) == (harmonics is None):
        raise InputError(
            "neither or both of harmonics and band",
            "one of them",
            "say which lines to keep",
            place="band" if harmonics is None else "harmonics",
        )
    if band is not None:
        return lines_within(band, rate, size)
    chosen = require_each(() if harmonics is None else harmonics, Real, place="harmonics")
    shown, key = f"the harmonics {list(chosen)}", "harmonics"
    if not len(chosen):
        raise InputError(f"no line in {shown}", "at least one line", "widen it", place=key)
    lines = sorted({int(k) for k in chosen if 0 <= k <= size // 2 and k == int(k)})
    if len(lines) < len(chosen):
        expected = f"different whole numbers from 0 to {size // 2}, half the samples of a period"
        cure = "name each line once, counted from the fundamental, or lower the fundamental"
        raise InputError(shown, expected, cure, place=key)
    return np.array(lines, dtype=np.int64)


def _first_sample(rate: float, skip: float, start: float = 0.0) -> int:
    """Return the number of samples to skip, of a record whose first is taken at a time `start`."""
    if not 0 <= skip < math.inf:
        cure = "give the time from the start of the record, in s"
        raise InputError(f"skip of {skip} s", "0 s or more", cure, place="skip")
    return max(0, math.ceil((skip - start) * rate - 1e-6))


def _whole_periods(left: int, size: int) -> int:
    if left < 2 * size:
        expected = f"at least two periods of {size} samples"
        cure = "record longer, skip less, or set fundamental to the repetition frequency"
        raise InputError(f"{left} samples after skip, {left // size} whole periods", expected, cure)
    return left // size


_CACHED = 1 << 17  # numbers that are worked on at once: a megabyte stays in the cache
_LEAST = 8  # periods worked on at once, so that merging their means costs little


@dataclass
class PeriodSums:
    """Sums of periods less their first mean, for digits (Chan, Golub and LeVeque 1983)."""

    channels: tuple[Channel, ...]
    sample_rate: float
    size: int  # samples of a period
    lines: Integers  # (line,): the multiples of the fundamental to keep
    count: int = 0

    def __post_init__(self) -> None:
        shape = self.size, len(self.channels)
        self._centre: Floats | None = None
        self._spectra: list[Complexes] = []
        self._sum, self._squares = np.zeros(shape), np.zeros(shape)
        self._apart = np.empty((0, *shape))

    def add(self, periods: Floats) -> None:
        step = max(_LEAST, _CACHED // self._sum.size)
        for begin in range(0, len(periods), step):
            part = periods[begin : begin + step]
            if self._centre is None:
                self._centre = part.mean(axis=0)
            if len(self._apart) < len(part):
                self._apart = np.empty_like(part)
            apart = np.subtract(part, self._centre, out=self._apart[: len(part)])
            self._sum += apart.sum(axis=0)
            self._squares += np.square(apart, out=apart).sum(axis=0)
            self._spectra.append(line_spectra(part, np.append(0, self.lines)))
        self.count += len(periods)

    @property
    def mean(self) -> Floats:
        """Mean over periods of each sample, shape (sample, channel)."""
        centre = 0.0 if self._centre is None else self._centre
        return np.asarray(centre + self._sum / max(self.count, 1))

    @property
    def variance(self) -> Floats:
        """Unbiased variance over periods of each sample, shape (sample, channel)."""
        squares = self._squares - self._sum**2 / self.count
        return np.asarray(np.maximum(squares, 0.0) / (self.count - 1))

    @property
    def spectra(self) -> Complexes:
        """The lines of the periods, shape (period, line, channel)."""
        return np.concatenate([part[:, 1:] for part in self._spectra])

    @property
    def offsets(self) -> Floats:
        """The mean of each period, shape (period, channel)."""
        return np.concatenate([part[:, 0].real for part in self._spectra])

    def periods(self, time: Steady | Floats, angle: Steady | Floats, **told: Any) -> PeriodicRecord:
        """Return what the sums are of, with hold, delay and dynamics of its channels undone."""
        frequency = self.lines * self.sample_rate / self.size
        transfer = transfer_of_recording(self.channels, frequency, self.sample_rate)
        return PeriodicRecord(
            channels=self.channels,
            sample_rate=self.sample_rate,
            harmonics=self.lines,
            spectra=self.spectra * transfer,
            variance=self.variance,
            mean=self.mean,
            time=time,
            angle=angle,
            **told,
        )


SETTLED = (1.0, *[0.1] * 7, np.inf)
"""Deviations by which the speed may be off in each round of finding it: from a turn off within the
record it takes six, from a tenth of one three. A speed that is off widens the first: of few periods
it never shows by more than four."""


Joint = tuple[Turning, PeriodSums]  # a rotation, and the periods without it


def _with_rotation(
    sums: PeriodSums,
    passes: Callable[[], Iterable[Floats]],  # each yields the periods anew
    time: Steady | Floats,
    mark: Floats | None,  # (period, sample): the angle that one measures
    phase: float = 0.0,  # else that at t = 0
    **told: Any,
) -> tuple[PeriodicRecord, PeriodSums]:
    """Return the periods without a rotation that stands on none of their lines, and that.

    Where no mark measures the angle, the speed is estimated with the lines, and takes the place of
    the one stated where that is surely off. Else it is told how far that plausibly is.
    """
    speed, size, rate = told["speed"], sums.size, sums.sample_rate
    turned = partial(_turned, time, phase)
    per_turn, angle = size / rate / (2 * np.pi), turned(speed) if mark is None else mark
    orders = orders_apart(abs(speed) * per_turn, sums.count, size)
    # What bends a force with the displacement asks for the samples of a mean period that has both.
    if not orders or any(channel.law is not None for channel in sums.channels):
        return sums.periods(time, angle, **told), sums

    def joint(angle: Steady | Floats, turns: float) -> Joint:
        rest = PeriodSums(sums.channels, rate, size, sums.lines)
        return turning(passes, angle, sums.mean, orders, turns, sums.lines, rest.add), rest

    off, std, turns = 0.0, np.inf, abs(speed) * per_turn
    if mark is not None or sums.count < LEAST:
        found, rest = joint(angle, turns)
    else:
        begins = np.concatenate([some_periods(time, p, p + 1)[:, 0] for p in range(sums.count)])
        told["speed"], off, std, found, rest = _at_its_speed(
            lambda speed: joint(turned(speed), abs(speed) * per_turn), begins, phase, speed
        )
        turns, angle = abs(told["speed"]) * per_turn, turned(told["speed"])
    kept = also_kept(found)
    # Taken for a response at the frequency of its line, which goes with its square at most.
    off_by = 2 * abs(turns - round(turns)) / turns * kept
    line, own = found.line, found.line + found.width * found.noise
    transfer = partial(transfer_of_recording, sums.channels, sample_rate=rate)
    first = some_periods(angle, 0, 1)[0, 0]
    at_start = partial(_at_start, first, transfer(np.array([turns * rate / size])), speed > 0)
    error, moved = 0.0, None
    if mark is None:  # a speed that is off turns the line, and exchanges some of it with others
        used = told["speed"] == speed
        error = plausible_slip(speed, off, std) if used else std
        aside, without = joint(turned(told["speed"] + error), turns)
        astray, exchanged = aside.line - line, line_spectra(without.mean - rest.mean, sums.lines)
        if used:
            among = exchanged + also_kept(aside) - kept
            among *= transfer(sums.lines * rate / size)
            moved = np.concatenate([among, at_start(astray[None])])
        else:
            told["checks"] = (_speed_note(told["speed"], std, speed),)
            phase_std = np.vdot(line, astray).imag / np.vdot(line, line).real
            told["phase_std"] = float(np.hypot(told["phase_std"], phase_std))
            own = own + scattered(np.sqrt(2) * (astray - 1j * phase_std * line), sums.count)
            off_by, error = off_by + np.sqrt(2) * exchanged, 0.0
    recorded = sums.periods(time, angle, speed=speed).spectra
    rotation = RotationLine(orders, at_start(own), recorded, found.kept, error, moved)
    periods = rest.periods(time, angle, rotation=rotation, **told)
    mean, more = periods.mean_spectrum, kept + scattered(off_by, sums.count)
    spectra = mean + (periods.spectra - mean) * found.widths[:, None]
    return changed(periods, spectra=spectra + more * transfer(periods.frequency)), rest


def _turned(time: Steady | Floats, phase: float, speed: float) -> Steady | Floats:
    """Return the angle of a steady rotation, of the phase at t = 0."""
    if isinstance(time, Steady):
        return replace(time, offset=phase, slope=speed)
    return phase + speed * time


def _at_start(angle: float, transfer: Complexes, forward: bool, line: Complexes) -> Complexes:
    """Return the line of a rotation, at angle zero, as recorded from the first sample on."""
    begins = line * np.exp(1j * angle)
    return np.asarray((begins if forward else begins.conj()) * transfer)


def _at_its_speed(
    joint: Callable[[float], Joint], begins: Floats, phase: float, stated: float
) -> tuple[float, float, float, Turning, PeriodSums]:
    """Return the speed to use, by how much that of the lines is off the stated one, and its std.

    The one stated is held against that of the lines at its end: only there noise alone is its std.
    """
    speed, found = stated, (first := joint(stated))
    for settled in SETTLED:
        off, std = slip(found[0], begins, phase + speed * begins)
        if abs(off) <= settled * std:
            break
        speed += off
        found = joint(speed)
    off += speed - stated
    if speed != stated and abs(off) <= SURE * std:
        return stated, off, std, *first
    return speed, off, std, *found


def _speed_note(speed: float, std: float, stated: float) -> Note:
    true, error, given = (30 * each / np.pi for each in (speed, std, stated))
    text = (
        f"the rotation turns with {true:.8g} +- {error:.2g} rpm, not {given:.8g}: that speed is "
        "used, with its deviation; state it, or record a mark (encoder or keyphasor)"
    )
    return Note("speed", "says", text)
