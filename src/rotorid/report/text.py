"""Results as tables for a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from rotorid.demo import DemoResult, findings
from rotorid.demo.paper import TABLE, printed_error
from rotorid.estimate import Estimate, Prediction
from rotorid.estimators.information import Information
from rotorid.models import Model
from rotorid.models.base import monomial_name
from rotorid.models.model import Parameter

_MATRICES = (("M", "''"), ("D", "'"), ("G", "'"), ("K", ""))
_COLOURS = {
    "ok": "green",
    "rejected": "yellow",
    "not_identifiable": "red",
    "not_converged": "red",
}


def estimate_tables(estimate: Estimate) -> RenderableType:
    """Return an estimate as tables, with what there is to say below them."""
    title = Text(f"{estimate.model}, {estimate.method}: ")
    title.append(estimate.status, _COLOURS[estimate.status])
    tables = [_table(headings, rows) for headings, *rows in estimate.tables.values()]
    notes = [Text(note, "yellow" if note.startswith("warning") else "") for note in estimate.notes]
    spaced = [part for table in tables for part in (Text(""), table)]
    return Group(title, *spaced, Text(""), *notes)


def prediction_table(errors: Iterable[Mapping[str, Prediction | None]]) -> RenderableType:
    """Return the relative error of each predicted channel, one column per record."""
    records = list(errors)
    headings = [f"record {i + 1}" for i in range(len(records))] if len(records) > 1 else ["error"]
    names = dict.fromkeys(name for record in records for name in record)
    rows = [(name, *(_error(record.get(name)) for record in records)) for name in names]
    return _table(("relative", *headings), rows)


def demo_tables(result: DemoResult) -> RenderableType:
    """Return the seed's Table 1 beside the errors of all seeds here, and what they show."""
    names = result.estimators
    beside: list[tuple[str, ...]] = []
    spread: list[tuple[str, ...]] = []
    for row in TABLE:
        i = result.names.index(row.base)
        errors = [printed_error(row, name) for name in names]
        printed = ["" if error is None else f"{error:.3f}" for error in errors]
        median = [f"{result.median(name)[i]:.3f}" for name in names]
        rms = [f"{result.rms(name)[i]:.3f}" for name in names]
        bias = [f"{result.bias(name)[i]:+.3f}" for name in names]
        truth = (row.base, result.units[i], f"{result.truth[i]:.5g}")
        beside.append((*truth, *_paired(printed, median)))
        spread.append((row.base, *_paired(rms, bias), f"{result.bound_percent[i]:.3f}"))
    return Group(
        Text("Table 1, |error| in %: of one run, as the paper prints it;"),
        Text(f"and beside it the median of {result.seeds} records here"),
        Text(""),
        _table(("parameter", "unit", "true", *_headings(names, "median")), beside),
        Text(f"\nThe paper lists the unbalance times Omega^2: {_as_printed()}"),
        Text(f"\nError in %: root mean square of {result.seeds} records; and its mean, the bias;"),
        Text("last the least that the data allow, the Cramer-Rao bound\n"),
        _table(("parameter", *_headings(names, "bias"), "bound"), spread),
        Text(""),
        Text(" ".join(findings(result))),
    )


def _as_printed() -> str:
    rows = [row for row in TABLE if row.speed_power]
    return ", ".join(f"{row.quantity} = {row.true:.5g} {row.unit}" for row in rows)


def _paired(first: Sequence[str], second: Sequence[str]) -> tuple[str, ...]:
    return tuple(text for pair in zip(first, second, strict=True) for text in pair)


def _headings(names: Sequence[str], second: str) -> tuple[str, ...]:
    return _paired(names, [second] * len(names))


def information_lines(records: Iterable[Information | None]) -> list[Text]:
    """Return the condition number of the regressor of each record, as the seed's robots have it."""
    return [
        Text(
            f"condition number of the regressor: {told.scaled_condition_number:.4g} with its "
            f"columns scaled, {told.condition_number:.4g} in SI units as it is"
        )
        for told in records
        if told is not None
    ]


