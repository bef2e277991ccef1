"""Parts of a rig: actuators, sensors, marks of the rotor angle, the logger. All are values."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import field
from typing import Literal

import numpy as np

from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.values import Floats
from rotorid.force.laws import Differential, Flux, Linear
from rotorid.rig.rotation import Encoder, Keyphasor, check


@frozen
class FluxSensors:
    """Hall sensors under both magnets of an actuator."""

    law: Flux  # how the reader turns them into the force
    noise: float = 0.0  # standard deviation in T

    def __post_init__(self) -> None:
        check(self, zero=("noise",))


@frozen
class Coil:
    """A coil behind a current controller, with the voltage that the moving rotor induces.

    ``L i' = v - R i - k_i x'``, ``v = w (L e + R int e dt)``, e the error of the current: without
    motion the current follows its command as a first-order lag of bandwidth w / 2 pi. The induced
    voltage is k_i times the velocity: what the magnet takes from the current it gives to the force.
    """

    # ohm and H, as the control current sees them
    resistance: float
    inductance: float
    bandwidth: float  # of the current controller, Hz

    def __post_init__(self) -> None:
        check(self, positive=("inductance", "bandwidth"), zero=("resistance",))


@frozen
class Actuator:
    """One axis of a magnetic bearing with its amplifier.

    Examples
    --------
    >>> Actuator(Linear(ki=120.0, ks=2e5), limit=3.0).slopes
    (120.0, 200000.0)
    """

    # from current and displacement to force; without one the command is the force itself
    law: Linear | Differential | None = None
    limit: float = np.inf  # largest command, A (N without law)
    # of the amplifier, first order, in Hz; without it the current follows at once
    bandwidth: float | None = None
    slew: float = np.inf  # largest slope of the current in A/s: supply voltage over coil inductance
    # standard deviation of the recorded current in A (of the force in N without law)
    noise: float = 0.0
    flux: FluxSensors | None = None
    coil: Coil | None = None  # in place of the bandwidth
    # tau in s of the eddy currents in the iron: the force follows the current as 1 / (1 + sqrt(i
    # omega tau))
    eddy: float = 0.0
    # half the width in A of the loop of the iron: the current that the force follows stays where it
    # is until the coil's is that far away (a play operator)
    hysteresis: float = 0.0
    heating: float = 0.0  # growth of the gaps in 1/s, from the first sample on

    def __post_init__(self) -> None:
        check(
            self,
            positive=("limit", "bandwidth", "slew"),
            zero=("noise", "eddy", "hysteresis"),
        )
        if self.coil is not None and (self.bandwidth is not None or self.hysteresis):
            raise InputError(
                "a coil beside a bandwidth or hysteresis",
                "one of them",
                "give the coil its own bandwidth, and leave the others out",
                place="coil",
            )
        if self.coil is not None and self.unbiased:
            raise InputError(
                "a coil of magnets without bias",
                "a bias, or a bandwidth in place of the coil",
                "their inductance changes with the current: give the bandwidth",
                place="coil",
            )
        if isinstance(self.law, Differential) and self.law.most < self.limit < np.inf:
            raise InputError(
                f"a current limit of {self.limit:g} A beyond the bias of {self.law.most:g} A",
                "a limit of the bias at most",
                "beyond it one magnet would have to push; lower the limit or raise the bias",
                place="limit",
            )
        if np.isfinite(self.slew) and self.bandwidth is None:
            raise InputError(
                "a slew limit without bandwidth",
                "the amplifier's bandwidth beside it",
                "give the bandwidth",
                place="slew",
            )
        if self.flux is not None and not isinstance(self.law, Differential):
            raise InputError(
                "flux sensors on an actuator without magnets",
                "a differential law",
                "give bias and gap, or leave the sensors out",
                place="flux",
            )

    @property
    def unit(self) -> str:
        return "N" if self.law is None else "A"

    @property
    def unbiased(self) -> bool:
        """Whether one magnet works at a time; commands are forces then, turned into currents."""
        return isinstance(self.law, Differential) and not self.law.bias

    @property
    def slopes(self) -> tuple[float, float]:
        """Return k_i and k_s at the centre; 1 and 0 where the command is the force."""
        if self.law is None or self.unbiased:
            return 1.0, 0.0
        slope = self.law.linearize()
        return slope.ki, slope.ks

    @property
    def time_constant(self) -> float:
        return 0.0 if self.bandwidth is None else 1 / (2 * np.pi * self.bandwidth)

    @property
    def linear(self) -> bool:
        """Whether its steps between events can be exact."""
        slow = np.isfinite(self.slew) or self.hysteresis > 0 or self.heating != 0
        return not slow and not isinstance(self.law, Differential)


@frozen
class SensorRunout:
    """What a sensor reads of the shaft's surface: cos cos(n phi) + sin sin(n phi), in m."""

    order: int
    cos: float = 0.0
    sin: float = 0.0

    def __post_init__(self) -> None:
        if self.order < 1:
            raise InputError(
                f"order {self.order}",
                "1 or more",
                "count orders of the speed from 1",
                place="order",
            )


