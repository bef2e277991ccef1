"""What an experiment file may hold, key by key; quantities become SI numbers here."""

from __future__ import annotations

import datetime
import math
from collections.abc import Set
from contextlib import suppress
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args, get_origin, get_type_hints
from unicodedata import normalize

from pydantic import BeforeValidator, Field, StrictBool, StrictInt, create_model, model_validator

from rotorid.core.errors import InputError
from rotorid.core.toml import Schema, members, si
from rotorid.core.units import to_si
from rotorid.core.values import grouped
from rotorid.data.lines import Window
from rotorid.force.channel_dynamics import Constant
from rotorid.force.entry import LawEntry, LawName, constant, law_keys
from rotorid.likelihood.unknowns import Nuisances

Hertz = Annotated[float, si("Hz"), Field(ge=1e-9, le=1e12)]
Seconds = Annotated[float, si("s"), Field(ge=0, le=1e9)]
Count = Annotated[StrictInt, Field(ge=0, le=10**9)]
Method = Literal["ls", "batch", "sequential", "ml"]
Effort = Literal["quick", "normal", "thorough"]
Quantity = str | int | float  # in a unit that the model knows


Serial = Annotated[  # each letter in one code, however it was typed
    str,
    Field(min_length=1, max_length=60, coerce_numbers_to_str=True),
    BeforeValidator(lambda said: normalize("NFC", said.strip()) if isinstance(said, str) else said),
]


def _phase(value: object) -> float | None:
    """Return the angle in rad; None where it is to be estimated."""
    return None if value == "unknown" else to_si(value, "rad")


def _short(key: str, kind: Any) -> BeforeValidator:
    """Take a value of a kind for a table of one key."""
    return BeforeValidator(lambda value: {key: value} if isinstance(value, kind) else value)


def _one_of(*kinds: str, beside: str = "", expected: str, cure: str) -> Any:
    """Return what refuses keys that are none of the sets that may stand together."""
    sets = [set(kind.split()) for kind in kinds]

    def check(entry: Schema) -> Schema:
        given = entry.model_fields_set - set(beside.split())
        if given not in sets:
            found = " and ".join(sorted(given)) + (" alone" if len(given) == 1 else "")
            raise InputError(found or "nothing", expected, cure)
        return entry

    return model_validator(mode="after")(check)


class DelayEntry(Schema):
    """By how long a column lags the truth, and how well that is known (0: exactly)."""

    value: Annotated[float, si("s")] = 0.0
    std: Annotated[float, si("s"), Field(gt=0, allow_inf_nan=False)] | None = None


Delay = Annotated[DelayEntry, _short("value", str | int | float)]


class DynamicsEntry(Schema):
    """What an amplifier, a filter or a sensor does to each line of a column.

    ``bandwidth`` alone: first order; with ``damping``: second order; ``eddy``: eddy currents;
    ``table``: a measured response. Of an input's column it is the actuator's, of a sensor's the
    sensor's, unless ``of`` says otherwise.
    """

    bandwidth: Annotated[Constant | None, constant("bandwidth", "Hz", of_law=False)] = None
    damping: Annotated[Constant | None, constant("damping", "1", of_law=False)] = None
    eddy: Annotated[Constant | None, constant("eddy", "s", of_law=False)] = None
    table: str | None = None
    shared: str = ""
    of: Literal["actuator", "sensor"] | None = None

    _kind = _one_of(
        *("bandwidth", "bandwidth damping", "eddy", "table"),
        beside="shared of",
        expected="one of bandwidth (with damping or without), eddy, table",
        cure="write { bandwidth = '1.5 kHz' }, for instance",
    )

    @property
    def uncertain(self) -> bool:
        constants = (self.bandwidth, self.damping, self.eddy)
        return any(c is not None and c.std for c in constants)


def _band(value: object) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(repr(value)[:60], "two frequencies", 'write ["0 Hz", "40 Hz"]')
    low, high = (to_si(end, "Hz") for end in value)
    if not 0 <= low <= high <= 1e12:
        raise InputError(
            repr(value)[:60], "0 Hz or more, the lower end first", "put the lower end first"
        )
    return low, high


