"""`Estimate`: the one result of every estimator; its JSON."""

from __future__ import annotations

import math
from codecs import BOM_UTF8
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from reprlib import Repr
from textwrap import shorten
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    Field,
    PlainSerializer,
    Strict,
    TypeAdapter,
    ValidationError,
)
from pydantic_core import to_json

from rotorid.errors import InputError, ReadError
from rotorid.evidence import Count, Evidence, Number
from rotorid.files import read_regular
from rotorid.limits import RESULT_BYTES, RESULT_OBJECTS, RESULT_VALUES
from rotorid.record import Check, Floats
from rotorid.tables import Page, Table, page_html, page_text, table
from rotorid.values import ByContent, read_only
from rotorid.writing import write_whole

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

SCHEMA = "rotorid-estimate/2"
NOTICED = 0.01  # p-value below which the tables say where the misfit lies
WORST = 8  # lines, equations, suspects or pairs that they list: what a screen holds
SPOILT = 0.3  # relative error of an accepted prediction from which on its reason is told
FAR = 10.0  # deviations in a value, from which on it is not shown in percent
MANY = 4  # pairs of one group of parameters, from which on its names are told once
TOGETHER = 0.95  # correlation from which two parameters are named as known together
HALF_WIDTH = 1.959964  # deviations on either side that hold 95 % of a normal distribution
EDITED = 1e-6  # share by which covariance and deviations of a file differ that was not edited
_BY_HAND = {"kg m": ("g mm", 1e6), "kg m^2": ("g mm^2", 1e9)}  # units in which one balances
READABLE = ("rotorid-estimate/1", SCHEMA)
Status = Literal["ok", "rejected", "not_identifiable", "not_converged"]

Optional = Annotated[float, Strict()] | None
Flag = Annotated[bool, Strict()]


@dataclass(frozen=True)
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


@dataclass(frozen=True)
class Misfit:
    """The misfit at the estimate, against what noise alone would leave."""

    cost: Number
    expected: Number
    dof: Count
    p_value: Number


@dataclass(frozen=True)
class LineMisfit:
    """The misfit of one line of one record (counted from 0), against what noise would leave."""

    record: Count
    frequency_hz: Number
    cost: Number
    expected: Number


@dataclass(frozen=True)
class EquationMisfit:
    """The misfit of one equation of one record (counted from 0), against what noise would leave."""

    record: Count
    equation: str
    cost: Number
    expected: Number


@dataclass(frozen=True)
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


@dataclass(frozen=True)
class Alternative:
    """Another answer that fits as well: its misfit, and ``(name, value)`` of each parameter."""

    cost: Number
    parameters: Annotated[
        tuple[tuple[str, Number], ...], BeforeValidator(_pairs), PlainSerializer(_rows)
    ]


@dataclass(frozen=True)
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
    parameters: Annotated[
        tuple[tuple[str, Number], ...], BeforeValidator(_pairs), PlainSerializer(_rows)
    ] = ()


@dataclass(frozen=True)
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


@dataclass(frozen=True)
class SourceFile:
    """A file that went into an estimate, and the sha256 of its content in hexadecimal.

    Empty where the file is beyond 16 GB, or made of holes for the most part.
    """

    file: str
    sha256: str


@dataclass(frozen=True)
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
    held: Annotated[
        tuple[tuple[str, Number], ...], BeforeValidator(_pairs), PlainSerializer(_rows)
    ] = ()
    environment: str = ""


@dataclass(frozen=True)
class Prediction:
    """How well an estimate predicts one channel: ``|residual| / |measured|`` on the lines."""

    relative_error: Number


def _undetermined(value: Value) -> Value:
    """Give what is not determined no finite deviation either."""
    if math.isnan(value.value) and value.std is None:
        return replace(value, std=math.nan, std_inflated=math.nan)
    return value


def _square(rows: Any) -> Floats:
    """Return a square matrix from its rows."""
    if any(len(row) != len(rows) for row in rows):
        raise ValueError("a square matrix")
    return np.array(rows, dtype=float).reshape(len(rows), len(rows))


