"""What went through the force laws of a record: the current and the displacement of each magnet."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from rotorid.frozen import frozen
from rotorid.lines import Lines, Samples
from rotorid.record import Floats, ForceLaw

NEAR = 1e-8
"""Displacement in m over which the slope of a law is taken: a hundred thousandth of any gap."""


@frozen
class Passed:
    """What went through the law of an input.

    Parameters
    ----------
    column : int
        Of the input among the channels of the record.
    law : ForceLaw
    shares : array, shape (channel,)
        The displacement as a combination of channels.
    flowing, position : array, shape (sample,)
    """

    column: int
    law: ForceLaw
    shares: Floats
    flowing: Floats
    position: Floats

    @classmethod
    def of(cls, lines: Lines, column: int, law: ForceLaw) -> Passed:
        """Find it for a channel; at rest where the record keeps no samples."""
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
