"""Recorded currents, fluxes and positions to forces, sample by sample, and back to currents.

A commanded current is held while the displacement goes on: its force is the sum of the law over
Gauss's points in the hold (docs/rig.md), right up to 0.45 of the sample rate to 1e-9. What of the
command's steps is left behind an amplifier enters a law that bends only by its square.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, replace
from dataclasses import fields as fields_of
from functools import cached_property
from typing import Any

import numpy as np

from rotorid.core.errors import InputError, naming
from rotorid.core.values import Complexes, Floats, frozen
from rotorid.data.lines import Lines, Samples
from rotorid.data.record import Channel, Drive, Record
from rotorid.force.laws import Flux, Law, Linear
from rotorid.signals.spectrum import quantity, shifted

_NODES, _WEIGHTS = (part / 2 for part in np.polynomial.legendre.leggauss(4))
_NODES = _NODES + 0.5


@frozen
class ForceReading:
    """How the force of one input follows from channels of a record."""

    law: Law
    # the channel of the current; of the flux densities B1 and B2 for `Flux`
    channels: tuple[str, ...]
    # displacement in the actuator as a combination of channels, in m; empty for `Flux`
    position: Mapping[str, float] = field(default_factory=dict)


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

    A force stands in place of the first of its channels; others that are no positions are dropped.
    Its channel keeps what it was made of (`law`), for inexact constants of bent laws; the deviation
    of a linear law's constants is in `gain_std`.
    """
    wanted = {**(drive_readings(record) if drives else {}), **(readings or {})}
    if not wanted and type(record) is Record:
        return record
    reader = _Reader(record, period)
    made = {law.channels[0]: reader.force(name, law) for name, law in wanted.items()}
    spent = {channel for law in wanted.values() for channel in law.channels[1:]} - made.keys()
    there = zip(record.channels, record.samples.T, strict=True)
    kept = [made.get(one.name, (one, column)) for one, column in there if one.name not in spent]
    channels, columns = zip(*kept, strict=True)
    # As `replace`, for subclasses too: a record of forces is a plain one.
    fields: dict[str, Any] = {each.name: getattr(record, each.name) for each in fields_of(Record)}
    samples = np.stack(columns, axis=1)
    return Record(**{**fields, "channels": channels, "samples": samples})


def driven(channels: Iterable[Channel], laws: Mapping[str, ForceReading]) -> tuple[Channel, ...]:
    """Return channels with the `Drive` of a linear law by input, and what it leaves unsure."""
    found = []
    for channel in channels:
        reading = laws.get(channel.name)
        if reading is not None and isinstance(law := reading.law, Linear):
            gain_std = float(np.hypot(channel.gain_std, law.std.get("ki", 0.0) / abs(law.ki)))
            drive = Drive(law.ki, law.ks, reading.position)
            channel = replace(channel, drive=drive, gain_std=gain_std)
        found.append(channel)
    return tuple(found)


def through_laws(
    record: Record, laws: Mapping[str, ForceReading], *, currents: bool, period: int | None = None
) -> Record:
    """Return a record whose inputs are read by laws, the displacement in them by coordinates.

    The `currents` of linear laws may stay as they are; of others they become forces.
    """
    spent = {name for law in laws.values() for name in law.channels}
    sensors = [channel for channel in record.channels if channel.name not in spent]
    bent = {name: law for name, law in laws.items() if not isinstance(law.law, Linear)}
    for name, reading in bent.items():
        with naming(record.source, place=f"channels.{name}.position"):
            position = as_channels(sensors, reading.position) if reading.position else {}
        bent[name] = replace(reading, position=position)
    if laws:
        record = replace(record, channels=driven(record.channels, laws))
    return forces(record, bent, drives=not currents, period=period)


def drive_readings(record: Record) -> dict[str, ForceReading]:
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
    record: Record
    period: int | None

    def shifted(self, samples: Floats, seconds: float) -> Floats:
        return shifted(samples, seconds * self.record.sample_rate, self.period)

    def column(self, name: str, lead: float = 0.0) -> Floats:
        """Return the quantity of a column, `lead` (s) later."""
        samples = self.record.column(name)
        channel = self.record.channels[self.record.index(name)]
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
        law, source = reading.law, self.record.channels[self.record.index(reading.channels[0])]
        with naming(self.record.source, place=name):
            if isinstance(law, Flux):
                force = law.force(*map(self.column, reading.channels))
            else:
                force = self._from_current(law, source, reading.position)
        plain = Channel(name, "N", delay_std=source.delay_std, gain_std=source.gain_std)
        if not isinstance(law, Linear):
            return replace(plain, law=replace(law, position=reading.position)), force
        current = self.record.column(source.name)
        deviation = law.force_std(current, self.displacement(reading.position, 0.0))
        size = float(np.sqrt(np.mean(force**2)))
        spread = float(np.sqrt(np.mean(np.broadcast_to(deviation, force.shape) ** 2)))
        relative = spread / size if size > 0 else 0.0
        return replace(plain, gain_std=float(np.hypot(source.gain_std, relative))), force

    def _from_current(self, law: Law, source: Channel, position: Mapping[str, float]) -> Floats:
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


# What went through the laws of a record: the current and the displacement of each magnet.

NEAR = 1e-8
"""Displacement in m over which the slope of a law is taken: a hundred thousandth of any gap."""


@frozen
class Passed:
    """What went through the law of an input."""

    column: int  # of the input among the channels of the record
    law: Law
    shares: Floats  # (channel,): the displacement as a combination of channels
    # (sample,)
    flowing: Floats
    position: Floats

    @classmethod
    def of(cls, lines: Lines, column: int, law: Law) -> Passed:
        shares = np.array([law.position.get(name, 0.0) for name in lines.names])
        if lines.samples is None:
            return cls(column, law, shares, np.zeros(1), np.zeros(1))
        position = displacement(lines, lines.samples, shares)
        flowing = law.flowing(lines.samples.values[:, column], position)
        return cls(column, law, shares, flowing, position)

    @cached_property
    def force(self) -> Floats:
        """The force as it was read, shape (sample,)."""
        return np.asarray(self.law.changed(self.flowing, self.position, {}).real)

    @cached_property
    def slope(self) -> Floats:
        """Force per displacement at each sample in N/m."""
        ahead, behind = (
            self.law.changed(self.flowing, self.position + move, {}).real for move in (NEAR, -NEAR)
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

    The law of a force reads its current again, with the displacement that the other columns give
    now; a positive factor that keeps both is one of the force. The covariance follows by slopes.
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
    if not (passed.law.closing(flowing, position) < passed.law.reach).all():
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
