"""`Estimate`, the one result of every estimator: its views, its tables, its JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from functools import cache
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import AfterValidator, PlainSerializer, TypeAdapter
from pydantic_core import to_json

from rotorid.answer.judge import EFFORT, OFF, SUSPECTS, Status, judge, ordered
from rotorid.answer.parts import (
    DOUBTFUL,
    Alternative,
    Assumption,
    Count,
    Evidence,
    LineMisfit,
    Misfit,
    ModeFit,
    Number,
    Optional,
    Prediction,
    Provenance,
    Shift,
    Suspect,
    Unbalance,
    Value,
    under,
)
from rotorid.core.distributions import HALF_WIDTH
from rotorid.core.errors import InputError
from rotorid.core.files import MARK, Kind, check_target, write_whole
from rotorid.core.linalg import coupled
from rotorid.core.notes import VERDICTS, Note, told_once
from rotorid.core.tables import Page, Table, table
from rotorid.core.values import Floats, Shown, frozen, import_pandas, read_only

if TYPE_CHECKING:
    import pandas as pd

NOTICED = 0.01  # p-value below which the tables say where the misfit lies
WORST = 8  # lines, equations, suspects or pairs that they list: what a screen holds
SPOILT = 0.3  # relative error of an accepted prediction from which on its reason is told
FAR = 10.0  # deviations in a value, from which on it is not shown in percent
ROUNDING = 0.005  # deviations below which a value is zero: half the last digit of two
ANYWHERE = 90.0  # deg, deviation of an angle from which on it may be any
NAMED_ASSUMPTIONS = 3  # of what is assumed: what moves the answer most
_GRAVE = ("refuses", "warns", "says")
NAMED = 1e-3  # share of the misfit below which a suspect explains nothing, and is not listed
MANY = 4  # pairs of one group of parameters, from which on its names are told once
TOGETHER = 0.95  # correlation from which two parameters are named as known together
_BY_HAND = {"kg m": ("g mm", 1e6), "kg m^2": ("g mm^2", 1e9)}  # units in which one balances

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
        if self.status != "ok":
            return ""
        if any(note.about == EFFORT for note in self.notes):
            return "little effort"
        if off := [n for n in self.notes if n.about in OFF and n.severity == "doubts"]:
            return f"{off[0].value or math.nan:.2g} std off along {' or '.join(off[0].on)}"
        if untold := [v.name for v in self.parameters if v.std is None and not v.fixed]:
            return f"nothing tells the std of {', '.join(untold)}"
        if self.misfit is None or not self.misfit.p_value < DOUBTFUL:
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

    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write the result file (JSON); `force` replaces a file that is no result, or was edited.

        Raises
        ------
        InputError
            For another's file, such as a record, and a path that cannot be written.
        OSError
            Where the file cannot be written.
        """
        check_target(Path(path), RESULT, force=force)
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


def page(estimate: Estimate, *, intervals: bool = False) -> Page:
    head = f"{estimate.model}, {estimate.method}: {verdict(estimate)}"
    return [head, *tables(estimate, intervals=intervals), *sentences(estimate)]


def verdict(estimate: Estimate) -> str:
    """Return the verdict, and what it rests on."""
    if estimate.doubt:
        return f"{estimate.status}, but doubtful ({estimate.doubt})"
    if lead := next((n for n in ordered(estimate.notes) if n.severity == "rejects"), None):
        suspected = lead.about == SUSPECTS and estimate.suspects
        cause = estimate.suspects[0].term if suspected else ", ".join((lead.about, *lead.on))
        return f"{estimate.status} ({cause})"
    if estimate.verdict == estimate.status:
        return estimate.status
    first = estimate.assumptions[0]
    more = f"{first.assumed}: {first.size} would shift {first.parameter} by {first.moves:.2g} std"
    return f"{estimate.verdict} ({more})"


def value_tables(estimate: Estimate, *, intervals: bool = False) -> dict[str, Table]:
    return {
        kind: _table(kind, values, intervals=intervals)
        for kind, values in estimate.quantities.items()
        if values
    }


def tables(estimate: Estimate, *, intervals: bool = False) -> list[Table]:
    values = value_tables(estimate, intervals=intervals)
    derived = values.pop("derived", None)
    late = estimate.method == "ml"  # products of the parameters, which few want to read
    found = [
        values.pop("parameters", None),
        None if late else derived,
        _unbalance_table(estimate, intervals=intervals),
        *values.values(),
        _mode_table(estimate),
        _alternative_table(estimate),
        _suspect_table(estimate),
        _misfit_table(estimate),
        derived if late else None,
    ]
    return [one for one in found if one is not None and one.rows]


