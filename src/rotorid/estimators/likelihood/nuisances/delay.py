"""Delays: of a channel, known with a deviation, or one common to all of a kind."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from rotorid.estimators.likelihood.nuisances.base import (
    Factor,
    Nuisances,
    Unknown,
    all_channels,
    all_inputs,
    all_sensors,
)
from rotorid.frozen import frozen
from rotorid.observation import Observation
from rotorid.record import Channel, Complexes, Floats


@frozen
class Delay(Factor):
    """The channels lag the quantity by tau; the lines are corrected for `known` already."""

    known: float = 0.0

    @classmethod
    def of(cls, channel: Channel, std: float | None) -> Self:
        """Return the delay of one channel, known to `std`."""
        unknown = Unknown(
            f"delay[{channel.name}]",
            "s",
            channel.delay,
            std,
            channel.delay,
            nuisance=True,
            additive=True,
        )
        return cls((unknown,), frozenset([channel.name]), channel.delay)

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        """Return the delays that are known with a deviation."""
        return [cls.of(c, c.delay_std) for c in all_channels(records) if c.delay_std > 0]

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        """Return the delay of each channel."""
        return [cls.of(c, None) for c in all_channels(records)]

    def factor(self, values: Floats, omega: Floats) -> Complexes:
        """``exp(i omega (tau - known))``."""
        return np.asarray(np.exp(1j * omega * (values[0] - self.known)))

    def slopes(self, values: Floats, omega: Floats) -> Complexes:
        """``i omega``."""
        return np.asarray(1j * omega[:, None])


class CommonDelay(Delay):
    """One delay of all inputs, ``delay[force]``, or of all sensors, ``delay[position]``."""

    @classmethod
    def common(cls, kind: str, records: Sequence[Observation]) -> Self:
        """Return the common delay of a kind of channel."""
        which = all_inputs(records) if kind == "force" else all_sensors(records)
        unknown = Unknown(f"delay[{kind}]", "s", 0.0, nuisance=True, additive=True)
        return cls((unknown,), frozenset(which))

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        """Return those of the settings."""
        return [cls.common(kind, records) for kind in wanted.delays]

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        """Return both."""
        return [cls.common(kind, records) for kind in ("force", "position")]
