"""Faults by name: what real machines and loggers do that the experiment file does not say.

A fault is one entry here: a function from a rig and a size to the rig as it really is. What the
experiment file says, `Rig.described`, stays that of the faultless rig, unless the fault is known to
everybody (an option, such as a notch). At the size `none` nothing changes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from rotorid.core.errors import InputError, naming, require_names
from rotorid.core.units import to_si
from rotorid.core.values import Floats, frozen
from rotorid.force.laws import Differential, Linear
from rotorid.rig.controller import Controller
from rotorid.rig.parts import (
    Actuator,
    Coil,
    Disturbance,
    Encoder,
    Keyphasor,
    PositionSensor,
    Rotation,
    SensorRunout,
)
from rotorid.rig.plant import other_axis, quarter_turn
from rotorid.rig.rig import Rig, Spoil
from rotorid.signals.spectrum import shifted

Wanted = Literal["right", "warned", "rejected"]
Apply = Callable[[Rig, float], Rig]


@frozen
class Fault:
    # the unit is of SI; shown is the size by default, as one would write it
    name: str
    unit: str
    shown: str
    size: float  # by default, in SI
    what: str  # one line
    # {"right", "warned", "rejected"}: of `identify`: an answer within its deviations; such a one
    # with a warning that names the fault; or a rejection whose suspects name it
    wanted: Wanted
    names: tuple[str, ...]  # beginnings of the suspects and checks that name it
    apply: Apply  # from a rig and a size in SI to the rig with the fault
    none: float = 0.0  # the size at which there is no fault
    rig: str = "three-mass"  # the shipped rig that the table of faults shows it on
    # the size is an angle by which the mark stands off: directions count from the mark
    turns: bool = False


FAULTS: dict[str, Fault] = {}
_SI = {"um": "m", "mm": "m", "kHz": "Hz", "deg": "rad", "us": "s", "mA": "A", "kN": "N"}


def _fault(
    size: str,
    wanted: Wanted,
    *names: str,
    of: Callable[[Any], Apply] = lambda apply: apply,
    none: float = 0.0,
    rig: str = "three-mass",
    turns: bool = False,
) -> Callable[[Callable[..., Any]], Apply]:
    """Enter a function, of a rig or the parts it is a fault `of`, by its name and its docstring."""

    def enter(change: Callable[..., Any]) -> Apply:
        name = change.__name__.strip("_").replace("_", "-")
        what = (change.__doc__ or "").rstrip(".")
        number, _, unit = size.partition(" ")
        si = _SI.get(unit, unit) or "1"
        apply, value = of(change), to_si(size, si) if unit else float(number)
        FAULTS[name] = Fault(name, si, size, value, what, wanted, names, apply, none, rig, turns)
        return apply

    return enter


def find_fault(text: str) -> tuple[Fault, float]:
    """Return the fault and the size of ``name`` or ``name=size``; a number is in its unit."""
    name, _, size = text.partition("=")
    cure = "see rotorid simulate --faults"
    require_names([name.strip()], FAULTS, "the fault {}", cure, place="--fault")
    fault = FAULTS[name.strip()]
    if not size.strip():
        return fault, fault.size
    if fault.unit != "1":
        with suppress(ValueError):
            size = f"{float(size)!r} {fault.unit}"
    return fault, to_si(size, fault.unit, place=f"--fault {fault.name}")


def with_faults(rig: Rig, faults: Sequence[tuple[Fault, float]]) -> Rig:
    """Return a rig with faults of given sizes, one after the other, described as without them."""
    faulty = replace(rig, described=rig.as_described)
    for fault, size in faults:
        if size != fault.none:
            with naming(place=f"--fault {fault.name}"):
                faulty = fault.apply(faulty, size)
    return faulty


# What the entries below are faults of: from a change of one part to the change of a rig.


def _actuators(change: Callable[[Actuator, float], Actuator]) -> Apply:
    return lambda rig, size: replace(
        rig, actuators={name: change(part, size) for name, part in rig.actuators.items()}
    )


def _laws(kind: type[Linear | Differential], found: str, shown: str) -> Callable[[Any], Apply]:
    """Return what changes the laws of a kind; the limits of the currents stay within the bias."""

    def of(change: Callable[[Any, float], Any]) -> Apply:
        def changed(part: Actuator, size: float) -> Actuator:
            if not isinstance(part.law, kind):
                expected = f"law = '{kind.__name__.lower()}'"
                raise InputError(found, expected, f"try it on the rig {shown}")
            law = change(part.law, size)
            return replace(part, law=law, limit=min(part.limit, getattr(law, "most", np.inf)))

        return _actuators(changed)

    return of


_magnets = _laws(Differential, "an actuator without magnets", "rigid")
_linear_laws = _laws(Linear, "another law", "three-mass")


def _sensors(change: Callable[[PositionSensor, float], PositionSensor]) -> Apply:
    return lambda rig, size: replace(
        rig, sensors=tuple(change(sensor, size) for sensor in rig.sensors)
    )


def _rotation(change: Callable[[Rotation, float], Rotation]) -> Apply:
    return lambda rig, size: replace(rig, rotation=change(rig.rotation, size))


Change = Callable[[Floats, float, np.random.Generator], Floats]


def _columns(chosen: Callable[[Rig, str], bool]) -> Callable[[Change], Apply]:
    return lambda change: (
        lambda rig, size: _spoiled(
            rig,
            lambda columns, rng: {
                name: change(samples, size, rng)
                for name, samples in columns.items()
                if chosen(rig, name)
            },
        )
    )


_first_sensor = _columns(lambda rig, name: name == rig.sensors[0].name)
_every_column = _columns(lambda rig, name: True)
_positions = _columns(lambda rig, name: any(name == sensor.name for sensor in rig.sensors))


def _known(rig: Rig, change: Callable[[Rig], Rig]) -> Rig:
    return replace(change(rig), described=change(rig.as_described))


def _disturbed(rig: Rig, on: Sequence[str], size: Callable[[Floats], Floats]) -> Rig:
    return replace(rig, disturbances=(*rig.disturbances, Disturbance(tuple(on), size)))


def _spoiled(rig: Rig, spoil: Spoil) -> Rig:
    return replace(rig, spoils=(*rig.spoils, spoil))


def _reading(rig: Rig, reads: Floats) -> Rig:
    """Let the sensors read other combinations of coordinates, shape (sensor, coordinate)."""
    rows = (zip(rig.model.coordinates, row, strict=True) for row in reads.tolist())
    combinations = [{name: factor for name, factor in row if factor} for row in rows]
    pairs = zip(rig.sensors, combinations, strict=True)
    return replace(rig, sensors=tuple(replace(sensor, reads=read) for sensor, read in pairs))


def _turned(names: Sequence[str], angle: float) -> Floats:
    """Return what a turn about the shaft makes of axes."""
    return np.asarray(np.cos(angle) * np.eye(len(names)) + np.sin(angle) * quarter_turn(names))


def _work(rig: Rig, values: Floats) -> Floats:
    return np.asarray(rig.model.require_linear().matrices(values, rig.rotation.speed).B)


def _translations(rig: Rig, axis: str) -> list[str]:
    units = rig.model.units
    return [n for n in rig.model.coordinates if n.startswith(axis) and units[n] == "m"]


# The amplifiers and magnets.


@_fault("1 kHz", "rejected", "bandwidth", "delay[force]", "amplifier", of=_actuators, none=np.inf)
def _current_loop(part: Actuator, size: float) -> Actuator:
    """Amplifiers as current loops with coil and induced voltage, this bandwidth."""
    coil = Coil(resistance=1.5, inductance=25e-3, bandwidth=size)
    return replace(part, coil=coil, bandwidth=None, slew=np.inf)


@_fault("25 V", "right", of=_actuators, none=np.inf, rig="rigid")
def _voltage_limit(part: Actuator, size: float) -> Actuator:
    """Amplifiers that saturate at this voltage (coils of 25 mH)."""
    return replace(part, slew=size / 25e-3, bandwidth=part.bandwidth or 2e3)


@_fault("20 mA", "right", rig="rigid")
def _pwm_ripple(rig: Rig, size: float) -> Rig:
    """Ripple of the switching amplifiers, 19.937 kHz, in the measured currents."""

    # The motion that it causes, k_i size / (m (2 pi 20 kHz)^2), is below 1e-10 m: left out.
    def rippled(samples: Floats, size: float, rng: np.random.Generator) -> Floats:
        turns = 19937.0 * np.arange(len(samples)) / rig.logger.sample_rate + rng.uniform()
        return np.asarray(samples + size * (4 * np.abs(turns % 1.0 - 0.5) - 1))

    return _columns(lambda _, name: name.startswith("i_"))(rippled)(rig, size)


@_fault("30 us", "rejected", "eddy", "delay[force]", "bandwidth", "amplifier", of=_actuators)
def _eddy(part: Actuator, size: float) -> Actuator:
    """Eddy currents: the force follows as 1 / (1 + sqrt(i omega tau))."""
    return replace(part, eddy=size)


@_fault("10 mA", "rejected", "hysteresis", of=_actuators, rig="rigid")
def _hysteresis(part: Actuator, size: float) -> Actuator:
    """Iron with a loop of half this width."""
    return replace(part, hysteresis=size)


_GAIN = ("force law", "ki", "common gain")
_LAW = (*_GAIN, "ks")


@_fault("20 um", "rejected", "gap", *_LAW, of=_magnets, rig="rigid")
def _iron_path(law: Differential, size: float) -> Differential:
    """Iron whose path is worth so much of a gap more."""
    return replace(law, iron=size)


@_fault("1.8", "rejected", "nonlinear", *_GAIN, "saturation", of=_magnets, none=np.inf, rig="rigid")
def _saturation(law: Differential, size: float) -> Differential:
    """Iron whose knee is at so many times the flux of the bias."""
    return replace(law, saturation=size * law.bias / law.gap)


@_fault("0.05", "rejected", "bias", "force law", "nonlinear", "ki", "ks", of=_magnets, rig="rigid")
def _bias_mismatch(law: Differential, size: float) -> Differential:
    """Bias of opposed magnets apart by twice this part."""
    return replace(law, bias_difference=size * law.bias)


@_fault("0.05", "rejected", "bias", *_LAW, of=_magnets, rig="rigid")
def _bias_low(law: Differential, size: float) -> Differential:
    """Bias lower than stated by this part."""
    if not size < 1:
        cure = 'write bias = "0 A" in the rig file: commands are other ones then'
        raise InputError(f"a bias lower by {size:g} of it", "a part below 1", cure)
    return replace(law, bias=law.bias * (1 - size))


@_fault("0.3", "right", rig="rigid")
def _low_bias(rig: Rig, size: float) -> Rig:
    """A machine that runs at a bias lower by this part, as its file says."""
    return _known(rig, lambda known: _bias_low(known, size))


@_fault("10 um", "rejected", "gap", *_LAW, of=_magnets, rig="rigid")
def _gap(law: Differential, size: float) -> Differential:
    """Gaps wider than stated."""
    return replace(law, gap=law.gap + size)


@_fault("0.02", "rejected", "ki", "gain[force]", of=_linear_laws)
def _force_gain(law: Linear, size: float) -> Linear:
    """All forces per current larger than stated by this part."""
    return replace(law, ki=law.ki * (1 + size))


@_fault("0.02", "rejected", "ki", "gain[F")
def _force_gain_one(rig: Rig, size: float) -> Rig:
    """Force per current of the first axis larger by this part."""
    name = rig.model.inputs[0]
    changed = _force_gain(rig, size).actuators[name]
    return replace(rig, actuators={**rig.actuators, name: changed})


@_fault("0.1", "rejected", "ks", "stiffness", of=_linear_laws)
def _negative_stiffness(law: Linear, size: float) -> Linear:
    """K_s larger than stated by this part."""
    return replace(law, ks=law.ks * (1 + size))


@_fault("0.004 1/s", "rejected", "drift", of=_actuators)
def _gap_drift(part: Actuator, size: float) -> Actuator:
    """Gaps that grow by this part in a second."""
    return replace(part, heating=size)


# Where magnets and sensors stand.


@_fault("3 deg", "rejected", "rotation", "cross")
def _actuators_rotated(rig: Rig, size: float) -> Rig:
    """Magnets turned against the sensors about the shaft."""
    B = _work(rig, rig.parameters) if rig.work is None else rig.work
    return replace(rig, work=B @ _turned(rig.model.inputs, size).T)


@_fault("3 deg", "rejected", "rotation", "cross")
def _sensors_rotated(rig: Rig, size: float) -> Rig:
    """Sensors turned against the magnets about the shaft."""
    return _reading(rig, rig.reads @ _turned(rig.model.coordinates, size))


@_fault("5 mm", "rejected", "sensor plane", "plane", "L_", rig="rigid")
def _sensor_plane(rig: Rig, size: float) -> Rig:
    """Sensors so much further along the shaft than stated."""
    names = rig.model.coordinates
    lever = np.zeros((len(names), len(names)))
    for j, name in enumerate(names):
        angle = f"theta_{other_axis(name)}"
        if angle in names:
            lever[j, names.index(angle)] = 1.0 if "x" in name else -1.0
    return _reading(rig, rig.reads @ (np.eye(len(names)) + size * lever))


@_fault("5 mm", "rejected", "L_", "prior L_", "plane", rig="rigid")
def _actuator_plane(rig: Rig, size: float) -> Rig:
    """The first bearing so much further out than stated."""
    if "L_a" not in rig.values:
        raise InputError("a model without L_a", "the model rigid", "try it on the rig rigid")
    moved = rig.model.values({**rig.values, "L_a": rig.values["L_a"] + size})
    return replace(rig, work=_work(rig, moved))


@_fault("2e4 N/m", "rejected", "cross", "rotating damping")
def _cross_force(rig: Rig, size: float) -> Rig:
    """Cross stiffness of a seal at each bearing."""
    return replace(rig, cross=size)


def _weight(rig: Rig, size: float, coordinates: Sequence[str]) -> Rig:
    """Let gravity act against some coordinates; the rotor is let down slowly while it settles."""
    time_of = rig.settling / 2

    def grown(time: Floats) -> Floats:
        begun = (time + rig.settling) / time_of if time_of else np.ones_like(time)
        return np.asarray(-size * np.clip(begun, 0.0, 1.0))

    return _disturbed(rig, coordinates, grown)


@_fault("9.81 m/s^2", "right")
def _gravity(rig: Rig, size: float) -> Rig:
    """A horizontal shaft, gravity along -y."""
    return _weight(rig, size, _translations(rig, "y"))


@_fault("9.81 m/s^2", "right", rig="rigid")
def _gravity_45(rig: Rig, size: float) -> Rig:
    """A horizontal shaft, both axes at 45 degrees to gravity."""
    down = [*_translations(rig, "x"), *_translations(rig, "y")]
    return _weight(rig, size / np.sqrt(2), down)


# The sensors.


@_fault("3 kHz", "rejected", "bandwidth", "delay", of=_sensors, none=np.inf)
def _sensor_bandwidth(sensor: PositionSensor, size: float) -> PositionSensor:
    """Position sensors of first order with this bandwidth."""
    return replace(sensor, bandwidth=size)


@_fault("0.02", "rejected", "gain[")
def _sensor_gain(rig: Rig, size: float) -> Rig:
    """The first sensor reads too much by this part."""
    gains = np.ones(len(rig.sensors))
    gains[0] += size
    return _reading(rig, gains[:, None] * rig.reads)


@_fault("0.05", "rejected", "nonlinear", "gain[s", of=_sensors, rig="rigid")
def _sensor_bend(sensor: PositionSensor, size: float) -> PositionSensor:
    """Sensors that read too much by this part at 50 um, as the cube."""
    return replace(sensor, cubic=size / 50e-6**2)


@_fault("0.004 1/s", "rejected", "drift", of=_sensors)
def _gain_drift(sensor: PositionSensor, size: float) -> PositionSensor:
    """Sensors whose gain grows by this part in a second."""
    return replace(sensor, heating=size)


@_fault("0.02", "rejected", "cross", "rotation")
def _cross_talk(rig: Rig, size: float) -> Rig:
    """Each sensor reads this part of the other axis's one."""
    others = np.abs(quarter_turn([sensor.name for sensor in rig.sensors])) @ rig.reads
    return _reading(rig, rig.reads + size * others)


