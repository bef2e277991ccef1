"""What a rig file may hold, key by key; quantities whose unit is known become SI numbers here."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, StrictInt

from rotorid.core.toml import Schema
from rotorid.core.units import to_si
from rotorid.force.entry import LawEntry


def _quantity(unit: str) -> BeforeValidator:
    return BeforeValidator(lambda value: to_si(value, unit))


Hertz = Annotated[float, _quantity("Hz")]
Seconds = Annotated[float, _quantity("s")]
Radians = Annotated[float, _quantity("rad")]
Metres = Annotated[float, _quantity("m")]
Speed = Annotated[float, _quantity("rad/s")]
Number = Annotated[float, Field(allow_inf_nan=False)]
Quantity = str | int | float  # in a unit that the model, or the actuator, knows


class RotationEntry(Schema):
    """How the rotor turns; the speed is that of the first sample."""

    speed: Speed = 0.0
    acceleration: Annotated[float, _quantity("rad/s^2")] = 0.0
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
    stiffness: Annotated[float | None, _quantity("N/m")] = None
    damping: Annotated[float | None, _quantity("N s/m")] = None
    integral: Annotated[float, _quantity("N/(m s)")] = 0.0
    filter: Hertz = 2000.0
    numerator: list[Number] | None = None
    denominator: list[Number] | None = None
    A: list[list[Number]] | None = None
    B: list[list[Number]] | None = None
    C: list[list[Number]] | None = None
    D: list[list[Number]] | None = None
    feedback: dict[str, str] = Field(default_factory=dict)


class FluxEntry(Schema):
    """Hall sensors under the poles; constants of the force law, and noise."""

    area: Annotated[float, _quantity("m^2")]
    poles: StrictInt = 2
    noise: Annotated[float, _quantity("T")] = 0.0


class ActuatorEntry(LawEntry):
    """An actuator; what ``[actuators.all]`` says holds for all of them."""

    law: Literal["force", "linear", "differential"] | None = None  # type: ignore[assignment]
    limit: Quantity | None = None
    bandwidth: Hertz | None = None
    supply: Annotated[float | None, _quantity("V")] = None
    inductance: Annotated[float | None, _quantity("H")] = None
    noise: Quantity | None = None
    flux: FluxEntry | None = None


class RunoutEntry(Schema):
    """One order of the runout of a sensor."""

    order: StrictInt = 1
    cos: Quantity = "0 m"
    sin: Quantity = "0 m"


class SensorEntry(Schema):
    """A position sensor, named after the coordinate that it reads, or with `reads`."""

    reads: str | None = None
    noise: Quantity | None = None
    bias: Quantity | None = None
    quantum: Quantity | None = None
    runout: list[RunoutEntry] = Field(default_factory=list)


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