if TYPE_CHECKING:
    Values = tuple[Value, ...]
    Covariance = Floats
else:
    Values = tuple[Annotated[Value, AfterValidator(_undetermined)], ...]
    Covariance = Annotated[
        tuple[tuple[Number, ...], ...], AfterValidator(_square), PlainSerializer(np.ndarray.tolist)
    ]


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(ByContent):
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
    suspects : sequence of Suspect
    prediction : mapping of input name to Prediction or None
        ``None`` for an input that is zero.
    lines_hz : sequence of float
    periods : int
    warnings : sequence of str
    condition_number : float or None
        Of the scaled least-squares problem.
    line_misfit : sequence of LineMisfit
        The misfit line by line, for methods with a likelihood.
    equation_misfit : sequence of EquationMisfit
        The same equation by equation.
    alternatives : sequence of Alternative
        Other answers that fit as well; not empty means that the status is ``not_identifiable``.
    modes : sequence of ModeFit
        Measured natural frequencies beside those of the estimate.
    unbalance : sequence of Unbalance
        What the parameters say of the unbalance of each plane.
    checks : sequence of Check
        What the data showed before any model.
    provenance : Provenance or None
        Files, experiment, version and command; for an estimate made in Python the model alone.
    evidence : Evidence or None
        What a report shows of the records; see `with_evidence`.

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
    suspects: tuple[Suspect, ...] = ()
    prediction: dict[str, Prediction | None] = field(default_factory=dict)
    lines_hz: tuple[Number, ...] = ()
    periods: Count = 0
    warnings: tuple[str, ...] = ()
    condition_number: Optional = None
    line_misfit: tuple[LineMisfit, ...] = ()
    equation_misfit: tuple[EquationMisfit, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    modes: tuple[ModeFit, ...] = ()
    unbalance: tuple[Unbalance, ...] = ()
    checks: tuple[Check, ...] = ()
    provenance: Provenance | None = None
    evidence: Evidence | None = None

    def __post_init__(self) -> None:
        covariance = np.array(self.covariance, dtype=float)
        object.__setattr__(self, "covariance", read_only(covariance))
        if self.status == "ok" and (found := _not_finite(self)):
            raise InputError(
                f"no finite {found} in an estimate called ok",
                "finite numbers",
                "check units and scales of the columns, or call it not_converged",
            )

    def __getitem__(self, name: str) -> Value:
        """Return a parameter, nuisance or derived quantity by name."""
        everything = (*self.parameters, *self.nuisance, *self.derived)
        for value in everything:
            if value.name == name:
                return value
        raise KeyError(f"{name!r}; there are: {', '.join(v.name for v in everything)}")

    def value(self, name: str) -> float:
        """Return the value of a quantity, in its unit."""
        return self[name].value

    def std(self, name: str) -> float | None:
        """Return the standard deviation of a quantity, in its unit."""
        return self[name].std

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
    def value_tables(self) -> list[Table]:
        """The parameters, nuisance and derived quantities.

        What is derived by its own name alone is left out, and so are inflated deviations where
        they are those that stand beside them.
        """
        return _value_tables(self)

    @property
    def tables(self) -> list[Table]:
        """What matters first: values, unbalance, what may be wrong, and what follows from them."""
        return _tables(self)

    @property
    def notes(self) -> list[str]:
        """Sentences on the fit, the data and the warnings, in text."""
        return _notes(self)

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
        return _page(self, intervals=intervals)

    def __str__(self) -> str:
        return page_text(self.page)

    def _repr_html_(self) -> str:
        """Return the tables for a notebook."""
        return page_html(self.page)

    def with_(self, **changes: Any) -> Estimate:
        """Return a copy with some fields replaced."""
        return replace(self, **changes)

    def plot(self) -> Figure:
        """Draw the deviations in percent and the correlations; returns a matplotlib figure.

        Raises
        ------
        InputError
            For an estimate without covariance.
        """
        from rotorid.plots.estimates import correlation, deviations
        from rotorid.plots.still import figure_of  # takes its time to load

        if not 0 < len(self.free) == len(self.covariance):
            raise InputError(
                "an estimate without covariance", "one row per free parameter", "see its status"
            )
        deviation = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        size = np.abs([value.value for value in self.free])
        with np.errstate(divide="ignore", invalid="ignore"):
            percent = 100 * deviation / size
        names = [value.name for value in self.free]
        return figure_of([deviations(names, percent), correlation(names, self.correlation)], 2)

    def to_frame(self) -> pd.DataFrame:
        """Return every quantity as a row of a pandas data frame, indexed by name.

        What is derived by its own name alone is there once, as a parameter.

        Raises
        ------
        ImportError
            Where pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError:
            raise ImportError(
                "no pandas for a data frame; install it: pip install pandas"
            ) from None
        kinds = {
            "parameter": self.parameters,
            "nuisance": self.nuisance,
            "derived": _derived(self)[0][1],
        }
        rows = [{**vars(v), "kind": kind} for kind, values in kinds.items() for v in values]
        columns = ["name", "kind", "unit", "value", "std", "std_inflated", "fixed"]
        return pd.DataFrame(rows, columns=columns).set_index("name")

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data, as the result file holds it."""
        from rotorid import __version__

        data = _adapter().dump_python(self, mode="json", exclude=_LEFT_OUT)
        return {"schema": SCHEMA, "version": __version__, **data}

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
        data = self.to_dict()
        try:
            return _json(data)
        except ValueError:  # names of files are bytes, and may be no text
            return _json(_encodable(data))


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


_TOLD = 10_000  # faults of a file from which on none is picked out: each costs what it holds


def _not_finite(estimate: Estimate) -> str:
    """Name what is not finite of an answer; what is derived may be undetermined."""
    for value in (*estimate.parameters, *estimate.nuisance, *estimate.derived):
        known = [value.std, value.std_inflated] if math.isfinite(value.value) else []
        if value not in estimate.derived:
            known.append(value.value)
        if not all(x is None or math.isfinite(x) for x in known):
            return f"{value.name} or deviation of it"
    misfit = estimate.misfit
    if misfit is not None and not math.isfinite(misfit.cost):
        return "misfit"
    stated = [value.std is not None for value in estimate.free]
    covariance = estimate.covariance
    if len(stated) == len(covariance):  # without scatter nothing is stated of a value
        covariance = covariance[np.ix_(stated, stated)]
    return "" if np.isfinite(covariance).all() else "covariance"


def _encodable(data: Any) -> Any:
    """Return plain data with the bytes of names that are no UTF-8 written out."""
    if isinstance(data, dict):
        return {_encodable(key): _encodable(value) for key, value in data.items()}
    if isinstance(data, list):
        return [_encodable(value) for value in data]
    is_text = isinstance(data, str)
    return data.encode("utf-8", "backslashreplace").decode() if is_text else data


_SHORT = Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 60
_EVERY = {"__all__": {"fixed", "std_inflated"}}
_LEFT_OUT: Any = {"nuisance": _EVERY, "derived": _EVERY}


@cache
def _adapter() -> TypeAdapter[Estimate]:
    """Return what reads and writes estimates; to build it takes its time."""
    return TypeAdapter(Estimate)


def _page(estimate: Estimate, *, intervals: bool = False) -> Page:
    """Return all there is to read: status, tables, and notes on them."""
    head = f"{estimate.model}, {estimate.method}: {estimate.status}"
    return [head, *_tables(estimate, intervals=intervals), *_notes(estimate)]


def _value_tables(estimate: Estimate, *, intervals: bool = False) -> list[Table]:
    """Return the parameters, nuisance and derived quantities."""
    return [
        _table(title, values, intervals=intervals)
        for title, values in (*_own(estimate), *_derived(estimate))
        if values
    ]


def _tables(estimate: Estimate, *, intervals: bool = False) -> list[Table]:
    """Return the values, unbalance, what may be wrong, and what follows from the values."""

    def shown(parts: list[tuple[str, tuple[Value, ...]]]) -> list[Table]:
        return [_table(title, values, intervals=intervals) for title, values in parts if values]

    late = estimate.method == "ml"  # products of the parameters, which few want to read
    parameters, *others = _own(estimate)
    return [
        *shown([parameters]),
        *([] if late else shown(_derived(estimate))),
        *_unbalance_tables(estimate, intervals=intervals),
        *shown(others),
        *_mode_tables(estimate),
        *_alternative_tables(estimate),
        *_suspect_tables(estimate),
        *_misfit_tables(estimate),
        *(shown(_derived(estimate)) if late else []),
    ]


def _notes(estimate: Estimate) -> list[str]:
    """Return sentences on the fit, the data, what was taken as exact, and the warnings."""
    return [
        *_fit_notes(estimate),
        *_together(estimate),
        *(
            f"{c.verdict}, {c.check}{f' of {c.channel}' if c.channel else ''}: {c.found}"
            for c in estimate.checks
            if c.verdict != "ok"
        ),
        *(f"warning: {warning}" for warning in estimate.warnings),
    ]


def _fit_notes(estimate: Estimate) -> list[str]:
    told = []
    if estimate.misfit is not None:
        m = estimate.misfit
        told.append(
            f"misfit {m.cost:.4g} where noise alone leaves {m.expected:.4g} "
            f"({m.dof} degrees of freedom), p = {m.p_value:.2g}"
        )
    errors = {n: "zero" if p is None else _percent(p) for n, p in estimate.prediction.items()}
    if errors:
        shown = ", ".join(f"{name} {error}" for name, error in errors.items())
        told.append(f"predicted against measured, {_by_noise(estimate)}off by: {shown}")
    if estimate.lines_hz:
        low, high = min(estimate.lines_hz), max(estimate.lines_hz)
        whole = f"{estimate.periods} periods" if estimate.periods > 1 else "no periods"
        told.append(f"{whole}, {len(estimate.lines_hz)} lines from {low:g} to {high:g} Hz")
    if estimate.condition_number is not None:
        told.append(f"condition number {estimate.condition_number:.4g}")
    if _inflated((*estimate.parameters, *estimate.nuisance)):
        told.append("inflated: deviations as if all of the misfit were noise")
    return told


def _together(estimate: Estimate) -> list[str]:
    """Name the pairs that are known together far better than one by one."""
    names = [value.name for value in estimate.free]
    if len(names) < 2 or len(names) != len(estimate.covariance):
        return []
    found = np.abs(np.triu(estimate.correlation, 1))
    pairs = [(found[i, j], i, j) for i, j in zip(*np.nonzero(found > TOGETHER), strict=True)]
    pairs.sort(key=lambda pair: (-round(float(pair[0]), 6), pair[1], pair[2]))
    if not pairs:
        return []
    said = []
    for group in _linked([(i, j) for _, i, j in pairs]):
        own = [(r, i, j) for r, i, j in pairs if i in group]
        if len(own) > MANY:
            said.append(f"{', '.join(names[i] for i in sorted(group))}, up to {own[0][0]:.3f}")
        else:
            told = ((names[i], names[j], estimate.correlation[i, j]) for _, i, j in own)
            said += [f"{one} with {other} {r:+.3f}" for one, other, r in told]
    more = f" and {len(said) - WORST} more" if len(said) > WORST else ""
    shown = (", " if len(said) == len(pairs) else "; ").join(said[:WORST])
    return [f"correlated, so known together better than one by one: {shown}{more}"]


def _linked(pairs: Sequence[tuple[int, int]]) -> list[set[int]]:
    """Return the groups that pairs link, in the order in which they begin."""
    groups: list[set[int]] = []
    for pair in pairs:
        met = [group for group in groups if group & {*pair}]
        if met:
            met[0].update(pair, *met[1:])
            groups = [group for group in groups if all(group is not other for other in met[1:])]
        else:
            groups.append({*pair})
    return groups


def _by_noise(estimate: Estimate) -> str:
    """Say what makes a prediction from the forces worse than none, where the cost is in order."""
    worst = max((p.relative_error for p in estimate.prediction.values() if p), default=0.0)
    if worst < SPOILT or estimate.status != "ok" or estimate.misfit is None:
        return ""
    return (
        "which says little here: beside a resonance with hardly any damping the noise of the "
        "measured forces moves the model as far as the machine moved; the misfit tells the fit; "
    )


def _own(estimate: Estimate) -> list[tuple[str, tuple[Value, ...]]]:
    return [("parameters", estimate.parameters), ("nuisance", estimate.nuisance)]


def _derived(estimate: Estimate) -> list[tuple[str, tuple[Value, ...]]]:
    """Return what is derived, but for what is so by its own name alone."""
    names = {value.name for value in estimate.parameters}
    return [("derived", tuple(v for v in estimate.derived if v.name not in names))]


def _table(title: str, values: Sequence[Value], *, intervals: bool = False) -> Table:
    """Return name, value, deviation, the same in percent, inflated, unit; or 95 % intervals."""
    if intervals:
        ends = [(value.name, *_ends(value), _row(value)[-1]) for value in values]
        return table((title, "value", "95 % from", "to", "unit"), ends)
    if _inflated(values):
        return table((title, "value", "std", "std %", "inflated", "unit"), map(_row, values))
    rows = [(*cells[:4], cells[5]) for cells in map(_row, values)]
    return table((title, "value", "std", "std %", "unit"), rows)


def _alternative_tables(estimate: Estimate) -> list[Table]:
    """Return the other answers beside this one."""
    if not estimate.alternatives:
        return []
    others = [dict(alternative.parameters) for alternative in estimate.alternatives]
    names = dict.fromkeys(name for other in others for name in other)
    own = {value.name: value.value for value in estimate.parameters}
    cost = [estimate.misfit and estimate.misfit.cost, *(a.cost for a in estimate.alternatives)]
    headings = ("other answers", "this", *(f"no. {i + 1}" for i in range(len(others))))
    rows = [
        (name, *("" if name not in o else f"{o[name]:.6g}" for o in (own, *others)))
        for name in names
    ]
    costs = ("misfit", *("" if c is None else f"{c:.4g}" for c in cost))
    return [table(headings, [*rows, costs])]


def _mode_tables(estimate: Estimate) -> list[Table]:
    """Return measured natural frequencies and damping ratios beside those of the estimate."""
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
            rows.append((label, f"{value:.6g}", _two_digits(std), f"{fitted:.6g}", away, unit))
    headings = ("natural frequencies", "measured", "std", "fitted", "off by std", "unit")
    return [table(headings, rows)] if rows else []


def _unbalance_tables(estimate: Estimate, *, intervals: bool) -> list[Table]:
    """Return amount and angle of the unbalance in each plane, in units of a balancer."""
    rows: list[tuple[str, ...]] = []
    for plane in estimate.unbalance:
        unit, factor = _BY_HAND.get(plane.unit, (plane.unit, 1.0))
        sizes = (factor * plane.amount, None if plane.std is None else factor * plane.std)
        angles = [
            None if a is None else math.degrees(a) for a in (plane.angle_rad, plane.angle_std_rad)
        ]
        amount, angle = Value("", "", *sizes), Value("", "", angles[0] or 0.0, angles[1])
        if intervals:
            rows.append((plane.plane, *_ends(amount), unit, *_ends(angle)))
        else:
            first, second = (_row(value)[1:3] for value in (amount, angle))
            rows.append((plane.plane, *first, unit, *second))
    headings: tuple[str, ...]
    if intervals:
        headings = ("unbalance", "amount", "95 % from", "to", "unit", "at deg", "95 % from", "to")
    else:
        headings = ("unbalance", "amount", "std", "unit", "at deg", "std")
    return [table(headings, rows)] if rows else []


def _suspect_tables(estimate: Estimate) -> list[Table]:
    """Return what the model may lack, what explains most first; nothing where nothing is wrong."""
    if estimate.status == "ok":
        return []
    rows = [
        (
            s.term,
            _plain(f"{s.drop:.3g}"),
            "" if s.share is None else f"{100 * s.share:.3g}",
            "" if s.value is None else f"{s.value:.4g}",
            "" if s.unit == "1" else s.unit,
        )
        for s in estimate.suspects[:WORST]
    ]
    headings = ("suspect", "misfit falls by", "% of the excess", "if freed", "unit")
    known = 5 if any(row[2] for row in rows) else 2  # results of version 1 hold the drop alone
    return [table(headings[:known], (row[:known] for row in rows))] if rows else []


def _misfit_tables(estimate: Estimate) -> list[Table]:
    """Return where the misfit lies, worst first; nothing where it is what noise leaves."""
    if estimate.misfit is None or estimate.misfit.p_value > NOTICED:
        return []
    several = len({row.record for row in estimate.line_misfit}) > 1
    lines = [
        (f"{row.frequency_hz:.6g} Hz" + f", record {row.record + 1}" * several, row)
        for row in estimate.line_misfit
    ]
    equations = [
        (row.equation + f", record {row.record + 1}" * several, row)
        for row in estimate.equation_misfit
    ]
    return [
        _misfit_table(title, rows)
        for title, rows in (("misfit by line", lines), ("misfit by equation", equations))
        if rows
    ]


def _misfit_table(title: str, rows: Sequence[tuple[str, LineMisfit | EquationMisfit]]) -> Table:
    def excess(named: tuple[str, LineMisfit | EquationMisfit]) -> float:
        return named[1].cost - named[1].expected

    worst = sorted(rows, key=excess, reverse=True)[:WORST]
    cells = [
        (name, _plain(f"{row.cost:.4g}"), _plain(f"{row.expected:.4g}")) for name, row in worst
    ]
    return table((title, "found", "by noise"), cells)


def _inflated(values: Sequence[Value]) -> bool:
    return any(v.std and v.std_inflated and v.std_inflated > 1.05 * v.std for v in values)


def _row(value: Value) -> tuple[str, ...]:
    unit = "" if value.unit == "1" else value.unit
    inflated = "" if value.std_inflated is None else _two_digits(value.std_inflated)
    if value.value == 0 and value.std:
        return value.name, "0", _two_digits(value.std), "", inflated, unit
    if value.fixed or value.std is None or not value.std > 0:
        std = "fixed" if value.fixed else "-" if value.std is None else f"{value.std:g}"
        return value.name, f"{value.value:.6g}", std, "", "", unit
    digits = 6
    if np.isfinite([value.value, value.std]).all():
        digits = int(np.floor(np.log10(abs(value.value))) - np.floor(np.log10(value.std))) + 2
    far = value.std > FAR * abs(value.value)  # a percentage of what may as well be zero
    percent = "" if far else _two_digits(100 * value.std / abs(value.value))
    number = _plain(f"{value.value:#.{min(max(digits, 2), 12)}g}")
    return value.name, number, _two_digits(value.std), percent, inflated, unit


def _ends(value: Value) -> tuple[str, str, str]:
    """Return a value and the ends of its 95 % interval, all to the same digit."""
    std = value.std_inflated or value.std
    if value.fixed or not std or not np.isfinite([value.value, std]).all():
        _, number, told = _row(value)[:3]
        return number, told if told == "fixed" else "-", "" if told == "fixed" else "-"
    low, high = (value.value + side * HALF_WIDTH * std for side in (-1, 1))
    last = int(np.floor(np.log10(std))) - 1
    largest = max(abs(low), abs(high))
    digits = max(int(np.floor(np.log10(largest))) - last + 1, 1)
    if last < 0 and largest < 1e6 and last > -9:
        return f"{value.value:.{-last}f}", f"{low:.{-last}f}", f"{high:.{-last}f}"
    shown = (_plain(f"{number:#.{min(digits, 12)}g}") for number in (value.value, low, high))
    first, second, third = shown
    return first, second, third


def _two_digits(number: float) -> str:
    return _plain(f"{number:#.2g}")


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


def load_estimate(path: str | Path) -> Estimate:
    """Read a result file.

    Parameters
    ----------
    path : str or Path
        A file that `Estimate.save` wrote.

    Returns
    -------
    Estimate

    Raises
    ------
    ReadError
        Where the file cannot be read or is no result file.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "run.json"
    >>> Estimate("one", "ls", "ok", (Value("m", "kg", 2.0, std=0.01),)).save(path)
    >>> load_estimate(path).value("m")
    2.0
    """
    file, cure = str(path), "write one with identify --json"
    content = read_regular(path, RESULT_BYTES, "a result file", cure).removeprefix(BOM_UTF8)
    if content.count(b",") > RESULT_VALUES or content.count(b"{") > RESULT_OBJECTS:
        raise ReadError(f"more than {RESULT_VALUES} values", "a result file", cure, file=file)
    try:
        head = _Head.model_validate_json(content)
        if head.schema_ not in READABLE:
            found, expected = f"schema {head.schema_!r}", " or ".join(map(repr, READABLE))
            raise ReadError(found, expected, cure, file=file)
        estimate = _adapter().validate_json(content)
    except ValidationError as error:
        if (count := error.error_count()) > _TOLD:
            raise ReadError(f"{count} faults", "a result file", cure, file=file) from None
        fault = error.errors(include_url=False)[0]
        raise _refusal(fault, cure).at(file=file) from None
    if (wrong := _contradiction(estimate)) is not None:
        place, said = wrong
        expected = "deviations of zero or more that are those of the covariance"
        raise ReadError(said, expected, f"{cure}: this one was edited", file=file, place=place)
    return estimate


def _contradiction(estimate: Estimate) -> tuple[str, str] | None:
    """Return where deviations and covariance cannot be, or are not those of each other."""
    for kind in ("parameters", "nuisance", "derived"):
        for number, value in enumerate(getattr(estimate, kind)):
            for key in ("std", "std_inflated"):
                if (getattr(value, key) or 0.0) < 0:
                    return f"{kind}.{number}.{key}", f"{getattr(value, key):g}"
    free, covariance = estimate.free, estimate.covariance
    if not len(covariance):
        return None
    if len(free) != len(covariance):
        return "covariance", f"{len(covariance)} rows for {len(free)} free quantities"
    size = np.sqrt(np.abs(np.diag(covariance)))
    std = np.array([s if v.std is None else v.std for v, s in zip(free, size, strict=True)])
    known = np.flatnonzero(np.isfinite(std) & np.isfinite(covariance).all(axis=1) & (std > 0))
    scaled = covariance[np.ix_(known, known)] / std[known, None] / std[known]
    off = np.abs(np.diag(scaled) - 1) > EDITED
    if off.any():
        i = int(known[off.argmax()])
        return "covariance", f"{covariance[i, i]:g} where {free[i].name} has a std of {std[i]:g}"
    if (np.abs(scaled - scaled.T) > EDITED).any():
        return "covariance", "a matrix that is not symmetric"
    if np.linalg.eigvalsh(scaled).min(initial=0.0) < -EDITED * len(scaled):
        return "covariance", "a combination of a negative variance"
    return None


def check_units(estimate: Estimate, units: Mapping[str, str]) -> None:
    """Refuse values in other units than those that a model gives its parameters.

    Raises
    ------
    InputError
        With the first of them.
    """
    for value in estimate.parameters:
        unit = units.get(value.name.partition("[")[0], value.unit)
        if value.unit != unit:
            raise InputError(
                f"{value.name} in {value.unit[:60]!r}",
                f"{unit}, as its model has it",
                "identify again: the values of a result are in SI",
                place="parameters",
            )


class _Head(BaseModel, defer_build=True):
    """What says which kind of file it is."""

    schema_: str = Field(alias="schema")


def _refusal(fault: Any, cure: str) -> InputError:
    """Turn the first fault that pydantic found into one line."""
    place = ".".join(str(part)[:60] for part in fault["loc"])
    if fault["type"] == "json_invalid":
        return ReadError(f"no JSON ({fault['ctx']['error']})", "a result file", cure)
    if fault["type"] == "missing":
        return ReadError("no such key", "a value", cure, place=place)
    found = _SHORT.repr(fault["input"])
    expected = fault["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
    return ReadError(found, expected[0].lower() + expected[1:], cure, place=place)
