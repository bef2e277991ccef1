"""`RigMachine`: the parts of a rig, and what follows from them alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from fractions import Fraction
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from rotorid.core.errors import InputError, require_names
from rotorid.core.values import Floats, Integers, frozen
from rotorid.models.model import Model
from rotorid.rig.controller import Controller
from rotorid.rig.parts import (
    Actuator,
    Disturbance,
    Logger,
    PositionSensor,
    Rotation,
    check,
    check_rate,
)
from rotorid.rig.plant import Lags, Plant, build_lags, quarter_turn, rotor_plant
from rotorid.signals.multisine import Multisine

MAX_EVENTS = 20_000
MAX_DELAY = 100
"""Steps of the controller: each is a state of the loop, whose stability is looked at; real ones
take one or two."""


class Schedule(NamedTuple):
    """One pattern of events, repeated for ever.

    The events of one instant happen in this order: the controller reads and computes; commands
    whose delay is over take effect; the logger records.
    """

    duration: float  # length of the pattern in s
    # (event,): time in s of each event in the pattern, and until the next one
    offset: Floats
    length: Floats
    # (event,): number within the pattern of the control step, of the command that takes effect and
    # of the logged sample; -1 where the event is none of the kind
    control: Integers
    apply: Integers
    log: Integers
    # control steps and logged samples of the pattern
    controls: int
    logs: int
    lag: int  # control steps after which a command takes effect; 0 where it does in the same one


def merge_clocks(control_rate: float, sample_rate: float, delay: float) -> Schedule:
    """Merge the clocks of controller and logger; both tick at t = 0."""
    check_rate(control_rate, "rate")
    check_rate(sample_rate, "sample_rate")
    if delay * control_rate > MAX_DELAY:
        expected = f"at most {MAX_DELAY} steps of the controller, {MAX_DELAY / control_rate:g} s"
        cure = "give how long the controller computes: a step or two"
        raise InputError(f"{delay:g} s", expected, cure, place="delay")
    ratio = Fraction(sample_rate / control_rate).limit_denominator(MAX_EVENTS)
    logs, controls = ratio.numerator, ratio.denominator
    close = abs(float(ratio) * control_rate / sample_rate - 1) < 1e-12
    if not close or logs + controls > MAX_EVENTS:
        found = f"a controller at {control_rate:.12g} Hz and samples at {sample_rate:.12g} Hz"
        expected = f"a ratio of whole numbers, at most {MAX_EVENTS} together"
        raise InputError(found, expected, "choose rates of a simpler ratio", place="sample_rate")
    steps = Fraction(delay * control_rate).limit_denominator(10**6)
    control = {Fraction(k, controls): k for k in range(controls)}
    log = {Fraction(k, logs): k for k in range(logs)}
    whole, part = divmod(steps, 1)
    apply = {Fraction(k + part, controls): k for k in range(controls)}
    times = sorted({*control, *log, *apply})
    duration = controls / control_rate
    ends = [*times[1:], Fraction(1)]

    def numbers(events: dict[Fraction, int]) -> Integers:
        return np.array([events.get(t, -1) for t in times], dtype=np.int64)

    return Schedule(
        duration=duration,
        offset=np.array([float(t) * duration for t in times]),
        length=np.array([float(b - a) * duration for a, b in zip(times, ends, strict=True)]),
        control=numbers(control),
        apply=numbers(apply),
        log=numbers(log),
        controls=controls,
        logs=logs,
        lag=int(whole),
    )


@frozen
class RigMachine:
    """What a rig is made of.

    The displacement of an actuator is B'q, the one that does work with its force. While the speed
    changes, the loads follow it as the model says; the angular acceleration adds nothing.
    """

    model: Model  # linear; each equation the balance of the forces on its coordinate
    values: Mapping[str, float]  # parameters (SI)
    rotation: Rotation
    actuators: Mapping[str, Actuator]  # one for each input
    sensors: tuple[PositionSensor, ...]
    controller: Controller  # from the sensors fed back to the inputs
    feedback: tuple[str, ...]  # names of the sensors that it reads
    logger: Logger
    # forces in N (or currents in A, by its unit), added to the commands; its t = 0 is the first
    # sample of the record
    excitation: Multisine | None = None
    # random forces on the rotor, white, held over each period of the controller: from an input or a
    # coordinate (the equation of it) to a standard deviation in N (N m for an angle)
    process_noise: Mapping[str, float] = field(default_factory=dict)
    # radius in m at which the rotor touches the auxiliary bearing, at each actuator
    clearance: float = np.inf
    delay: float = 0.0  # time in s from the controller's sample until its command takes effect
    settling: float = 1.0  # time in s that the rig runs before the record begins
    tolerance: float = 1e-8  # relative error of a step, for what is integrated
    # (row, input): B as it really is, where the magnets do not stand as the model says
    work: Floats | None = None
    # cross stiffness at each actuator in N/m: F_x = -cross y, F_y = cross x, as of a seal
    cross: float = 0.0
    disturbances: tuple[Disturbance, ...] = ()
    # stiffness in N/m of the auxiliary bearings; 0 ends the run where the rotor touches
    contact: float = 0.0
    # from times in s of the record to a factor on the controller's answer
    gain: Callable[[Floats], Floats] | None = None
    # what the experiment file takes the rig for; itself by default
    described: Self | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensors", tuple(self.sensors))
        object.__setattr__(self, "feedback", tuple(self.feedback))
        inputs, coordinates = self.model.inputs, self.model.coordinates
        missing = [name for name in inputs if name not in self.actuators]
        if missing:
            raise InputError(
                f"no actuator of {missing[0]}", "one for each input", "add it", place="actuators"
            )
        require_names(self.actuators, inputs, place="actuators")
        require_names(self.feedback, [sensor.name for sensor in self.sensors], place="feedback")
        for part in self.disturbances:
            require_names(part.on, inputs + coordinates, place="disturbances")
        require_names(self.process_noise, inputs + coordinates, place="process_noise")
        for name, std in self.process_noise.items():
            if not std >= 0:
                raise InputError(f"{std}", "0 or more", "give a standard deviation", place=name)
        for sensor in self.sensors:
            require_names(sensor.combination, coordinates, place=f"sensors.{sensor.name}")
        if self.excitation is not None:
            require_names(self.excitation.names, inputs, place="excitation")
        sizes = (self.controller.positions, self.controller.commands)
        if sizes != (len(self.feedback), len(inputs)):
            raise InputError(
                f"a controller from {sizes[0]} positions to {sizes[1]} commands",
                f"from {len(self.feedback)} to {len(inputs)}",
                "match the sensors fed back and the inputs",
                place="controller",
            )
        check(self, positive=("clearance", "tolerance"), zero=("delay", "settling"))

    @property
    def as_described(self) -> Self:
        return self if self.described is None else self.described

    @cached_property
    def schedule(self) -> Schedule:
        return merge_clocks(1 / self.controller.period, self.logger.converter_rate, self.delay)

    @cached_property
    def parameters(self) -> Floats:
        return self.model.values(self.values)

    @property
    def parts(self) -> tuple[Actuator, ...]:
        return tuple(self.actuators[name] for name in self.model.inputs)

    @property
    def linear(self) -> bool:
        """Whether every step between events can be exact."""
        exact = all(part.linear for part in self.parts)
        return exact and self.rotation.constant and self.contact == 0

    def plant(self, duration: float) -> Plant:
        plant = rotor_plant(self.model, self.parameters, self.rotation, duration, self.work)
        turn = self.cross * quarter_turn(self.model.inputs)
        plant.motion[0, :, : len(plant.mass)] -= plant.force @ turn @ plant.displacement
        return plant

    @cached_property
    def reads(self) -> Floats:
        """What the sensors read, shape (sensor, coordinate)."""
        names = self.model.coordinates
        return np.array([[s.combination.get(name, 0.0) for name in names] for s in self.sensors])

    @cached_property
    def fed_back(self) -> Integers:
        names = [sensor.name for sensor in self.sensors]
        return np.array([names.index(name) for name in self.feedback], dtype=np.int64)

    def lags(self, plant: Plant) -> Lags:
        return build_lags(plant, self.parts, self.sensors, self.reads, self.logger.filter)
