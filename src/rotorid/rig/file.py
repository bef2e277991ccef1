"""Rig files: what they may hold, key by key, and the rig that is built of it.

The shipped rigs are such files too. Quantities whose unit is known become SI numbers when a file is
read; those in a unit that the model or the actuator knows, when the rig is built.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, StrictInt
from scipy import signal

from rotorid.core.errors import InputError, naming, require_names
from rotorid.core.frozen import frozen
from rotorid.core.toml import Schema, parse_toml, read_named, si
from rotorid.core.units import to_si
from rotorid.force.entry import LawEntry, law_keys
from rotorid.force.laws import Differential, Flux, Linear
from rotorid.models import Model, load_model, shipped_models
from rotorid.models.equations import linear_combination
from rotorid.rig import parts
from rotorid.rig.controller import Controller, pid, side_by_side
from rotorid.rig.faults import find_fault, with_faults
from rotorid.rig.logger import Logged, RigRecord, read
from rotorid.rig.rig import RIG_SAMPLES, Rig
from rotorid.signals import multisine

Hertz = Annotated[float, si("Hz")]
Seconds = Annotated[float, si("s")]
Radians = Annotated[float, si("rad")]
Metres = Annotated[float, si("m")]
Speed = Annotated[float, si("rad/s")]
Number = Annotated[float, Field(allow_inf_nan=False)]
Quantity = str | int | float  # in a unit that the model, or the actuator, knows
LIBRARY = "rotorid.rig"
_NEEDED = {
    "pid": ("stiffness", "damping"),
    "transfer-function": ("numerator", "denominator"),
    "state-space": ("D",),
}
"""What the kinds of controllers cannot do without."""


class RotationEntry(Schema):
    """How the rotor turns; the speed is that of the first sample."""

    speed: Speed = 0.0
    acceleration: Annotated[float, si("rad/s^2")] = 0.0
    drift: Speed = 0.0
    drift_period: Seconds = 10.0
    phase: Radians = 0.0


class ControllerEntry(Schema):
    """The sampled controller of all axes.

    ``pid``: stiffness and damping of the closed bearing, so that k_s is added to what the gains
    must give; integral and filter. ``transfer-function``, the same on each axis, and
    ``state-space``: from positions in m to commands in A (N), the sign of the feedback in them.
    """

    rate: Hertz
    delay: Seconds = 0.0
    kind: Literal["pid", "transfer-function", "state-space"] = "pid"
    stiffness: Annotated[float | None, si("N/m")] = None
    damping: Annotated[float | None, si("N s/m")] = None
    integral: Annotated[float, si("N/(m s)")] = 0.0
    filter: Hertz = 2000.0
    numerator: list[Number] | None = None
    denominator: list[Number] | None = None
    A: list[list[Number]] | None = None
    B: list[list[Number]] | None = None
    C: list[list[Number]] | None = None
    D: list[list[Number]] | None = None
    feedback: dict[str, str] = Field(default_factory=dict)

    def build(self, actuators: Sequence[parts.Actuator]) -> Controller:
        parts.check_rate(self.rate, "rate")
        needed = _NEEDED[self.kind]
        for key in needed:
            if getattr(self, key) in (None, []):
                expected = f"{' and '.join(needed)} of a controller of the kind {self.kind}"
                raise InputError(f"no {key}", expected, f"add {key}")
        if self.kind == "pid":
            return side_by_side([self._pid(*part.slopes) for part in actuators])
        if self.kind == "transfer-function":
            return self._transfer_function().on_each(len(actuators))
        a, b, c, d = (np.array(getattr(self, key) or [], dtype=float) for key in "ABCD")
        return Controller(a, b, c, d, 1 / self.rate)

    def _pid(self, ki: float, ks: float) -> Controller:
        assert self.stiffness is not None
        assert self.damping is not None
        gains = (self.stiffness + ks) / ki, self.integral / ki, self.damping / ki
        return pid(*gains, self.filter, 1 / self.rate)

    def _transfer_function(self) -> Controller:
        numerator, denominator = self.numerator or [], self.denominator or []
        if len(numerator) > len(denominator) or denominator[0] == 0:
            found = f"{len(numerator)} and {len(denominator)} coefficients"
            expected = "a denominator at least as long as the numerator, that starts with no 0"
            raise InputError(found, expected, "pad the denominator: a controller cannot look ahead")
        numerator = np.trim_zeros(numerator, "f") or [0.0]
        return Controller(*signal.tf2ss(numerator, denominator), 1 / self.rate)

    def sensors_of(
        self, model: Model, values: Mapping[str, float], sensors: Sequence[parts.PositionSensor]
    ) -> tuple[str, ...]:
        """Return the sensor of each input: the one given, or that which reads its displacement."""
        names, found = [sensor.name for sensor in sensors], []
        reads = np.array([[s.combination.get(c, 0.0) for c in model.coordinates] for s in sensors])
        columns = model.require_linear().matrices(model.values(values)).B.T
        for name, column in zip(model.inputs, columns, strict=True):
            there = np.abs(reads - column).max(axis=1) <= 1e-9 * np.abs(column).max()
            if name in self.feedback:
                cure, place = "take a sensor from there", f"feedback.{name}"
                require_names([self.feedback[name]], names, cure=cure, place=place)
            elif not there.any():
                raise InputError(
                    f"no sensor that reads the displacement at {name}",
                    "the sensor to feed back to it",
                    f"add {name} = '...' to controller.feedback",
                    place="feedback",
                )
            found.append(self.feedback.get(name) or names[there.argmax()])
        return tuple(found)


class FluxEntry(Schema):
    """Hall sensors under the poles; constants of the force law, and noise."""

    area: Annotated[float, si("m^2")]
    poles: StrictInt = 2
    noise: Annotated[float, si("T")] = 0.0


ALL = "all"


class ActuatorEntry(LawEntry):
    """An actuator; what ``[actuators.all]`` says holds for all of them."""

    law: Literal["force", "linear", "differential"] | None = None  # type: ignore[assignment]
    limit: Quantity | None = None
    bandwidth: Hertz | None = None
    supply: Annotated[float | None, si("V")] = None
    inductance: Annotated[float | None, si("H")] = None
    noise: Quantity | None = None
    flux: FluxEntry | None = None

    def actuator(self) -> parts.Actuator:
        law = self._force_law()
        unit = "N" if law is None else "A"
        if (self.supply is None) != (self.inductance is None):
            expected = "both, whose ratio limits the current's slope, or neither"
            raise InputError("one of supply and inductance", expected, "add the other")
        supply, inductance = self.supply, self.inductance
        flux = None
        if self.flux is not None:
            angle = law.angle if isinstance(law, Differential) else 0.0
            flux = parts.FluxSensors(Flux(self.flux.area, self.flux.poles, angle), self.flux.noise)
        return parts.Actuator(
            law=law,
            limit=np.inf if self.limit is None else to_si(self.limit, unit, place="limit"),
            bandwidth=self.bandwidth,
            slew=np.inf if supply is None or inductance is None else supply / inductance,
            noise=0.0 if self.noise is None else to_si(self.noise, unit, place="noise"),
            flux=flux,
        )

    def _force_law(self) -> Linear | Differential | None:
        if self.law not in (None, "force"):
            law = self.build()
            return law if isinstance(law, Linear | Differential) else None
        given = [key for key in law_keys() if key in self.model_fields_set and key != "law"]
        if given:
            expected = "law = 'linear' or 'differential' beside it"
            raise InputError(f"{given[0]} without a force law", expected, "add the law")
        return None


def build_actuators(
    entries: Mapping[str, ActuatorEntry], model: Model
) -> dict[str, parts.Actuator]:
    """Return the actuator of each input: what ``all`` says, and what its own table changes."""
    require_names(entries, (ALL, *model.inputs), place="actuators")
    shared = entries.get(ALL, ActuatorEntry())
    built = {}
    for name in model.inputs:
        own = entries.get(name, ActuatorEntry())
        changed = {key: getattr(own, key) for key in own.model_fields_set}
        with naming(place=f"actuators.{name if changed else ALL}"):
            built[name] = shared.model_copy(update=changed).actuator()
    return built


class RunoutEntry(Schema):
    """One order of the runout of a sensor."""

    order: StrictInt = 1
    cos: Quantity | None = None
    sin: Quantity | None = None


class SensorEntry(Schema):
    """A position sensor, named after the coordinate that it reads, or with `reads`."""

    reads: str | None = None
    noise: Quantity | None = None
    bias: Quantity | None = None
    quantum: Quantity | None = None
    runout: list[RunoutEntry] = Field(default_factory=list)

    def build(self, name: str, model: Model) -> parts.PositionSensor:
        place, reads = f"sensors.{name}", None
        if self.reads is None:
            require_names([name], model.coordinates, place="sensors")
        else:
            reads = linear_combination(self.reads, model.coordinates, place=f"{place}.reads")
        unit = parts.sensor_unit(reads or [name], model.units)

        def number(value: Quantity | None, key: str) -> float:
            return 0.0 if value is None else to_si(value, unit, place=f"{place}.{key}")

        sizes = {key: number(getattr(self, key), key) for key in ("noise", "bias", "quantum")}
        orders = [
            (o.order, number(o.cos, f"runout.{i}.cos"), number(o.sin, f"runout.{i}.sin"))
            for i, o in enumerate(self.runout)
        ]
        with naming(place=place):
            runout = tuple(parts.SensorRunout(*part) for part in orders)
            return parts.PositionSensor(name, reads, **sizes, runout=runout)


class SignalEntry(Schema):
    """The excitation of one input: the peak of each line, and a phase added to each."""

    amplitude: Quantity
    phase: Radians = 0.0


class ExcitationEntry(Schema):
    """A multisine: its lines by `harmonics`, or all odd or all up to the highest."""

    fundamental: Hertz
    harmonics: list[StrictInt] | None = None
    odd: StrictInt | None = None
    full: StrictInt | None = None
    leave_out: StrictInt | None = None
    phases: Literal["zero", "schroeder", "random"] = "schroeder"
    apart: bool = False
    minimize_crest: bool = False
    signals: dict[str, SignalEntry] = Field(min_length=1)

    def build(self, rate: float, seed: int) -> multisine.Multisine:
        """Return the multisine for a controller's rate in Hz."""
        rng = np.random.default_rng([seed, 1])
        first = next(iter(self.signals.values()))
        unit = "A" if str(first.amplitude).strip().endswith("A") else "N"
        amplitude = {
            name: to_si(signal.amplitude, unit, place=f"excitation.signals.{name}.amplitude")
            for name, signal in self.signals.items()
        }
        with naming(place="excitation"):
            self._check_lines(rate)
            signals = multisine.multisine(
                self.fundamental,
                self._lines(rng),
                amplitude,
                phases=self.phases,
                apart=self.apart,
                unit=unit,
                rng=rng,
            )
        turned = signals.scaled([np.exp(1j * signal.phase) for signal in self.signals.values()])
        return multisine.minimize_crest(turned) if self.minimize_crest else turned

    def _check_lines(self, rate: float) -> None:
        """Refuse lines that a controller cannot play, before they are laid out one by one."""
        highest = max(self.odd or 0, self.full or 0)
        # A fundamental that is not positive is refused by itself.
        period = rate / self.fundamental if self.fundamental > 0 else 1.0
        if not period <= RIG_SAMPLES:
            found = f"a period of {period:.3g} steps of the controller"
            expected = f"at most {RIG_SAMPLES}"
            raise InputError(found, expected, "choose a higher fundamental", place="fundamental")
        if 2 * highest > period:
            expected = f"at most half the rate of the controller, {rate / 2:.6g} Hz"
            cure = "end at a lower line"
            raise InputError(f"lines up to {highest * self.fundamental:.6g} Hz", expected, cure)

    def _lines(self, rng: np.random.Generator) -> np.ndarray:
        given = [key for key in ("harmonics", "odd", "full") if getattr(self, key) is not None]
        if len(given) != 1:
            found = " and ".join(given) or "no lines"
            raise InputError(found, "one of harmonics, odd and full", "keep one of these")
        if self.odd is not None:
            lines = multisine.odd_harmonics(self.odd)
        elif self.full is not None:
            lines = multisine.full_harmonics(self.full)
        else:
            lines = np.array(self.harmonics)
        return lines if self.leave_out is None else multisine.leave_out(lines, self.leave_out, rng)


