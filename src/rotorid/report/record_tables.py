"""Tables of predictions, models, rotors and rigs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from rotorid.answer.validation import ChannelError
from rotorid.core.tables import Page, Table, by_hand, table
from rotorid.linear.family import Information
from rotorid.models import Model
from rotorid.models.base import monomial_name
from rotorid.models.rotor.drawing import Rotor
from rotorid.models.rotor.fem import bending
from rotorid.models.rotor.rotor_model import RotorModel, inertia
from rotorid.rig.faults import FAULTS
from rotorid.rig.logger import Logged, LoggedColumn


def validation_table(records: Sequence[Sequence[ChannelError]]) -> Table:
    """Return how far each channel is off beside what explains it, and what it comes to."""
    several = len(records) > 1
    rows = [
        (
            f"{c.name}, record {number + 1}" if several else c.name,
            *map(_percent, (c.relative_error, c.noise, c.deviations)),
            "" if c.p_value is None else f"{c.p_value:.2g}",
            "zero" if c.relative_error is None else "fails" if c.fails else "predicted",
        )
        for number, record in enumerate(records)
        for c in record
    ]
    headings = ("channel", "off by %", "by noise %", "by deviations %", "chance", "verdict")
    return table(headings, rows)


def information_lines(records: Iterable[Information | None]) -> list[str]:
    """Return the condition number of the regressor of each record, as it is quoted for robots."""
    return [
        f"condition number of the regressor: {told.scaled_condition_number:.4g} with its "
        f"columns scaled, {told.condition_number:.4g} in SI units as it is"
        for told in records
        if told is not None
    ]


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.3g}"


def told_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """Return a table without the columns that say nothing in any row."""
    told = [k for k in range(len(headings)) if any(row[k] for row in rows)]
    return table([headings[k] for k in told], [[row[k] for k in told] for row in rows])


WIDTH = 76
"""Characters of the drawing: a terminal of 80 holds it."""
HALF = 5
"""Lines of the drawing above its axis."""
KINDS = (
    ("discs", "disc", "D"),
    ("actuators", "actuator", "A"),
    ("sensors", "sensor", "s"),
    ("supports", "support", "^"),
    ("unbalance", "unbalance", "u"),
)
"""What stands on a rotor, in words, and its mark in the drawing."""


def rotor_page(model: RotorModel) -> Page:
    rotor = model.rotor
    nodes = [
        (str(k), f"{1e3 * node.position:.6g}", ", ".join(node.names if node.named else ()), what)
        for k, node in enumerate(rotor.nodes)
        for what in [_standing(rotor, node.names)]
    ]
    return [
        *_head(model),
        *drawing(rotor),
        "",
        *_weights(model),
        table(("node", "mm", "place", "what stands there"), nodes),
        *_parameters(model),
        *_channels(model),
    ]


def _standing(rotor: Rotor, names: tuple[str, ...]) -> str:
    held = [word for key, word, _ in KINDS if set(names) & set(getattr(rotor, key))]
    return ", ".join(held)


def _weights(model: RotorModel) -> list[str]:
    hertz = ", ".join(f"{w / (2 * np.pi):.4g}" for w in bending(model.rotor))
    told = [f"shaft alone, free, at rest: bending at {hertz} Hz"]
    missing = [name for name in model.parameter_names if name not in model.nominal]
    if missing:
        return [*told, f"no mass as a whole: {', '.join(missing)} without nominal"]
    whole = inertia(model, model.nominal)
    return [
        f"{whole.mass:.5g} kg, centre at {1e3 * whole.centre:.5g} mm; I_t {whole.transverse:.4g}, "
        f"I_p {whole.polar:.4g} kg m^2 about it (nominal values)",
        *told,
    ]


def _channels(model: RotorModel) -> list[str]:
    coordinates = [f"x_{name}, y_{name}" for name in model.rotor.sensors]
    read = f"; sensors at {'; '.join(coordinates)}" if coordinates else ""
    return [
        f"inputs: {', '.join(model.inputs) or 'none'}{read}",
        f"{len(model.coordinates)} coordinates: x, y, theta_x, theta_y of each node, such as "
        f"{model.coordinates[0]}; monomials of the matrices: "
        + ", ".join(monomial_name(m, model.parameter_names) for m in model.monomials if m.any()),
    ]


def drawing(rotor: Rotor) -> list[str]:
    """Return the rotor seen from the side, in characters; its marks stand below."""
    widest = max(section.outer for section in rotor.sections)
    borders = np.cumsum([0.0, *(section.length for section in rotor.sections)])
    middle = (np.arange(WIDTH) + 0.5) / WIDTH * rotor.length
    number = np.searchsorted(borders, middle).clip(1, len(rotor.sections)) - 1
    outer = np.array([s.outer for s in rotor.sections])[number] / widest
    inner = np.array([s.inner for s in rotor.sections])[number] / widest
    height = (np.arange(HALF, -HALF - 1, -1) / (HALF + 0.5))[:, None]
    inside = np.abs(height) <= outer
    bore = np.abs(height) < inner
    canvas = np.where(bore & inside, ".", np.where(inside, "#", " "))
    for disc in rotor.discs.values():
        canvas[:, _column(rotor, disc.at)] = "|"
    lines = ["".join(row).rstrip() for row in canvas]
    marks = np.full((2, WIDTH), " ")
    for key, _, mark in KINDS:
        for member in getattr(rotor, key).values():
            column = _column(rotor, member.at)
            marks[0 if marks[0, column] == " " else 1, column] = mark
    legend = ", ".join(f"{mark} {word}" for key, word, mark in KINDS if getattr(rotor, key))
    below = ["".join(row).rstrip() for row in marks if (row != " ").any()]
    return [*lines, *below, f"0 to {rotor.length:g} m" + (f"; {legend}" if legend else "")]


def _column(rotor: Rotor, at: float) -> int:
    return int(np.clip(at / rotor.length * WIDTH, 0, WIDTH - 1))


_MATRICES = (("M", "''"), ("D", "'"), ("G", "'"), ("K", ""))


def model_list(models: Iterable[Model]) -> Table:
    rows = [
        (m.name, str(len(m.coordinates)), str(len(m.inputs)), str(len(m.base.names)), m.title)
        for m in models
    ]
    return table(("model", "coordinates", "inputs", "base parameters", "title"), rows)


def model_page(model: Model) -> Page:
    units = [(name, model.units[name]) for name in (*model.coordinates, *model.inputs)]
    kinds = ["coordinate"] * len(model.coordinates) + ["input"] * len(model.inputs)
    signals = [(name, kind, unit) for (name, unit), kind in zip(units, kinds, strict=True)]
    return [
        *_head(model),
        *(f"{i + 1}. {' '.join(text.split())}" for i, text in enumerate(model.texts)),
        table(("signal", "kind", "unit"), signals),
        *_parameters(model),
        *_structure(model),
        *(f"warning: {fault}" for fault in model.unit_faults),
    ]


def _head(model: Model) -> list[str]:
    source = [f"source: {model.source}"] if model.source else []
    return [f"{model.name}: {model.title}", *source, ""]


def _parameters(model: Model) -> list[Table]:
    rows = [
        (p.name, p.unit, "" if p.nominal is None else f"{p.nominal:.6g}") for p in model.parameters
    ]
    base = zip(model.base.names, model.base.units, strict=True)
    return [table(("parameter", "unit", "nominal"), rows), table(("base parameter", "unit"), base)]


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


_HEADINGS = ("column", "unit", "mean", "rms about it", "hold", "delay us")


def record_page(record: Logged, file: str, experiment: str) -> Page:
    turning = record.truth.rpm
    return [
        f"{record.count} samples at {record.sample_rate:g} Hz, {turning:.6g} rpm: {file}",
        table(_HEADINGS, map(_row, record.columns)),
        f"The experiment file that identifies it: {experiment}",
        f"    rotorid identify {experiment}",
    ]


def fault_page() -> Page:
    """Return the faults that a rig may have, one a line: name, size by default, what it is."""
    names = max(map(len, FAULTS))
    return [f"{f.name:{names}}  {f.shown:>10}  {f.what}" for f in FAULTS.values()]


def _row(column: LoggedColumn) -> tuple[str, ...]:
    mean, rms = column.samples.mean(), column.samples.std()
    unit, factor = by_hand(column.unit)
    return (
        column.name,
        unit,
        f"{factor * mean:.4g}",
        f"{factor * rms:.4g}",
        "zero-order" if column.hold else "",
        f"{column.delay * 1e6:.6g}" if column.delay else "",
    )
