"""Weighted least squares by QR and SVD, and the jackknife covariance of its values.

The residual of a filtered record is correlated from sample to sample, and how is not known (the
filter, the controller, what the model leaves out): blocks that are longer scatter on their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from itertools import pairwise
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from rotorid.core.linalg import column_lengths, leave_out
from rotorid.core.values import Booleans, Floats, Integers, frozen
from rotorid.data.record import PeriodicRecord
from rotorid.signals.spectrum import synthesize

POOLING_PERIODS = 30
RANK_TOLERANCE = 1e-11


def pooled(variance: Floats, power: Floats, periods: int) -> Floats:
    """Make variances of periods, the paper's (8), fit to be weights (docs/theory.md, section 3)."""
    mean = np.broadcast_to(variance.mean(axis=0), variance.shape)
    raised = mean if periods < POOLING_PERIODS else np.maximum(variance, 1e-3 * mean)
    floor = 1e-18 * np.where(power > 0, power, power.max(initial=0.0) or 1.0)
    return np.asarray(np.maximum(raised, floor))


@frozen
class Block:
    """Equations of one record: ``design @ free = target``, weighted by sample and row."""

    # (line, row, free) and (line, row) of the lines of a record, or of its samples without one
    design: NDArray[Any]
    target: NDArray[Any]
    variance: Floats  # (sample, row), or (row,) for all samples alike
    record: PeriodicRecord | None = None  # for its harmonics and samples

    def whitened(self) -> tuple[Floats, Floats]:
        """Return matrix and right side in samples over deviations, rows flattened."""
        deviation, free = np.sqrt(self.variance), self.design.shape[2]
        return (
            (self._in_samples(self.design) / deviation[..., None]).reshape(-1, free),
            (self._in_samples(self.target) / deviation).reshape(-1),
        )

    def _in_samples(self, rows: NDArray[Any]) -> Floats:
        if self.record is None:
            return rows
        columns = rows.reshape(len(rows), -1)
        waves = synthesize(columns, self.record.harmonics, self.record.samples)
        return waves.reshape(-1, *rows.shape[1:])

    def gains_of(self, gains: Floats) -> NDArray[Any]:
        """Turn gains on whitened samples, (free, sample x row), into gains on lines, if there are.

        ``d free = Re(sum_k,r gains[:, k, r] d target[k, r])``; shape (free, line, row).
        """
        record = self.record
        if record is None:
            return gains
        weighted = gains.reshape(len(gains), record.samples, -1) / np.sqrt(self.variance)
        transformed = np.fft.rfft(weighted, axis=1)[:, record.harmonics]
        return np.asarray(record.multiplicity[:, None] * transformed.conj())


@frozen
class LeastSquaresSolution:
    values: Floats  # (free,): NaN where the equations do not determine them
    # (free, line, row) of each block: how the values answer to its targets; of samples (free, n)
    gains: tuple[NDArray[Any], ...]
    condition_number: float  # of the whitened matrix with columns scaled to length one
    # (free, n): directions, in scaled parameters, that the equations leave open
    undetermined: Floats
    # (equation, free), and (equation,): what was solved, where it was in one go, what it leaves of
    # each equation, and the deviation that each was divided by
    matrix: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    residual: Floats = field(default_factory=lambda: np.zeros(0))
    deviation: Floats = field(default_factory=lambda: np.zeros(0))


def solve(blocks: Sequence[Block]) -> LeastSquaresSolution:
    """Solve ``min sum |whitened(design @ free - target)|^2``: docs/theory.md, sections 2 and 3."""
    whitened = [block.whitened() for block in blocks]
    matrix = np.concatenate([m for m, _ in whitened])
    right = np.concatenate([r for _, r in whitened])
    scale = column_lengths(matrix)
    orthogonal, triangle = np.linalg.qr(matrix / scale)
    left, singular, directions = np.linalg.svd(triangle)
    rank = int((singular > RANK_TOLERANCE * max(singular.max(initial=0.0), 1e-300)).sum())
    if not right.any():
        rank = 0  # zero solves it, and any multiple of what else does
    open_directions = directions[rank:].T
    inverse = (directions[:rank].T / singular[:rank]) @ left[:, :rank].T
    gains = (inverse / scale[:, None]) @ orthogonal.T
    values = gains @ right
    unknown = (np.abs(open_directions) > 1e-6).any(axis=1)
    values[unknown] = np.nan
    if unknown.any():  # each direction is to have a parameter of its own
        _, _, order = scipy.linalg.qr(open_directions.T, mode="economic", pivoting=True)
        own = open_directions[np.sort(order[: open_directions.shape[1]])]
        open_directions = np.linalg.solve(own.T, open_directions.T).T
    split = np.split(gains, np.cumsum([len(r) for _, r in whitened])[:-1], axis=1)
    parts = tuple(b.gains_of(g) for b, g in zip(blocks, split, strict=True))
    condition = float(singular[0] / singular[-1]) if 0 < rank == len(values) else np.inf
    each = zip(blocks, whitened, strict=True)
    deviation = np.concatenate([np.resize(np.sqrt(b.variance), len(r)) for b, (_, r) in each])
    left_over = right - matrix @ (gains @ right)
    return LeastSquaresSolution(
        values, parts, condition, open_directions, matrix, left_over, deviation
    )


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
MOST = 0.8
"""Correlation of neighbours that is made up for at most: of eight blocks none is known better."""
DISTINCT = 1e-3
"""Share of the power of a column that the design must leave, for it to be another column."""


