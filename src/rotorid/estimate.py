"""`Estimate`: the one result of every estimator; its JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from html import escape
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from rotorid.errors import ReadError
from rotorid.record import Floats

SCHEMA = "rotorid-estimate/1"
Status = Literal["ok", "rejected", "not_identifiable", "not_converged"]


@dataclass(frozen=True)
class Value:
    """A named quantity with its standard deviation.

    ``std`` and ``std_inflated`` are ``None`` where the method gives none; a fixed value has
    ``std`` 0.
    """

    name: str
    unit: str
    value: float
    std: float | None = None
    std_inflated: float | None = None
    fixed: bool = False


@dataclass(frozen=True)
class Misfit:
    """The cost at the estimate against what noise alone would leave."""

    cost: float
    expected: float
    dof: int
    p_value: float


@dataclass(frozen=True)
class LineMisfit:
    """The cost of one line of one record (counted from 0) against what noise would leave."""

    record: int
    frequency_hz: float
    cost: float
    expected: float


@dataclass(frozen=True)
class Suspect:
    """A term missing from the model, and the drop of the cost if it were there."""

    term: str
    drop: float


@dataclass(frozen=True)
class Prediction:
    """How well an estimate predicts one channel: |residual| / |measured| on the lines."""

    relative_error: float


@dataclass(frozen=True)
class Estimate:
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
    <BLANKLINE>
    """

    model: str
    method: str
    status: Status
    parameters: tuple[Value, ...]
    nuisance: tuple[Value, ...] = ()
    derived: tuple[Value, ...] = ()
    covariance: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    misfit: Misfit | None = None
    suspects: tuple[Suspect, ...] = ()
    prediction: dict[str, Prediction | None] = field(default_factory=dict)
    lines_hz: tuple[float, ...] = ()
    periods: int = 0
    warnings: tuple[str, ...] = ()
    condition_number: float | None = None
    line_misfit: tuple[LineMisfit, ...] = ()

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
    def tables(self) -> dict[str, list[tuple[str, ...]]]:
        """Rows of text of the parameters, nuisance and derived quantities, headings first.

        What is derived by its own name alone is left out, and so are inflated deviations where
        they are those that stand beside them.
        """
        names = {value.name for value in self.parameters}
        parts = {
            "parameters": self.parameters,
            "nuisance": self.nuisance,
            "derived": tuple(value for value in self.derived if value.name not in names),
        }
        return {title: _table(title, values) for title, values in parts.items() if values}

    @property
    def notes(self) -> list[str]:
        """Sentences on the fit, the data and the warnings, in text."""
        notes = []
        if self.misfit is not None:
            m = self.misfit
            notes.append(
                f"cost {m.cost:.4g} where {m.expected:.4g} is expected "
                f"({m.dof} degrees of freedom), p = {m.p_value:.2g}"
            )
        errors = {n: "zero" if p is None else _percent(p) for n, p in self.prediction.items()}
        if errors:
            shown = ", ".join(f"{name} {error}" for name, error in errors.items())
            notes.append(f"relative error of the prediction: {shown}")
        if self.suspects:
            found = ", ".join(f"{s.term} ({s.drop:.3g})" for s in self.suspects[:5])
            notes.append(f"first suspects (drop of the cost): {found}")
        if self.lines_hz:
            low, high = min(self.lines_hz), max(self.lines_hz)
            notes.append(
                f"{self.periods} periods, {len(self.lines_hz)} lines from {low:g} to {high:g} Hz"
            )
        if self.condition_number is not None:
            notes.append(f"condition number {self.condition_number:.4g}")
        if _inflated((*self.parameters, *self.nuisance)):
            notes.append("inflated: deviations as if all of the misfit were noise")
        return [*notes, *(f"warning: {warning}" for warning in self.warnings)]

    def __str__(self) -> str:
        lines = [f"{self.model}, {self.method}: {self.status}"]
        for rows in self.tables.values():
            widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
            lines += ["", *(_aligned(row, widths) for row in rows)]
        return "\n".join([*lines, "", *self.notes])

    def _repr_html_(self) -> str:
        """Return the tables for a notebook."""
        html = [f"<p><b>{escape(f'{self.model}, {self.method}: {self.status}')}</b></p>"]
        for headings, *rows in self.tables.values():
            cells = [f"<th>{escape(text)}</th>" for text in headings]
            html += ["<table><tr>", *cells, "</tr>"]
            for row in rows:
                html += ["<tr>", *(f"<td>{escape(text)}</td>" for text in row), "</tr>"]
            html.append("</table>")
        return "".join([*html, *(f"<p>{escape(note)}</p>" for note in self.notes)])

    def with_(self, **changes: Any) -> Estimate:
        """Return a copy with some fields replaced."""
        return replace(self, **changes)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data, as the result file holds it (interface, schema 1)."""
        from rotorid import __version__

        data = asdict(self)
        data["covariance"] = self.covariance.tolist()
        for row in (*data["nuisance"], *data["derived"]):
            del row["fixed"], row["std_inflated"]
        return {"schema": SCHEMA, "version": __version__, **data}

    def save(self, path: str | Path) -> None:
        """Write the result file (JSON).

        Raises
        ------
        OSError
            Where the file cannot be written.
        """
        text = json.dumps(_finite(self.to_dict()), indent=2, allow_nan=False)
        Path(path).write_text(text + "\n", encoding="utf-8")


def _table(title: str, values: Sequence[Value]) -> list[tuple[str, ...]]:
    """Return headings and rows: name, value, deviation, the same in percent, inflated, unit."""
    rows = [(title, "value", "std", "std %", "inflated", "unit"), *map(_row, values)]
    return rows if _inflated(values) else [(*row[:4], row[5]) for row in rows]


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
    percent = _two_digits(100 * value.std / abs(value.value))
    number = f"{value.value:#.{min(max(digits, 2), 12)}g}".rstrip(".")
    return value.name, number, _two_digits(value.std), percent, inflated, unit


def _two_digits(number: float) -> str:
    return f"{number:#.2g}".rstrip(".")


def _percent(prediction: Prediction) -> str:
    return f"{100 * prediction.relative_error:.3g} %"


def _aligned(row: Sequence[str], widths: Sequence[int]) -> str:
    """Return a line: names and units to the left, numbers to the right."""
    last = len(row) - 1
    cells = [
        text.ljust(width) if i in (0, last) else text.rjust(width)
        for i, (text, width) in enumerate(zip(row, widths, strict=True))
    ]
    return "  ".join(cells).rstrip()


def _finite(data: Any) -> Any:
    """Replace numbers that JSON does not know by null."""
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_finite(value) for value in data]
    if isinstance(data, float) and not np.isfinite(data):
        return None
    return data


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
    """
    file, wanted = str(path), ("a result file", "write one with identify --json")
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        found = str(error.strerror or error)
        raise ReadError(found, "a readable result file", "check the path", file=file) from error
    except (ValueError, RecursionError) as error:
        raise ReadError(f"no JSON ({error})", *wanted, file=file) from error
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        found = repr(data.get("schema") if isinstance(data, dict) else type(data).__name__)
        raise ReadError(f"schema {found}", repr(SCHEMA), wanted[1], file=file)
    try:
        return _from_dict(data)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise ReadError(f"{type(error).__name__}: {error}", *wanted, file=file) from error