class EncoderEntry(Schema):
    """An encoder; the logger reads its counter."""

    lines: StrictInt
    jitter: Radians = 0.0


class KeyphasorEntry(Schema):
    """A mark that passes once per revolution; the logger samples its pulse."""

    jitter: Seconds = 0.0
    noise: Number = 0.0
    width: Number = 0.1


class LoggerEntry(Schema):
    """What the logger records besides the positions."""

    sample_rate: Hertz
    current: Literal["command", "measured"] = "command"
    oversampling: StrictInt = 1
    encoder: EncoderEntry | None = None
    keyphasor: KeyphasorEntry | None = None

    def build(self) -> parts.Logger:
        if self.encoder is not None and self.keyphasor is not None:
            raise InputError(
                "both", "one of encoder and keyphasor", "remove one", place="logger.encoder"
            )
        angle: parts.Encoder | parts.Keyphasor | None = None
        with naming(place="logger"):
            if self.encoder is not None:
                angle = parts.Encoder(**dict(self.encoder))
            elif self.keyphasor is not None:
                angle = parts.Keyphasor(**dict(self.keyphasor))
            return parts.Logger(
                self.sample_rate, self.current, angle, oversampling=self.oversampling
            )


class RigFile(Schema):
    """A rig file."""

    title: str = ""
    model: str
    duration: Seconds
    settling: Seconds = 1.0
    seed: Annotated[StrictInt, Field(ge=0)] = 0
    clearance: Metres | None = None
    rotation: RotationEntry = Field(default_factory=RotationEntry)
    parameters: dict[str, Quantity] = Field(default_factory=dict)
    controller: ControllerEntry
    actuators: dict[str, ActuatorEntry]
    sensors: dict[str, SensorEntry] = Field(min_length=1)
    excitation: ExcitationEntry | None = None
    process_noise: dict[str, Quantity] = Field(default_factory=dict)
    logger: LoggerEntry

    def build(self, model: Model) -> Rig:
        sensors = tuple(entry.build(name, model) for name, entry in self.sensors.items())
        actuators = build_actuators(self.actuators, model)
        values = {**model.nominal, **in_si(self.parameters, model.parameter_units, "parameters")}
        with naming(place="parameters"):
            model.values(values)  # refuses where one is missing
        with naming(place="controller"):
            feedback = self.controller.sensors_of(model, values, sensors)
            controller = self.controller.build([actuators[name] for name in model.inputs])
        logger = self.logger.build()
        noisy = {name: model.units[name] for name in model.inputs}
        noisy |= {c: "N m" if model.units[c] == "rad" else "N" for c in model.coordinates}
        entry, rate = self.excitation, self.controller.rate
        excitation = None if entry is None else entry.build(rate, self.seed)
        return Rig(
            model=model,
            values=values,
            rotation=parts.Rotation(**dict(self.rotation)),
            actuators=actuators,
            sensors=sensors,
            controller=controller,
            feedback=feedback,
            logger=logger,
            excitation=excitation,
            process_noise=in_si(self.process_noise, noisy, "process_noise"),
            clearance=np.inf if self.clearance is None else self.clearance,
            delay=self.controller.delay,
            settling=self.settling,
        )