@frozen
class Scatter:
    covariance: Floats  # (free, free)
    shifts: Floats  # (block, free): what each block adds to the answer, in the order of the record
    memory: float  # correlation of neighbouring blocks that is left, and made up for; else 0
    # bool array, shape (free,): what a single block tells: no deviation can be stated
    alone: Booleans
    numbers: Integers  # the block of each equation

    @property
    def blocks(self) -> int:
        return len(self.shifts)

    def worst(self, change: Floats) -> tuple[int, float]:
        """Return which value changes by the most deviations, and by how many."""
        spread = np.sqrt(np.diag(self.covariance).clip(0))
        known = np.isfinite(change) & (spread > 0) & ~self.alone
        shares = np.where(known, np.abs(change) / np.where(spread > 0, spread, 1.0), 0.0)
        return int(shares.argmax()), float(shares.max())

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
        return halves, np.asarray(wider(dof) * np.sqrt(within * self.blocks / dof))

    def with_column(
        self,
        solution: LeastSquaresSolution,
        columns: Floats,
        pull: Floats,
        noise: Floats,
        *,
        free: bool = False,
    ) -> tuple[Floats, Floats, Floats]:
        """Return what some columns, (equation, column), each by itself, add to a solution.

        Sizes ``s = (p'e + c'X pull + noise) / p'p``, ``p = c - X G c`` (0 where that is too little
        of c), e holding ``-X pull`` of what noise of the motion pulls, and less by the product of
        what noise leaves on c and on e, (column,); how many deviations of the jackknife
        each is from zero, and the moves ``-G c s``, (column, free).
        Of what swings `free` none may be a multiple of what is known: with it zero solves the rest.
        """
        columns = columns / solution.deviation[:, None]
        count, answer = self.blocks, np.hstack(solution.gains) @ columns
        part = columns - solution.matrix @ answer
        starts = np.searchsorted(self.numbers, range(count))
        power = np.add.reduceat(part**2, starts)
        score = part * solution.residual[:, None] + columns * (solution.matrix @ pull)[:, None]
        score = np.add.reduceat(score, starts)
        score += noise * (np.diff([*starts, len(columns)]) / len(columns))[:, None]
        whole = power.sum(axis=0)
        told = whole > DISTINCT * (length := (columns**2).sum(axis=0))
        if free:
            right = solution.residual + solution.matrix @ np.nan_to_num(solution.values)
            told &= (right @ columns) ** 2 < (1 - DISTINCT) * (right @ right) * length
        told &= (whole - power > ALONE * whole).all(axis=0) & (count >= FEWEST)
        size = np.where(told, score.sum(axis=0) / np.where(told, whole, 1.0), 0.0)
        without = (score - size * power) / np.where(told, whole - power, 1.0)
        std = wider(count - 1) * (count - 1) / np.sqrt(max(count - 3, 1)) * without.std(axis=0)
        return size, np.abs(size) / np.where(std > 0, std, np.inf), (-answer * size).T


def wider(dof: int) -> float:
    return float(-scipy.special.stdtrit(dof, scipy.special.ndtr(-CHANCE)) / CHANCE)


def block_numbers(samples: Sequence[int], blocks: int) -> Integers:
    """Return the block of each sample of runs of so many samples; none crosses runs."""
    total, first, found = sum(samples), 0, []
    for count in samples:
        own = max(1, round(blocks * count / total))
        found.append(first + np.arange(count) * own // count)
        first += own
    return np.concatenate(found).astype(np.int64)


def scatter_of_blocks(matrix: Floats, residual: Floats, gains: Floats, blocks: Integers) -> Scatter:
    """Return the covariance of an answer by leaving out each block in turn (the jackknife).

    ``values - values without b = (1 - G_b X_b)^-1 G_b e_b``, exactly, with the whitened design X,
    its residual e and gains G, (free, equation); `blocks` are those of the equations.
    Neighbours that depend on one another are merged.
    """
    length = column_lengths(gains.T)
    while True:
        count, found = int(blocks.max()) + 1, []
        edges = np.searchsorted(blocks, np.arange(count + 1))
        for own in (slice(*pair) for pair in pairwise(edges)):
            shift = gains[:, own] @ residual[own]
            share = gains[:, own] @ matrix[own] * length / length[:, None]
            change, untold = leave_out(share, shift / length, ALONE)
            found.append((shift, change * length, (np.abs(untold) > TINY).any(axis=1)))
        shifts, without, alone = (np.array(part) for part in zip(*found, strict=True))
        size, known = (shifts**2).sum(axis=0), shifts.any(axis=0)
        # How much what a block adds resembles what the one before added, in any parameter.
        alike = ((shifts[1:] * shifts[:-1]).sum(axis=0)[known] / size[known]).max(initial=0.0)
        memory = float(alike) if count >= FEWEST and alike > MEMORY / np.sqrt(count) else 0.0
        if not memory or count // 2 < FEWEST:
            break
        blocks = blocks // 2
    apart = without - without.mean(axis=0)
    covariance = apart.T @ apart * ((count - 1) / count)
    # A variance from so few is itself uncertain: that of Student's t.
    spread = (count - 1) / max(count - 3, 1)
    # A sum whose terms remember by r scatters as (1 + r) / (1 - r) times that of independent ones.
    kept = min(memory, MOST)
    spread *= (1 + kept) / (1 - kept)
    return Scatter(covariance * spread, shifts, memory, np.asarray(alone.any(axis=0)), blocks)
