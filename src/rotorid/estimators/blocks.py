"""Deviations from blocks of a record: what the answer would be without each of them.

The residual of a filtered record is correlated from sample to sample, and how is not known: the
filter, the controller and what the model leaves out all have a memory. Blocks that are longer than
it scatter on their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import scipy

from rotorid.frozen import frozen
from rotorid.record import Booleans, Floats, Integers

BLOCKS = 32
"""Blocks to begin with: deviations are then known to an eighth, and a block is long."""
FEWEST = 8
"""Blocks that are not merged further: from fewer no deviation can be told."""
ALONE = 0.02
"""Share of what tells a combination of parameters that must lie outside a block: with less, the
answer without the block is no answer, and nothing tells the deviation."""
CHANCE = 4.0
"""Deviations that chance reaches over a hundred parameters of normal estimates."""
TINY = 0.1
"""Share of a parameter in such a combination from which it is one of its own."""
MEMORY = 1.0
"""Deviations of the correlation of neighbours, 1 / sqrt(blocks), from which they are merged."""


@frozen
class Scatter:
    """What blocks of the record say of the answer.

    Parameters
    ----------
    covariance : array, shape (free, free)
    shifts : array, shape (block, free)
        What each block adds to the answer, in the order of the record.
    memory : bool
        Whether neighbouring blocks still depend on one another.
    alone : bool array, shape (free,)
        What a single block tells: no deviation can be stated.
    """

    covariance: Floats
    shifts: Floats
    memory: bool
    alone: Booleans

    @property
    def blocks(self) -> int:
        """The number of blocks."""
        return len(self.shifts)

    def halves(self) -> tuple[Floats, Floats]:
        """Return what the halves add, shape (half, free), and the deviation of half of that.

        The deviation is the scatter within the halves: a step between them is not in it. It is
        widened as Student's t is wider than the normal distribution, so far out as chance reaches.
        """
        middle = self.blocks // 2
        parts = (self.shifts[:middle], self.shifts[middle:])
        halves = 2 * np.stack([part.sum(axis=0) for part in parts])
        within = sum(((part - part.mean(axis=0)) ** 2).sum(axis=0) for part in parts)
        dof = max(self.blocks - 2, 1)
        wider = -scipy.special.stdtrit(dof, scipy.special.ndtr(-CHANCE)) / CHANCE
        return halves, np.asarray(wider * np.sqrt(within * self.blocks / dof))


def block_numbers(samples: Sequence[int], blocks: int) -> Integers:
    """Return the block of each sample of runs of so many samples; none crosses runs."""
    total, first, found = sum(samples), 0, []
    for count in samples:
        own = max(1, round(blocks * count / total))
        found.append(first + np.arange(count) * own // count)
        first += own
    return np.concatenate(found).astype(np.int64)


def scatter_of_blocks(
    matrix: Floats, residual: Floats, gains: Floats, numbers: Integers
) -> Scatter:
    """Return the covariance of an answer by leaving out each block in turn (the jackknife).

    ``values - values without b = (1 - G_b X_b)^-1 G_b e_b``, exactly; neighbours that depend on one
    another are merged.

    Parameters
    ----------
    matrix : array, shape (equation, free)
        X, whitened.
    residual : array, shape (equation,)
        e = right side - X values, whitened.
    gains : array, shape (free, equation)
        G: values = G @ right side.
    numbers : int array, shape (equation,)
        The block of each equation.
    """
    while True:
        count = int(numbers.max()) + 1
        shifts, without, alone = _leave_out(matrix, residual, gains, numbers, count)
        memory = _remembers(shifts)
        if not memory or count // 2 < FEWEST:
            break
        numbers = numbers // 2
    apart = without - without.mean(axis=0)
    covariance = apart.T @ apart * ((count - 1) / count)
    # A variance from so few is itself uncertain: that of Student's t.
    spread = (count - 1) / max(count - 3, 1)
    return Scatter(covariance * spread, shifts, memory, alone)


def _leave_out(
    matrix: Floats, residual: Floats, gains: Floats, numbers: Integers, count: int
) -> tuple[Floats, Floats, Booleans]:
    """Return what blocks add to the values, the change without each, and what one alone tells."""
    free = len(gains)
    shifts, without = np.zeros((count, free)), np.zeros((count, free))
    alone: Booleans = np.zeros(free, dtype=bool)
    length = np.sqrt((gains**2).sum(axis=1))
    length = np.where(length > 0, length, 1.0)
    edges = np.searchsorted(numbers, np.arange(count + 1))
    for block, own in enumerate(slice(*pair) for pair in pairwise(edges)):
        shifts[block] = gains[:, own] @ residual[own]
        rest = np.eye(free) - (gains[:, own] @ matrix[own] * length) / length[:, None]
        left, size, right = np.linalg.svd(rest)
        told = size > ALONE
        alone |= (np.abs(right[~told]) > TINY).any(axis=0)
        change = (left[:, told].T @ (shifts[block] / length)) / size[told]
        without[block] = right[told].T @ change * length
    return shifts, without, alone


def _remembers(shifts: Floats) -> bool:
    """Tell whether what a block adds resembles what the one before added, in any parameter."""
    count = len(shifts)
    size = (shifts**2).sum(axis=0)
    known = size > 0
    if count < FEWEST or not known.any():
        return False
    lagged = (shifts[1:] * shifts[:-1]).sum(axis=0)[known] / size[known]
    return bool(lagged.max() > MEMORY / np.sqrt(count))