class TimeEntry(Schema):
    """The column of sample times, and its unit where the file does not state it."""

    column: str
    unit: str | None = None


def _scale(value: object) -> object:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not isinstance(value, str) and not (number and math.isfinite(value)):  # type: ignore[arg-type]
        raise InputError(
            repr(value)[:60],
            "a finite scale, or the name of a scalar",
            'write what turns the column into its unit, such as 0.05 or "gain_x1", or leave it out '
            "for 1",
        )
    return value


class Recorded(Schema):
    """A column, and how it was recorded."""

    column: str | None = None
    unit: str | None = None
    scale: Annotated[str | float | None, BeforeValidator(_scale)] = None
    offset: Quantity = 0.0
    hold: Literal["none", "zero-order"] = "none"
    delay: Delay = DelayEntry()
    gain_std: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    dynamics: DynamicsEntry | None = None

    @property
    def deviations(self) -> list[str]:
        bent = self.dynamics is not None and self.dynamics.uncertain
        stds = {"gain_std": self.gain_std, "delay.std": self.delay.std, "dynamics": bent}
        return [key for key, std in stds.items() if std]


class ColumnEntry(Recorded):
    """A column of a force law."""

    column: str


_AS_RECORDED = {"hold", "delay", "gain_std", "dynamics"}
"""Keys that a channel with a law says for its columns, or these say themselves."""
Kind = Literal["samples", "phasors", "responses"]
"""What a record is made of, and therefore what its channels say."""


def _check_keys(
    given: Set[str], wanted: Set[str], allowed: Set[str], beside: str, cure: str = "remove it"
) -> None:
    for key in sorted(wanted - given):
        raise InputError("no such key", "a value", "add it", place=key)
    known = wanted | allowed
    for key in sorted(given - known):
        if cure == "remove it" and key in (*law_keys(), "unit"):
            cure = "remove it; the unit of a current stands in its own table"
        raise InputError(f"{key} {beside}", f"one of {', '.join(sorted(known))}", cure, place=key)


def _quantity_or_column(value: object) -> object:
    if isinstance(value, int | float) and not isinstance(value, bool):
        cure = f'write std = "{value} um", with the unit of the amplitude'
        raise InputError(f"{value} without a unit", "a quantity, or the name of a column", cure)
    return value


class PhasorKeys(Schema):
    """The columns of a channel of a table of 1x phasors, and how the instrument states them."""

    amplitude: str | None = None
    phase: str | None = None
    real: str | None = None
    imag: str | None = None
    std: Annotated[str | None, BeforeValidator(_quantity_or_column)] = None
    phase_unit: str = "deg"
    lag: StrictBool = False
    peak_to_peak: StrictBool = False

    @property
    def polar(self) -> bool:
        return self.amplitude is not None or self.phase is not None


_OF_TABLES = {"unit", "std", "lag", "reads", "delay", "gain_std", "dynamics"}
_PHASORS = _OF_TABLES | {"scale", "peak_to_peak"}
_RESPONSES = _OF_TABLES | {"scale", "input", "coherence"}