def sentences(estimate: Estimate) -> list[str]:
    grave = (c for c in estimate.checks if c.severity in _GRAVE)
    shown = [c for c in grave if not any(str(c) in told for told in estimate.warnings)]
    keyed = (((c.about, c.on) if c.verdict == "note" else c, c) for c in shown)
    return [
        *on_fit(estimate),
        *told_once((key, f"{c.verdict}, {on_data(c)}") for key, c in keyed),
        *_assumed(estimate),
        *(f"warning: {warning}" for warning in estimate.warnings),
    ]


def _assumed(estimate: Estimate) -> list[str]:
    notes = [check for check in estimate.checks if check.severity == "assumes"]
    told = [f"note, {note.about}: {note.text}" for note in notes[:NAMED_ASSUMPTIONS]]
    more = len(notes) - len(told)
    return [*told, f"note, {more} more assumptions shift something by less"] if more else told


def on_data(check: Note) -> str:
    own = check.severity == "assumes"  # its text names what it shifts
    names = f" of {', '.join(check.on)}" if check.on and not own else ""
    return f"{check.about}{names}: {check.text}"


def on_fit(estimate: Estimate) -> list[str]:
    told = []
    if estimate.misfit is not None:
        m = estimate.misfit
        judged = (
            f"; {m.expected:.4g} expected from noise ({m.dof} degrees of freedom), "
            f"p = {m.p_value:.2g}"
        )
        told.append(f"misfit {m.cost:.4g}{judged if m.dof else ', no degrees of freedom'}")
    errors = {n: "zero" if p is None else _percent(p) for n, p in estimate.prediction.items()}
    if errors:
        shown = ", ".join(f"{name} {error}" for name, error in errors.items())
        told.append(f"relative prediction error{_by_noise(estimate)}: {shown}")
    if estimate.lines_hz:
        low, high = min(estimate.lines_hz), max(estimate.lines_hz)
        whole = f"{estimate.periods} periods" if estimate.periods > 1 else "no periods"
        told.append(f"{whole}, {len(estimate.lines_hz)} lines from {low:g} to {high:g} Hz")
    if estimate.condition_number is not None:
        told.append(f"condition number {estimate.condition_number:.4g}")
    if _inflated((*estimate.parameters, *estimate.nuisance)):
        told.append("inflated: std as if all of the misfit were noise")
    if any(v.interval for v in estimate.parameters):
        told.append("95 %: interval by the profile of the misfit, which std does not describe")
    if _assuming(estimate.parameters):
        told.append(f"{ERR}: std of what errors of the assumptions below may shift")
    return [*told, *_together(estimate)]


def _together(estimate: Estimate) -> list[str]:
    names = [value.name for value in estimate.free]
    if len(names) < 2 or len(names) != len(estimate.covariance):
        return []
    found = np.abs(np.triu(estimate.correlation, 1))
    pairs = [(found[i, j], i, j) for i, j in zip(*np.nonzero(found > TOGETHER), strict=True)]
    pairs.sort(key=lambda pair: (-round(float(pair[0]), 6), pair[1], pair[2]))
    if not pairs:
        return []
    said = []
    groups = [set(group.tolist()) for group in coupled(found > TOGETHER)]
    for group in sorted(groups, key=lambda of: next(k for k, p in enumerate(pairs) if p[1] in of)):
        own = [(r, i, j) for r, i, j in pairs if i in group]
        if len(own) > MANY:
            said.append(f"{', '.join(names[i] for i in sorted(group))}, up to {own[0][0]:.3f}")
        else:
            told = ((names[i], names[j], estimate.correlation[i, j]) for _, i, j in own)
            said += [f"{one} with {other} {r:+.3f}" for one, other, r in told]
    more = f" and {len(said) - WORST} more" if len(said) > WORST else ""
    shown = (", " if len(said) == len(pairs) else "; ").join(said[:WORST])
    return [f"strongly correlated; known better in combination: {shown}{more}"]


def _by_noise(estimate: Estimate) -> str:
    worst = max((p.relative_error for p in estimate.prediction.values() if p), default=0.0)
    if worst < SPOILT or estimate.status != "ok" or estimate.misfit is None:
        return ""
    return (
        " (of little meaning here: noise of the readings or, near a lightly damped resonance, of "
        "the measured forces is as large as the motion; see the misfit)"
    )


