"""What is unknown of channels: a factor of their lines, or how they bend.

Factors are a gain, a free factor, a delay, a bandwidth. A sensor that reads too much far out and an
iron that runs through a loop no setting asks for: they are freed one at a time, to see what they
explain.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Iterable, Sequence
from dataclasses import field, replace
from functools import partial
from typing import ClassVar, Self

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.core.values import Complexes, Floats
from rotorid.data.observation import Observation
from rotorid.data.record import Channel
from rotorid.force.channel_dynamics import UNKNOWN, Constant, Dynamics, FirstOrder
from rotorid.likelihood.effects import Adds, Effect, Scales
from rotorid.likelihood.unknowns.kinds import (
    Nuisances,
    Plausible,
    Scalar,
    Unknown,
    all_channels,
    all_inputs,
    all_sensors,
)
from rotorid.signals.spectrum import transfer_of_recording

FACTORS = {
    "mil instead of um, um instead of mil, or inches instead of mm": 25.4,
    "mm instead of um, or mA instead of A": 1e3,
    "m instead of um, or uA instead of A": 1e6,
    "degrees instead of radians": 180 / np.pi,
    "rms instead of amplitude": np.sqrt(2),
    "peak to peak instead of amplitude": 2.0,
    "inches instead of m": 1 / 0.0254,
    "pounds-force instead of N": 1 / 4.4482216152605,
    "kilograms-force instead of N": 1 / 9.80665,
    "ten times": 10.0,
}
"""Factors by which a reading is off where a unit was mistaken; each may be its inverse."""
SNAP = 0.03
"""A free factor this close to that of a unit is taken for it: calibrations are off by less."""


def factor_name(gain: float) -> str:
    """Say which unit was mistaken where a gain is that of one, and whether it is upside down."""
    name, _ = _nearest(abs(gain)) or ("", 1.0)
    told = [name] if name else []
    if gain < 0:
        told.append("upside down")
    return f" ({', '.join(told)})" if told else ""


def snap(gain: float) -> float | None:
    """Return the sign and unit factor that a gain is close to, or None."""
    near = _nearest(abs(gain))
    return None if near is None else float(np.copysign(near[1], gain))


def _nearest(size: float) -> tuple[str, float] | None:
    """Return the unit whose factor is nearest to a size, with that factor; None where none is."""
    factors = [("", 1.0), *((n, way) for n, f in FACTORS.items() for way in (f, 1 / f))]
    name, exact = min(factors, key=lambda known: abs(size / known[1] - 1))
    return (name, exact) if abs(size / exact - 1) < SNAP else None


@frozen
class Factor(Unknown):
    """Multiplies the lines of channels: true line = factor * corrected line."""

    cure: str = field(default="check the channel, or declare it unknown", kw_only=True)

    def effects(self) -> Sequence[Effect]:
        return (Scales(self.on, self.factor, self.slopes),)

    @abstractmethod
    def factor(self, values: Floats, omega: Floats) -> Complexes:
        """Return true line over corrected line, shape (line,), at the values of its scalars."""

    @abstractmethod
    def slopes(self, values: Floats, omega: Floats) -> Complexes:
        """Return the derivative of the logarithm of `factor`, shape (line, scalar)."""


class Gain(Factor):
    """Reading = gain * quantity."""

    setting = "gain_std"
    # What calibrating by hand reaches.
    plausible = Plausible(
        "gain",
        "1",
        0.01,
        "taken as exact: 1 % of it",
        "gain_std says how well it is known",
        in_scale=True,
    )

    @classmethod
    def of(cls, channel: Channel, std: float | None) -> Self:
        unknown = Scalar(f"gain[{channel.name}]", "1", 1.0, std, positive=True, anchored=True)
        return cls((unknown,), frozenset([channel.name]))

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        return [cls.of(c, c.gain_std) for c in all_channels(records) if c.gain_std > 0]

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        return [cls.of(c, None) for c in all_channels(records)]

    def factor(self, values: Floats, omega: Floats) -> Complexes:
        return np.full(len(omega), 1 / values[0], dtype=np.complex128)

    def slopes(self, values: Floats, omega: Floats) -> Complexes:
        return np.full((len(omega), 1), -1 / values[0], dtype=np.complex128)


class Multiplier(Factor):
    """Quantity = s * reading: linear in s, so that a search may pass through zero."""

    @classmethod
    def of(cls, name: str, channels: Iterable[str], start: float = 1.0) -> Self:
        unknown = Scalar(f"gain[{name}]", "1", start, additive=True)
        cure = "check the unit, the sign and the calibration of the channel"
        return cls((unknown,), frozenset(channels), cure=cure)

    def size(self, values: Floats) -> float:
        return float(1 / values[0]) if values[0] else np.nan

    def told(self, value: float | None) -> tuple[str, str]:
        said, cure = super().told(value)
        return said + ("" if value is None else factor_name(value)), cure

    def factor(self, values: Floats, omega: Floats) -> Complexes:
        return np.full(len(omega), values[0], dtype=np.complex128)

    def slopes(self, values: Floats, omega: Floats) -> Complexes:
        return np.full((len(omega), 1), 1 / (values[0] or 1e-300), dtype=np.complex128)


@frozen
class Delay(Factor):
    """The channels lag the quantity by tau; the lines are corrected for `known` already."""

    setting = "delay"
    rival = "term"
    # A tenth of the sample time of many loggers, and the lag of a filter of 16 kHz.
    plausible: ClassVar[Plausible | None] = Plausible(
        "delay",
        "s",
        10e-6,
        "taken as exact: 10 us of it",
        'delay = { std = ".." } says how well it is known',
    )

    known: float = 0.0

    @classmethod
    def _late(cls, label: str, channels: frozenset[str], start: float, std: float | None) -> Self:
        unknown = Scalar(f"delay[{label}]", "s", start, std, additive=True)
        cure = f'give delay or hold of the channels, or have it estimated: delays = ["{label}"]'
        return cls((unknown,), channels, start, cure=cure)

    @classmethod
    def of(cls, channel: Channel, std: float | None) -> Self:
        return cls._late(channel.name, frozenset([channel.name]), channel.delay, std)

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        return [cls.of(c, c.delay_std) for c in all_channels(records) if c.delay_std > 0]

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        return [cls.of(c, None) for c in all_channels(records)]

    def factor(self, values: Floats, omega: Floats) -> Complexes:
        return np.asarray(np.exp(1j * omega * (values[0] - self.known)))

    def slopes(self, values: Floats, omega: Floats) -> Complexes:
        return np.asarray(1j * omega[:, None])

    def instead(self, value: float, inputs: Collection[str]) -> Unknown | None:
        """Return a bandwidth, where the channels lag and do not lead: at first they look alike."""
        actuator, label = self.on <= {*inputs}, next(iter(self.on))
        late = value < 0 if actuator else value > 0 and not self.on & {*inputs}
        if len(self.on) > 1:
            label = "force" if actuator else "position"
        return Response.undeclared(label, self.on, value, actuator=actuator) if late else None


class CommonDelay(Delay):
    """One delay of all inputs, ``delay[force]``, or of all sensors, ``delay[position]``."""

    setting = "delays"
    plausible = None

    @classmethod
    def common(cls, kind: str, records: Sequence[Observation]) -> Self:
        which = all_inputs(records) if kind == "force" else all_sensors(records)
        return cls._late(kind, frozenset(which), 0.0, None)

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        return [cls.common(kind, records) for kind in wanted.delays]

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        return [cls.common(kind, records) for kind in ("force", "position")]


FLAT = 1e15
"""Bandwidth in Hz of what has none: of light."""


@frozen
class Response(Factor):
    """Dynamics whose constants are not known exactly; lines are corrected with the given ones."""

    setting = "dynamics"
    rival = "lag"

    dynamics: Dynamics

    @classmethod
    def of(cls, channels: Sequence[Channel]) -> Self:
        dynamics = channels[0].dynamics
        assert dynamics is not None
        label = dynamics.shared or channels[0].name
        unknowns = tuple(
            Scalar(
                f"{constant.name}[{label}]",
                constant.unit,
                constant.value,
                None if constant.std == UNKNOWN else constant.std,
                positive=True,
            )
            for constant in dynamics.constants
        )
        return cls(unknowns, frozenset(c.name for c in channels), dynamics)

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        groups: dict[str, list[Channel]] = {}
        for channel in all_channels(records):
            dynamics = channel.dynamics
            if dynamics is not None and any(c.std for c in dynamics.constants):
                groups.setdefault(dynamics.shared or channel.name, []).append(channel)
        return [cls.of(channels) for channels in groups.values()]

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        return [
            replace(found, scalars=tuple(replace(u, std=None) for u in found.scalars))
            for found in cls.asked(records, Nuisances())
        ]

    @classmethod
    def undeclared(
        cls, label: str, channels: frozenset[str], lag: float, *, actuator: bool
    ) -> Self:
        """Return the bandwidth of channels that are said to have none, from a delay alike in s."""
        dynamics = FirstOrder(bandwidth=Constant("bandwidth", "Hz", FLAT), actuator=actuator)
        start = 1 / (2 * np.pi * abs(lag))
        unknown = Scalar(f"bandwidth[{label}]", "Hz", start, positive=True)
        cure = "declare it: dynamics = { bandwidth = .. } of the channels"
        return cls((unknown,), channels, dynamics, cure=cure)

    def factor(self, values: Floats, omega: Floats) -> Complexes:
        """H over the H that the lines are corrected for, or one over it for a sensor."""
        ratio = self.dynamics.response(omega, values) / self.dynamics.response(
            omega, self.dynamics.values
        )
        return np.asarray(ratio if self.dynamics.actuator else 1 / ratio)

    def slopes(self, values: Floats, omega: Floats) -> Complexes:
        slopes = self.dynamics.slopes(omega, values)
        return np.asarray(slopes if self.dynamics.actuator else -slopes)


@frozen
class Bend(Unknown):
    """Channels read too much by ``unknown * shape(samples)``."""

    rival = "term"
    cure: str = field(default="calibrate what bends over its range, or excite less", kw_only=True)

    def effects(self) -> Sequence[Effect]:
        return tuple(Adds(name, lines=partial(self._lines, name)) for name in self.on)

    def _lines(self, name: str, record: Observation) -> Complexes | None:
        lines, samples = record.lines, record.lines.samples
        if samples is None:
            return None
        column = lines.names.index(name)
        bent = samples.lines(self.shape(samples.values[:, column])[:, None])
        # Lines of samples become those of the quantity as the channel's own do.
        channel = [lines.channels[column]]
        corrected = transfer_of_recording(channel, lines.frequency, samples.sample_rate)
        return np.asarray((bent * corrected)[:, 0])

    @staticmethod
    @abstractmethod
    def shape(samples: Floats) -> Floats:
        """Return what is added to a signal for an unknown of one."""

    @classmethod
    def _of(cls, what: str, label: str, unit: str, channels: Sequence[Channel]) -> Self:
        unknown = Scalar(f"{what} {label}", unit, 0.0, additive=True)
        return cls((unknown,), frozenset(c.name for c in channels))


class Cubic(Bend):
    """``reading = quantity (1 + unknown * quantity^2)``: symmetric, as of opposed sensors."""

    @staticmethod
    def shape(samples: Floats) -> Floats:
        return np.asarray(samples**3)

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        found = []
        for unit, channels in _sensors(records).items():
            found += [cls._of("nonlinear", c.name, _per_square(unit), [c]) for c in channels]
            if len(channels) > 1:
                label = f"{channels[0].name} ... {channels[-1].name}"
                found.append(cls._of("nonlinear", label, _per_square(unit), channels))
        return found


class Hysteresis(Bend):
    """An input that lags by half the width of a loop, whichever way it goes: hysteresis."""

    @staticmethod
    def shape(samples: Floats) -> Floats:
        return np.asarray(np.sign(np.roll(samples, -1) - np.roll(samples, 1)))

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        channels = list(all_inputs(_with_samples(records)).values())
        found = [cls._of("hysteresis", c.name, c.unit, [c]) for c in channels]
        if len(channels) > 1:
            found.append(cls._of("hysteresis", "force", channels[0].unit, channels))
        return found


def _with_samples(records: Sequence[Observation]) -> list[Observation]:
    return [record for record in records if record.lines.samples is not None]


def _sensors(records: Sequence[Observation]) -> dict[str, list[Channel]]:
    there = {s.channel.name: s.channel for r in _with_samples(records) for s in r.direct}
    found: dict[str, list[Channel]] = {}
    for channel in there.values():
        found.setdefault(channel.unit, []).append(channel)
    return found


def _per_square(unit: str) -> str:
    return f"1/{unit}^2" if unit else "1"