class ChannelEntry(Recorded, LawEntry, PhasorKeys):
    """Where an input, coordinate or sensor comes from: a column, a law's columns, a phasor's.

    With ``input`` it is a frequency response: of a table, or of a universal file's ``column``.
    """

    law: LawName | None = None  # type: ignore[assignment]
    reads: str | None = None
    current: ColumnEntry | None = None
    flux: Annotated[list[ColumnEntry] | None, Field(min_length=2, max_length=2)] = None
    position: str | None = None
    input: str | None = None
    coherence: str | None = None

    @property
    def kind(self) -> Kind:
        if self.input is not None:
            return "responses"
        phasor = self.polar or self.real is not None or self.imag is not None
        return "phasors" if phasor else "samples"

    @property
    def parts(self) -> tuple[str, str]:
        return ("amplitude", "phase") if self.polar else ("real", "imag")

    @model_validator(mode="after")
    def _column_or_law(self) -> ChannelEntry:
        given, wanted = self.model_fields_set, {*self.parts}
        if self.kind == "responses":
            wanted = wanted if self.column is None else {"column"}
            allowed, beside = _RESPONSES, "in a frequency response"
        elif self.kind == "phasors":
            allowed, beside = _PHASORS, "in a phasor's channel"
        elif self.law is None:
            wanted, beside = {"column"} if self.scale != 0 else set(), "without a law"
            allowed = {*_AS_RECORDED, "column", "unit", "scale", "offset", "reads"}
            if given & PhasorKeys.model_fields.keys():
                beside = "in a channel of samples"
        else:
            wanted = {"flux"} if self.law == "flux" else {"current", "position"}
            allowed, beside = {*law_keys(), *_AS_RECORDED}, f"beside law = {self.law!r}"
        _check_keys(given, wanted, allowed | ({"phase_unit"} if self.polar else set()), beside)
        for column in self.columns:
            for key in sorted(given & _AS_RECORDED & column.model_fields_set):
                raise InputError(
                    f"{key} here and in the column's table", "it once", "remove one", place=key
                )
        return self

    @property
    def columns(self) -> tuple[ColumnEntry, ...]:
        return tuple(self.flux or (() if self.current is None else (self.current,)))

    @property
    def deviations(self) -> list[str]:
        columns = [f"{column.column}.{key}" for column in self.columns for key in column.deviations]
        return [*super().deviations, *self.uncertain, *columns]

    @property
    def recorded(self) -> tuple[ColumnEntry, ...]:
        said = {key: getattr(self, key) for key in _AS_RECORDED & self.model_fields_set}
        return tuple(column.model_copy(update=said) for column in self.columns)


class SpeedEntry(Schema):
    """The speed of a run in rad/s; of a table, the column of the speeds of its rows."""

    value: Annotated[float, si("rad/s"), Field(ge=-1e9, le=1e9)] = 0.0
    column: str | None = None
    unit: str | None = None

    _kind = _one_of(
        *("", "value", "column", "column unit"),
        expected="a speed, or a column with its unit",
        cure='write speed = "3000 rpm", or { column = "n", unit = "rpm" } in a table',
    )


def _speed(value: object) -> object:
    if isinstance(value, dict | SpeedEntry):
        return value
    speed = to_si(value, "rad/s")
    if not abs(speed) <= 1e9:
        cure = "look at its unit: rpm, Hz and rad/s are different"
        raise InputError(f"{speed:g} rad/s", "1e9 rad/s at most", cure)
    return SpeedEntry(value=f"{speed!r} rad/s")  # type: ignore[arg-type]


class AngleEntry(TimeEntry):
    """The column of an encoder: an angle with a unit, or a counter of lines."""

    lines: Annotated[StrictInt | None, Field(ge=1, le=10**9)] = None

    _kind = _one_of(
        *("column unit", "column lines", "column unit lines"),
        expected="the unit of an angle, or the lines of a revolution that are counted",
        cure="add one",
    )


class OwnEntry(Schema):
    """What is known of a parameter in one record."""

    fixed: Quantity | None = None
    value: Quantity | None = None
    std: Quantity | None = None

    _kind = _one_of(
        *("fixed", "value std"),
        expected="fixed, or value and std",
        cure="say what the parameter was in this record; each = true in [parameters] lets every "
        "record have an unknown one of its own",
    )


_FILES = {"kind", "file", "files", "header_row", "speed", "overrule", "channels", "parameters"}
_TIMES = {"sample_rate", "time", "angle", "keyphasor", "angle_lag_std", "skip", "until", "mask"}
_SAMPLES = _FILES | _TIMES | {"phase"}
_TURN_UP = 'say kind = "phasors" to cut a run-up into a table'
_MADE: dict[str, tuple[set[str], str, str]] = {
    "periods": (
        _SAMPLES | {"fundamental", "period_samples", "harmonics", "band"},
        "beside a period",
        "give the fundamental",
    ),
    "whole": (
        _SAMPLES | {"band", "references", "quiet"},
        "without a period",
        "leave out the fundamental to use the whole record, whose noise it tells",
    ),
    "filtered": (_SAMPLES | {"cutoff", "decimate", "leave_out"}, "beside cutoff", "add cutoff"),
    "run-up": ((_FILES | _TIMES | {"revolutions"}) - {"speed"}, "in a table of phasors", _TURN_UP),
    "phasors": (_FILES | {"rows", "same_speed"}, "in a table of phasors", 'say kind = "phasors"'),
    "responses": (
        _FILES | {"rows", "frequency", "averages", "window", "band", "every"},
        "in a table of responses",
        'say kind = "responses"',
    ),
}
"""What is made of a record: its keys, how others beside them are told, and how to ask for it."""


