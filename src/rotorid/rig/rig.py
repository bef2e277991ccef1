"""`Rig`: a levitated rotor in closed loop, run as a machine is and recorded as a logger does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rotorid.core.errors import InputError
from rotorid.core.values import Floats, frozen
from rotorid.core.watch import polled
from rotorid.force.laws import Differential, Linear
from rotorid.rig import kernel
from rotorid.rig.kernel import Bearings, Events, Log, Loop, RotorTable, Steps, Tables
from rotorid.rig.linear_loop import exact_steps, growth, noise_matrix
from rotorid.rig.logger import Logged, RigRecord, logged, read
from rotorid.rig.machine import RigMachine
from rotorid.rig.plant import Plant, pairs

RIG_SAMPLES = 5_000_000
"""Of a record that a rig makes, with the settling before it: eight minutes at 10 kHz, a third of
a kilobyte each for the columns and the truth beside them."""

# From the samples of the logger's columns, by name, to those that it changes.
Spoil = Callable[[dict[str, Floats], np.random.Generator], dict[str, Floats]]


class RigError(InputError):
    """A rig that cannot run on: what happened, when (s since it was switched on), on which axis."""


SETTLED = 60.0
"""s that a rig is given to settle, unless its record is longer: all of it takes time to run."""


@frozen
class Rig(RigMachine):
    spoils: tuple[Spoil, ...] = ()  # what happens to the logger's columns, one after the other

    def run(self, duration: float, rng: np.random.Generator) -> RigRecord:
        """Run so many s; an unstable loop, a touch or a current beyond the bias is a `RigError`."""
        return read(self.as_described, self.record(duration, rng))

    def record(self, duration: float, rng: np.random.Generator) -> Logged:
        """Run the rig and record it, as `run`, but leave the columns as they are."""
        whole = (duration + self.settling) * self.logger.sample_rate
        if not whole <= RIG_SAMPLES:
            raise InputError(
                f"{whole:.3g} samples, with the settling before them",
                f"at most {RIG_SAMPLES}",
                "run shorter, or sample more slowly",
                place="duration",
            )
        if self.settling > max(SETTLED, duration):
            expected = f"at most {SETTLED:g} s, or as long as the record"
            cure = "give it less: a bearing settles in a second or two"
            raise InputError(f"{self.settling:g} s", expected, cure, place="settling")
        samples = round(duration * self.logger.sample_rate)
        if samples < 1:
            raise InputError(f"{duration} s", "one sample or more", "run longer", place="duration")
        plant = self.plant(duration)
        self._require_stable(plant, duration)
        log = empty_log(self, samples)
        tables = tables_of(self, plant, samples, rng)
        with polled("simulating samples", lambda: int(np.count_nonzero(log.state[:, 0])), samples):
            code, axis, time, size = kernel.run(tables, kernel.room_of(tables), log)
        if code != kernel.FINE:
            since = time + tables.events.settling * self.schedule.duration
            raise self._fault(code, axis, since, size, float(tables.bearings.clearance[axis]))
        found = logged(self, plant, log, rng)
        recorded = {column.name: column.samples for column in found.columns}
        for spoil, own in zip(self.spoils, rng.spawn(len(self.spoils)), strict=True):
            recorded |= spoil(recorded, own)
        return replace(
            found, columns=tuple(replace(c, samples=recorded[c.name]) for c in found.columns)
        )

    def _fault(self, code: int, axis: int, time: float, size: float, clearance: float) -> RigError:
        name = self.model.inputs[axis]
        when = f"{time:.6g} s after switching on"
        if code == kernel.TOUCH:
            found = f"the rotor touching the auxiliary bearing at {name}, {when}"
            expected = f"a displacement below the clearance of {clearance * 1e6:.4g} um"
            cure = "lower the excitation or the unbalance, or stiffen the controller"
        elif code == kernel.BEYOND_BIAS:
            law = self.actuators[name].law
            assert isinstance(law, Differential)
            found = f"a current of {size:.4g} A at {name}, {when}"
            expected = f"less than the bias of {law.most:.4g} A"
            cure = "raise the bias, lower the excitation, or limit the current"
        else:
            found = f"no step small enough, {when}"
            expected = f"motion that can be followed to {self.tolerance:g}"
            cure = "check the parameters, or allow a larger tolerance"
        return RigError(found, expected, cure)

    def _require_stable(self, plant: Plant, duration: float) -> None:
        for speed in dict.fromkeys(self.rotation.range_until(duration)):
            rate, frequency, axis = growth(self, plant, speed)
            if rate >= 0:
                raise RigError(
                    f"an unstable loop at {speed:.6g} rad/s: from the first instant it grows by a "
                    f"factor of e every {1 / rate if rate > 0 else np.inf:.3g} s with "
                    f"{frequency:.4g} Hz, most of all at {axis}",
                    "a loop whose free motion decays",
                    "check the sign and the size of the gains against k_i and k_s, add damping, or "
                    "shorten the delay",
                )


FRICTION = 0.15  # of a steel shaft in a dry auxiliary bearing
HUM = 50.0  # Hz, of the mains
_POSITION_FLOOR, _VELOCITY_FLOOR = 1e-6, 1e-3  # m, m/s: below, errors count absolutely


def tables_of(rig: RigMachine, plant: Plant, samples: int, rng: np.random.Generator) -> Tables:
    plan, lags, noise = rig.schedule, rig.lags(plant), noise_matrix(rig, plant)
    floor = np.repeat([_POSITION_FLOOR, _VELOCITY_FLOOR], len(plant.force))
    # The pattern of events is repeated until the record is complete.
    settling = int(np.ceil(rig.settling / plan.duration - 1e-9))
    readings = samples * rig.logger.oversampling
    events = Events(plan, settling + -(-readings // plan.logs), settling)
    if rig.linear:
        steps = exact_steps(rig, plant, lags, rig.rotation.speed)
        loads = _load_table(rig, plant, events)
    else:  # only their sizes matter
        size = 2 * len(plant.force) + len(lags.floor)
        shapes = ((size, size), (size, plant.force.shape[1]), (size, noise.shape[1]), (size, 0))
        steps = Steps(False, *(np.zeros((len(plan.offset), *shape)) for shape in shapes))
        loads = np.zeros((0, 0))
    return Tables(
        events,
        steps,
        bearing_table(rig, plant),
        RotorTable(plant, noise, rig.rotation.numbers, rig.tolerance, floor),
        lags,
        loop_table(rig, events, samples, rng),
        loads,
    )


def bearing_table(rig: RigMachine, plant: Plant) -> Bearings:
    parts = rig.parts
    law, heating = np.zeros((2, len(parts), 7))
    for row, rate, part in zip(law, heating, parts, strict=True):
        match part.law:
            case Differential() as pair:
                row[:] = pair.numbers
                rate[2] = part.heating * pair.gap
            case Linear(ki=ki, ks=ks):  # as 1 / gap^2 and 1 / gap^3 go
                row[:2] = ki, ks
                rate[:2] = -2 * part.heating * ki, -3 * part.heating * ks
            case None:
                row[:2] = 1.0, 0.0
    magnets = [part.law if isinstance(part.law, Differential) else None for part in parts]
    columns = {
        name: np.array([getattr(part, name) for part in parts])
        for name in ("limit", "time_constant", "slew", "hysteresis")
    }
    return Bearings(
        kind=np.array([0 if m is None else 1 if m.bias else 2 for m in magnets]),
        law=law,
        heating=heating,
        bias=np.array([np.inf if m is None else m.most for m in magnets]),
        lagging=np.flatnonzero(columns["time_constant"] > 0),
        displacement=plant.displacement,
        clearance=np.array(
            [rig.clearance if m is None else min(rig.clearance, m.reach) for m in magnets]
        ),
        pair=pairs(rig.model.inputs),
        contact=rig.contact,
        friction=FRICTION,
        **columns,
    )


def loop_table(rig: RigMachine, events: Events, samples: int, rng: np.random.Generator) -> Loop:
    plan = events.pattern
    steps = events.repeats * plan.controls
    start = events.settling * plan.duration
    control_time = np.arange(steps, dtype=float) * rig.controller.period - start
    log_time = np.arange(samples, dtype=float) / rig.logger.sample_rate
    apart = bool(((plan.log >= 0) & (plan.control < 0)).any())
    deviations = np.array(list(rig.process_noise.values()))
    process = rng.normal(size=(steps, len(deviations))) * deviations
    middle = control_time + rig.controller.period / 2
    known = [part.size(middle) for part in rig.disturbances]
    recorded = control_time[control_time > -rig.controller.period / 2]
    gain = np.ones(1) if rig.gain is None else rig.gain(recorded)
    controller, fed_back = rig.controller, np.eye(len(rig.sensors))[rig.fed_back]
    return Loop(
        A=controller.A,
        B=controller.B @ fed_back,
        C=controller.C,
        D=controller.D @ fed_back,
        **{
            name: np.array([getattr(sensor, name) for sensor in rig.sensors])
            for name in ("quantum", "cubic", "heating")
        },
        filtered=bool(np.isfinite(rig.logger.filter)),
        process=np.column_stack([process, *known]),
        error_at_control=_errors(rig, control_time, rng),
        error_at_log=_errors(rig, log_time if apart else log_time[:0], rng),
        excitation=excitation_table(rig),
        gain=gain,
    )


def _errors(rig: RigMachine, time: Floats, rng: np.random.Generator) -> Floats:
    """Draw the noise, and add bias and runout, at given times; shape (time, sensor)."""
    angle = rig.rotation.angle_at(time)
    errors = rng.normal(size=(len(time), len(rig.sensors)))
    for j, sensor in enumerate(rig.sensors):
        runout = np.zeros_like(angle)
        for part in sensor.runout:
            runout += part.cos * np.cos(part.order * angle) + part.sin * np.sin(part.order * angle)
        errors[:, j] = sensor.noise * errors[:, j] + sensor.bias + runout
        errors[:, j] += sensor.hum * np.cos(2 * np.pi * HUM * time)
    return errors


def excitation_table(rig: RigMachine) -> Floats:
    """Return one period of what is added to the commands, shape (step, input)."""
    inputs = rig.model.inputs
    if rig.excitation is None:
        return np.zeros((1, len(inputs)))
    played = rig.excitation.samples(1 / rig.controller.period)
    table = np.zeros((len(played), len(inputs)))
    for name, column in zip(rig.excitation.names, played.T, strict=True):
        part = rig.actuators[name]
        if rig.excitation.unit not in ("N", part.unit):
            found = f"an excitation in {rig.excitation.unit}"
            cure = "give forces, or commands in the actuator's unit"
            raise InputError(found, f"N or {part.unit}", cure, place=f"excitation.{name}")
        per_newton = part.slopes[0] if rig.excitation.unit == "N" else 1.0
        table[:, inputs.index(name)] = column / per_newton
    return table


def _load_table(rig: RigMachine, plant: Plant, events: Events) -> Floats:
    """Return cosine and sine of the loads' harmonics at each event."""
    patterns = np.arange(events.repeats) - events.settling
    time = (patterns[:, None] * events.pattern.duration + events.pattern.offset).ravel()
    turns = rig.rotation.angle_at(time)[:, None] * plant.harmonics
    return np.stack([np.cos(turns), np.sin(turns)], axis=-1).reshape(len(time), -1)


def empty_log(rig: RigMachine, samples: int) -> Log:
    every, inputs = rig.logger.oversampling, len(rig.model.inputs)
    command, current, force = np.zeros((3, samples, inputs))
    recorded, effective = np.zeros((2, samples * every, inputs))
    state = np.zeros((samples, 2 * len(rig.model.coordinates)))
    reading = np.zeros((samples, len(rig.sensors)))
    return Log(state, reading, command, current, force, recorded, effective, every)
