"""`Estimate`, the one result of every estimator: what it consists of, its views, its JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, replace
from functools import cache
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, PlainSerializer, Strict, TypeAdapter
from pydantic_core import to_json

from rotorid.answer.judge import EFFORT, OFF, Status, judge, ordered
from rotorid.core.errors import InputError, ReadError, one_line
from rotorid.core.files import MARK, Kind, write_whole
from rotorid.core.notes import VERDICTS, Note
from rotorid.core.tables import Page
from rotorid.core.units import check_unit
from rotorid.core.values import Floats, Shown, frozen, import_pandas, read_only

if TYPE_CHECKING:
    import pandas as pd


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


SCHEMA = "rotorid-estimate/2"
RESULT = Kind("rotorid identify --json")


def _undetermined(value: Value) -> Value:
    if math.isnan(value.value) and value.std is None:
        return replace(value, std=math.nan, std_inflated=math.nan)
    return value


def _square(rows: Any) -> Floats:
    if any(len(row) != len(rows) for row in rows):
        raise ValueError("a square matrix")
    return np.array(rows, dtype=float).reshape(len(rows), len(rows))


_SPARSE = ("drop", "share", "size", "periods")


def _told(notes: Sequence[Note]) -> list[dict[str, Any]]:
    """Return notes as a file holds them: drop, share, size and periods only where there are any."""
    return [
        {k: v for k, v in vars(note).items() if k not in _SPARSE or v not in (None, "", ())}
        for note in notes
    ]


_OPEN = ("not identifiable: ", "cure: ")  # what is open, and what would cure it
Values = tuple[Annotated[Value, AfterValidator(_undetermined)], ...]
if TYPE_CHECKING:
    Covariance = Floats
else:
    Covariance = Annotated[
        tuple[tuple[Number, ...], ...], AfterValidator(_square), PlainSerializer(np.ndarray.tolist)
    ]


@frozen
class Estimate(Shown):
    """What an estimator found.

    Parameters
    ----------
    model, method : str
    status : {"ok", "rejected", "not_identifiable", "not_converged"}
    parameters : sequence of Value
        Base parameters for the least-squares family, physical ones for maximum likelihood.
    nuisance : sequence of Value
    derived : sequence of Value
        The physical parameters that follow from base ones, or the base ones from physical ones.
    covariance : array, shape (free, free)
        One row per parameter that is not fixed, in order, then per nuisance parameter.
    misfit : Misfit or None
        ``None`` for methods without a likelihood.
    prediction : mapping of input name to Prediction or None
        ``None`` for an input that is zero.
    lines_hz : sequence of float
    periods : int
    notes : sequence of Note
        All that was found; `warnings` (in words), `suspects` and `checks` are views of them.
    condition_number : float or None
        Of the scaled least-squares problem.
    line_misfit : sequence of LineMisfit
        The misfit line by line, for methods with a likelihood.
    alternatives : sequence of Alternative
        Other answers that fit as well; not empty means that the status is ``not_identifiable``.
    modes : sequence of ModeFit
        Measured natural frequencies beside those of the estimate.
    unbalance : sequence of Unbalance
        What the parameters say of the unbalance of each plane.
    provenance : Provenance or None
        Files, experiment, version and command; for an estimate made in Python the model alone.
    evidence : Evidence or None
        What a report shows of the records; see `with_evidence`.
    speeds : (float, float) or None
        The lowest and the highest speed of the records, rad/s.
    shifts : sequence of Shift
        What errors of what is assumed move: what follows from the values at other speeds asks.

    Examples
    --------
    >>> mass = Value("m", "kg", 2.0, std=0.01)
    >>> estimate = Estimate("one", "ls", "ok", (mass,), covariance=np.array([[1e-4]]))
    >>> estimate.value("m"), estimate.std("m")
    (2.0, 0.01)
    >>> print(estimate)
    one, ls: ok
    <BLANKLINE>
    parameters  value    std  std %  unit
    m           2.000  0.010   0.50  kg
    """

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
    speeds: tuple[Number, Number] | None = None
    shifts: tuple[Shift, ...] = ()

    def __post_init__(self) -> None:
        covariance = np.array(self.covariance, dtype=float)
        object.__setattr__(self, "covariance", read_only(covariance))
        object.__setattr__(self, "notes", ordered(self.notes))
        if self.status == "ok" and (found := _not_finite(self)):
            cure = "check units and scales of the columns, or call it not_converged"
            raise InputError(f"no finite {found} in an estimate called ok", "finite numbers", cure)

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
    def assumptions(self) -> tuple[Assumption, ...]:
        """What was taken as exact and would move the answer unseen, the largest first."""
        return tuple(
            Assumption(note.about, note.size, ", ".join(note.on), note.value or 0.0, note.cure)
            for note in self.notes
            if note.severity == "assumes"
        )

    @property
    def verdict(self) -> str:
        """What the first line says: ok, ok under assumptions, doubtful, or the status."""
        if self.doubt:
            return "doubtful"
        return under(self.status, self.notes)

    @property
    def doubt(self) -> str:
        """Why an answer that is ok is doubtful all the same; empty where it is not."""
        if self.status == "ok" and any(note.about == EFFORT for note in self.notes):
            return "little effort"
        if self.status == "ok" and (off := [n for n in self.notes if n.about in OFF]):
            return f"{off[0].value or math.nan:.2g} std off along {' or '.join(off[0].on)}"
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

    @property
    def quantities(self) -> dict[str, tuple[Value, ...]]:
        """Every value by its kind; what is derived by its own name alone is a parameter only."""
        names = {value.name for value in self.parameters}
        derived = tuple(value for value in self.derived if value.name not in names)
        return {"parameters": self.parameters, "nuisance": self.nuisance, "derived": derived}

    def __getitem__(self, name: str) -> Value:
        """Return a parameter, nuisance or derived quantity by name."""
        every = [value for values in self.quantities.values() for value in values]
        for value in every:
            if value.name == name:
                return value
        raise KeyError(f"{name!r}; there are: {', '.join(v.name for v in every)}")

    def value(self, name: str) -> float:
        """Return the value of a quantity, in its unit."""
        return self[name].value

    def std(self, name: str) -> float | None:
        """Return the standard deviation of a quantity, in its unit."""
        return self[name].std

    def __repr__(self) -> str:
        names = ", ".join(f"{v.name} = {v.value:.4g}" for v in self.parameters)
        found = shorten(names, 120, placeholder="...")
        return f"<Estimate {shorten(self.model, 40)}, {self.method}: {self.status}; {found}>"

    @property
    def page(self) -> Page:
        """All there is to read: status, tables, and notes on them."""
        return self.summary()

    def summary(self, *, intervals: bool = False) -> Page:
        """Return what `print` shows: sentences and tables.

        Parameters
        ----------
        intervals : bool
            The ends of the 95 % intervals in place of the deviations.
        """
        from rotorid.answer.estimate_tables import page

        return page(self, intervals=intervals)

    def with_(self, **changes: Any) -> Estimate:
        """Return a copy with some fields replaced."""
        return replace(self, **changes)

    def with_notes(self, *more: Note) -> Estimate:
        """Return a copy with further notes, and the status that they leave."""
        if not more:
            return self
        return replace(self, status=judge(more, self.status), notes=(*self.notes, *more))

    def _drawn(self) -> tuple[list[Any], str]:
        from rotorid.report.drawn import correlation, deviations  # takes its time to load

        if not 0 < len(self.free) == len(self.covariance):
            told = "an estimate without covariance"
            raise InputError(told, "one row per free parameter", "see its status")
        deviation = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        size = np.abs([value.value for value in self.free])
        with np.errstate(divide="ignore", invalid="ignore"):
            percent = 100 * deviation / size
        names = [value.name for value in self.free]
        panels = [deviations(names, percent), correlation(names, self.correlation)]
        return panels, "deviations in percent, and correlations"

    def to_frame(self) -> pd.DataFrame:
        """Return every quantity as a row of a pandas data frame, indexed by name.

        What is derived by its own name alone is there once, as a parameter.

        Raises
        ------
        ImportError
            Where pandas is not installed.
        """
        rows = [
            {**vars(value), "kind": kind.removesuffix("s")}
            for kind, values in self.quantities.items()
            for value in values
        ]
        columns = ["name", "kind", "unit", "value", "std", "std_inflated", "std_assumed"]
        columns += ["interval", "fixed"]
        frame: pd.DataFrame = import_pandas().DataFrame(rows, columns=columns)
        return frame.set_index("name")

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data, as the result file holds it."""
        from rotorid import __version__

        data = adapter().dump_python(self, mode="json", exclude=_LEFT_OUT)
        data["warnings"] = list(self.warnings)
        data["suspects"] = [vars(suspect) for suspect in self.suspects]
        data["checks"] = [check.as_check for check in self.checks]
        data["assumptions"] = [vars(one) for one in self.assumptions]
        return {"schema": SCHEMA, "version": __version__, "verdict": self.verdict, **data}

    def save(self, path: str | Path) -> None:
        """Write the result file (JSON).

        Raises
        ------
        OSError
            Where the file cannot be written.
        """
        write_whole(path, self.to_json())

    def to_json(self) -> bytes:
        """Return the content of the result file."""
        data = {**self.to_dict(), "written": MARK}
        try:
            return RESULT.signed(_json(data))
        except ValueError:  # names of files are bytes, and may be no text
            return RESULT.signed(_json(_encodable(data)))