class RowsEntry(Schema):
    """The rows of a table that a record takes: those in which a column holds a text or number."""

    column: str
    value: str | StrictInt | Annotated[float, Field(strict=True)] = Field(alias="is")


class RecordKeys(Schema):
    """What may be said of one run of the machine."""

    kind: Kind = "samples"
    frequency: TimeEntry | None = None
    averages: Annotated[StrictInt | None, Field(ge=1, le=10**9)] = None
    window: Window | None = None
    every: Annotated[StrictInt, Field(ge=1, le=10**6)] = 1
    file: str | None = None
    files: Annotated[list[str] | None, Field(min_length=1)] = None
    header_row: Count | None = None
    rows: RowsEntry | None = None
    same_speed: Annotated[float, si("rad/s"), Field(ge=0, le=1e6)] = 0.0
    sample_rate: Hertz | None = None
    overrule: StrictBool = False
    time: Annotated[TimeEntry | None, _short("column", str)] = None
    speed: Annotated[SpeedEntry, BeforeValidator(_speed)] = SpeedEntry()
    angle: AngleEntry | None = None
    keyphasor: str | None = None
    phase: Annotated[float | None, BeforeValidator(_phase)] = 0.0
    angle_lag_std: Seconds | None = None
    fundamental: Hertz | None = None
    period_samples: Count | None = None
    harmonics: list[Count] | None = None
    band: Annotated[tuple[float, float] | None, BeforeValidator(_band)] = None
    skip: Seconds | None = None
    until: Annotated[float | None, si("s"), Field(gt=0, le=1e9)] = None
    mask: str | None = None
    revolutions: Annotated[StrictInt, Field(ge=4, le=10**6)] | None = None
    references: Annotated[list[str] | None, Field(min_length=1)] = None
    quiet: str | None = None
    cutoff: Hertz | None = None
    decimate: Annotated[StrictInt | None, Field(ge=1, le=10**6)] = None
    leave_out: Annotated[list[str] | None, Field(min_length=1)] = None
    channels: dict[str, ChannelEntry] = Field(default_factory=dict)
    parameters: dict[str, OwnEntry] = Field(default_factory=dict)

    @property
    def paths(self) -> list[str]:
        return list(self.files or ()) if self.file is None else [self.file]