def _runout(rig: Rig, order: int, size: float) -> Rig:
    """Add runout of an order: a quarter turn on from axis to axis, another angle in each plane."""
    sensors = []
    for j, sensor in enumerate(rig.sensors):
        angle = order * np.pi / 2 * (j % 2) + 0.7 * (j // 2)
        part = SensorRunout(order, size * np.cos(angle), size * np.sin(angle))
        sensors.append(replace(sensor, runout=(*sensor.runout, part)))
    return replace(rig, sensors=tuple(sensors))


@_fault("5 um", "rejected", "runout", "load")
def _runout_1(rig: Rig, size: float) -> Rig:
    """Runout once per revolution on all sensors."""
    return _runout(rig, 1, size)


@_fault("5 um", "right")
def _runout_2(rig: Rig, size: float) -> Rig:
    """Runout twice per revolution on all sensors."""
    return _runout(rig, 2, size)


@_fault("5 um", "right")
def _runout_3(rig: Rig, size: float) -> Rig:
    """Runout three times per revolution on all sensors."""
    return _runout(rig, 3, size)


@_fault("2 um", "rejected", "hum", "line 50", of=_sensors, rig="rigid")
def _hum(sensor: PositionSensor, size: float) -> PositionSensor:
    """50 Hz of the mains in all sensors."""
    return replace(sensor, hum=size)


@_fault("2 um", "right", of=_sensors)
def _quantization(sensor: PositionSensor, size: float) -> PositionSensor:
    """Sensors with steps of this size."""
    return replace(sensor, quantum=size)


# What acts on the rotor.


@_fault("2 um", "rejected", "base motion", "line 70", rig="rigid")
def _base_motion(rig: Rig, size: float) -> Rig:
    """A foundation that shakes along x at 70 Hz."""
    # Seen from the housing the rotor is accelerated by the housing's acceleration, reversed.
    w = 2 * np.pi * 70.0
    shaken = _translations(rig, "x")
    return _disturbed(rig, shaken, lambda time: np.asarray(size * w**2 * np.cos(w * time)))


@_fault("20 N", "warned", "transient", "settling", "drift")
def _transient(rig: Rig, size: float) -> Rig:
    """A force on the first axis that dies away within five periods."""
    constant = 5.0 / (rig.excitation.fundamental if rig.excitation else 10.0)

    def dying(time: Floats) -> Floats:
        return np.asarray(size * np.exp(-np.maximum(time, 0.0) / constant))

    return _disturbed(rig, rig.model.inputs[:1], dying)


@_fault("3 kN", "warned", "touch", "knock")
def _touch_down(rig: Rig, size: float) -> Rig:
    """A shock of 4 ms after 3 s that throws the rotor into its bearings."""

    def push(time: Floats) -> Floats:
        part = (time - 3.0) / 4e-3
        return np.where((part > 0) & (part < 1), size * np.sin(np.pi * part), 0.0)

    return replace(_disturbed(rig, rig.model.inputs[:1], push), contact=2e7)


# The rotation and its marks.


@_fault("1e-3", "rejected", "speed", of=_rotation)
def _speed_variation(turn: Rotation, size: float) -> Rotation:
    """A speed that wanders by this part in 7 s, stated as constant."""
    return replace(turn, drift=size * turn.speed, drift_period=7.0)


@_fault("1e-4", "rejected", "speed", of=_rotation)
def _speed_off(turn: Rotation, size: float) -> Rotation:
    """A speed higher than stated by this part."""
    return replace(turn, speed=turn.speed * (1 + size))


@_fault("5 deg", "right", of=_rotation, turns=True)
def _phase_mark(turn: Rotation, size: float) -> Rotation:
    """A mark that stands off its place; directions count from it."""
    return replace(turn, phase=turn.phase + size)


@_fault("1", "right", rig="rigid")
def _backward(rig: Rig, size: float) -> Rig:
    """A rotor that turns the other way, as its encoder shows."""
    reverse = _rotation(lambda turn, _: replace(turn, speed=-turn.speed))
    return _known(rig, lambda known: reverse(known, size))


def _mark(rig: Rig, kind: type[Encoder] | type[Keyphasor], **changes: Any) -> Rig:
    """Change the mark; a rig that has none of the kind is given one, as everybody knows."""
    mark = rig.logger.angle
    if not isinstance(mark, kind):
        mark = plain = Encoder(1024) if kind is Encoder else Keyphasor()
        rig = _known(rig, lambda known: replace(known, logger=replace(known.logger, angle=plain)))
    return replace(rig, logger=replace(rig.logger, angle=replace(mark, **changes)))


@_fault("1", "right")
def _keyphasor_logic(rig: Rig, size: float) -> Rig:
    """A keyphasor's pulse as a logic level, no sample on its flanks."""
    return _mark(rig, Keyphasor, logic=True)


@_fault("3", "warned", "pulse", "missing")
def _keyphasor_missing(rig: Rig, size: float) -> Rig:
    """So many pulses of the keyphasor missing."""
    return _mark(rig, Keyphasor, missing=round(size))


@_fault("3", "warned", "pulse", "double", "too many")
def _keyphasor_double(rig: Rig, size: float) -> Rig:
    """So many pulses of the keyphasor twice."""
    return _mark(rig, Keyphasor, double=round(size))


@_fault("20", "warned", "encoder", "counts", "angle", rig="rigid")
def _encoder_lost(rig: Rig, size: float) -> Rig:
    """An encoder without index that loses so many lines."""
    return _mark(rig, Encoder, lost=round(size))


@_fault("20", "warned", "encoder", "counts", "angle", rig="rigid")
def _encoder_double(rig: Rig, size: float) -> Rig:
    """An encoder without index that counts so many lines twice."""
    return _mark(rig, Encoder, lost=-round(size))


@_fault("20", "right", rig="rigid")
def _encoder_index(rig: Rig, size: float) -> Rig:
    """An encoder that loses so many lines, set right by its index."""
    return _mark(rig, Encoder, lost=round(size), index=True)


# The logger.


@_fault("2 kHz", "right", "delay[angle]", "phase", "lag", none=np.inf, rig="rigid")
def _anti_alias(rig: Rig, size: float) -> Rig:
    """Filters before the logger, second order, but not on the angle."""
    return replace(rig, logger=replace(rig.logger, filter=size))


@_fault("5 us", "rejected", "delay", "skew")
def _skew(rig: Rig, size: float) -> Rig:
    """A multiplexer: each position so much later than the one before."""
    steps = {s.name: j * size * rig.logger.sample_rate for j, s in enumerate(rig.sensors)}
    return _spoiled(
        rig, lambda columns, _: {n: shifted(columns[n], step) for n, step in steps.items()}
    )


@_fault("1", "rejected", "sign[", of=_first_sensor)
def _sensor_sign(samples: Floats, size: float, _: np.random.Generator) -> Floats:
    """The first sensor's column with the other sign."""
    return -samples


@_fault("1", "rejected", "swap[")
def _sensors_swapped(rig: Rig, size: float) -> Rig:
    """The first two sensors' columns exchanged."""
    one, other = (sensor.name for sensor in rig.sensors[:2])
    return _spoiled(rig, lambda columns, _: {one: columns[other], other: columns[one]})


@_fault("25.4", "rejected", "unit[", of=_first_sensor, none=1.0)
def _unit(samples: Floats, size: float, _: np.random.Generator) -> Floats:
    """The first sensor's column so many times too small: mil, said to be um."""
    return samples / size


@_fault("0.5", "rejected", "stuck", of=_first_sensor)
def _dead_sensor(samples: Floats, size: float, _: np.random.Generator) -> Floats:
    """The first sensor stands still for this part of the record."""
    at = round((1 - size) * len(samples))
    return np.concatenate([samples[:at], np.full(len(samples) - at, samples[at - 1])])


@_fault("0.8", "rejected", "clip", "nonlinear", of=_first_sensor, none=1.0)
def _clipping(samples: Floats, size: float, _: np.random.Generator) -> Floats:
    """The first sensor's column clipped at this part of its peak."""
    most = size * np.abs(samples).max()
    return np.clip(samples, -most, most)


@_fault("3", "rejected", "nan", "finite", of=_first_sensor)
def _nan(samples: Floats, size: float, rng: np.random.Generator) -> Floats:
    """So many readings of the first sensor that are no numbers."""
    gaps = samples.copy()
    gaps[rng.choice(len(samples), _count(size, len(samples)), replace=False)] = np.nan
    return gaps


@_fault("1", "rejected", "lost", "dropped", "phase", "clock")
def _lost_sample(rig: Rig, size: float) -> Rig:
    """One sample lost in the middle of the record."""
    return _lost_samples(rig, size)


@_fault("20", "rejected", "lost", "dropped", "phase", "clock", of=_every_column)
def _lost_samples(samples: Floats, size: float, _: np.random.Generator) -> Floats:
    """So many samples lost in the middle of the record."""
    at = len(samples) // 2 + 37
    return np.delete(samples, slice(at, at + _count(size, len(samples) - at)))


def _count(size: float, most: int) -> int:
    if not 0 <= size <= most:
        found = f"{size:g} samples"
        raise InputError(found, f"0 to {most}, which the record has", "choose fewer, or run longer")
    return round(size)


@_fault("20e-6", "rejected", "clock", "drift", of=_positions)
def _two_clocks(samples: Floats, size: float, _: np.random.Generator) -> Floats:
    """Positions on a clock that is fast by this part."""
    # Interpolated from blocks of constant shift, a thousandth of a sample apart.
    grid = np.round(size * np.arange(len(samples)) * 1e3) / 1e3
    found = samples.copy()
    for shift in np.unique(grid):
        rows = np.flatnonzero(grid == shift)
        first, last = max(rows[0] - 64, 0), min(rows[-1] + 65, len(samples))
        moved = shifted(samples[first:last], float(-shift))
        found[rows] = moved[rows - first]
    return found


# The controller, as everybody knows it.


@_fault("4 Hz", "right")
def _notch(rig: Rig, size: float) -> Rig:
    """Unbalance control: a notch of this width on the rotation."""
    period = rig.controller.period
    angle, radius = rig.rotation.speed * period, 1 - np.pi * size * period
    # (z^2 - 2 z cos + 1) / (z^2 - 2 r z cos + r^2), scaled to 1 at rest, on every position.
    c = np.cos(angle)
    a1, a2 = -2 * radius * c, radius**2
    gain = (1 + a1 + a2) / (2 - 2 * c)
    A = np.array([[-a1, 1.0], [-a2, 0.0]])
    B = gain * np.array([[-2 * c - a1], [1 - a2]])
    notch = Controller(A, B, np.array([[1.0, 0.0]]), np.array([[gain]]), period)
    before = notch.on_each(rig.controller.positions)
    return replace(rig, controller=rig.controller.after(before))


@_fault("0.2", "right")
def _gain_schedule(rig: Rig, size: float) -> Rig:
    """A controller whose gains rise by this part in the fifth second."""
    return replace(rig, gain=lambda time: 1 + size * np.clip(time - 4.0, 0.0, 1.0))
