"""The gain of a channel: it reads gain times the quantity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from rotorid.estimators.likelihood.nuisances.base import Factor, Nuisances, Unknown, all_channels
from rotorid.observation import Observation
from rotorid.record import Channel, Complexes, Floats


class Gain(Factor):
    """Reading = gain * quantity."""

    @classmethod
    def of(cls, channel: Channel, std: float | None) -> Self:
        """Return the gain of one channel, known to `std`."""
        unknown = Unknown(
            f"gain[{channel.name}]", "1", 1.0, std, 1.0, nuisance=True, positive=True, anchored=True
        )
        return cls((unknown,), frozenset([channel.name]))

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        """Return the gains that are known with a deviation."""
        return [cls.of(c, c.gain_std) for c in all_channels(records) if c.gain_std > 0]

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        """Return the gain of each channel."""
        return [cls.of(c, None) for c in all_channels(records)]

    def factor(self, values: Floats, omega: Floats) -> Complexes:
        """1 / g."""
        return np.full(len(omega), 1 / values[0], dtype=np.complex128)

    def slopes(self, values: Floats, omega: Floats) -> Complexes:
        """-1 / g."""
        return np.full((len(omega), 1), -1 / values[0], dtype=np.complex128)
