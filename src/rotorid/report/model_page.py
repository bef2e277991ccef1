"""What the program makes of a model, in words and tables."""

from __future__ import annotations

from collections.abc import Iterable

from rotorid.models import Model
from rotorid.models.base import monomial_name
from rotorid.models.model import Parameter
from rotorid.tables import Page, Table, table

_MATRICES = (("M", "''"), ("D", "'"), ("G", "'"), ("K", ""))


def model_list(models: Iterable[Model]) -> Table:
    """Return one line per model."""
    rows = [
        (m.name, str(len(m.coordinates)), str(len(m.inputs)), str(len(m.base.names)), m.title)
        for m in models
    ]
    return table(("model", "coordinates", "inputs", "base parameters", "title"), rows)


def model_page(model: Model) -> Page:
    """Return what the program makes of a model: equations, parameters, base parameters."""
    units = [(name, model.units[name]) for name in (*model.coordinates, *model.inputs)]
    kinds = ["coordinate"] * len(model.coordinates) + ["input"] * len(model.inputs)
    signals = [(name, kind, unit) for (name, unit), kind in zip(units, kinds, strict=True)]
    return [
        f"{model.name}: {model.title}",
        *([f"source: {model.source}"] if model.source else []),
        "",
        *(f"{i + 1}. {' '.join(text.split())}" for i, text in enumerate(model.texts)),
        table(("signal", "kind", "unit"), signals),
        table(("parameter", "unit", "nominal"), map(_parameter, model.parameters)),
        table(("base parameter", "unit"), zip(model.base.names, model.base.units, strict=True)),
        *_structure(model),
        *(f"warning: {fault}" for fault in model.unit_faults),
    ]


def _parameter(parameter: Parameter) -> tuple[str, str, str]:
    nominal = "" if parameter.nominal is None else f"{parameter.nominal:.6g}"
    return parameter.name, parameter.unit, nominal


def _structure(model: Model) -> list[str]:
    """Return M, D, G, K and g row by row, where the equations are linear."""
    linear = model.linear
    if linear is None:
        return ["not linear in the coordinates: no M, D, G, K"]
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
    lines = ["M q'' + D q' + Omega G q' + K q = B u + g, row by row:"]
    for title, found in rows.items():
        lines += [f"{title}:" if found else f"{title}: zero"]
        lines += [f"  {row + 1}: {_sum(texts)}" for row, texts in sorted(found.items())]
    return lines


def _product(model: Model, coefficient: float, monomial: int, factor: str) -> str:
    name = monomial_name(model.monomials[monomial].tolist(), model.parameter_names)
    size = "" if abs(coefficient) == 1 else f"{abs(coefficient):.12g}"
    signal = "" if factor == "1" else factor.replace("**", "^")
    text = "*".join(part for part in (size, name, signal) if part) or "1"
    return f"-{text}" if coefficient < 0 else text


def _sum(texts: list[str]) -> str:
    return " + ".join(texts).replace("+ -", "- ")
