"""Whole periods of a record: their samples and lines, running mean and variance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rotorid.core.errors import InputError
from rotorid.core.values import Complexes, Floats, Integers
from rotorid.data.lazy_time import Steady
from rotorid.data.record import Channel, PeriodicRecord
from rotorid.signals.spectrum import line_spectra, transfer_of_recording

KEYS = frozenset({"fundamental", "period_samples", "harmonics", "band", "skip"})
"""What an error of this module is about, by the place that it names."""


def period_size(rate: float, fundamental: float | None, samples: int | None) -> int:
    """Return the samples of a period, which are a whole number."""
    key = "period_samples" if fundamental is None else "fundamental"
    if fundamental is None and samples is not None:
        exact, source = float(samples), ""
    elif fundamental is not None and samples is None:
        if not 0 < fundamental < math.inf:
            raise InputError(
                f"a fundamental of {fundamental} Hz",
                "more than 0 Hz",
                "give the rate at which the excitation repeats",
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


def lines_of(
    rate: float, size: int, harmonics: Sequence[int] | None, band: tuple[float, float] | None
) -> Integers:
    """Return the harmonics to keep, increasing."""
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


def first_sample(rate: float, skip: float, start: float = 0.0) -> int:
    """Return the number of samples to skip, of a record whose first is taken at a time `start`."""
    if not 0 <= skip < math.inf:
        raise InputError(
            f"skip of {skip} s",
            "0 s or more",
            "give the time from the start of the record, in s",
            place="skip",
        )
    return max(0, math.ceil((skip - start) * rate - 1e-6))


def check_length(left: int, size: int) -> None:
    """Refuse a record without two periods."""
    if left < 2 * size:
        raise InputError(
            f"{left} samples after skip, {left // size} whole periods",
            f"at least two periods of {size} samples",
            "record longer, skip less, or give the rate at which the excitation repeats",
        )


def check_nyquist(channels: Sequence[Channel], size: int, lines: Integers) -> None:
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
        """Add the next periods, shape (period, sample, channel)."""
        step = max(_LEAST, _CACHED // (self.size * self.channels))
        for begin in range(0, len(periods), step):
            part = periods[begin : begin + step]
            self._add_moments(part)
            self._spectra.append(self._lines_of(part))
        self.count += len(periods)

    def _add_moments(self, part: Floats) -> None:
        """Add what differs from the first periods' mean, and its squares, in one buffer."""
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


def median(values: Floats, axis: int = -1) -> Floats:
    """Return the median over an axis: to sort many short rows is faster than to part them.

    numpy's own loads arrays with masks, which take longer than what is done here at a start.
    """
    ordered = np.sort(np.moveaxis(values, axis, -1), axis=-1)
    middle = ordered.shape[-1] // 2
    if ordered.shape[-1] % 2:
        return np.asarray(ordered[..., middle])
    return np.asarray((ordered[..., middle - 1] + ordered[..., middle]) / 2)


def quartiles(values: Floats) -> Floats:
    """Return the quartiles of a row of numbers, the middle one of them its median."""
    place = np.array([0.25, 0.5, 0.75]) * (len(values) - 1)
    return np.asarray(np.interp(place, np.arange(len(values)), np.sort(values)))


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