def model_list(models: Iterable[Model]) -> RenderableType:
    """Return one line per model."""
    rows = [
        (m.name, str(len(m.coordinates)), str(len(m.inputs)), str(len(m.base.names)), m.title)
        for m in models
    ]
    return _table(("model", "coordinates", "inputs", "base parameters", "title"), rows)


def model_description(model: Model) -> RenderableType:
    """Return what the program makes of a model: equations, parameters, base parameters."""
    units = [(name, model.units[name]) for name in (*model.coordinates, *model.inputs)]
    kinds = ["coordinate"] * len(model.coordinates) + ["input"] * len(model.inputs)
    parts: list[RenderableType] = [
        Text(f"{model.name}: {model.title}"),
        *([Text(f"source: {model.source}")] if model.source else []),
        Text(""),
        *(Text(f"{i + 1}. {text}") for i, text in enumerate(model.texts)),
        Text(""),
        _table(
            ("signal", "kind", "unit"),
            [(name, kind, unit) for (name, unit), kind in zip(units, kinds, strict=True)],
        ),
        Text(""),
        _table(("parameter", "unit", "nominal"), [_parameter(p) for p in model.parameters]),
        Text(""),
        _table(
            ("base parameter", "unit"), list(zip(model.base.names, model.base.units, strict=True))
        ),
        *_structure(model),
        *(Text(f"warning: {fault}", "yellow") for fault in model.unit_faults),
    ]
    return Group(*parts)


def _parameter(parameter: Parameter) -> tuple[str, str, str]:
    nominal = "" if parameter.nominal is None else f"{parameter.nominal:.6g}"
    return parameter.name, parameter.unit, nominal


def _structure(model: Model) -> list[RenderableType]:
    """Return M, D, G, K and g row by row, where the equations are linear."""
    linear = model.linear
    if linear is None:
        return [Text("\nnot linear in the coordinates: no M, D, G, K")]
    rows: dict[str, dict[int, list[str]]] = {f"{name} q{dots}": {} for name, dots in _MATRICES}
    rows["g"] = {}
    for term in linear.stiffness:
        gyroscopic = term.order == 1 and str(term.factor) == "Omega"
        name, dots = ("G", "'") if gyroscopic else _MATRICES[(3, 1, 0)[term.order]]
        factor = "1" if gyroscopic else str(term.factor)
        text = _product(model, term.coefficient, term.monomial, factor)
        rows[f"{name} q{dots}"].setdefault(term.row, []).append(
            f"{text} {model.coordinates[term.column]}"
        )
    for load in linear.load_terms:
        text = _product(model, load.coefficient, load.monomial, str(load.signal))
        rows["g"].setdefault(load.row, []).append(text)
    lines = ["", "M q'' + D q' + Omega G q' + K q = B u + g, row by row:"]
    for title, found in rows.items():
        lines += [f"{title}:" if found else f"{title}: zero"]
        lines += [f"  {row + 1}: {_sum(texts)}" for row, texts in sorted(found.items())]
    return [Text(line) for line in lines]


def _product(model: Model, coefficient: float, monomial: int, factor: str) -> str:
    name = monomial_name(model.monomials[monomial].tolist(), model.parameter_names)
    size = "" if abs(coefficient) == 1 else f"{abs(coefficient):.12g}"
    signal = "" if factor == "1" else factor.replace("**", "^")
    text = "*".join(part for part in (size, name, signal) if part) or "1"
    return f"-{text}" if coefficient < 0 else text


def _sum(texts: list[str]) -> str:
    return " + ".join(texts).replace("+ -", "- ")


def _error(prediction: Prediction | None) -> str:
    return "zero" if prediction is None else f"{100 * prediction.relative_error:.3g} %"


def _table(headings: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> Table:
    """Return a table; columns that hold a number in every row that says something to the right."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading, *cells in zip(headings, *rows, strict=True):
        numeric = all(c in ("", "fixed") or c[0] in "+-.0123456789" for c in cells)
        table.add_column(Text(heading), justify="right" if numeric else "left", overflow="fold")
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    return table
