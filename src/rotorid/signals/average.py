"""Whole periods of a record averaged, in memory or block by block."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from rotorid.core.errors import InputError, naming
from rotorid.core.units import quantity
from rotorid.core.values import Booleans, Complexes, Floats, Integers
from rotorid.data.lazy_time import Steady, changed
from rotorid.data.record import Channel, PeriodicRecord, Record, check_samples
from rotorid.signals.checks.periods import ramp_notes, ramps, without_ramps
from rotorid.signals.checks.registry import check_periods, check_record
from rotorid.signals.spectrum import line_spectra, transfer_of_recording

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
    hertz = None if fundamental is None else quantity(fundamental, "Hz")
    ends = None if band is None else (quantity(band[0], "Hz"), quantity(band[1], "Hz"))
    rate, channels = record.sample_rate, record.channels
    with naming(record.source):
        size = _period_size(rate, hertz, period_samples)
        lines = _lines_of(rate, size, harmonics, ends)
        first = _first_sample(rate, quantity(skip, "s"), record.start)
        left = max(len(record.samples) - first, 0)
        _check_length(left, size)
        used = slice(first, first + left // size * size)
        kept, warnings = _kept_periods(record, used, size)
        samples = record.samples[used].reshape(-1, size, len(channels))
        sums = PeriodSums(size, len(channels), lines)
        sums.add(samples if isinstance(kept, slice) else samples[kept])
        _check_nyquist(channels, size, lines)
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
        size = _period_size(rate, fundamental, period_samples)
        sums = PeriodSums(size, len(channels), _lines_of(rate, size, harmonics, band))
        first = _first_sample(rate, skip)
        _check_nyquist(channels, size, sums.lines)
    looked_at = _Excerpt()
    for periods in _whole_periods(blocks, first, size):
        sums.add(periods)
        looked_at.add(periods)
    with naming(blocks.source):
        _check_length(sums.count * size, size)
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


def _period_size(rate: float, fundamental: float | None, samples: int | None) -> int:
    key = "period_samples" if fundamental is None else "fundamental"
    if fundamental is None and samples is not None:
        exact, source = float(samples), ""
    elif fundamental is not None and samples is None:
        if not 0 < fundamental < math.inf:
            raise InputError(
                f"a fundamental of {fundamental} Hz",
                "more than 0 Hz",
                "set fundamental to the repetition frequency",
                place=key,
            )
        exact, source = rate / fundamental, f" ({rate:g} / {fundamental:g} Hz)"
    else:
        raise InputError(
            "neither or both of fundamental and period_samples",
            "one of them",
            "give the fundamental frequency or the samples of a period",
            place=key,
        )
    size = round(exact) if math.isfinite(exact) else 0
    if not math.isfinite(exact) or abs(exact - size) > 1e-6 * abs(exact):
        raise InputError(
            f"a period of {exact:.6g} samples{source}",
            "a whole number of samples",
            "give a lower common fundamental and multiply the harmonics, or resample",
            place=key,
        )
    if size < 2:
        raise InputError(f"a period of {size} samples", "2 or more", "sample faster", place=key)
    return size


def _lines_of(
    rate: float, size: int, harmonics: Sequence[int] | None, band: tuple[float, float] | None
) -> Integers:
    key = "band" if harmonics is None else "harmonics"
    if band is None and harmonics is not None:
        chosen, shown = harmonics, f"the harmonics {list(harmonics)}"
    elif band is not None and harmonics is None:
        chosen, shown = _within(rate, size, band), f"the band {band[0]:g} to {band[1]:g} Hz"
    else:
        raise InputError(
            "neither or both of harmonics and band",
            "one of them",
            "say which lines to keep",
            place=key,
        )
    if not len(chosen):
        raise InputError(f"no line in {shown}", "at least one line", "widen it", place=key)
    lines = sorted({int(k) for k in chosen if 0 <= k <= size // 2 and k == int(k)})
    if len(lines) < len(chosen):
        raise InputError(
            shown,
            f"different whole numbers from 0 to {size // 2}, half the samples of a period",
            "name each line once, counted from the fundamental, or lower the fundamental",
            place=key,
        )
    return np.array(lines, dtype=np.int64)


def _within(rate: float, size: int, band: tuple[float, float]) -> range:
    (low, high), spacing = band, rate / size
    if not high <= (size // 2 + 1e-6) * spacing:
        raise InputError(
            f"a band up to {high:g} Hz",
            f"lines up to {rate / 2:g} Hz, half the sample rate",
            "lower its upper end",
            place="band",
        )
    if not 0 <= low <= high:
        raise InputError(
            f"the band {low:g} to {high:g} Hz",
            "0 Hz or more, the lower end first",
            "put the lower end first",
            place="band",
        )
    return range(math.ceil(low / spacing - 1e-6), math.floor(high / spacing + 1e-6) + 1)


def _first_sample(rate: float, skip: float, start: float = 0.0) -> int:
    """Return the number of samples to skip, of a record whose first is taken at a time `start`."""
    if not 0 <= skip < math.inf:
        raise InputError(
            f"skip of {skip} s",
            "0 s or more",
            "give the time from the start of the record, in s",
            place="skip",
        )
    return max(0, math.ceil((skip - start) * rate - 1e-6))


def _check_length(left: int, size: int) -> None:
    if left < 2 * size:
        raise InputError(
            f"{left} samples after skip, {left // size} whole periods",
            f"at least two periods of {size} samples",
            "record longer, skip less, or set fundamental to the repetition frequency",
        )


def _check_nyquist(channels: Sequence[Channel], size: int, lines: Integers) -> None:
    """Refuse a correction of the Nyquist line, whose phase is not in the samples."""
    corrected = [c.name for c in channels if c.hold or c.delay or c.delay_std]
    if corrected and 2 * lines[-1] == size:
        raise InputError(
            f"the Nyquist line with the hold or delay of {corrected[0]}",
            "lines below the Nyquist frequency",
            "leave that line out",
            place="harmonics",
        )


_FEW_LINES = 20  # up to which sums with sines cost less than a fast transform of every sample
_CACHED = 1 << 17  # numbers that are worked on at once: a megabyte stays in the cache
_LEAST = 8  # periods worked on at once, so that merging their means costs little


@dataclass
class PeriodSums:
    """What is kept of periods: their number, mean, squares about it, and the lines of each.

    Every period is summed as it differs from the mean of the first ones: no digits are lost to a
    large mean (Chan, Golub and LeVeque 1983), and sums of parts add in any order.
    """

    # samples of a period, channels
    size: int
    channels: int
    lines: Integers  # (line,): the multiples of the fundamental to keep
    count: int = 0

    def __post_init__(self) -> None:
        self._centre: Floats | None = None
        self._spectra: list[Complexes] = []
        self._sum = np.zeros((self.size, self.channels))
        self._squares = np.zeros((self.size, self.channels))
        self._apart = np.empty((0, self.size, self.channels))
        self._folds = _folds(self.lines, self.size) if len(self.lines) <= _FEW_LINES else None

    def add(self, periods: Floats) -> None:
        step = max(_LEAST, _CACHED // (self.size * self.channels))
        for begin in range(0, len(periods), step):
            part = periods[begin : begin + step]
            self._add_moments(part)
            self._spectra.append(self._lines_of(part))
        self.count += len(periods)

    def _add_moments(self, part: Floats) -> None:
        if self._centre is None:
            self._centre = part.mean(axis=0)
        if len(self._apart) < len(part):
            self._apart = np.empty_like(part)
        apart = np.subtract(part, self._centre, out=self._apart[: len(part)])
        self._sum += apart.sum(axis=0)
        self._squares += np.square(apart, out=apart).sum(axis=0)

    def _lines_of(self, part: Floats) -> Complexes:
        if self._folds is None:
            return line_spectra(part, self.lines)
        lines = np.empty((len(part), len(self.lines), self.channels), dtype=np.complex128)
        half = self.size // 2
        for places, waves, join in self._folds:
            folded = part if join is None else join(part[:, :half], part[:, half:])
            sums = np.matmul(waves.T, folded)
            lines.real[:, places], lines.imag[:, places] = np.split(sums, 2, axis=1)
        return lines

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
        return np.concatenate(self._spectra)

    def periods(
        self,
        channels: tuple[Channel, ...],
        rate: float,
        time: Steady | Floats,
        angle: Steady | Floats,
        **told: Any,
    ) -> PeriodicRecord:
        """Return what the sums are of, with hold, delay and dynamics of its channels undone."""
        transfer = transfer_of_recording(channels, self.lines * rate / self.size, rate)
        return PeriodicRecord(
            channels=channels,
            sample_rate=rate,
            harmonics=self.lines,
            spectra=self.spectra * transfer,
            variance=self.variance,
            mean=self.mean,
            time=time,
            angle=angle,
            **told,
        )


def _folds(lines: Integers, size: int) -> list[tuple[Integers, Floats, np.ufunc | None]]:
    """Return places of lines, their cosines and sines, X = mean x exp(-i wt), and how they fold.

    The second half of a period repeats the first on even lines, and is its opposite on odd ones: of
    the sum or the difference of both halves it takes half the products. A period of an odd number
    of samples stays whole.
    """
    signs = np.zeros_like(lines) if size % 2 else np.where(lines % 2, -1, 1)
    joins: dict[int, np.ufunc | None] = {-1: np.subtract, 0: None, 1: np.add}
    folds = []
    for sign in sorted(set(signs.tolist())):
        places = np.flatnonzero(signs == sign)
        # From whole numbers, so that the sine of the Nyquist line is nothing.
        turns = np.multiply.outer(lines[places], np.arange(size)) % size
        angle = 2 * np.pi * turns / size
        sine = np.where(2 * turns % size == 0, 0.0, np.sin(angle))
        waves = np.concatenate([np.cos(angle), -sine])[:, : size // 2 if sign else size] / size
        folds.append((places, np.ascontiguousarray(waves.T), joins[sign]))
    return folds