def _table(title: str, values: Sequence[Value], *, intervals: bool = False) -> Table:
    if intervals:
        ends = [(value.name, *_ends(value), row_of(value)[-1]) for value in values]
        return table((title, "value", "95 % from", "to", "unit"), ends)
    shown = ["value", "std", "std %", *(["inflated"] if _inflated(values) else [])]
    shown += [ERR] if _assuming(values) else []
    shown += ["95 %"] if any(v.interval for v in values) else []
    shown += ["unit"]
    places = [0, *map(_COLUMNS.index, shown)]
    return table((title, *shown), [[cells[k] for k in places] for cells in map(row_of, values)])


def _alternative_table(estimate: Estimate) -> Table | None:
    if not estimate.alternatives:
        return None
    others = [dict(alternative.parameters) for alternative in estimate.alternatives]
    names = dict.fromkeys(name for other in others for name in other)
    own = {value.name: value.value for value in estimate.parameters}
    cost = [estimate.misfit and estimate.misfit.cost, *(a.cost for a in estimate.alternatives)]
    headings = ("other answers", "this", *(f"no. {i + 1}" for i in range(len(others))))
    every = own, *others
    rows = [(n, *("" if n not in each else f"{each[n]:.6g}" for each in every)) for n in names]
    costs = ("misfit", *("" if c is None else f"{c:.4g}" for c in cost))
    return table(headings, [*rows, costs])


def _mode_table(estimate: Estimate) -> Table:
    rows = []
    for m in estimate.modes:
        turning = f" at {m.speed_rad_s / (2 * math.pi):g} rev/s" if m.speed_rad_s else ""
        name = f"mode {m.mode}{turning}" + "".join(f", {n} = {v:g}" for n, v in m.parameters)
        pairs = [(name, m.frequency_hz, m.std_hz, m.fitted_hz, "Hz")]
        if m.damping_ratio is not None and m.damping_std and m.fitted_damping_ratio is not None:
            ratio = m.damping_ratio, m.damping_std, m.fitted_damping_ratio
            pairs.append((f"{name}, damping ratio", *ratio, ""))
        for label, value, std, fitted, unit in pairs:
            away = f"{(fitted - value) / std:+.2f}"
            rows.append((label, f"{value:.6g}", two_digits(std), f"{fitted:.6g}", away, unit))
    return table(("natural frequencies", "measured", "std", "fitted", "off by std", "unit"), rows)


def _unbalance_table(estimate: Estimate, *, intervals: bool) -> Table:
    rows: list[tuple[str, ...]] = []
    for plane in estimate.unbalance:
        unit, factor = _BY_HAND.get(plane.unit, (plane.unit, 1.0))
        sizes = (factor * plane.amount, None if plane.std is None else factor * plane.std)
        turned = plane.angle_rad, plane.angle_std_rad
        angles = [None if angle is None else math.degrees(angle) for angle in turned]
        both = Value("", "", *sizes), Value("", "", angles[0] or 0.0, angles[1])
        first, second = (_ends(x) if intervals else row_of(x)[1:3] for x in both)
        if angles[1] is not None and angles[1] > ANYWHERE:
            second = ("any", *("" for _ in second[1:]))
        rows.append((plane.plane, *first, unit, *second))
    spread = ("95 % from", "to") if intervals else ("std",)
    return table(("unbalance", "amount", *spread, "unit", "at deg", *spread), rows)


def _suspect_table(estimate: Estimate) -> Table | None:
    if estimate.status == "ok":
        return None
    rows = [
        (
            s.term,
            _plain(f"{s.drop:.3g}"),
            "" if s.share is None else f"{100 * s.share:.3g}",
            "" if s.value is None else f"{s.value:.4g}",
            "" if s.unit == "1" else s.unit,
        )
        for s in [s for s in estimate.suspects if s.share is None or s.share >= NAMED][:WORST]
    ]
    headings = ("suspect", "misfit reduction", "% of the excess", "fitted value", "unit")
    known = 5 if any(row[2] for row in rows) else 2  # results of version 1 hold the drop alone
    return table(headings[:known], (row[:known] for row in rows))


