"""Rig files: TOML to `Rig`. The shipped rigs are such files too."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
from scipy import signal

from rotorid.core.errors import InputError, ReadError, naming, nearest, require_names
from rotorid.core.frozen import frozen
from rotorid.core.limits import RIG_SAMPLES
from rotorid.core.toml import parse_toml, read_bytes
from rotorid.core.units import to_si
from rotorid.data.record import Channel
from rotorid.force.entry import law_keys
from rotorid.force.laws import Differential, Flux, Linear
from rotorid.force.reading import as_channels
from rotorid.models import Model, load_model, shipped_models
from rotorid.models.equations import linear_combination
from rotorid.rig.controller import Controller, pid, side_by_side
from rotorid.rig.faults import find_fault, with_faults
from rotorid.rig.file_schema import (
    ActuatorEntry,
    ControllerEntry,
    ExcitationEntry,
    LoggerEntry,
    RigFile,
    SensorEntry,
)
from rotorid.rig.logger import Logged, RigRecord, read
from rotorid.rig.marks import Encoder, Keyphasor, Rotation
from rotorid.rig.parts import (
    Actuator,
    FluxSensors,
    Logger,
    PositionSensor,
    ProcessNoise,
    SensorRunout,
    sensor_unit,
)
from rotorid.rig.rig import Rig
from rotorid.rig.schedule import check_rate
from rotorid.signals.multisine import (
    Multisine,
    full_harmonics,
    leave_out,
    minimize_crest,
    multisine,
    odd_harmonics,
)


@frozen
class RigPlan:
    """What a rig file says."""

    # the rig's name and title, and its file as it stands
    name: str
    title: str
    text: str
    file: str  # where it comes from, for messages
    model: str  # A shipped model, or the path of a model file
    rig: Rig
    duration: float  # s
    seed: int  # of the noise

    def run(self, seed: int | None = None) -> RigRecord:
        """Run the rig for its duration, with its seed or another."""
        found = self.record(seed)
        with naming(self.file or self.name):
            return read(self.rig.described or self.rig, found)

    def record(self, seed: int | None = None) -> Logged:
        """Run the rig as `run` does, but leave the logger's columns as they are."""
        rng = np.random.default_rng(self.seed if seed is None else seed)
        with naming(self.file or self.name):
            return self.rig.record(self.duration, rng)

    def with_faults(self, faults: Sequence[str]) -> RigPlan:
        """Return the plan of a rig with faults, each ``name`` or ``name=size``."""
        return replace(self, rig=with_faults(self.rig, [find_fault(text) for text in faults]))


def shipped_rigs() -> tuple[str, ...]:
    """Return the names of the rigs in the package.

    Examples
    --------
    >>> shipped_rigs()
    ('flexible', 'rigid', 'three-mass')
    """
    library = files("rotorid.rig").joinpath("library")
    return tuple(
        sorted(p.name.removesuffix(".toml") for p in library.iterdir() if p.name.endswith(".toml"))
    )


def load_rig(name: str | Path) -> RigPlan:
    """Load a shipped rig by its name, or a rig file (TOML) by its path.

    Parameters
    ----------
    name : str or Path
        ``"three-mass"``, ``"rigid"`` or ``"flexible"``; or the path of a file.

    Returns
    -------
    RigPlan
        ``run()`` gives its record in SI, as `rid.read_record` gives that of a logger; ``rig`` is
        the machine, ``duration`` in s and ``seed`` how it is run.

    Raises
    ------
    InputError
        For a name that is none of these, and for a file that does not say what a rig is.

    Examples
    --------
    >>> load_rig("three-mass").rig.model.inputs
    ('F_x1', 'F_y1', 'F_x3', 'F_y3')
    """
    text = str(name)
    if text in shipped_rigs():
        resource = files("rotorid.rig").joinpath("library").joinpath(f"{text}.toml")
        return parse_rig(resource.read_bytes(), name=text, file=f"{text}.toml")
    path = Path(name)
    if not path.suffix and not path.exists():
        raise ReadError(
            f"no rig {text[:60]!r}",
            f"one of {', '.join(shipped_rigs())}, or the path of a rig file",
            "take a name from there, or give a path ending in .toml",
        )
    data = read_bytes(path)
    return parse_rig(data, name=path.stem, file=text, folder=path.parent)


