"""Sums over the periods of a record: mean, scatter and lines, block by block, in any order."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rotorid.record import Complexes, Floats, Integers, PeriodicRecord
from rotorid.signals.period_lines import Sampled
from rotorid.signals.spectrum import line_spectra, transfer_of_recording

_FEW_LINES = 20  # up to which sums with sines cost less than a fast transform of every sample
_CACHED = 1 << 17  # numbers that are worked on at once: a megabyte stays in the cache
_LEAST = 8  # periods worked on at once, so that merging their means costs little


def periods_at_once(size: int, channels: int) -> int:
    """Return how many periods of a size make a block that stays in the cache."""
    return max(_LEAST, _CACHED // (size * channels))


@dataclass
class PeriodSums:
    """What is kept of periods: their number, mean, squares about it, and the lines of each.

    Sums of parts of a record, merged in any order, are those of the whole, by the formulas of
    Chan, Golub and LeVeque (1983), which lose no digits to a large mean.

    Parameters
    ----------
    size, channels : int
        Samples of a period, channels.
    lines : int array, shape (line,)
        The multiples of the fundamental to keep.
    """

    size: int
    channels: int
    lines: Integers
    count: int = 0
    mean: Floats = field(init=False)
    squares: Floats = field(init=False)
    spectra: dict[int, Complexes] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.mean = np.zeros((self.size, self.channels))
        self.squares = np.zeros((self.size, self.channels))
        self._apart = np.empty((0, self.size, self.channels))
        few = len(self.lines) <= _FEW_LINES
        self._waves = np.ascontiguousarray(_waves(self.lines, self.size).T) if few else None

    def add(self, periods: Floats, first: int) -> None:
        """Add periods, shape (period, sample, channel), the first of them number `first`."""
        step = periods_at_once(self.size, self.channels)
        for begin in range(0, len(periods), step):
            part = periods[begin : begin + step]
            mean = part.mean(axis=0)
            self._merge_moments(len(part), mean, self._squares(part, mean))
            self.spectra[first + begin] = self._lines_of(part)

    def _merge_moments(self, count: int, mean: Floats, squares: Floats) -> None:
        if count == 0:
            return
        total = self.count + count
        if self.count == 0:
            self.mean, self.squares = mean.copy(), squares.copy()
        else:
            apart = mean - self.mean
            self.mean += apart * (count / total)
            np.square(apart, out=apart)
            apart *= self.count * count / total
            self.squares += squares
            self.squares += apart
        self.count = total

    def _squares(self, part: Floats, mean: Floats) -> Floats:
        """Return the sum over periods of the squares about their mean."""
        if len(self._apart) < len(part):
            self._apart = np.empty_like(part)
        apart = np.subtract(part, mean, out=self._apart[: len(part)])
        return np.asarray(np.square(apart, out=apart).sum(axis=0))

    def _lines_of(self, part: Floats) -> Complexes:
        if self._waves is None:
            return line_spectra(part, self.lines)
        sums = np.matmul(part.transpose(0, 2, 1), self._waves).transpose(0, 2, 1)
        return np.asarray(sums[:, : len(self.lines)] + 1j * sums[:, len(self.lines) :])

    @property
    def variance(self) -> Floats:
        """Unbiased variance over periods of each sample, shape (sample, channel)."""
        return self.squares / (self.count - 1)

    def ordered(self) -> Complexes:
        """Return the lines of the periods in their order, shape (period, line, channel)."""
        return np.concatenate([self.spectra[first] for first in sorted(self.spectra)])

    def periods(
        self,
        recorded: Sampled,
        time: Floats,
        angle: Floats,
        *,
        phase_known: bool,
        phase_std: float = 0.0,
        warnings: tuple[str, ...] = (),
    ) -> PeriodicRecord:
        """Return what the sums are of, with hold, delay and dynamics of its channels undone."""
        rate, channels = recorded.sample_rate, recorded.channels
        transfer = transfer_of_recording(channels, self.lines * rate / self.size, rate)
        return PeriodicRecord(
            channels=channels,
            sample_rate=rate,
            harmonics=self.lines,
            spectra=self.ordered() * transfer,
            variance=self.variance,
            mean=self.mean,
            speed=recorded.speed,
            time=time,
            angle=angle,
            phase_known=phase_known,
            phase_std=phase_std,
            source=recorded.source,
            warnings=warnings,
        )


def median(values: Floats) -> Floats:
    """Return the median over the last axis: to sort many short rows is faster than to part them."""
    ordered = np.sort(values, axis=-1)
    middle = ordered.shape[-1] // 2
    if ordered.shape[-1] % 2:
        return np.asarray(ordered[..., middle])
    return np.asarray((ordered[..., middle - 1] + ordered[..., middle]) / 2)


def _waves(lines: Integers, size: int) -> Floats:
    """Return cosines and sines over a period, shape (2 x line, sample): X = mean x exp(-i wt).

    From whole numbers, so that the sine of the Nyquist line is nothing.
    """
    turns = np.multiply.outer(lines, np.arange(size)) % size
    angle = 2 * np.pi * turns / size
    sine = np.where(2 * turns % size == 0, 0.0, np.sin(angle))
    return np.concatenate([np.cos(angle), -sine]) / size
