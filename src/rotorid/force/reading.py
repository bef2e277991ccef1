"""Recorded currents, fluxes and positions to forces, sample by sample.

A current that a sampled controller commands is held while the displacement goes on, so that neither
the samples of the force nor those of a held force give the right line. By Gauss's points c_j and
weights w_j in the period of the hold, it is the line of (docs/rig.md derives it)

    F = sum_j w_j S(-c_j) law(i, S(c_j) x),

S(c) a shift of samples by c, to which delays add. The result is a channel without hold and delay,
right up to 0.45 of the sample rate to 1e-9 (the shifts, `rotorid.signals.spectrum`).

A column with dynamics, as of a lagging amplifier or of a sensor of some bandwidth, is first made
the current that flows, or the displacement that there is, line by line over the record: hold, delay
and dynamics. What of the command's steps is left behind the amplifier enters a law that bends only
by its square.

The forces of laws that bend are computed sample by sample, before any line is taken. Should a
constant of the law be another one than stated, the force is another one too: the current that made
it is found again, by inverting the law, and goes through the law with the other constant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from typing import Any

import numpy as np

from rotorid.core.errors import InputError, naming
from rotorid.core.frozen import frozen
from rotorid.core.values import Complexes, Floats
from rotorid.data.record import Channel, LawConstant, Record
from rotorid.force.laws import KNEE, Differential, Flux, Linear, bent, with_moved
from rotorid.signals.spectrum import quantity, shifted

KNEE_CONSTANT = "knee"
"""How much of a knee the iron has, (b_0 / b_s)^4, b_0 the bias over the gap: what bends as much as
it does, however far off saturation is, so that a search may begin from none."""

_BIASED = ("bias", "bias_difference")
_STEPS = 50
"""Newton's steps at most; four or five are taken, a dozen where the iron is near saturation."""


@frozen
class ForceSource:
    """The law of a channel's force, as `rotorid.data.record.ForceLaw` asks."""

    law: Differential | Flux
    # displacement in the actuator as a combination of channels; empty for `Flux`
    position: Mapping[str, float] = field(default_factory=dict)
    # names under which constants are shared with other channels
    shared: Mapping[str, str] = field(default_factory=dict)

    @property
    def constants(self) -> dict[str, LawConstant]:
        return {
            of.key or field: LawConstant(
                of.unit,
                getattr(self.law, field),
                getattr(self.law, f"{field}_std"),
                of.positive,
                self.shared.get(field, ""),
            )
            for field, of in self.law.stated.items()
            if not (field in _BIASED and isinstance(self.law, Differential) and not self.law.bias)
        }

    @property
    def reach(self) -> float:
        """Displacement in m at which the rotor would touch the poles."""
        return np.inf if isinstance(self.law, Flux) else self.law.reach

    def flowing(self, force: Floats, position: Floats) -> Floats:
        """Return the current in A that made a force; for a flux law the force itself.

        Forces beyond what the magnets can give stand for the most that they can.
        """
        if isinstance(self.law, Flux):
            return force
        current = self.law.guess(force, position)
        size = self.law.bias or float(np.abs(current).max(initial=0.0)) or 1.0
        slope = self.law.linearize(0.0 if self.law.bias else size).ki
        for _ in range(_STEPS):
            found = self.law._force(current + 1e-30j, position)
            step = (force - found.real) / np.maximum(found.imag / 1e-30, 1e-3 * slope)
            nearer = np.clip(current + step, -self.law.most, self.law.most)
            moved = np.abs(nearer - current).max(initial=0.0)
            current = nearer
            if moved < 1e-12 * size:
                break
        return np.asarray(current)

    def force(
        self, flowing: Floats, position: Floats, changes: Mapping[str, complex]
    ) -> Floats | Complexes:
        """Return the force in N with some constants, by their names, changed by so much."""
        fields = {of.key or field: field for field, of in self.law.stated.items()}
        moved = with_moved(self.law, {fields[n]: c for n, c in changes.items() if n in fields})
        if isinstance(self.law, Flux):
            return np.asarray(flowing * (moved.gain / self.law.gain))
        fluxes: Any = moved.fluxes(flowing, position)
        if KNEE_CONSTANT in changes:
            knee = changes[KNEE_CONSTANT] * (self.law.gap / self.law.bias) ** KNEE
            fluxes = [bent(flux, knee) for flux in fluxes]
        ahead, behind = fluxes
        return np.asarray(moved.constant * np.cos(moved.angle) * (ahead**2 - behind**2))


_NODES, _WEIGHTS = (part / 2 for part in np.polynomial.legendre.leggauss(4))
_NODES = _NODES + 0.5


@frozen
class ForceReading:
    """How the force of one input follows from channels of a record."""

    law: Linear | Differential | Flux
    # the channel of the current; of the flux densities B1 and B2 for `Flux`
    channels: tuple[str, ...]
    # displacement in the actuator as a combination of channels, in m; empty for `Flux`
    position: Mapping[str, float] = field(default_factory=dict)
    # names under which constants of the law are the same ones as those of other inputs
    shared: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", tuple(self.channels))
        wanted = 2 if isinstance(self.law, Flux) else 1
        if len(self.channels) != wanted:
            raise InputError(
                f"{len(self.channels)} channels",
                "two flux densities" if wanted == 2 else "one current",
                "name the channels of the law",
            )