def _misfit_table(estimate: Estimate) -> Table | None:
    rows = sorted(estimate.line_misfit, key=lambda row: row.cost - row.expected, reverse=True)
    if estimate.misfit is None or estimate.misfit.p_value > NOTICED:
        return None
    several = len({row.record for row in rows}) > 1
    cells = [
        (
            f"{row.frequency_hz:.6g} Hz" + f", record {row.record + 1}" * several,
            _plain(f"{row.cost:.4g}"),
            _plain(f"{row.expected:.4g}"),
        )
        for row in rows[:WORST]
    ]
    return table(("misfit by line", "found", "by noise"), cells)


def _inflated(values: Sequence[Value]) -> bool:
    return any(v.std and v.std_inflated and v.std_inflated > 1.05 * v.std for v in values)


def _assuming(values: Sequence[Value]) -> bool:
    return any(v.std and v.std_assumed and v.std_assumed > 0.1 * v.std for v in values)


ERR = "if assumptions err"  # the heading of std_assumed
_COLUMNS = ("", "value", "std", "std %", "inflated", ERR, "95 %", "unit")


def row_of(value: Value) -> tuple[str, ...]:
    """Return the cells of `_COLUMNS`."""
    unit = "" if value.unit == "1" else value.unit
    inflated = "" if value.std_inflated is None else two_digits(value.std_inflated)
    shift, least = value.std_assumed, 1e-6 * (value.std or 0.0)  # below it there is rounding only
    assumed = "" if shift is None else "0" if shift < least else two_digits(shift)
    rest = inflated, assumed, interval_text(value), unit
    if value.std and abs(value.value) < ROUNDING * value.std:
        return value.name, "0", two_digits(value.std), "", *rest
    if value.fixed or value.std is None or not value.std > 0:
        std = "fixed" if value.fixed else "-" if value.std is None else f"{value.std:g}"
        return value.name, f"{value.value:.6g}", std, *[""] * 4, unit
    far = value.std > FAR * abs(value.value)  # a percentage of what may as well be zero
    percent = "" if far else two_digits(100 * value.std / abs(value.value))
    return value.name, figures(value.value, value.std), two_digits(value.std), percent, *rest


def assuming_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """Return a table without the columns of what nothing assumed may move."""
    kept = [k for k, head in enumerate(headings) if head != ERR or {r[k] for r in rows} - {"-"}]
    return table([headings[k] for k in kept], [[row[k] for k in kept] for row in rows])


def _ends(value: Value) -> tuple[str, ...]:
    """Return a value and the ends of its 95 % interval, all to the same digit."""
    std = value.std_inflated or value.std
    if value.fixed or not std or not np.isfinite([value.value, std]).all():
        _, number, told = row_of(value)[:3]
        return number, told if told == "fixed" else "-", "" if told == "fixed" else "-"
    even = (value.value - HALF_WIDTH * std, value.value + HALF_WIDTH * std)
    low, high = value.interval or even
    last = int(np.floor(np.log10(std))) - 1
    largest = max(abs(end) for end in (*even, low, high) if math.isfinite(end))
    digits = max(int(np.floor(np.log10(largest))) - last + 1, 1)
    if last < 0 and largest < 1e6 and last > -9:
        return f"{value.value:.{-last}f}", f"{low:.{-last}f}", f"{high:.{-last}f}"
    return tuple(_plain(f"{number:#.{min(digits, 12)}g}") for number in (value.value, low, high))


def interval_text(value: Value) -> str:
    """Return the interval of a value that has one of its own, empty of others."""
    if value.interval is None:
        return ""
    (_, low, high), (below, above) = _ends(value), map(math.isinf, value.interval)
    if below or above:
        return "any" if below and above else f"below {high}" if below else f"above {low}"
    return f"{low} to {high}"


def figures(value: float, spread: float) -> str:
    """Return a value to the second digit of its spread."""
    if value == 0 or not (math.isfinite(value) and 0 < spread < math.inf):
        return f"{value:.6g}"
    digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(spread)) + 2
    return _plain(f"{value:#.{min(max(digits, 2), 12)}g}")


def two_digits(number: float) -> str:
    return _plain(f"{number:#.2g}") if math.isfinite(number) else ""


def _plain(text: str) -> str:
    """Return a number without a power of ten where it has less than eight digits."""
    mantissa, _, power = text.partition("e")
    if power.startswith("+") and int(power) < 7:
        return f"{float(text):.0f}"
    return text.rstrip(".") if not power else f"{mantissa.rstrip('.')}e{power}"


def _percent(prediction: Prediction) -> str:
    if prediction.relative_error > FAR:  # of a rotor that floats forces alone tell no motion
        return f"more than {100 * FAR:.0f} %"
    return f"{100 * prediction.relative_error:.3g} %"
