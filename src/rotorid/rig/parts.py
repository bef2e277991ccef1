"""Parts of a rig, all values: rotation and its marks, actuators, sensors, the logger."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from rotorid.core.errors import InputError, require_positive
from rotorid.core.values import Floats, frozen
from rotorid.force.laws import Differential, Flux, Linear, require
from rotorid.signals.angle import MeasuredAngle, encoder_angle, mark_angle


def check(part: object, *, positive: tuple[str, ...] = (), zero: tuple[str, ...] = ()) -> None:
    """Refuse values that are not positive, or negative, where they must not be."""
    for name in (*positive, *zero):
        value, strict = getattr(part, name), name in positive
        fine = value is None or value > 0 or (value == 0 and not strict)
        expected = "more than 0" if strict else "0 or more"
        cure = f"give a {'positive ' if strict else ''}size, without a sign"
        require(fine, name, value, expected, cure)


def check_rate(rate: float, place: str) -> None:
    require_positive(rate, "Hz", "give how often its clock ticks in a second", place=place)


def angle_and_speed(rotation: Any, time: Any) -> tuple[Any, Any]:
    """Return phi and Omega at a time, or at several: compiled, for the kernel too."""
    speed, acceleration, drift, period, phase = rotation
    t = np.maximum(time, 0.0)
    angle = phase + speed * time + acceleration * t * t / 2
    omega = speed + acceleration * t
    if drift != 0.0:
        rate = 2 * np.pi / period
        angle = angle + drift / rate * (1 - np.cos(rate * t))
        omega = omega + drift * np.sin(rate * t)
    return angle, omega


@frozen
class Rotation:
    """Speed over time, ``Omega = speed + acceleration t + drift sin(2 pi t / drift_period)``.

    t = 0 is the first sample of the record; before it the rig settles at the speed of t = 0.
    """

    speed: float = 0.0  # rad/s at t = 0
    acceleration: float = 0.0  # rad/s^2: a ramp
    drift: float = 0.0  # rad/s: the amplitude of a slow wandering
    drift_period: float = 10.0  # s
    phase: float = 0.0  # rotor angle in rad at t = 0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not np.isfinite(value):
                cure = "give a number, or leave it out"
                raise InputError(f"{value}", "a finite number", cure, place=name)
        if self.drift:
            cure = "give the time in which the speed drifts to and fro"
            require_positive(self.drift_period, "s", cure, place="drift_period")

    @property
    def constant(self) -> bool:
        return self.acceleration == 0 and self.drift == 0

    @property
    def numbers(self) -> Floats:
        """What `angle_and_speed` takes."""
        return np.array([getattr(self, name) for name in self.__dataclass_fields__])

    def speed_at(self, time: ArrayLike) -> Floats:
        return np.asarray(angle_and_speed(self.numbers, np.asarray(time, dtype=float))[1])

    def angle_at(self, time: ArrayLike) -> Floats:
        return np.asarray(angle_and_speed(self.numbers, np.asarray(time, dtype=float))[0])

    def range_until(self, end: float) -> tuple[float, float]:
        """Return the lowest and the highest speed in rad/s between the start and an end in s."""
        speeds = self.speed_at(np.linspace(0.0, end, 2049))
        return float(speeds.min()), float(speeds.max())


@frozen
class Encoder:
    name: ClassVar = "encoder"  # of its column
    lines: int  # counts per revolution
    jitter: float = 0.0  # standard deviation of each reading before it is counted, in rad
    # lines that the counter loses in the record, each at a time of its own; negative where it
    # counts them twice
    lost: int = 0
    # the counter is set to 0 at every revolution, so that what is lost is found again
    index: bool = False

    def __post_init__(self) -> None:
        check(self, positive=("lines",), zero=("jitter",))

    def column(self, rotation: Rotation, time: Floats, rng: np.random.Generator) -> Floats:
        """Return the counter at times in s, afresh at every revolution."""
        angle = rotation.angle_at(time) + self.jitter * rng.normal(size=len(time))
        lines = np.floor(angle * (self.lines / (2 * np.pi)))
        if not self.lost:
            return np.asarray(lines % self.lines)
        (own,) = rng.spawn(1)
        at = np.sort(own.choice(len(time), abs(self.lost), replace=False))
        lost = np.sign(self.lost) * np.searchsorted(at, np.arange(len(time)), side="right")
        if self.index:
            # What was lost before this revolution began does not count any more.
            turn = np.floor_divide(lines, self.lines)
            first = np.searchsorted(np.maximum.accumulate(turn), turn)
            lost = lost - lost[first]
        return np.asarray((lines - lost) % self.lines)

    def read(self, column: Floats, sample_rate: float) -> MeasuredAngle:
        return encoder_angle(column, sample_rate, per_revolution=self.lines, lines=self.lines)


@frozen
class Keyphasor:
    """A mark that passes at phi = 0; flanks of its pulse last two samples, as a low-pass has it."""

    name: ClassVar = "keyphasor"
    jitter: float = 0.0  # standard deviation of the pulses' times in s
    noise: float = 0.0  # standard deviation of the samples; a pulse is 1 high
    width: float = 0.1  # part of a revolution that the mark lasts
    logic: bool = False  # the pulse is a logic level
    # pulses that are not seen, or come twice, in the record
    missing: int = 0
    double: int = 0

    def __post_init__(self) -> None:
        check(self, positive=("width",), zero=("jitter", "noise", "missing", "double"))

    def column(self, rotation: Rotation, time: Floats, rng: np.random.Generator) -> Floats:
        """Return the sampled pulses: high from phi = 2 pi n, with flanks of two samples."""
        step = time[1] - time[0]
        turns = rotation.angle_at(time[[0, -1]]) / (2 * np.pi)
        speeds = rotation.speed_at(time)
        if speeds.min() <= 0 <= speeds.max():
            expected = "a rotor that turns one way"
            cure = "choose another speed, or leave the keyphasor out"
            raise InputError(f"a keyphasor at {speeds.min():.4g} rad/s", expected, cure)
        shortest = 2 * np.pi * min(self.width, 1 - self.width) / np.abs(speeds).max()
        if shortest < (1 if self.logic else 4) * step:
            raise InputError(
                f"pulses of {shortest / step:.3g} samples",
                "four or more, so that their flanks can be seen; one of a logic level",
                "sample faster, or make the mark wider",
                place="keyphasor",
            )
        numbers = np.arange(np.floor(turns.min()) - 1, np.ceil(turns.max()) + 2)
        rise = _times_of(numbers, rotation, time) + self.jitter * rng.normal(size=len(numbers))
        fall = _times_of(numbers + self.width, rotation, time)
        first, last = np.minimum(rise, fall), np.maximum(rise, fall)
        if self.missing or self.double:
            (own,) = rng.spawn(1)
            first, last = _misread(self, first, last, own)
        order = np.argsort(first)
        first, last = first[order], last[order]
        if self.logic:
            pulse = np.maximum(np.searchsorted(first, time, side="right") - 1, 0)
            level = np.where((time >= first[pulse]) & (time < last[pulse]), 1.0, 0.0)
        else:
            knots = np.stack([first - step, first + step, last - step, last + step], axis=1).ravel()
            level = np.interp(time, knots, np.tile([0.0, 1.0, 1.0, 0.0], len(first)))
        return np.asarray(level + self.noise * rng.normal(size=len(level)))

    def read(self, column: Floats, sample_rate: float) -> MeasuredAngle:
        return mark_angle(column, sample_rate)


def _misread(
    mark: Keyphasor, first: Floats, last: Floats, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Leave pulses out, and add others half a revolution after one."""
    inner = np.arange(3, len(first) - 3)
    chosen = rng.choice(inner, mark.missing + mark.double, replace=False)
    twice = chosen[mark.missing :]
    half = (first[twice + 1] - first[twice]) / 2
    kept = np.delete(np.arange(len(first)), chosen[: mark.missing])
    return (
        np.concatenate([first[kept], first[twice] + half]),
        np.concatenate([last[kept], last[twice] + half]),
    )


