"""What went through the force laws of a record: the current and the displacement of each magnet."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.core.values import Complexes, Floats
from rotorid.data.lines import Lines, Samples
from rotorid.data.record import ForceLaw

NEAR = 1e-8
"""Displacement in m over which the slope of a law is taken: a hundred thousandth of any gap."""


@frozen
class Passed:
    """What went through the law of an input."""

    column: int  # of the input among the channels of the record
    law: ForceLaw
    shares: Floats  # (channel,): the displacement as a combination of channels
    # (sample,)
    flowing: Floats
    position: Floats

    @classmethod
    def of(cls, lines: Lines, column: int, law: ForceLaw) -> Passed:
        shares = np.array([law.position.get(name, 0.0) for name in lines.names])
        if lines.samples is None:
            return cls(column, law, shares, np.zeros(1), np.zeros(1))
        position = displacement(lines, lines.samples, shares)
        flowing = law.flowing(lines.samples.values[:, column], position)
        return cls(column, law, shares, flowing, position)

    @cached_property
    def force(self) -> Floats:
        """The force as it was read, shape (sample,)."""
        return np.asarray(self.law.force(self.flowing, self.position, {}).real)

    @cached_property
    def slope(self) -> Floats:
        """Force per displacement at each sample in N/m."""
        ahead, behind = (
            self.law.force(self.flowing, self.position + move, {}).real for move in (NEAR, -NEAR)
        )
        return np.asarray((ahead - behind) / (2 * NEAR))


def displacement(lines: Lines, samples: Samples, shares: Floats) -> Floats:
    """Return the samples of a combination of channels, without what recorded them."""
    found = np.zeros(len(samples.values))
    for column in np.flatnonzero(shares):
        found += shares[column] * samples.column(int(column), lines.channels[column])
    return found


def combined_columns(lines: Lines, through: Iterable[Passed], matrix: Floats) -> Lines:
    """Return the lines whose columns are ``matrix @ columns``, as if logged so.

    A column of a force that was read by a law is that of its current; the law reads it again, with
    the displacement that the other columns give now. A positive factor of one that keeps both is
    one of the force itself. The covariance follows by the slopes.
    """
    samples = lines.samples
    whole, moved = matrix.astype(float), np.zeros_like(lines.mean)
    values = None if samples is None else samples.values @ matrix.T
    every = {each.column: each for each in through}
    for column, passed in every.items():
        sources = np.flatnonzero(matrix[column]).tolist()
        same = np.array_equal(passed.shares @ matrix, passed.shares)
        if (same and np.array_equal(sources, [column]) and matrix[column, column] > 0) or not all(
            source in every for source in sources
        ):
            continue
        again = _again(lines, passed, [(matrix[column, k], every[k]) for k in sources], matrix)
        if again is None:
            continue
        whole[column] = passed.shares @ matrix * again.slope.mean()
        for source in sources:
            other = every[source]
            whole[column, source] += matrix[column, source]
            whole[column] -= matrix[column, source] * other.slope.mean() * other.shares
        if samples is not None and values is not None:
            # The lines are those of the force as it was corrected; only the change is added.
            change = again.force - displacement(lines, samples, whole[column])
            moved[:, column] = samples.lines(change[:, None])[:, 0]
            values[:, column] = again.force
    return _transformed(lines, whole, moved, values)


def _again(
    lines: Lines, passed: Passed, sources: list[tuple[float, Passed]], matrix: Floats
) -> Passed | None:
    """Return what goes through a law with other columns; None where that is beyond its gap."""
    flowing = np.sum([factor * source.flowing for factor, source in sources], axis=0)
    position = passed.position
    if lines.samples is not None:
        position = displacement(lines, lines.samples, passed.shares @ matrix)
    if not (np.abs(position) < passed.law.reach).all():
        return None
    found = replace(passed, flowing=flowing, position=position)
    with np.errstate(all="ignore"):
        sound = np.isfinite(found.force).all() and np.isfinite(found.slope).all()
    return found if sound else None


def _transformed(lines: Lines, matrix: Floats, moved: Complexes, values: Floats | None) -> Lines:
    covariance = matrix @ lines.covariance.matrices @ matrix.T
    scatter, samples, beside = lines.scatter, lines.samples, lines.beside
    if beside is not None and beside.noise is not None:
        beside = replace(beside, noise=beside.noise @ matrix.T)
    return replace(
        lines,
        mean=lines.mean @ matrix.T + moved,
        covariance=replace(lines.covariance, matrices=covariance),
        scatter=None if scatter is None else scatter @ matrix.T + moved,
        samples=samples if samples is None or values is None else replace(samples, values=values),
        beside=beside,
    )