def _from_dict(data: dict[str, Any]) -> Estimate:
    if data["status"] not in get_args(Status):
        raise ValueError(f"the status {data['status']!r}")
    size = len(data["covariance"])
    covariance = [[_number(x) for x in row] for row in data["covariance"]]
    condition = data.get("condition_number")
    return Estimate(
        model=_text(data["model"]),
        method=_text(data["method"]),
        status=data["status"],
        parameters=tuple(map(_value, data["parameters"])),
        nuisance=tuple(map(_value, data["nuisance"])),
        derived=tuple(map(_value, data["derived"])),
        covariance=np.array(covariance, dtype=float).reshape(size, size),
        misfit=_read(Misfit, data["misfit"]),
        suspects=tuple(_read(Suspect, row) for row in data["suspects"]),
        prediction={key: _read(Prediction, row) for key, row in data["prediction"].items()},
        lines_hz=tuple(map(_number, data["lines_hz"])),
        periods=int(_number(data["periods"])),
        warnings=tuple(map(_text, data["warnings"])),
        condition_number=None if condition is None else _number(condition),
        line_misfit=tuple(_read(LineMisfit, row) for row in data.get("line_misfit", ())),
    )


def _number(x: object) -> float:
    """Return a number; null stands for one that is not finite."""
    if isinstance(x, bool) or not isinstance(x, int | float | None):
        raise TypeError(f"{x!r} for a number")
    return math.nan if x is None else float(x)


def _text(x: object) -> str:
    if not isinstance(x, str):
        raise TypeError(f"{x!r} for a text")
    return x


_FIELDS: dict[str, Callable[[object], object]] = {
    "str": _text,
    "float": _number,
    "float | None": lambda x: None if x is None else _number(x),
    "int": lambda x: int(_number(x)),
    "bool": bool,
}


def _read(kind: type[Any], row: dict[str, object] | None) -> Any:
    """Return a dataclass from a row of plain data, its fields checked; None from null."""
    if row is None:
        return None
    types = {field.name: str(field.type) for field in fields(kind)}
    return kind(**{key: _FIELDS[types[key]](x) for key, x in row.items()})


def _value(row: dict[str, object]) -> Value:
    value: Value = _read(Value, row)
    # Of what is not determined no deviation is finite either: null, all of them.
    return replace(value, std=math.nan, std_inflated=math.nan) if row["value"] is None else value
