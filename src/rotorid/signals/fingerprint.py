"""Prints of a record by which the same samples are found in another one, wherever they begin there.

Of a few samples, chosen by their own digits and not by their place, the digits of all channels of
the next few are summed up to one number: two records hold that number at two places where both
hold those samples, and by chance nowhere.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rotorid.frozen import frozen
from rotorid.record import Floats, Integers

Words = npt.NDArray[np.uint64]

WINDOW = 16
"""Samples that a print is of: of some channels with noise, alike in no two measurements."""
CHOSEN = 4
"""Bits that are zero in the sum of a sample that a print begins at: one in 16, 60 of 1000."""
MOST = 1 << 16
"""Prints that are kept of a record: half of them are dropped where there are more."""
FEWEST = 8
"""Prints that records share where they share samples: so many at one distance are no chance."""
NEARLY_ALL = 0.95
"""Share of the prints that are the same where samples are; coarse digits repeat by chance less."""


def _factors(count: int) -> Words:
    """Return odd numbers whose digits look like chance: splitmix64 of 1, 2, .. (Vigna)."""
    found = np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        found = (found ^ (found >> np.uint64(shift))) * np.uint64(factor)
    return np.asarray((found ^ (found >> np.uint64(31))) | np.uint64(1))


_FACTORS = _factors(4096)


@frozen
class Prints:
    """The prints of a record that it holds once, in rising order, and the samples they begin at.

    Parameters
    ----------
    values : uint64 array, shape (print,)
    places : int array, shape (print,)
    chosen : uint64 array, shape (print,)
        The sum of the sample that each begins at.
    level : int
        Bits that are zero in all of these.
    count : int
        Samples of the record.
    """

    values: Words
    places: Integers
    chosen: Words
    level: int
    count: int

    def at(self, level: int) -> tuple[Words, Integers]:
        """Return the prints of which more bits are zero, and their places."""
        kept = _selected(self.chosen, level)
        return self.values[kept], self.places[kept]


@frozen
class Shared:
    """Samples that two records share: their number, and where they begin in each."""

    count: int
    first: int
    second: int


class Printer:
    """Takes the prints of a record, block by block."""

    def __init__(self) -> None:
        self.level, self.count = CHOSEN, 0
        self.tail = np.empty(0, dtype=np.uint64)
        self.parts = [(self.tail, np.empty(0, dtype=np.int64), self.tail)]
        self.held = 0

    def add(self, samples: Floats) -> None:
        """Go on with samples, shape (sample, channel)."""
        sums = np.concatenate([self.tail, _sums(samples)])
        begin = self.count - len(self.tail)
        self.count += len(samples)
        inside = max(len(sums) - WINDOW, 0)
        places = 1 + np.flatnonzero(_selected(sums[1 : inside + 1], self.level))
        places = places[sums[places] != sums[places - 1]]  # what stands still tells nothing
        windows = sums[places[:, None] + np.arange(WINDOW)]
        prints = (windows * _FACTORS[:WINDOW]).sum(axis=1, dtype=np.uint64)
        self.parts.append((prints, places + begin, sums[places]))
        self.held += len(places)
        self.tail = sums[inside:]
        if self.held > MOST:
            self._thin()

    def _thin(self) -> None:
        """Keep half of the prints, those of which another bit is zero."""
        while self.held > MOST and self.level < 48:
            self.level += 1
            joined = [np.concatenate(part) for part in zip(*self.parts, strict=True)]
            kept = _selected(joined[2], self.level)
            self.parts = [(joined[0][kept], joined[1][kept], joined[2][kept])]
            self.held = int(kept.sum())

    def prints(self) -> Prints:
        """Return the prints that the record holds once."""
        values, places, chosen = (np.concatenate(part) for part in zip(*self.parts, strict=True))
        _, first, times = np.unique(values, return_index=True, return_counts=True)
        once = first[times == 1]
        return Prints(values[once], places[once], chosen[once], self.level, self.count)


def _sums(samples: Floats) -> Words:
    """Return a number of the digits of each sample, (sample,): of all channels."""
    found = np.zeros(len(samples), dtype=np.uint64)
    for channel in range(samples.shape[1]):
        digits = np.ascontiguousarray(samples[:, channel] + 0.0).view(np.uint64)  # one zero
        found += digits * _FACTORS[WINDOW + channel % (len(_FACTORS) - WINDOW)]
    found ^= found >> np.uint64(29)
    return np.asarray(found * _FACTORS[0])


def _selected(sums: Words, level: int) -> npt.NDArray[np.bool_]:
    return np.asarray(sums >> np.uint64(64 - level) == 0)


def candidates(records: Sequence[Prints]) -> list[tuple[int, int]]:
    """Return pairs of records that hold the same prints, in rising order."""
    values = np.concatenate([record.values for record in records])
    owners = np.repeat(np.arange(len(records)), [len(record.values) for record in records])
    order = np.argsort(values, kind="stable")
    again = np.flatnonzero(values[order[1:]] == values[order[:-1]])
    pairs, times = np.unique(
        np.stack([owners[order[again]], owners[order[again + 1]]], axis=1),
        axis=0,
        return_counts=True,
    )
    return [(int(a), int(b)) for (a, b), n in zip(pairs, times, strict=True) if n >= FEWEST]


def shared(one: Prints, other: Prints) -> Shared | None:
    """Return the samples that two records share, in every digit; None where they share none."""
    level = max(one.level, other.level)
    (values, places), (others, theirs) = one.at(level), other.at(level)
    _, mine, its = np.intersect1d(values, others, assume_unique=True, return_indices=True)
    if len(mine) < FEWEST:
        return None
    lags, times = np.unique(places[mine] - theirs[its], return_counts=True)
    lag = int(lags[times.argmax()])
    begin, end = max(lag, 0), min(one.count, other.count + lag)
    inside = ((places >= begin) & (places < end - WINDOW)).sum()
    there = ((theirs + lag >= begin) & (theirs + lag < end - WINDOW)).sum()
    if times.max() < max(FEWEST, NEARLY_ALL * max(inside, there)):
        return None
    return Shared(end - begin, begin, begin - lag)
