"""The rotation of a rig: constant, ramping, drifting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rotorid.errors import InputError
from rotorid.record import Floats


@dataclass(frozen=True)
class Rotation:
    """Speed over time, ``Omega = speed + acceleration t + drift sin(2 pi t / drift_period)``.

    t = 0 is the first sample of the record; before it the rig settles at the speed of t = 0.

    Parameters
    ----------
    speed : float
        rad/s at t = 0.
    acceleration : float
        rad/s^2: a ramp.
    drift : float
        rad/s: the amplitude of a slow wandering.
    drift_period : float
        s.
    phase : float
        Rotor angle in rad at t = 0.

    Raises
    ------
    InputError
        For values that are not finite or a drift without period.

    Examples
    --------
    >>> ramp = Rotation(speed=10.0, acceleration=2.0)
    >>> float(ramp.speed_at(3.0)), float(ramp.angle_at(3.0))
    (16.0, 39.0)
    """

    speed: float = 0.0
    acceleration: float = 0.0
    drift: float = 0.0
    drift_period: float = 10.0
    phase: float = 0.0

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            if not np.isfinite(value):
                raise InputError(f"{value}", "a finite number", "correct it", place=name)
        if self.drift and self.drift_period <= 0:
            raise InputError(
                f"{self.drift_period}", "more than 0 s", "correct it", place="drift_period"
            )

    @property
    def constant(self) -> bool:
        """Whether the speed never changes."""
        return self.acceleration == 0 and self.drift == 0

    def speed_at(self, time: ArrayLike) -> Floats:
        """Return Omega in rad/s at times in s."""
        t = np.maximum(np.asarray(time, dtype=float), 0.0)
        rate = 2 * np.pi / self.drift_period
        return np.asarray(self.speed + self.acceleration * t + self.drift * np.sin(rate * t))

    def angle_at(self, time: ArrayLike) -> Floats:
        """Return phi in rad at times in s: the integral of the speed plus the phase."""
        time = np.asarray(time, dtype=float)
        t = np.maximum(time, 0.0)
        rate = 2 * np.pi / self.drift_period
        wander = self.drift / rate * (1 - np.cos(rate * t))
        return np.asarray(self.phase + self.speed * time + self.acceleration * t**2 / 2 + wander)

    def range_until(self, end: float) -> tuple[float, float]:
        """Return the lowest and the highest speed in rad/s between the start and an end in s."""
        speeds = self.speed_at(np.linspace(0.0, end, 2049))
        return float(speeds.min()), float(speeds.max())
