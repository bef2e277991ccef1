"""Constants of a channel's dynamics: bandwidth, damping, eddy currents."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Self

import numpy as np

from rotorid.dynamics import UNKNOWN, Constant, Dynamics, FirstOrder
from rotorid.estimators.likelihood.nuisances.base import Factor, Nuisances, Unknown, all_channels
from rotorid.frozen import frozen
from rotorid.observation import Observation
from rotorid.record import Channel, Complexes, Floats

FLAT = 1e15
"""Bandwidth in Hz of what has none: of light."""


@frozen
class Response(Factor):
    """Dynamics whose constants are not known exactly; lines are corrected with the given ones."""

    dynamics: Dynamics

    @classmethod
    def of(cls, channels: Sequence[Channel], dynamics: Dynamics) -> Self:
        """Return the constants that some channels share."""
        label = dynamics.shared or channels[0].name
        unknowns = tuple(
            Unknown(
                f"{constant.name}[{label}]",
                constant.unit,
                constant.value,
                None if constant.std == UNKNOWN else constant.std,
                constant.value,
                nuisance=True,
                positive=True,
            )
            for constant in dynamics.constants
        )
        return cls(unknowns, frozenset(c.name for c in channels), dynamics)

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        """Return the dynamics with a constant that is not known exactly."""
        groups: dict[str, list[Channel]] = {}
        for channel in all_channels(records):
            dynamics = channel.dynamics
            if dynamics is not None and any(c.std for c in dynamics.constants):
                groups.setdefault(dynamics.shared or channel.name, []).append(channel)
        return [
            cls.of(channels, channels[0].dynamics)
            for channels in groups.values()
            if channels[0].dynamics is not None
        ]

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        """Return the dynamics that channels have, their constants free."""
        return [
            replace(found, unknowns=tuple(replace(u, std=None) for u in found.unknowns))
            for found in cls.asked(records, Nuisances())
        ]

    @classmethod
    def undeclared(
        cls, label: str, channels: frozenset[str], lag: float, *, actuator: bool
    ) -> Self:
        """Return the bandwidth of channels that are said to have none, from a delay alike in s."""
        dynamics = FirstOrder(bandwidth=Constant("bandwidth", "Hz", FLAT), actuator=actuator)
        start = 1 / (2 * np.pi * lag)
        unknown = Unknown(f"bandwidth[{label}]", "Hz", start, nuisance=True, positive=True)
        return cls((unknown,), channels, dynamics)

    def factor(self, values: Floats, omega: Floats) -> Complexes:
        """H over the H that the lines are corrected for, or one over it for a sensor."""
        ratio = self.dynamics.response(omega, values) / self.dynamics.response(
            omega, self.dynamics.values
        )
        return np.asarray(ratio if self.dynamics.actuator else 1 / ratio)

    def slopes(self, values: Floats, omega: Floats) -> Complexes:
        """D ln H, its sign turned for a sensor."""
        slopes = self.dynamics.slopes(omega, values)
        return np.asarray(slopes if self.dynamics.actuator else -slopes)