def parse_rig(
    data: bytes | str, *, name: str = "rig", file: str = "", folder: str | Path = "."
) -> RigPlan:
    raw = data.encode() if isinstance(data, str) else data
    entry = parse_toml(raw, RigFile, file=file)
    with naming(file):
        rig = _build(entry, load_model(entry.model, folder=folder))
    model = _model_path(entry, folder)
    return RigPlan(name, entry.title, raw.decode(), file, model, rig, entry.duration, entry.seed)


def _model_path(entry: RigFile, folder: str | Path) -> str:
    """Return the model's name, or its whole path, that any folder can be left for."""
    shipped = entry.model in shipped_models()
    return entry.model if shipped else (Path(folder) / entry.model).resolve().as_posix()


def _build(entry: RigFile, model: Model) -> Rig:
    sensors = tuple(_sensor(name, e, model) for name, e in entry.sensors.items())
    actuators = build_actuators(entry.actuators, model)
    values = _values(entry, model)
    controller, feedback = build_controller(entry.controller, model, values, actuators, sensors)
    return Rig(
        model=model,
        values=values,
        rotation=Rotation(**dict(entry.rotation)),
        actuators=actuators,
        sensors=sensors,
        controller=controller,
        feedback=feedback,
        logger=_logger(entry.logger),
        excitation=None if entry.excitation is None else _excitation(entry, entry.excitation),
        process_noise=_process_noise(entry, model),
        clearance=np.inf if entry.clearance is None else entry.clearance,
        delay=entry.controller.delay,
        settling=entry.settling,
    )


def _values(entry: RigFile, model: Model) -> dict[str, float]:
    units = model.parameter_units
    known = {**model.nominal}
    for name, quantity in entry.parameters.items():
        _require(name, units, "parameters")
        known[name] = to_si(quantity, units[name], place=f"parameters.{name}")
    missing = [name for name in units if name not in known]
    if missing:
        raise InputError(
            f"no value of {', '.join(missing)}",
            "a value of every parameter that has no nominal one",
            "add it",
            place="parameters",
        )
    return known


def _require(name: str, known: Iterable[str], place: str) -> None:
    there = list(known)
    require_names([name], there, cure=nearest(name, there), place=place)


def _sensor(name: str, entry: SensorEntry, model: Model) -> PositionSensor:
    place = f"sensors.{name}"
    reads = None
    if entry.reads is not None:
        reads = linear_combination(entry.reads, model.coordinates, place=f"{place}.reads")
    else:
        _require(name, model.coordinates, "sensors")
    unit = sensor_unit(reads or [name], model.units)

    def si(key: str) -> float:
        value = getattr(entry, key)
        return 0.0 if value is None else to_si(value, unit, place=f"{place}.{key}")

    runout = tuple(
        SensorRunout(
            part.order,
            to_si(part.cos, unit, place=f"{place}.runout.{i}.cos"),
            to_si(part.sin, unit, place=f"{place}.runout.{i}.sin"),
        )
        for i, part in enumerate(entry.runout)
    )
    with naming(place=place):
        return PositionSensor(name, reads, si("noise"), si("bias"), si("quantum"), runout)


def _logger(entry: LoggerEntry) -> Logger:
    marks: Mapping[str, object] = {"encoder": entry.encoder, "keyphasor": entry.keyphasor}
    if all(mark is not None for mark in marks.values()):
        raise InputError(
            "both", "one of encoder and keyphasor", "remove one", place="logger.encoder"
        )
    angle: Encoder | Keyphasor | None = None
    with naming(place="logger"):
        if entry.encoder is not None:
            angle = Encoder(**dict(entry.encoder))
        elif entry.keyphasor is not None:
            angle = Keyphasor(**dict(entry.keyphasor))
    return Logger(entry.sample_rate, entry.current, angle, oversampling=entry.oversampling)


