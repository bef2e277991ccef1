"""Whole periods of a record that is read in blocks: as `average`, without its samples in memory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from rotorid.record import Floats, PeriodicRecord, Record, check_samples
from rotorid.signals.checks import check_record
from rotorid.signals.period_lines import (
    Sampled,
    check_nyquist,
    first_sample,
    lines_of,
    period_size,
    too_short,
)
from rotorid.signals.sums import PeriodSums
from rotorid.steady import Steady, changed


class Blocks(Sampled, Protocol):
    """A record whose samples come in blocks, shape (sample, channel)."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels."""
        ...

    @property
    def phase(self) -> float:
        """Rotor angle in rad at the first sample."""
        ...

    def read(self) -> Iterator[Floats]:
        """Return an iterator over the blocks."""
        ...


def average_blocks(
    blocks: Blocks,
    fundamental: float | None = None,
    *,
    period_samples: int | None = None,
    harmonics: Sequence[int] | None = None,
    band: tuple[float, float] | None = None,
    skip: float = 0.0,
    phase_known: bool = True,
) -> PeriodicRecord:
    """Cut a record into whole periods while it is read, and keep the chosen lines of each.

    Parameters, result and errors are those of `rotorid.average`. What is kept grows with the
    periods by their lines only.
    """
    size = period_size(blocks, fundamental, period_samples)
    lines = lines_of(blocks, size, harmonics, band)
    first = first_sample(blocks, skip)
    check_nyquist(blocks, size, lines)
    sums = PeriodSums(size, len(blocks.channels), lines)
    looked_at = _Excerpt()
    for periods in _whole_periods(blocks, first, size):
        sums.add(periods, sums.count)
        looked_at.add(periods)
    if sums.count < 2:
        raise too_short(blocks, sums.count * size, size)
    time = Steady(first, (sums.count, size), blocks.sample_rate)
    angle = replace(time, offset=blocks.phase, slope=blocks.speed)
    record = sums.periods(blocks, time, angle, phase_known=phase_known)
    excerpt = Record(blocks.channels, looked_at.samples(), blocks.sample_rate)
    return changed(record, checks=check_record(excerpt, record))


def _whole_periods(blocks: Blocks, first: int, size: int) -> Iterator[Floats]:
    """Yield whole periods after the first sample, shape (period, sample, channel)."""
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
