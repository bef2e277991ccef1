"""Whole periods of a record averaged, in memory or block by block."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from rotorid.core.errors import InputError, naming
from rotorid.core.units import quantity
from rotorid.core.values import Booleans, Floats
from rotorid.data.lazy_time import Steady, changed
from rotorid.data.record import Channel, PeriodicRecord, Record, check_samples
from rotorid.signals.checks.periods import ramp_notes, ramps, without_ramps
from rotorid.signals.checks.registry import check_periods, check_record
from rotorid.signals.periods import (
    PeriodSums,
    check_length,
    check_nyquist,
    first_sample,
    lines_of,
    period_size,
)

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
    hertz = None if fundamental is None else quantity(fundamental, "Hz")
    ends = None if band is None else (quantity(band[0], "Hz"), quantity(band[1], "Hz"))
    rate, channels = record.sample_rate, record.channels
    with naming(record.source):
        size = period_size(rate, hertz, period_samples)
        lines = lines_of(rate, size, harmonics, ends)
        first = first_sample(rate, quantity(skip, "s"), record.start)
        left = max(len(record.samples) - first, 0)
        check_length(left, size)
        used = slice(first, first + left // size * size)
        kept, warnings = _kept_periods(record, used, size)
        samples = record.samples[used].reshape(-1, size, len(channels))
        sums = PeriodSums(size, len(channels), lines)
        sums.add(samples if isinstance(kept, slice) else samples[kept])
        check_nyquist(channels, size, lines)
    found = sums.periods(
        channels,
        rate,
        *_course(record, first, (len(samples), size), kept),
        speed=record.speed,
        phase_known=record.phase_known,
        phase_std=record.phase_std,
        source=record.source,
        warnings=warnings,
    )
    rise = ramps(record, found)
    if rise.any():
        flat = without_ramps(record, found, rise)
        again = average(flat, period_samples=size, harmonics=lines.tolist(), skip=skip)
        return changed(again, checks=(*again.checks, *ramp_notes(again, rise)))
    seen = check_record(record, found, excerpt=_excerpt(record, first, size))
    return changed(found, checks=(*seen, *check_periods(found)))


def _excerpt(record: Record, first: int, size: int) -> Record:
    """Return the periods of a long record that are looked at: some of its start, middle and end.

    What a channel does in every period, as to clip, shows in any.
    """
    count, few = len(record.samples), size * max(1, _LOOKED_AT // (3 * size))
    if record.valid is not None or count <= max(_LOOKED_AT, 3 * few):
        return record
    middle = first + size * ((count - first) // (2 * size))
    end = first + size * ((count - first) // size)
    parts = [slice(0, few), slice(middle - few, middle), slice(end - few, end)]
    samples = np.concatenate([record.samples[part] for part in parts])
    return replace(record, samples=samples, angle=None, valid=None)


def _kept_periods(
    record: Record, used: slice, size: int
) -> tuple[slice | Booleans, tuple[str, ...]]:
    """Return the periods without a masked sample, and what is said of the others."""
    if record.valid is None or record.valid[used].all():
        return slice(None), ()
    kept: Booleans = np.all(record.valid[used].reshape(-1, size), axis=1)
    left = int(kept.sum())
    if left < 2:
        raise InputError(
            f"{left} of {len(kept)} periods without a sample that the mask leaves out",
            "at least two",
            "record longer, or leave out less",
        )
    told = f"{len(kept) - left} of {len(kept)} periods hold samples that are masked: left out"
    return kept, (told,)


def _course(
    record: Record, first: int, shape: tuple[int, int], kept: slice | Booleans
) -> tuple[Steady | Floats, Steady | Floats]:
    time = Steady(first, shape, record.sample_rate, record.start)
    angle = replace(time, slope=record.speed) if record.angle is None else record.angle
    if not isinstance(angle, Steady):
        angle = angle[first : first + shape[0] * shape[1]].reshape(shape)
    if isinstance(kept, slice):
        return time, angle
    return time()[kept], (angle() if isinstance(angle, Steady) else angle)[kept]


class _Blocks(Protocol):
    """A record whose samples come in blocks, shape (sample, channel)."""

    @property
    def channels(self) -> tuple[Channel, ...]: ...
    @property
    def sample_rate(self) -> float: ...
    @property
    def speed(self) -> float: ...
    @property
    def phase(self) -> float: ...  # rotor angle in rad at the first sample
    @property
    def source(self) -> str: ...
    def read(self) -> Iterator[Floats]: ...


def average_blocks(
    blocks: _Blocks,
    fundamental: float | None = None,
    *,
    period_samples: int | None = None,
    harmonics: Sequence[int] | None = None,
    band: tuple[float, float] | None = None,
    skip: float = 0.0,
    phase_known: bool = True,
) -> PeriodicRecord:
    """As `average`, of a record while it is read: what is kept grows with periods x lines only."""
    rate, channels = blocks.sample_rate, blocks.channels
    with naming(blocks.source):
        size = period_size(rate, fundamental, period_samples)
        sums = PeriodSums(size, len(channels), lines_of(rate, size, harmonics, band))
        first = first_sample(rate, skip)
        check_nyquist(channels, size, sums.lines)
    looked_at = _Excerpt()
    for periods in _whole_periods(blocks, first, size):
        sums.add(periods)
        looked_at.add(periods)
    with naming(blocks.source):
        check_length(sums.count * size, size)
    time = Steady(first, (sums.count, size), rate)
    found = sums.periods(
        channels,
        rate,
        time,
        replace(time, offset=blocks.phase, slope=blocks.speed),
        speed=blocks.speed,
        phase_known=phase_known,
        source=blocks.source,
    )
    return changed(found, checks=check_record(Record(channels, looked_at.samples(), rate), found))


def _whole_periods(blocks: _Blocks, first: int, size: int) -> Iterator[Floats]:
    """Yield whole periods after the first sample, shape (period, sample, channel)."""
    names = [channel.name for channel in blocks.channels]
    passed, rest = 0, np.empty((0, len(names)))
    for block in blocks.read():
        begin = min(max(first - passed, 0), len(block))
        used = block[begin:]
        check_samples(names, used, blocks.source, first=passed + begin)
        passed += len(block)
        joined = np.concatenate([rest, used]) if len(rest) else used
        whole = len(joined) // size
        if whole:
            yield joined[: whole * size].reshape(whole, size, -1)
        rest = joined[whole * size :].copy()


class _Excerpt:
    """Periods from here and there in a record: of its blocks 0, 1, 3, 7 and so on, and the last."""

    def __init__(self) -> None:
        self.number, self.parts, self.last = 0, list[Floats](), np.empty((0, 0))

    def add(self, periods: Floats) -> None:
        few = max(1, 2048 // periods.shape[1])
        part = periods[:few].reshape(-1, periods.shape[2])
        if self.number & (self.number + 1) == 0:
            self.parts.append(part.copy())
            self.last = np.empty((0, periods.shape[2]))
        else:
            self.last = part.copy()
        self.number += 1

    def samples(self) -> Floats:
        return np.concatenate([*self.parts, self.last])