def _excitation(file: RigFile, entry: ExcitationEntry) -> Multisine:
    rng = np.random.default_rng([file.seed, 1])
    unit = "A" if str(next(iter(entry.signals.values())).amplitude).strip().endswith("A") else "N"
    amplitude = {
        name: to_si(signal.amplitude, unit, place=f"excitation.signals.{name}.amplitude")
        for name, signal in entry.signals.items()
    }
    highest = max(entry.odd or 0, entry.full or 0)
    with naming(place="excitation"):
        _check_lines(highest, entry.fundamental, file.controller.rate)
        signals = multisine(
            entry.fundamental,
            _lines(entry, rng),
            amplitude,
            phases=entry.phases,
            apart=entry.apart,
            unit=unit,
            rng=rng,
        )
    turned = signals.scaled([np.exp(1j * signal.phase) for signal in entry.signals.values()])
    return minimize_crest(turned) if entry.minimize_crest else turned


def _check_lines(highest: int, fundamental: float, rate: float) -> None:
    """Refuse lines that a controller cannot play, before they are laid out one by one."""
    period = rate / fundamental if fundamental > 0 else 1.0  # else it is refused by itself
    if not period <= RIG_SAMPLES:
        raise InputError(
            f"a period of {period:.3g} steps of the controller",
            f"at most {RIG_SAMPLES}",
            "choose a higher fundamental",
            place="fundamental",
        )
    if 2 * highest > period:
        raise InputError(
            f"lines up to {highest * fundamental:.6g} Hz",
            f"at most half the rate of the controller, {rate / 2:.6g} Hz",
            "end at a lower line",
        )


def _lines(entry: ExcitationEntry, rng: np.random.Generator) -> np.ndarray:
    given = [key for key in ("harmonics", "odd", "full") if getattr(entry, key) is not None]
    if len(given) != 1:
        raise InputError(
            " and ".join(given) or "no lines",
            "one of harmonics, odd and full",
            "keep one of these",
        )
    if entry.harmonics is not None:
        lines = np.array(entry.harmonics)
    elif entry.odd is not None:
        lines = odd_harmonics(entry.odd)
    else:
        lines = full_harmonics(entry.full or 0)
    return lines if entry.leave_out is None else leave_out(lines, entry.leave_out, rng)


def _process_noise(entry: RigFile, model: Model) -> ProcessNoise:
    known = (*model.inputs, *model.coordinates)
    std = {}
    for name, quantity in entry.process_noise.items():
        _require(name, known, "process_noise")
        angle = model.units[name] == "rad"
        unit = "N m" if angle else model.units[name] if name in model.inputs else "N"
        std[name] = to_si(quantity, unit, place=f"process_noise.{name}")
    return ProcessNoise(std)


ALL = "all"


def build_actuators(entries: Mapping[str, ActuatorEntry], model: Model) -> dict[str, Actuator]:
    """Return the actuator of each input: what ``all`` says, and what its own table changes."""
    for name in entries:
        if name != ALL and name not in model.inputs:
            raise InputError(
                repr(name[:60]),
                f"all, or one of {', '.join(model.inputs)}",
                "name an input of the model, or all",
                place="actuators",
            )
    shared = entries.get(ALL, ActuatorEntry())
    built = {}
    for name in model.inputs:
        own = entries.get(name, ActuatorEntry())
        changed = {key: getattr(own, key) for key in own.model_fields_set}
        with naming(place=f"actuators.{name if own.model_fields_set else ALL}"):
            built[name] = _actuator(shared.model_copy(update=changed))
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
    if entry.law in (None, "force"):
        given = [key for key in law_keys() if key in entry.model_fields_set and key != "law"]
        if given:
            raise InputError(
                f"{given[0]} without a force law",
                "law = 'linear' or 'differential' beside it",
                "add the law",
            )
        return None
    law = entry.build()
    return None if isinstance(law, Flux) else law


def build_controller(
    entry: ControllerEntry,
    model: Model,
    values: Mapping[str, float],
    actuators: Mapping[str, Actuator],
    sensors: Sequence[PositionSensor],
) -> tuple[Controller, tuple[str, ...]]:
    """Return the controller of a rig file and the sensors that it reads."""
    with naming(place="controller"):
        feedback = tuple(
            _feedback(name, j, entry, model, values, sensors) for j, name in enumerate(model.inputs)
        )
        check_rate(entry.rate, "rate")
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
            "pad the denominator: a controller cannot look ahead",
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
        cure = "take a sensor from there"
        require_names([entry.feedback[name]], names, cure=cure, place=f"feedback.{name}")
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
