"""Sums over the periods of a record: mean, scatter and lines, block by block, in any order."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rotorid.frozen import frozen
from rotorid.record import Complexes, Floats, Integers, PeriodicRecord
from rotorid.signals.period_lines import Sampled
from rotorid.signals.spectrum import line_spectra, transfer_of_recording
from rotorid.steady import Steady

_FEW_LINES = 20  # up to which sums with sines cost less than a fast transform of every sample
_CACHED = 1 << 17  # numbers that are worked on at once: a megabyte stays in the cache
_LEAST = 8  # periods worked on at once, so that merging their means costs little


def periods_at_once(size: int, channels: int) -> int:
    """Return how many periods of a size make a block that stays in the cache."""
    return max(_LEAST, _CACHED // (size * channels))


@dataclass
class PeriodSums:
    """What is kept of periods: their number, mean, squares about it, and the lines of each.

    Every period is summed as it differs from the mean of the first ones: no digits are lost to a
    large mean (Chan, Golub and LeVeque 1983), and sums of parts add in any order.

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
    spectra: dict[int, Complexes] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._centre: Floats | None = None
        self._sum = np.zeros((self.size, self.channels))
        self._squares = np.zeros((self.size, self.channels))
        self._apart = np.empty((0, self.size, self.channels))
        self._folds = _folds(self.lines, self.size) if len(self.lines) <= _FEW_LINES else None

    def add(self, periods: Floats, first: int) -> None:
        """Add periods, shape (period, sample, channel), the first of them number `first`."""
        step = periods_at_once(self.size, self.channels)
        for begin in range(0, len(periods), step):
            part = periods[begin : begin + step]
            self._add_moments(part)
            self.spectra[first + begin] = self._lines_of(part)
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
        for fold in self._folds:
            sums = np.matmul(fold.waves.T, fold.of(part))
            lines.real[:, fold.places] = sums[:, : len(fold.places)]
            lines.imag[:, fold.places] = sums[:, len(fold.places) :]
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

    def ordered(self) -> Complexes:
        """Return the lines of the periods in their order, shape (period, line, channel)."""
        return np.concatenate([self.spectra[first] for first in sorted(self.spectra)])

    def periods(
        self,
        recorded: Sampled,
        time: Steady | Floats,
        angle: Steady | Floats,
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


def median(values: Floats, axis: int = -1) -> Floats:
    """Return the median over an axis: to sort many short rows is faster than to part them.

    numpy's own loads arrays with masks, which take longer than what is done here at a start.
    """
    ordered = np.sort(np.moveaxis(values, axis, -1), axis=-1)
    middle = ordered.shape[-1] // 2
    if ordered.shape[-1] % 2:
        return np.asarray(ordered[..., middle])
    return np.asarray((ordered[..., middle - 1] + ordered[..., middle]) / 2)


@frozen
class _Fold:
    """Lines that halve a period alike: its second half repeats the first, or is its opposite.

    Even lines are those of the sum of both halves, odd ones those of their difference: half the
    products. A period of an odd number of samples stays whole.
    """

    places: Integers
    waves: Floats
    sign: int

    def of(self, part: Floats) -> Floats:
        """Return the samples, folded, shape (period, sample, channel)."""
        if not self.sign:
            return part
        half = part.shape[1] // 2
        join = np.add if self.sign > 0 else np.subtract
        return np.asarray(join(part[:, :half], part[:, half:]))


def _folds(lines: Integers, size: int) -> list[_Fold]:
    """Return the lines by how they fold, with their cosines and sines, (sample, 2 x line)."""
    signs = np.zeros_like(lines) if size % 2 else np.where(lines % 2, -1, 1)
    folds = []
    for sign in sorted(set(signs.tolist())):
        places = np.flatnonzero(signs == sign)
        waves = _waves(lines[places], size)[:, : size // 2 if sign else size]
        folds.append(_Fold(places, np.ascontiguousarray(waves.T), sign))
    return folds


def quartiles(values: Floats) -> Floats:
    """Return the quartiles of a row of numbers, the middle one of them its median."""
    place = np.array([0.25, 0.5, 0.75]) * (len(values) - 1)
    return np.asarray(np.interp(place, np.arange(len(values)), np.sort(values)))


def _waves(lines: Integers, size: int) -> Floats:
    """Return cosines and sines over a period, shape (2 x line, sample): X = mean x exp(-i wt).

    From whole numbers, so that the sine of the Nyquist line is nothing.
    """
    turns = np.multiply.outer(lines, np.arange(size)) % size
    angle = 2 * np.pi * turns / size
    sine = np.where(2 * turns % size == 0, 0.0, np.sin(angle))
    return np.concatenate([np.cos(angle), -sine]) / size
