"""Actuators and controller of a rig file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import signal

from rotorid.actuators.entry import LawEntry, law_keys
from rotorid.actuators.flux import Flux
from rotorid.actuators.laws import Differential, Linear
from rotorid.actuators.reading import as_channels
from rotorid.errors import InputError
from rotorid.models import Model
from rotorid.record import Channel
from rotorid.rig.controller import Controller, pid, side_by_side
from rotorid.rig.parts import Actuator, FluxSensors, PositionSensor
from rotorid.rig.rig_schema import ActuatorEntry, ControllerEntry
from rotorid.units import to_si

ALL = "all"


def build_actuators(entries: Mapping[str, ActuatorEntry], model: Model) -> dict[str, Actuator]:
    """Return the actuator of each input: what ``all`` says, and what its own table changes."""
    for name in entries:
        if name != ALL and name not in model.inputs:
            raise InputError(
                repr(name[:60]),
                f"all, or one of {', '.join(model.inputs)}",
                "correct the name",
                place="actuators",
            )
    shared = entries.get(ALL, ActuatorEntry())
    built = {}
    for name in model.inputs:
        own = entries.get(name, ActuatorEntry())
        changed = {key: getattr(own, key) for key in own.model_fields_set}
        try:
            built[name] = _actuator(shared.model_copy(update=changed))
        except InputError as error:
            raise error.at(place=f"actuators.{name if own.model_fields_set else ALL}") from None
    return built


def _actuator(entry: ActuatorEntry) -> Actuator:
    law = _law(entry)
    unit = "N" if law is None else "A"
    electric = (entry.supply, entry.inductance)
    if (None in electric) != (electric == (None, None)):
        raise InputError(
            "one of supply and inductance",
            "both, whose ratio limits the current's slope, or neither",
            "add the other",
        )
    supply, inductance = entry.supply, entry.inductance
    slew = np.inf if supply is None or inductance is None else supply / inductance
    angle = law.angle if isinstance(law, Differential) else 0.0
    flux = None
    if entry.flux is not None:
        flux = FluxSensors(Flux(entry.flux.area, entry.flux.poles, angle), entry.flux.noise)
    return Actuator(
        law=law,
        limit=np.inf if entry.limit is None else to_si(entry.limit, unit, place="limit"),
        bandwidth=entry.bandwidth,
        slew=slew,
        noise=0.0 if entry.noise is None else to_si(entry.noise, unit, place="noise"),
        flux=flux,
    )


def _law(entry: ActuatorEntry) -> Linear | Differential | None:
    given = {key: getattr(entry, key) for key in law_keys() if key in entry.model_fields_set}
    if entry.law in (None, "force"):
        given.pop("law", None)
        if given:
            raise InputError(
                f"{next(iter(given))} without a force law",
                "law = 'linear' or 'differential' beside it",
                "add the law",
            )
        return None
    law = LawEntry.model_construct(**given).build()
    return None if isinstance(law, Flux) else law


def build_controller(
    entry: ControllerEntry,
    model: Model,
    values: Mapping[str, float],
    actuators: Mapping[str, Actuator],
    sensors: Sequence[PositionSensor],
) -> tuple[Controller, tuple[str, ...]]:
    """Return the controller of a rig file and the sensors that it reads."""
    try:
        feedback = tuple(
            _feedback(name, j, entry, model, values, sensors) for j, name in enumerate(model.inputs)
        )
        period = 1 / entry.rate
        if entry.kind == "pid":
            return side_by_side(
                [_pid(entry, actuators[name], period) for name in model.inputs]
            ), feedback
        if entry.kind == "transfer-function":
            axis = _transfer_function(entry, period)
            return axis.on_each(len(model.inputs)), feedback
        if entry.D is None:
            raise InputError("no D", "matrices D, and A, B, C where it has states", "add them")
        a, b, c, d = (np.array(getattr(entry, key) or [], dtype=float) for key in "ABCD")
        return Controller(a, b, c, d, period), feedback
    except InputError as error:
        raise error.at(place="controller") from None


def _pid(entry: ControllerEntry, actuator: Actuator, period: float) -> Controller:
    if entry.stiffness is None or entry.damping is None:
        raise InputError(
            "no stiffness or no damping",
            "stiffness and damping of the closed bearing",
            "add them",
        )
    ki, ks = actuator.slopes
    return pid(
        (entry.stiffness + ks) / ki,
        entry.integral / ki,
        entry.damping / ki,
        entry.filter,
        period,
    )


def _transfer_function(entry: ControllerEntry, period: float) -> Controller:
    if not entry.numerator or not entry.denominator:
        raise InputError(
            "no numerator or no denominator", "both, highest power of z first", "add them"
        )
    if len(entry.numerator) > len(entry.denominator) or entry.denominator[0] == 0:
        raise InputError(
            f"{len(entry.numerator)} and {len(entry.denominator)} coefficients",
            "a denominator at least as long as the numerator, that starts with no 0",
            "correct them: a controller cannot look ahead",
        )
    numerator = np.trim_zeros(entry.numerator, "f") or [0.0]
    return Controller(*signal.tf2ss(numerator, entry.denominator), period)


def _feedback(
    name: str,
    index: int,
    entry: ControllerEntry,
    model: Model,
    values: Mapping[str, float],
    sensors: Sequence[PositionSensor],
) -> str:
    """Return the sensor of an input: the one given, or the one that reads its displacement."""
    names = [sensor.name for sensor in sensors]
    if name in entry.feedback:
        if entry.feedback[name] not in names:
            raise InputError(
                repr(entry.feedback[name][:60]),
                f"one of {', '.join(names)}",
                "correct the name",
                place=f"feedback.{name}",
            )
        return entry.feedback[name]
    column = model.require_linear().matrices(model.values(values)).B[:, index]
    position = {c: float(b) for c, b in zip(model.coordinates, column, strict=True) if b}
    channels = [Channel(sensor.name, reads=sensor.combination) for sensor in sensors]
    try:
        found = as_channels(channels, position)
    except InputError:
        found = {}
    if list(found.values()) != [1.0]:
        raise InputError(
            f"no sensor that reads the displacement at {name}",
            "the sensor to feed back to it",
            f"add {name} = '...' to controller.feedback",
            place="feedback",
        )
    return next(iter(found))
