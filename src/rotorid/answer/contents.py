"""What an estimate consists of: values, misfit, suspects, other answers, where it comes from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import field, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, PlainSerializer, Strict

from rotorid.answer.judge import EFFORT, Status, ordered
from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.notes import VERDICTS, Note
from rotorid.core.values import ByContent, Floats, read_only

Kind = Literal["periods", "lines", "phasors", "responses", "samples"]
# JSON knows no NaN: null stands for a number that is not finite, in both directions.
Number = Annotated[float, Strict(), BeforeValidator(lambda x: math.nan if x is None else x)]
Numbers = tuple[Number, ...]
Count = Annotated[int, Strict()]
Optional = Annotated[float, Strict()] | None
Flag = Annotated[bool, Strict()]


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
    """

    name: str
    unit: str
    value: Number
    std: Optional = None
    std_inflated: Optional = None
    fixed: Flag = False


DOUBTFUL = 1e-3
"""The p-value from which on a misfit is what noise leaves; below it the model is doubtful."""
EXPLAINS = 0.2
"""Least share of the excess misfit with which a suspect is a lead."""


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

    Empty where the file is beyond 16 GB, or made of holes for the most part.
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
class RecordEvidence:
    """One record as it was used."""

    source: str
    # {"periods", "lines", "phasors", "responses", "samples"}: cut into periods; the lines of the
    # whole record; a table of 1x phasors or of frequency responses; samples filtered
    kind: Kind
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
    """What a report shows besides the values.

    Examples
    --------
    >>> Evidence(known=(Prior("L1", 0.3, 0.0005),)).prior("L1").std
    0.0005
    """

    records: tuple[RecordEvidence, ...] = ()
    known: tuple[Prior, ...] = ()  # what was known beforehand, with its deviation

    def prior(self, name: str) -> Prior | None:
        return next((prior for prior in self.known if prior.name == name), None)


def _undetermined(value: Value) -> Value:
    if math.isnan(value.value) and value.std is None:
        return replace(value, std=math.nan, std_inflated=math.nan)
    return value


def _square(rows: Any) -> Floats:
    if any(len(row) != len(rows) for row in rows):
        raise ValueError("a square matrix")
    return np.array(rows, dtype=float).reshape(len(rows), len(rows))


def _told(notes: Sequence[Note]) -> list[dict[str, Any]]:
    """Return notes as a file holds them: drop and share only where there is one."""
    return [
        {k: v for k, v in vars(note).items() if v is not None or k not in ("drop", "share")}
        for note in notes
    ]


_OPEN = ("not identifiable: ", "cure: ")  # what is open, and what would cure it


if TYPE_CHECKING:
    Values = tuple[Value, ...]
    Covariance = Floats
else:
    Values = tuple[Annotated[Value, AfterValidator(_undetermined)], ...]
    Covariance = Annotated[
        tuple[tuple[Number, ...], ...], AfterValidator(_square), PlainSerializer(np.ndarray.tolist)
    ]


@frozen
class Answer(ByContent):
    """The fields of an `Estimate`, where each is explained, and what only they decide."""

    model: str
    method: str
    status: Status
    parameters: Values
    nuisance: Values = ()
    derived: Values = ()
    covariance: Covariance = field(default_factory=lambda: np.zeros((0, 0)))
    misfit: Misfit | None = None
    prediction: dict[str, Prediction | None] = field(default_factory=dict)
    lines_hz: tuple[Number, ...] = ()
    periods: Count = 0
    notes: Annotated[tuple[Note, ...], PlainSerializer(_told)] = ()
    condition_number: Optional = None
    line_misfit: tuple[LineMisfit, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    modes: tuple[ModeFit, ...] = ()
    unbalance: tuple[Unbalance, ...] = ()
    provenance: Provenance | None = None
    evidence: Evidence | None = None

    def __post_init__(self) -> None:
        covariance = np.array(self.covariance, dtype=float)
        object.__setattr__(self, "covariance", read_only(covariance))
        object.__setattr__(self, "notes", ordered(self.notes))
        if self.status == "ok" and (found := _not_finite(self)):
            raise InputError(
                f"no finite {found} in an estimate called ok",
                "finite numbers",
                "check units and scales of the columns, or call it not_converged",
            )

    @property
    def on_answer(self) -> tuple[Note, ...]:
        """The notes on the answer itself, without its possible causes."""
        found = (note for note in self.notes if note.drop is None)
        return tuple(note for note in found if note.severity not in VERDICTS)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The notes on the answer, in words; what is open and what would cure it are named so."""
        return tuple(
            _OPEN[bool(note.cure)] + note.text if note.severity == "open" else note.text
            for note in self.on_answer
        )

    @property
    def checks(self) -> tuple[Note, ...]:
        """The notes on the data, and on what was taken as exact."""
        return tuple(note for note in self.notes if note.severity in VERDICTS)

    @property
    def suspects(self) -> tuple[Suspect, ...]:
        """What the model may lack, or a channel get wrong: what explains most first."""
        return tuple(
            Suspect(note.about, note.drop, note.share, note.value, note.unit)
            for note in self.notes
            if note.drop is not None
        )

    @property
    def doubt(self) -> str:
        """Why an answer that is ok is doubtful all the same; empty where it is not."""
        if self.status == "ok" and any(note.about == EFFORT for note in self.notes):
            return "little effort"
        if self.status != "ok" or self.misfit is None or not self.misfit.p_value < DOUBTFUL:
            return ""
        return f"p = {self.misfit.p_value:.1g}"

    @property
    def free(self) -> tuple[Value, ...]:
        """The quantities of the rows of `covariance`, in order."""
        return (*(value for value in self.parameters if not value.fixed), *self.nuisance)

    @property
    def correlation(self) -> Floats:
        """Correlation matrix of `free`, shape (free, free)."""
        deviation = np.sqrt(np.diag(self.covariance))
        scale = np.where(deviation > 0, deviation, 1.0)
        return np.asarray(self.covariance / np.outer(scale, scale))


def _not_finite(answer: Answer) -> str:
    estimated = len(answer.parameters) + len(answer.nuisance)
    for k, value in enumerate((*answer.parameters, *answer.nuisance, *answer.derived)):
        known = [value.std, value.std_inflated] if math.isfinite(value.value) else []
        if k < estimated:
            known.append(value.value)
        if not all(x is None or math.isfinite(x) for x in known):
            return f"{value.name} or deviation of it"
    misfit = answer.misfit
    if misfit is not None and not math.isfinite(misfit.cost):
        return "misfit"
    stated = [value.std is not None for value in answer.free]
    covariance = answer.covariance
    if len(stated) == len(covariance):  # without scatter nothing is stated of a value
        covariance = covariance[np.ix_(stated, stated)]
    return "" if np.isfinite(covariance).all() else "covariance"