class RecordEntry(RecordKeys):
    """One run of the machine."""

    @model_validator(mode="after")
    def _keys_of_what_is_made(self) -> RecordEntry:
        if self.kind != "phasors" and self.speed.column is not None:
            raise InputError(
                f"a column of speeds in a record of {self.kind}",
                "one speed, or an angle column or a keyphasor beside samples",
                'write speed = "3000 rpm"; for a table of a row per speed, kind = "phasors"',
                place="speed",
            )
        allowed, beside, _ = _MADE[self.made]
        for key in sorted(self.model_fields_set - allowed):
            others = [how for keys, _, how in _MADE.values() if key in keys]
            cure = f"remove {key}, or {', or '.join(others)}"
            _check_keys({key}, set(), allowed, beside, cure)
        if self.made == "phasors" and "speed" not in self.model_fields_set:
            raise InputError(
                "no speed",
                "the column of the speeds of the rows",
                'write speed = { column = "n", unit = "rpm" }; of a run-up over time, angle or '
                "keyphasor",
                place="speed",
            )
        return self

    @model_validator(mode="after")
    def _one_of_each(self) -> RecordEntry:
        if self.made == "whole" and self.band is None:
            raise InputError(
                "neither fundamental nor band nor cutoff",
                "what is made of the record: periods, lines of the whole, or filtered samples",
                "give the fundamental of a periodic excitation; without one, the band that was "
                'excited, or, for a model that is not linear, cutoff = "100 Hz"',
                place="fundamental, period_samples",
            )
        pairs = [("file", "files", True), ("references", "quiet", False)]
        pairs += [(of, mark, False) for mark in ("keyphasor", "angle") for of in ("speed", "phase")]
        pairs += [("keyphasor", "angle", False)]
        if self.made == "periods":
            pairs += [("fundamental", "period_samples", True), ("harmonics", "band", True)]
        for first, second, needed in pairs:
            given = self.model_fields_set & {first, second}
            if len(given) > 1 or (needed and not given):
                marks = given & {"angle", "keyphasor"}
                raise InputError(
                    "both" if given else "neither",
                    f"one of {first} and {second}",
                    "remove one" + ": a mark gives speed and angle" * bool(marks)
                    if given
                    else "add one",
                    place=f"{first}, {second}",
                )
        if self.until is not None and self.skip is not None and self.until <= self.skip:
            found = f"until = {self.until:g} s with skip = {self.skip:g} s"
            raise InputError(found, "an end after the start", "correct one of them", place="until")
        return self

    @property
    def made(self) -> str:
        """What is made of the record, as `_MADE` has it: a run-up is cut into a table."""
        if self.kind != "samples":
            turned = self.kind == "phasors" and (self.angle or self.keyphasor)
            return "run-up" if turned else self.kind
        if self.cutoff is not None:
            return "filtered"
        return "whole" if self.fundamental is None and self.period_samples is None else "periods"

    @property
    def channel_kind(self) -> Kind:
        return "samples" if self.made == "run-up" else self.kind


class PriorKeys(Schema):
    """What a parameter and a combination of parameters have in common."""

    value: Quantity | None = None
    std: Quantity | None = None
    min: Quantity | None = None
    max: Quantity | None = None

    @property
    def bounded(self) -> bool:
        return self.min is not None or self.max is not None


class ParameterEntry(PriorKeys):
    """What is known of a parameter beforehand."""

    fixed: Quantity | None = None
    start: Quantity | None = None
    each: StrictBool = False

    @model_validator(mode="after")
    def _one_kind(self) -> ParameterEntry:
        given = self.model_fields_set - {"min", "max", "each"}
        alone = set() if self.bounded or self.each else {"fixed"}
        if given not in ({"value", "std"}, {"start"}, alone):
            raise InputError(
                " and ".join(sorted(given)) or "nothing",
                "fixed, or each, or value and std, or start",
                "keep one of these; min and max may stand beside the last two, or alone, each too",
            )
        return self


class ConstraintEntry(PriorKeys):
    """A combination of parameters that is known."""

    expression: str

    _kind = _one_of(
        *("value", "value std", "min", "max", "min max"),
        beside="expression",
        expected="value, with std or without, or min and max",
        cure="keep one of these",
    )


class DampingEntry(Schema):
    """A measured damping ratio and its deviation."""

    value: Annotated[float, Field(gt=-1, lt=1)]
    std: Annotated[float, Field(gt=0, allow_inf_nan=False)]


class ModeEntry(Schema):
    """A measured natural frequency."""

    frequency: Annotated[float, si("Hz")]
    std: Annotated[float, si("Hz")]
    damping: DampingEntry | None = None
    speed: Annotated[float, si("rad/s"), Field(ge=-1e9, le=1e9)] = 0.0
    parameters: dict[str, Quantity] = Field(default_factory=dict)
    mode: Annotated[StrictInt | None, Field(ge=1, le=10**6)] = None


def _unknown_of_measurement() -> dict[str, Any]:
    """Return the fields of `Nuisances` as keys of a table; `each` stands at each parameter."""
    kinds = get_type_hints(Nuisances, include_extras=True)
    del kinds["each"]
    return {
        name: (list[get_args(kind)[0]], Field(default_factory=list))  # type: ignore[misc]
        if get_origin(kind) is tuple
        else (kind, getattr(Nuisances, name))
        for name, kind in kinds.items()
    }


