"""What the logger of a rig leaves: columns, a record as a reader makes it, and the truth."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from rotorid.core.values import Floats, frozen
from rotorid.data.record import Channel, Record
from rotorid.force.channel_dynamics import Constant, FirstOrder
from rotorid.force.laws import Differential
from rotorid.force.reading import ForceReading, through_laws
from rotorid.rig import parts
from rotorid.rig.machine import RigMachine
from rotorid.rig.plant import Plant
from rotorid.signals.spectrum import shifted

if TYPE_CHECKING:
    from rotorid.rig.kernel import Log


@frozen
class LoggedColumn:
    """A column of the logger in SI, and how its samples relate to the quantity, as in `Channel`."""

    name: str
    unit: str
    samples: Floats
    hold: bool = False
    delay: float = 0.0
    dynamics: FirstOrder | None = None

    def channel(self, name: str) -> Channel:
        return Channel(name, self.unit, hold=self.hold, delay=self.delay, dynamics=self.dynamics)


@frozen
class Truth:
    """What no logger sees."""

    parameters: Mapping[str, float]
    # what the columns below are
    coordinates: tuple[str, ...]
    inputs: tuple[str, ...]
    # (sample,): s, rad, rad/s
    time: Floats
    angle: Floats
    speed: Floats
    # (sample, coordinate)
    position: Floats
    velocity: Floats
    # (sample, input): in the coils and on the rotor, at the instant of the sample; where a command
    # takes effect then, just after it. Without force law the current is the commanded force.
    current: Floats
    force: Floats

    @property
    def rpm(self) -> float:
        return float(self.speed.mean() * 30 / np.pi)


@frozen
class Logged:
    """Columns of one clock, and the truth; not read yet, so it may hold what no reader takes."""

    sample_rate: float
    columns: tuple[LoggedColumn, ...]
    truth: Truth = field(repr=False)

    @property
    def count(self) -> int:
        return len(self.columns[0].samples)


@frozen
class RigRecord(Record):
    """Channels of linear actuators hold currents, with their `Drive`; those of others, forces."""

    columns: tuple[LoggedColumn, ...] = ()
    truth: Truth | None = field(default=None, repr=False)


def label(name: str, part: parts.Actuator, kind: str = "i") -> str:
    """Return the column of an input: F_x1 for a force; i_x1, b1_x1, b2_x1 for its sources."""
    return name if part.law is None else f"{kind}_{name.removeprefix('F_')}"


def how_recorded(rig: RigMachine, part: parts.Actuator) -> tuple[bool, float]:
    """Return hold and delay of the recorded command or current of an actuator.

    The quantity, a hold of commands delayed by d and smoothed by the amplifier, is later than
    they are by d + T/2 + lag on average; the column by their mean age at the samples. Beside a
    command the amplifier's lag is its dynamics. A column that changes only when it is sampled is
    held, exactly: a command logged as often as it is computed or a whole number of times more, and
    so the current of an amplifier without lag.
    """
    command = rig.logger.current == "command"
    oversampled = rig.logger.oversampling > 1
    held = rig.schedule.controls == 1 and (command or (part.time_constant == 0 and not oversampled))
    half = 0.5 / rig.logger.sample_rate if held else 0.0
    late = _lateness(rig, part.time_constant, command=command)
    return held, round((late + half) * 1e12) / 1e12 + 0.0


def _lateness(rig: RigMachine, lag: float, *, command: bool) -> float:
    """Return by how much the samples of a command, or of the current, are later than it, in s.

    Its images fold onto its lines where it is sampled: those of its steps, or of its kinks.
    """
    schedule, period = rig.schedule, rig.controller.period
    every = rig.logger.oversampling if command else 1
    read = (schedule.log >= 0) & (schedule.log % every == 0)
    theta = schedule.offset[read] % period  # since the last tick of the controller
    age = theta.mean() if command else np.mean([_age(t, period, rig.delay, lag) for t in theta])
    return float(age - (rig.delay + period / 2 + (0.0 if command else lag)))


def _age(theta: float, period: float, delay: float, lag: float) -> float:
    """Return the mean age of the commands in the current, theta after the controller's last tick.

    The step response s gives the command m ticks ago the weight
    s(m T + theta - d) - s((m - 1) T + theta - d), so the age is
    theta + T sum_m (1 - s(m T + theta - d)).
    """
    waiting = max(0, math.ceil((delay - theta) / period - 1e-9))  # commands not begun yet
    first = max(waiting * period + theta - delay, 0.0)
    rest = math.exp(-first / lag) / -math.expm1(-period / lag) if lag > 0 else 0.0
    return theta + period * (waiting + rest)


def logged(rig: RigMachine, plant: Plant, log: Log, rng: np.random.Generator) -> Logged:
    """Return what the logger makes of a run; the noise of its recording is drawn here."""
    time = np.arange(len(log.state)) / rig.logger.sample_rate
    count = len(rig.model.coordinates)
    truth = Truth(
        parameters=dict(rig.values),
        coordinates=rig.model.coordinates,
        inputs=rig.model.inputs,
        time=time,
        angle=rig.rotation.angle_at(time),
        speed=rig.rotation.speed_at(time),
        position=log.state[:, :count],
        velocity=log.state[:, count:],
        current=log.current,
        force=log.force,
    )
    drives = _drive_columns(rig, plant, log, rng)
    positions = [
        LoggedColumn(sensor.name, parts.sensor_unit(sensor.combination, rig.model.units), reading)
        for sensor, reading in zip(rig.sensors, log.reading.T, strict=True)
    ]
    mark = rig.logger.angle
    marks = [LoggedColumn(mark.name, "1", mark.column(rig.rotation, time, rng))] if mark else []
    return Logged(rig.logger.sample_rate, (*drives, *positions, *marks), truth)


def read(rig: RigMachine, found: Logged) -> RigRecord:
    by_name = {column.name: column for column in found.columns}
    mark = rig.logger.angle
    turned: Floats | None
    if mark is not None and mark.name in by_name:
        angle = mark.read(by_name[mark.name].samples, found.sample_rate)
        turned, speed = angle.angle, angle.speed
    else:
        time = np.arange(found.count) / found.sample_rate
        known = rig.rotation.constant and rig.rotation.phase == 0
        turned = None if known else rig.rotation.angle_at(time)
        speed = float(rig.rotation.speed_at(time).mean())
    record = _as_read(rig, by_name, turned, speed)
    return RigRecord(**vars(record), columns=found.columns, truth=found.truth)


def _drive_columns(
    rig: RigMachine, plant: Plant, log: Log, rng: np.random.Generator
) -> list[LoggedColumn]:
    found = []
    described = rig.as_described
    command = rig.logger.current == "command"
    shown = log.command if command else decimated(log.recorded, log.every)
    position = log.state[:, : plant.displacement.shape[1]] @ plant.displacement.T
    steps = np.arange(log.every) / log.every
    position = np.array([[shifted(x, step) for step in steps] for x in position.T])
    position = position.transpose(2, 1, 0).reshape(len(log.effective), -1)
    for j, (name, part) in enumerate(zip(rig.model.inputs, rig.parts, strict=True)):
        told = described.parts[j]
        samples = shown[:, j] + part.noise * rng.normal(size=len(shown))
        lag = command and told.bandwidth and Constant("bandwidth", "Hz", told.bandwidth)
        dynamics = FirstOrder(bandwidth=lag, actuator=True) if lag else None
        how = how_recorded(described, told)
        found.append(LoggedColumn(label(name, part), part.unit, samples, *how, dynamics))
        if part.flux is not None and isinstance(part.law, Differential):
            current = _unfolded(rig, part, log.effective[:, j])
            densities = part.flux.law.densities(part.law, current, position[:, j])
            for kind, density in zip(("b1", "b2"), densities, strict=True):
                flux = decimated(density, log.every)
                samples = flux + part.flux.noise * rng.normal(size=len(flux))
                found.append(LoggedColumn(label(name, part, kind), "T", samples))
    return found


def _unfolded(rig: RigMachine, part: parts.Actuator, current: Floats) -> Floats:
    """Return fine samples of a current as a filter before the converter leaves them.

    A delay of the column could not stand for what the kinks of the current add: the position, which
    is in a flux too, has none. Eddy currents round the kinks off; without oversampling there is no
    filter.
    """
    if part.eddy or rig.logger.oversampling == 1:
        return current
    lag = part.time_constant if part.coil is None else 1 / (2 * np.pi * part.coil.bandwidth)
    return shifted(current, _lateness(rig, lag, command=False) * rig.logger.converter_rate)


def decimated(samples: Floats, every: int) -> Floats:
    """Return each so many-th sample of columns after a filter without lag.

    Flat to a tenth of the rate that is left, and 120 dB down from nine tenths of it on, whence the
    images of a held command fold onto its lines.
    """
    if every == 1 or len(samples) < 2:  # scipy reflects a record at its ends: one sample has none
        return samples
    taps, beta = scipy.signal.kaiserord(120.0, 0.8 / (every / 2))
    half = taps // 2 + 1
    weights = scipy.signal.firwin(2 * half + 1, 0.5, window=("kaiser", beta), fs=every)
    how: Any = {"window": weights, "padtype": "antireflect"}  # more than scipy's stubs know
    return np.asarray(scipy.signal.resample_poly(samples, 1, every, **how))


def actuator_position(rig: RigMachine, plant: Plant, index: int) -> dict[str, float]:
    row = zip(rig.model.coordinates, plant.displacement[index].tolist(), strict=True)
    return {name: value for name, value in row if value}


def _as_read(
    rig: RigMachine, columns: Mapping[str, LoggedColumn], angle: Floats | None, speed: float
) -> Record:
    plant, units = rig.plant(1.0), rig.model.units
    found: list[tuple[Channel, LoggedColumn]] = []
    laws: dict[str, ForceReading] = {}
    for j, (name, part) in enumerate(zip(rig.model.inputs, rig.parts, strict=True)):
        kinds = ("i",) if part.flux is None else ("b1", "b2")
        sources = [columns[label(name, part, kind)] for kind in kinds]
        bent = isinstance(part.law, Differential)
        read_from = [column.channel(column.name if bent else name) for column in sources]
        found += zip(read_from, sources, strict=True)
        if part.law is not None:
            through = part.law if part.flux is None else part.flux.law
            place = {} if part.flux is not None else actuator_position(rig, plant, j)
            laws[name] = ForceReading(through, tuple(c.name for c in read_from), place)
    for s in rig.sensors:
        channel = Channel(s.name, parts.sensor_unit(s.combination, units), reads=s.reads)
        found.append((channel, columns[s.name]))
    record = Record(
        channels=tuple(channel for channel, _ in found),
        samples=np.stack([column.samples for _, column in found], axis=1),
        sample_rate=rig.logger.sample_rate,
        speed=speed,
        angle=angle,
        source=f"rig {rig.model.name}",
    )
    period = None  # samples of the excitation's, where that is a whole number
    if rig.excitation is not None:
        exact = rig.logger.sample_rate / rig.excitation.fundamental
        period = round(exact) if abs(exact - round(exact)) < 1e-6 else None
    return through_laws(record, laws, currents=True, period=period)