def _not_finite(answer: Estimate) -> str:
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


def _json(data: dict[str, Any]) -> bytes:
    """Return JSON with one key, and of a list one entry, on each line: to be read, and not long."""

    def text(value: Any) -> bytes:
        return to_json(value, inf_nan_mode="null")

    parts = []
    for key, value in data.items():
        entry = text(value)
        if isinstance(value, list) and value and isinstance(value[0], dict | list):
            entry = b"[\n    " + b",\n    ".join(map(text, value)) + b"\n  ]"
        parts.append(b"  " + text(key) + b": " + entry)
    return b"{\n" + b",\n".join(parts) + b"\n}\n"


def _encodable(data: Any) -> Any:
    """Return plain data with the bytes of names that are no UTF-8 written out."""
    if isinstance(data, dict):
        return {_encodable(key): _encodable(value) for key, value in data.items()}
    if isinstance(data, list):
        return [_encodable(value) for value in data]
    is_text = isinstance(data, str)
    return data.encode("utf-8", "backslashreplace").decode() if is_text else data


_LEFT_OUT: Any = {
    "nuisance": {"__all__": {"fixed", "std_assumed", "interval"}},
    "derived": {"__all__": {"fixed", "std_inflated", "std_assumed"}},
}


@cache
def adapter() -> TypeAdapter[Estimate]:
    """Return what reads and writes estimates; to build it takes its time."""
    return TypeAdapter(Estimate)


def check_units(estimate: Estimate, units: Mapping[str, str]) -> None:
    for value in estimate.parameters:
        unit = units.get(value.name.partition("[")[0], value.unit)
        if value.unit != unit:
            told, expected = f"{value.name} in {value.unit[:60]!r}", f"{unit}, as its model has it"
            cure = "identify again: the values of a result are in SI"
            raise InputError(told, expected, cure, place="parameters")
