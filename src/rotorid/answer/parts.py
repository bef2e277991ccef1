"""What an answer consists of: values, misfits, suspects, evidence; each as JSON holds it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import field
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, PlainSerializer, Strict

from rotorid.core.errors import ReadError, one_line
from rotorid.core.notes import Note
from rotorid.core.units import check_unit
from rotorid.core.values import Floats, frozen

RecordKind = Literal["periods", "lines", "phasors", "responses", "samples"]
# JSON knows no NaN: null stands for a number that is not finite, in both directions.
Number = Annotated[float, Strict(), BeforeValidator(lambda x: math.nan if x is None else x)]
Numbers = tuple[Number, ...]
Interval = tuple[  # null stands for an end that there is not
    Annotated[float, Strict(), BeforeValidator(lambda x: -math.inf if x is None else x)],
    Annotated[float, Strict(), BeforeValidator(lambda x: math.inf if x is None else x)],
]
Count = Annotated[int, Strict()]
Optional = Annotated[float, Strict()] | None
Flag = Annotated[bool, Strict()]


def under(status: str, notes: Iterable[Note]) -> str:
    """Return the status of a result, in words, with what notes say that it assumes."""
    sizes = (note.value or 0.0 for note in notes if note.severity == "assumes")
    return UNDER if status == "ok" and any(size > FAR for size in sizes) else status


def _name(text: str) -> str:
    """Refuse, in a file, a name that no quantity has: other programs read them from exports."""
    if text.strip() and text.isprintable():
        return text
    expected = "the name of a quantity, in printable characters"
    cure = "write the file with identify --json"
    raise ReadError(f"the name {one_line(repr(text))}", expected, cure)


def _unit(text: str) -> str:
    check_unit(text)
    return text


@frozen
class Value:
    """A named quantity with its standard deviation.

    Parameters
    ----------
    name : str
    unit : str
        SI.
    value : float
        NaN where it is not determined.
    std : float or None
        ``None`` where the method gives none; 0 for a fixed value.
    std_inflated : float or None
        As if all of the misfit were noise.
    fixed : bool
        Known beforehand and not estimated.
    std_assumed : float or None
        How far the value may move if what is assumed is wrong by a plausible size: the root of the
        sum of squares over `Estimate.assumptions`. ``None`` where nobody asked.
    interval : (float, float) or None
        Ends of the 95 % interval by the profile of the misfit, infinite where there is none;
        ``None`` where it is that of `std_inflated`, 1.96 to either side.
    """

    name: Annotated[str, AfterValidator(_name)]
    unit: Annotated[str, AfterValidator(_unit)]
    value: Number
    std: Optional = None
    std_inflated: Optional = None
    fixed: Flag = False
    std_assumed: Optional = None
    interval: Interval | None = None


DOUBTFUL = 5e-4
"""The p-value from which on a misfit is what noise leaves; below it the model is doubtful. The
directional tests are held against it too: together they doubt one right model in a thousand."""
UNDER = "ok under assumptions"
"""The verdict of an answer that what it assumes may move by more than `FAR` of its deviations."""
FAR = 5.0
SAME_SPEED = 1e-3
"""Share by which a speed may lie beside those of the records and be one of them: they wander so."""
EXPLAINS = 0.2  # least share of the excess misfit with which a suspect is a lead


@frozen
class Misfit:
    """The misfit at the estimate, against what noise alone would leave."""

    cost: Number
    expected: Number
    dof: Count
    p_value: Number


@frozen
class LineMisfit:
    """The misfit of one line of one record (counted from 0), against what noise would leave."""

    record: Count
    frequency_hz: Number
    cost: Number
    expected: Number


@frozen
class Assumption:
    """What was taken as exact and would move the answer unseen."""

    assumed: str  # ``force scale``, ``L1``, ``ground``, ``rotor angle``, ...
    size: str  # the error that is plausible
    parameter: str  # what it would move most
    moves: Number  # by so many standard deviations
    cure: str  # what would settle it, or say better how well it is known


@frozen
class Shift:
    """How far the values may be off unseen where something assumed is wrong by a plausible size."""

    about: str
    size: str
    text: str
    cure: str
    moves: dict[str, Numbers]  # by how much each value, SI, for each way of being wrong
    # A value that may follow the speed is off by so much times Omega^2 besides, and all is over
    # hypot(T^2, seen): T the highest speed, of a record or asked for, seen what the records tell.
    grows: dict[str, Number] = field(default_factory=dict)
    seen: Number = 0.0

    def __post_init__(self) -> None:
        if len({len(by) for by in self.moves.values()}) != 1:
            raise ValueError("as many numbers for each value, of one value at least")

    @property
    def note(self) -> Note:
        return Note(self.about, "assumes", self.text, self.cure, size=self.size)

    def at(self, speed: float, highest: float) -> dict[str, Floats]:
        over = math.hypot(max(speed, highest) ** 2, self.seen) if self.grows else 1.0
        added = {name: slope * speed**2 for name, slope in self.grows.items()}
        return {n: (np.array(by) + added.get(n, 0.0)) / over for n, by in self.moves.items()}


@frozen
class Suspect:
    """What the model may lack, or a channel get wrong.

    Parameters
    ----------
    term : str
        ``damping k1``, ``gain[x1]``, ``swap[x1, y1]``, ...
    drop : float
        Drop of the cost if the term were free.
    share : float or None
        Share of the excess misfit that it explains.
    value : float or None
        Its estimate when it is freed.
    unit : str
        Of `value`.
    """

    term: str
    drop: Number
    share: Optional = None
    value: Optional = None
    unit: str = ""


def _pairs(rows: Any) -> Any:
    """Return ``(name, value)`` from rows of a file; pairs as they are."""
    if not isinstance(rows, list):
        return rows
    return tuple(
        (r["name"], r["value"]) if isinstance(r, dict) and len(r) == 2 else r for r in rows
    )


def _rows(pairs: tuple[tuple[str, float], ...]) -> list[dict[str, Any]]:
    return [{"name": name, "value": value} for name, value in pairs]


Pairs = Annotated[tuple[tuple[str, Number], ...], BeforeValidator(_pairs), PlainSerializer(_rows)]


@frozen
class Alternative:
    """Another answer that fits as well: its misfit, and ``(name, value)`` of each parameter."""

    cost: Number
    parameters: Pairs


@frozen
class ModeFit:
    """A measured natural frequency beside that of the estimate.

    Parameters
    ----------
    mode : int
        Its number among the distinct natural frequencies, from 1.
    speed_rad_s : float
    frequency_hz, std_hz : float
        As measured.
    fitted_hz, fitted_std_hz : float
        Of the estimate, with the deviation that follows from those of the parameters.
    damping_ratio, damping_std : float or None
        As measured; ``None`` where it was not.
    fitted_damping_ratio : float
    parameters : sequence of (name, value)
        What was otherwise in the test.
    """

    mode: Count
    speed_rad_s: Number
    frequency_hz: Number
    std_hz: Number
    fitted_hz: Number
    fitted_std_hz: Number
    damping_ratio: Optional = None
    damping_std: Optional = None
    fitted_damping_ratio: Optional = None
    parameters: Pairs = ()


@frozen
class Unbalance:
    """The unbalance of one plane: what stands there too much, and in which direction.

    Parameters
    ----------
    plane : str
        The coordinates on which it acts: ``x2, y2``; ``theta_x, theta_y`` for a couple.
    unit : str
        kg m, or kg m^2 of a couple.
    amount : float
    angle_rad : float
        In the rotor, counted from the zero of the rotor angle.
    std, angle_std_rad : float or None
        ``None`` where the estimate states no deviations.
    """

    plane: str
    unit: str
    amount: Number
    angle_rad: Number
    std: Optional = None
    angle_std_rad: Optional = None


@frozen
class SourceFile:
    """A file that went into an estimate, and the sha256 of its content in hexadecimal.

    Empty where the file is beyond 16 GB.
    """

    file: str
    sha256: str


@frozen
class Provenance:
    """Where an estimate comes from.

    Parameters
    ----------
    files : sequence of SourceFile
        Records and models that were read.
    experiment : str
        The experiment file's text.
    version : str
        Of rotorid.
    command : str
        As it was given.
    model : str
        The model file's text, whole, so that the result needs no other file.
    held : sequence of (name, value)
        What was substituted in the model before it was identified, SI.
    environment : str
        Versions of Python and of what computes: other ones may differ in the last digits.
    """

    files: tuple[SourceFile, ...] = ()
    experiment: str = ""
    version: str = ""
    command: str = ""
    model: str = ""
    held: Pairs = ()
    environment: str = ""


@frozen
class Prediction:
    """How well an estimate predicts one channel: ``|residual| / |measured|`` on the lines."""

    relative_error: Number


@frozen
class ChannelEvidence:
    """One channel of a record: what was measured, and what the estimate predicts."""

    # SI
    name: str
    unit: str
    # amplitudes on the lines of the record: as measured, as predicted, of their difference, and of
    # what the noise of the record makes of that difference, one standard deviation; of a channel
    # that is not predicted, the noise of the channel. Empty where there is none.
    measured: Numbers = ()
    predicted: Numbers = ()
    difference: Numbers = ()
    noise: Numbers = ()
    # the same over time, at the times of the record
    wave_measured: Numbers = ()
    wave_predicted: Numbers = ()
    # standard deviation that noise gives the difference of the two at any time
    wave_noise: Number = math.nan
    # |predicted - measured| / |measured| on all lines that are not left out
    error: Number = math.nan
    # lines beside a resonance on which the noise alone moves the prediction further than the
    # channel moved. They are in none of what is over time, nor in `error`.
    left_out: Count = 0


@frozen
class ResponseEvidence:
    """A position by a force: the model's response, and what it leaves of the one over the other."""

    force: str
    position: str  # a combination of coordinates
    unit: str
    speed_rad_s: Number
    frequency_hz: Numbers  # of lines whose response is larger than its bar
    real: Numbers
    imag: Numbers
    std: Numbers  # of the complex number; 0: not known