class MethodKeys(Schema):
    """What says how to compute."""

    method: Method | None = None
    free_weight: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 100.0


if TYPE_CHECKING:
    UnknownKeys = MethodKeys
else:
    UnknownKeys = create_model("UnknownKeys", __base__=MethodKeys, **_unknown_of_measurement())


class EstimatorEntry(UnknownKeys):
    """How to estimate."""

    effort: Effort = "normal"

    @property
    def unknown(self) -> dict[str, Any]:
        return self.model_dump(include={*_unknown_of_measurement()})


OPEN = "?"
"""What `rotorid new` writes where it found nothing."""


def left_open(entry: object) -> tuple[int, str]:
    """Return how many things a draft leaves open, and which: keys, and the tables they are of."""
    places = [place.rstrip(".0123456789") for place, said in members(entry) if said == OPEN]
    parts = [place.rpartition(".") for place in dict.fromkeys(places)]
    tables = grouped((table, key) for table, _, key in parts)
    alike = grouped((", ".join(keys), table) for table, keys in tables.items())
    told = (k + f" of {', '.join(t)}" * any(t) for k, t in alike.items())
    return len(parts), "; ".join(told)


def _date(value: object) -> object:
    """Take a date, or a date and time, as TOML or a text has it; no count of days or seconds."""
    with suppress(ValueError):
        if isinstance(value, str):
            return datetime.datetime.fromisoformat(value).date()
        if isinstance(value, datetime.datetime):
            return value.date()
        if isinstance(value, datetime.date | None):
            return value
    raise InputError(repr(value)[:60], "a date", "write year, month and day as in 2026-03-01")


class ExperimentFile(Schema):
    """An experiment file."""

    @model_validator(mode="before")
    @classmethod
    def _nothing_left_open(cls, value: object) -> object:
        count, told = left_open(value)
        if count:
            cure = "fill them in, as the comments there say"
            raise InputError(f'"{OPEN}" for {told}', "their values", cure)
        return value

    @model_validator(mode="after")
    def _something_measured(self) -> ExperimentFile:
        if not self.records and not self.modes:
            expected = "at least one record, or one measured natural frequency"
            cure = "add one"
            raise InputError("neither [[records]] nor [[modes]]", expected, cure, place="records")
        return self

    model: str
    records: list[RecordEntry] = Field(default_factory=list)
    modes: list[ModeEntry] = Field(default_factory=list)
    channels: dict[str, ChannelEntry] = Field(default_factory=dict)
    parameters: dict[str, ParameterEntry] = Field(default_factory=dict)
    constraints: list[ConstraintEntry] = Field(default_factory=list)
    estimator: EstimatorEntry = Field(default_factory=EstimatorEntry)
    serial: Serial | None = None
    date: Annotated[datetime.date | None, BeforeValidator(_date)] = None


class DraftColumn(TimeEntry, extra="ignore"):
    """A column of a draft, whatever else is said of it."""


class DraftRecord(RecordKeys):
    """A record with all its columns, as far as it is filled in."""

    angle: DraftColumn | None = None  # type: ignore[assignment]
    band: Any = None

    @model_validator(mode="before")
    @classmethod
    def _filled_in(cls, value: object) -> object:
        if not isinstance(value, dict):
            return value
        if value.get("sample_rate") == OPEN:
            expected = "the rate of samples, or the kind of a table"
            cure = 'write sample_rate = "5 kHz", or kind = "phasors" or "responses" in its place'
            raise InputError(f'"{OPEN}"', expected, cure, place="sample_rate")
        left = (OPEN, [OPEN, OPEN])
        filled = {key for key, said in value.items() if said not in left or key == "file"}
        return {key: value[key] for key in _OF_DRAFTS if key in filled}


_OF_DRAFTS = (
    *("file", "files", "header_row", "mask", "sample_rate", "time", "skip", "until", "speed"),
    *("phase", "angle", "keyphasor", "fundamental", "period_samples", "harmonics", "band"),
)


class DraftFile(Schema, extra="ignore"):
    """A file that is not finished, or wrong elsewhere than in its records."""

    records: list[DraftRecord]