@frozen
class PositionSensor:
    """A sensor of a coordinate, or of a combination of some."""

    name: str  # A coordinate's name, or a new one where it reads several
    reads: Mapping[str, float] | None = None  # ``{coordinate: coefficient}``
    # standard deviation, offset and least step in m (rad for an angle)
    noise: float = 0.0
    bias: float = 0.0
    quantum: float = 0.0
    runout: tuple[SensorRunout, ...] = ()
    bandwidth: float = np.inf  # of the sensor, first order, in Hz
    cubic: float = 0.0  # its reading r is bent to r (1 + cubic r^2); in 1/m^2
    heating: float = 0.0  # growth of its gain in 1/s, from the first sample on
    hum: float = 0.0  # amplitude of the mains in its reading, in m

    def __post_init__(self) -> None:
        check(self, positive=("bandwidth",), zero=("noise", "quantum"))

    @property
    def combination(self) -> Mapping[str, float]:
        """What it reads, as ``{coordinate: coefficient}``."""
        return {self.name: 1.0} if self.reads is None else self.reads


def sensor_unit(combination: Iterable[str], units: Mapping[str, str]) -> str:
    """Return the unit of what a sensor reads: that of a length, where it reads one."""
    found = [units[name] for name in combination]
    return next((unit for unit in found if unit != "rad"), "rad")


@frozen
class Logger:
    """What is recorded, and how often."""

    sample_rate: float  # Hz
    # {"command", "measured"}: the controller's command, or the coil's current
    current: Literal["command", "measured"] = "command"
    angle: Encoder | Keyphasor | None = None  # without one the speed is taken as known
    # corner in Hz of the filter before the converter: second order, after Butterworth, on positions
    # and measured currents
    filter: float = np.inf
    # measured currents and flux densities are sampled so many times as often, then decimated
    # without lag, as converters do: a current behind a held command has images beside every
    # multiple of the sample rate, which fold onto its lines. Positions are what the controller has
    # read.
    oversampling: int = 1

    def __post_init__(self) -> None:
        check(self, positive=("filter", "oversampling"))

    @property
    def converter_rate(self) -> float:
        """Rate in Hz at which currents and flux densities are sampled."""
        return self.sample_rate * self.oversampling


@frozen
class ProcessNoise:
    """Random forces on the rotor, white, held over each period of the controller."""

    # input or coordinate (the equation of it) to standard deviation in N (N m for an angle)
    std: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, value in self.std.items():
            if not value >= 0:
                raise InputError(f"{value}", "0 or more", "give a standard deviation", place=name)


@frozen
class Disturbance:
    """A force, or an acceleration of the frame, that nobody measures.

    Held over each period of the controller, at its value in the middle.
    """

    # input (N), or coordinate (acceleration in m/s^2, rad/s^2), to its factor
    on: Mapping[str, float]
    # from times in s, the record's first sample at 0, to the size there
    size: Callable[[Floats], Floats]