def forces(
    record: Record,
    readings: Mapping[str, ForceReading] | None = None,
    *,
    drives: bool = True,
    period: int | None = None,
) -> Record:
    """Return a record whose currents, or flux densities, have become forces.

    `readings` are by input; with `drives` the channels with a `Drive` are read too. What lies just
    beyond the ends of the record is taken from a `period`, in samples, away.

    The channel of a force stands in place of the first that it came from; the others that were
    used up, and are no positions, are dropped. What the force was made of stays with its channel
    (`law`), for constants of bent laws that are not known exactly; the deviation of a linear law's
    constants is in `gain_std`.
    """
    wanted = {**(drive_readings(record) if drives else {}), **(readings or {})}
    if not wanted and type(record) is Record:
        return record
    reader = _Reader(record, period)
    found = {name: reader.force(name, reading) for name, reading in wanted.items()}
    place = {reading.channels[0]: name for name, reading in wanted.items()}
    spent = {channel for reading in wanted.values() for channel in reading.channels[1:]}
    channels, columns = [], []
    for channel, column in zip(record.channels, record.samples.T, strict=True):
        if channel.name in place:
            channel, column = found[place[channel.name]]
        elif channel.name in spent:
            continue
        channels.append(channel)
        columns.append(column)
    # As `replace`, for subclasses too: a record of forces is a plain one.
    return Record(
        channels=tuple(channels),
        samples=np.stack(columns, axis=1),
        sample_rate=record.sample_rate,
        speed=record.speed,
        angle=record.angle,
        phase_known=record.phase_known,
        phase_std=record.phase_std,
        source=record.source,
        valid=record.valid,
        warnings=record.warnings,
        start=record.start,
    )


def drive_readings(record: Record) -> dict[str, ForceReading]:
    """Return how the forces of channels with a `Drive` are read."""
    positions = [channel for channel in record.channels if channel.drive is None]
    return {
        channel.name: ForceReading(
            Linear(channel.drive.ki, channel.drive.ks),
            (channel.name,),
            as_channels(positions, channel.drive.position) if channel.drive.ks else {},
        )
        for channel in record.channels
        if channel.drive is not None
    }


def as_channels(sensors: Sequence[Channel], position: Mapping[str, float]) -> dict[str, float]:
    """Write a combination of coordinates as one of position channels."""
    for sensor in sensors:
        if dict(sensor.combination) == dict(position):
            return {sensor.name: 1.0}
    names = sorted({name for s in sensors for name in s.combination} | set(position))
    reads = np.array([[s.combination.get(name, 0.0) for s in sensors] for name in names])
    target = np.array([position.get(name, 0.0) for name in names])
    weights = np.linalg.lstsq(reads, target, rcond=None)[0] if sensors else np.zeros(0)
    if not sensors or np.abs(reads @ weights - target).max() > 1e-9 * np.abs(target).max():
        raise InputError(
            "no sensors that give the displacement "
            + " + ".join(f"{value:g}*{name}" for name, value in position.items()),
            "a position channel in the plane of the actuator, or a combination of some",
            "add the channel, or use ml, which needs no such sensor",
        )
    weights[np.abs(weights) < 1e-9 * np.abs(weights).max()] = 0.0
    named = zip(sensors, weights, strict=True)
    return {sensor.name: float(f"{weight:.12g}") for sensor, weight in named if weight}


@frozen
class _Reader:
    """Columns of a record, shifted in time."""

    record: Record
    period: int | None

    def channel(self, name: str) -> Channel:
        self.record.column(name)  # raises where there is none
        return self.record.channels[self.record.names.index(name)]

    def shifted(self, samples: Floats, seconds: float) -> Floats:
        return shifted(samples, seconds * self.record.sample_rate, self.period)

    def column(self, name: str, lead: float = 0.0) -> Floats:
        """Return the quantity of a column, `lead` (s) later."""
        channel, samples = self.channel(name), self.record.column(name)
        if channel.dynamics is None:  # one shift is nearer than two
            return self.shifted(samples, channel.delay + lead)
        rate = self.record.sample_rate
        return self.shifted(quantity(samples, channel, rate, self.period), lead)

    def displacement(self, position: Mapping[str, float], lead: float) -> Floats:
        total = np.zeros(len(self.record.samples))
        for name, factor in position.items():
            total += factor * self.column(name, lead)
        return total

    def force(self, name: str, reading: ForceReading) -> tuple[Channel, Floats]:
        """Return the channel of the force and its samples."""
        source = self.channel(reading.channels[0])
        with naming(self.record.source, place=name):
            if isinstance(reading.law, Flux):
                fluxes = [self.column(flux) for flux in reading.channels]
                force = reading.law.force(*fluxes)
            else:
                force = self._from_current(reading.law, source, reading.position)
        return self._channel(name, force, reading, source), force

    def _channel(self, name: str, force: Floats, reading: ForceReading, source: Channel) -> Channel:
        law = reading.law
        plain = Channel(name, "N", delay_std=source.delay_std, gain_std=source.gain_std)
        if isinstance(law, Differential | Flux):
            return replace(plain, law=ForceSource(law, reading.position, reading.shared))
        current = self.record.column(source.name)
        deviation = law.force_std(current, self.displacement(reading.position, 0.0))
        size = float(np.sqrt(np.mean(force**2)))
        spread = float(np.sqrt(np.mean(np.broadcast_to(deviation, force.shape) ** 2)))
        relative = spread / size if size > 0 else 0.0
        return replace(plain, gain_std=float(np.hypot(source.gain_std, relative)))

    def _from_current(
        self, law: Linear | Differential, source: Channel, position: Mapping[str, float]
    ) -> Floats:
        step = 1 / self.record.sample_rate
        if source.dynamics is not None:
            return law.force(self.column(source.name), self.displacement(position, 0.0))
        current = self.record.column(source.name)
        points = zip(_NODES * step, _WEIGHTS, strict=True) if source.hold else ((0.0, 1.0),)
        total = np.zeros_like(current)
        for node, weight in points:
            lead = node - source.delay  # from a reading to an instant at which its current flows
            force = law.force(current, self.displacement(position, lead))
            total += weight * self.shifted(force, -lead)
        return total