def in_si(
    quantities: Mapping[str, Quantity], units: Mapping[str, str], place: str
) -> dict[str, float]:
    require_names(quantities, units, place=place)
    return {name: to_si(q, units[name], place=f"{place}.{name}") for name, q in quantities.items()}


@frozen
class RigPlan:
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
        with naming(self.file or self.name):
            return read(self.rig.as_described, self.record(seed))

    def record(self, seed: int | None = None) -> Logged:
        """Run the rig as `run` does, but leave the logger's columns as they are."""
        rng = np.random.default_rng(self.seed if seed is None else seed)
        with naming(self.file or self.name):
            return self.rig.record(self.duration, rng)

    def with_faults(self, faults: Sequence[str]) -> RigPlan:
        """Return the plan of a rig with faults, each ``name`` or ``name=size``."""
        return replace(self, rig=with_faults(self.rig, [find_fault(text) for text in faults]))


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
    cure = "take a name from there, or give a path ending in .toml"
    data, found, path = read_named(name, LIBRARY, "rig", cure)
    return parse_rig(data, name=found, file=str(path), folder=path.parent)


def parse_rig(
    data: bytes | str, *, name: str = "rig", file: str = "", folder: str | Path = "."
) -> RigPlan:
    raw = data.encode() if isinstance(data, str) else data
    entry = parse_toml(raw, RigFile, file=file)
    with naming(file):
        rig = entry.build(load_model(entry.model, folder=folder))
    # The model's name, or its whole path, that any folder can be left for.
    shipped = entry.model in shipped_models()
    model = entry.model if shipped else (Path(folder) / entry.model).resolve().as_posix()
    return RigPlan(name, entry.title, raw.decode(), file, model, rig, entry.duration, entry.seed)
