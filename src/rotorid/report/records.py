"""Records, models, rotors and rigs: pages of inspection, and what commands print of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from rotorid.core.tables import Page, Table, by_hand, table
from rotorid.models import Model
from rotorid.models.base import monomial_name
from rotorid.models.rotor.drawing import Rotor
from rotorid.models.rotor.fem import bending
from rotorid.models.rotor.rotor_model import RotorModel, inertia
from rotorid.report import drawn
from rotorid.report.drawn import MARKS, RPM
from rotorid.report.html import Mood, Passage, marked, page_of
from rotorid.rig.faults import FAULTS
from rotorid.rig.logger import Logged
from rotorid.signals.inspection import ChannelFacts, Inspection, LineInspection


def told_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """Return a table without the columns that say nothing in any row."""
    rows = list(rows)
    told = [k for k in range(len(headings)) if any(row[k] for row in rows)]
    return table([headings[k] for k in told], [[row[k] for k in told] for row in rows])


def cell(value: float | None, form: str, factor: float = 1.0, none: str = "") -> str:
    return none if value is None or np.isnan(value) else format(factor * value, form)


_LEVELS = ("channel", "unit", "low", "high", "rms", "S/N dB", "least coherence", "crest")
_HEADINGS = (*_LEVELS, "odd %", "even %", "1x", "2x", "3x")


def inspection_page(found: Inspection | LineInspection) -> Page:
    recorded, shown, noise = _told(found)
    graver = [check for check in found.checks if check.severity != "passes"]
    fine = [check.about for check in found.checks if check.severity == "passes"]
    return [
        f"{found.source}: {found.verdict}. {found.sentence}",
        recorded,
        *(f"{check.verdict}: {check}" for check in graver),
        f"checked, nothing found: {', '.join(fine)}" if fine else "",
        shown,
        *noise,
    ]


def _told(found: Inspection | LineInspection) -> tuple[str, Table, Sequence[str]]:
    if isinstance(found, Inspection):
        return _recorded(found), told_table(_HEADINGS, map(_row, found.channels)), _noise(found)
    lines, rows = found.lines, []
    what, over, unit_over = f"lines of responses to {lines.channels[0].name}", lines.frequency, "Hz"
    if found.turning:
        what, over, unit_over = "rows of 1x phasors", RPM * lines.speed, "rpm"
    ends = f"from {over.min():.6g} to {over.max():.6g} {unit_over}"
    for facts in found.channels:
        unit, factor = by_hand(facts.unit, max(abs(facts.low), abs(facts.high)))
        levels = (f"{factor * level:.4g}" for level in (facts.low, facts.high))
        rows.append((facts.name, unit, *levels, f"{facts.at:.6g}", cell(facts.snr_db, ".1f")))
    headings = ("channel", "unit", "least", "largest", f"at {unit_over}", "S/N dB")
    return f"{len(over)} {what}, {ends}", table(headings, rows), lines.warnings


def _recorded(found: Inspection) -> str:
    record, periods = found.record, found.periods
    length = len(record.samples) / record.sample_rate
    told = [f"{len(record.samples)} samples at {record.sample_rate:.8g} Hz, {length:.6g} s"]
    if periods is None:
        told.append("no period")
    else:
        how = "found" if found.found else "given"
        told.append(
            f"{periods.periods} periods of {periods.samples} samples ({how}: "
            f"{1 / periods.fundamental:.6g} s, {periods.fundamental:.6g} Hz), "
            f"{len(periods.harmonics)} lines from {periods.frequency[0]:.5g} to "
            f"{periods.frequency[-1]:.5g} Hz"
        )
    told.append(
        f"speed {RPM * record.speed:.6g} rpm" if record.speed else "standstill, or no speed given"
    )
    return "; ".join(told)


def _row(facts: ChannelFacts) -> tuple[str, ...]:
    unit, factor = by_hand(facts.unit, max(abs(facts.low), abs(facts.high)))
    orders = [f"{factor * a:.3g}" for a in facts.orders] or ["", "", ""]
    return (
        facts.name,
        unit,
        *(f"{factor * level:.4g}" for level in (facts.low, facts.high, facts.rms)),
        cell(facts.snr_db, ".1f"),
        cell(facts.coherence, ".3f"),
        cell(facts.crest_factor, ".2f"),
        cell(facts.odd, ".2g", 100),
        cell(facts.even, ".2g", 100),
        *orders,
    )


def _noise(found: Inspection) -> list[str]:
    """Say which noises go together: in closed loop the controller makes it so."""
    if found.noise_correlation is None or len(found.channels) < 2:
        return []
    size = np.triu(found.noise_correlation, 1)
    i, j = np.unravel_index(int(np.argmax(size)), size.shape)
    names = [facts.name for facts in found.channels]
    return [
        f"noise of {names[i]} and {names[j]}: correlation {size[i, j]:.2f}"
        + (" (maximum likelihood uses it)" if size[i, j] > 0.3 else "")
    ]


MOODS: dict[str, Mood] = {"ok": "good", "note": "good", "warning": "doubt", "refused": "bad"}


def inspection_report(
    name: str, found: Sequence[Inspection | LineInspection], told: str, done: Sequence[str] = ()
) -> str:
    several = len(found) > 1
    parts = [_part(one, f", record {k}" if several else "") for k, one in enumerate(found, 1)]
    return page_of(Passage(f"Records of {name}", lead=told, parts=tuple(parts)), done=done)


def _part(found: Inspection | LineInspection, title: str) -> Passage:
    graver = [check for check in found.checks if check.severity != "passes"]
    fine = "; ".join(check.found for check in found.checks if check.severity == "passes")
    recorded, shown, noise = _told(found)
    return Passage(
        found.source or "record",
        lead=recorded,
        badge=found.verdict,
        verdict=found.sentence,
        mood=MOODS[found.verdict],
        steps=tuple(marked("<strong>{}</strong>: {}", n.verdict, str(n)) for n in graver),
        said=(f"Passed: {fine}.",) if fine else (),
        table=shown,
        after=" ".join(noise),
        parts=tuple(_pictures(found, title)),
    )


def _pictures(one: Inspection | LineInspection, title: str) -> Iterator[Passage]:
    if not isinstance(one, Inspection):
        told = "Amplitude of each row, channel by channel, with the noise where something tells it."
        panels = tuple(drawn.rows(one.lines, turning=one.turning))
        yield Passage(f"Rows of the table{title}", told, panels=panels)
        return
    periods = one.periods
    size = 1 if periods is None else periods.samples
    yield Passage(
        f"Samples{title}",
        "The whole record, where it is long as a band from its lowest to its highest sample; a "
        "flat edge is a limit, a spike a knock, a slope a drift.",
        panels=tuple(drawn.samples(one.record, size)),
    )
    if periods is None:
        return
    yield Passage(
        f"Spectrum of the mean period{title}",
        "Multiples of the fundamental, used, odd or even, with the noise of the mean. What is not "
        "used and stands above the noise is distortion, rotation, or excitation left out.",
        panels=tuple(drawn.spectra(periods)),
    )
    yield Passage(
        f"Deviation of each period{title}",
        "From the mean of all, over its scatter. It falls while the machine settles, stands out "
        "where something knocked, and bends like a bow where it drifts.",
        panels=(drawn.each_period(periods),),
    )
    if one.noise_correlation is not None:
        names = [facts.name for facts in one.channels]
        yield Passage(
            f"Correlation of the noise{title}",
            "Correlation between the noises of two channels on the lines that are used. In "
            "closed loop the controller feeds the noise of sensors into the forces.",
            panels=(drawn.noise_correlation(names, one.noise_correlation),),
        )


WIDTH = 76  # characters of the drawing: a terminal of 80 holds it
HALF = 5  # lines of the drawing above its axis


def rotor_page(model: RotorModel) -> Page:
    rotor = model.rotor
    nodes = []
    for k, node in enumerate(rotor.nodes):
        held = [word for key, word, *_ in MARKS if {*node.names} & set(getattr(rotor, key))]
        named = ", ".join(node.names if node.named else ())
        nodes.append((str(k), f"{1e3 * node.position:.6g}", named, ", ".join(held)))
    return [
        *_head(model),
        *drawing(rotor),
        "",
        *_weights(model),
        table(("node", "mm", "place", "what stands there"), nodes),
        *_parameters(model),
        *_channels(model),
    ]


def _weights(model: RotorModel) -> list[str]:
    hertz = ", ".join(f"{w / (2 * np.pi):.4g}" for w in bending(model.rotor))
    told = [f"shaft alone, free, at rest: bending at {hertz} Hz"]
    missing = [name for name in model.parameter_names if name not in model.nominal]
    if missing:
        return [*told, f"no mass as a whole: {', '.join(missing)} without nominal"]
    mass, centre, transverse, polar = inertia(model, model.nominal)
    return [
        f"{mass:.5g} kg, centre at {1e3 * centre:.5g} mm; I_t {transverse:.4g}, "
        f"I_p {polar:.4g} kg m^2 about it (nominal values)",
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
    for key, _, mark, *_ in MARKS:
        for member in getattr(rotor, key).values():
            column = _column(rotor, float(member.at))
            marks[0 if marks[0, column] == " " else 1, column] = mark
    legend = ", ".join(f"{mark} {word}" for key, word, mark, *_ in MARKS if getattr(rotor, key))
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
    rows = [(p.name, p.unit, cell(p.nominal, ".6g")) for p in model.parameters]
    base = zip(model.base.names, model.base.units, strict=True)
    return [table(("parameter", "unit", "nominal"), rows), table(("base parameter", "unit"), base)]


def _structure(model: Model) -> list[str]:
    linear = model.linear
    if linear is None:
        return ["not linear in the coordinates: no M, D, G, K"]
    rows: dict[str, dict[int, list[str]]] = {f"{name} q{dots}": {} for name, dots in _MATRICES}
    rows["g"] = {}
    for term in linear.stiffness:
        gyroscopic = term.kind.matrix == "G"
        name, dots = ("G", "'") if gyroscopic else _MATRICES[(3, 1, 0)[term.kind.order]]
        factor = "1" if gyroscopic else str(term.kind.factor)
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
        sums = {row: " + ".join(texts).replace("+ -", "- ") for row, texts in found.items()}
        lines += [f"  {row + 1}: {text}" for row, text in sorted(sums.items())]
    return lines


def _product(model: Model, coefficient: float, monomial: int, factor: str) -> str:
    name = monomial_name(model.monomials[monomial].tolist(), model.parameter_names)
    size = "" if abs(coefficient) == 1 else f"{abs(coefficient):.12g}"
    signal = "" if factor == "1" else factor.replace("**", "^")
    text = "*".join(part for part in (size, name, signal) if part) or "1"
    return f"-{text}" if coefficient < 0 else text


def record_page(record: Logged, file: str, experiment: str) -> Page:
    rows = []
    for column in record.columns:
        unit, factor = by_hand(column.unit, float(np.abs(column.samples).max(initial=0.0)))
        mean, rms = factor * column.samples.mean(), factor * column.samples.std()
        hold, delay = "zero-order" if column.hold else "", column.delay * 1e6
        late = f"{delay:.6g}" if delay else ""
        rows.append((column.name, unit, f"{mean:.4g}", f"{rms:.4g}", hold, late))
    return [
        f"{record.count} samples at {record.sample_rate:g} Hz, {record.truth.rpm:.6g} rpm: {file}",
        table(("column", "unit", "mean", "rms about it", "hold", "delay us"), rows),
        f"The experiment file that identifies it: {experiment}",
        f"    rotorid identify {experiment}",
    ]


def fault_page() -> Page:
    names = max(map(len, FAULTS))
    return [f"{f.name:{names}}  {f.shown:>10}  {f.what}" for f in FAULTS.values()]