def _times_of(turns: Floats, rotation: Rotation, time: Floats) -> Floats:
    """Return when the rotor has made so many turns (Newton's method on the angle)."""
    mean = (rotation.angle_at(time[-1]) - rotation.angle_at(time[0])) / (time[-1] - time[0])
    t = time[0] + (2 * np.pi * turns - rotation.angle_at(time[0])) / mean
    for _ in range(20):
        t = t - (rotation.angle_at(t) - 2 * np.pi * turns) / rotation.speed_at(t)
    return np.asarray(t)


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
    """One axis of a magnetic bearing with its amplifier."""

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
        check(self, positive=("limit", "bandwidth", "slew"), zero=("noise", "eddy", "hysteresis"))
        if self.coil is not None and (self.bandwidth is not None or self.hysteresis):
            found = "a coil beside a bandwidth or hysteresis"
            cure = "give the coil its own bandwidth, and leave the others out"
            raise InputError(found, "one of them", cure, place="coil")
        if self.coil is not None and self.unbiased:
            expected = "a bias, or a bandwidth in place of the coil"
            cure = "their inductance changes with the current: give the bandwidth"
            raise InputError("a coil of magnets without bias", expected, cure, place="coil")
        if isinstance(self.law, Differential) and self.law.most < self.limit < np.inf:
            found = f"a current limit of {self.limit:g} A beyond the bias of {self.law.most:g} A"
            cure = "beyond it one magnet would have to push; lower the limit or raise the bias"
            raise InputError(found, "a limit of the bias at most", cure, place="limit")
        if np.isfinite(self.slew) and self.bandwidth is None:
            expected = "the amplifier's bandwidth beside it"
            cure = "give the bandwidth"
            raise InputError("a slew limit without bandwidth", expected, cure, place="slew")
        if self.flux is not None and not isinstance(self.law, Differential):
            found = "flux sensors on an actuator without magnets"
            cure = "give bias and gap, or leave the sensors out"
            raise InputError(found, "a differential law", cure, place="flux")

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
            cure = "count orders of the speed from 1"
            raise InputError(f"order {self.order}", "1 or more", cure, place="order")


@frozen
class PositionSensor:
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
        return {self.name: 1.0} if self.reads is None else self.reads


def sensor_unit(combination: Iterable[str], units: Mapping[str, str]) -> str:
    """Return the unit of what a sensor reads: that of a length, where it reads one."""
    found = [units[name] for name in combination]
    return next((unit for unit in found if unit != "rad"), "rad")


@frozen
class Logger:
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
class Disturbance:
    """A force, or acceleration of the frame, held over each controller period at its middle."""

    on: tuple[str, ...]  # inputs (N), or coordinates (acceleration in m/s^2, rad/s^2)
    # from times in s, the record's first sample at 0, to the size there
    size: Callable[[Floats], Floats]