@frozen
class RecordEvidence:
    """One record as it was used."""

    source: str
    # {"periods", "lines", "phasors", "responses", "samples"}: cut into periods; the lines of the
    # whole record; a table of 1x phasors or of frequency responses; samples filtered
    kind: RecordKind
    lines: Count = 0  # lines that were used
    # how many neighbouring lines one value here stands for: their root mean square
    lines_per_point: Count = 1
    # 0 where there are none
    periods: Count = 0
    samples_per_period: Count = 0
    sample_rate_hz: Number = math.nan
    speed_rad_s: Numbers = ()  # the lowest and the highest speed
    frequency_hz: Numbers = ()  # of the lines; of several neighbouring ones the middle
    time_s: Numbers = ()  # one period; or an excerpt of the record; or every so many samples
    channels: tuple[ChannelEvidence, ...] = ()  # those that are predicted first
    response: ResponseEvidence | None = None  # of the pair that tells most

    def __post_init__(self) -> None:
        for channel in self.channels:
            on_lines = (channel.measured, channel.predicted, channel.difference, channel.noise)
            over_time = (channel.wave_measured, channel.wave_predicted)
            for rows, length in ((on_lines, len(self.frequency_hz)), (over_time, len(self.time_s))):
                if any(len(row) not in (0, length) for row in rows):
                    raise ValueError(f"{length} numbers of each kind, or none")


@frozen
class Prior:
    """What was known of a quantity before the records: its value and deviation, 0 for exactly."""

    name: str  # of a parameter or nuisance, or an expression in parameters
    value: Number
    std: Number


@frozen
class Evidence:
    """What a report shows besides the values."""

    records: tuple[RecordEvidence, ...] = ()
    known: tuple[Prior, ...] = ()  # what was known beforehand, with its deviation

    def prior(self, name: str) -> Prior | None:
        return next((prior for prior in self.known if prior.name == name), None)
