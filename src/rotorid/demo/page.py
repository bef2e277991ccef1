"""The page of the demonstration."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from markupsafe import Markup

from rotorid.answer.parts import RecordEvidence
from rotorid.core.tables import Page, Table, table
from rotorid.demo import DemoResult, findings
from rotorid.demo.machine import MASS, STATED, MachineResult
from rotorid.demo.paper import COLUMNS, TABLE, PaperRow, printed_error
from rotorid.demo.run import FORCE_NOISE, PERIODS, POSITION_NOISE, SAMPLE_RATE
from rotorid.report import drawn
from rotorid.report.drawn import line_filter
from rotorid.report.estimate import verdict_of
from rotorid.report.html import Section, answer
from rotorid.report.panels import BLUE, GREEN, GREY, PINK, RED, SKY, Axis, Curve, Floats, Panel
from rotorid.results.evidence import record_evidence


def demo_page(result: DemoResult) -> Page:
    records = f"{result.runs} records" if result.runs > 1 else "one record"
    return [
        f"Error in %, root mean square of {records}; first the least that the data allow,",
        "the Cramer-Rao bound",
        sizes(result),
        "Table 1, |error| in %: of one run, as the paper prints it;",
        f"and beside it the median of {records} here",
        beside_the_paper(result),
        f"The paper lists the unbalance times Omega^2: {as_printed()}",
        "",
        f"Mean error of {records} in %, the bias",
        means(result),
        *findings(result),
    ]


def ordered(result: DemoResult) -> list[str]:
    return sorted(result.estimators, key=lambda name: name != "ml")  # it stands beside the bound


def sizes(result: DemoResult) -> Table:
    errors = {name: result.rms(name) for name in ordered(result)}
    return _figures(result, {"bound": result.bound_percent, **errors}, ".3f")


def means(result: DemoResult) -> Table:
    return _figures(result, {name: result.bias(name) for name in ordered(result)}, "+.3f")


def _deviations(result: DemoResult) -> Table | None:
    """Return scatter over stated deviation; none from a single record."""
    if result.runs < 2:
        return None
    ratios = {name: result.scatter_over_stated(name) for name in result.estimators}
    return _figures(result, ratios, ".2f")


def _figures(result: DemoResult, columns: Mapping[str, Floats], form: str) -> Table:
    """Return a row per parameter, in the order of the paper."""
    rows = [
        (row.base, *(format(values[i], form) for values in columns.values()))
        for row, i in _numbered(result)
    ]
    return table(("parameter", *columns), rows)


def beside_the_paper(result: DemoResult) -> Table:
    """Return the errors that the paper prints, each with the median here; and the truth."""
    names = [name for name in result.estimators if name in COLUMNS]
    rows = []
    for row, i in _numbered(result):
        printed = [printed_error(row, name) for name in names]
        pairs = [
            (f"{error:.3f}", f"{result.median(name)[i]:.3f}")
            for name, error in zip(names, printed, strict=True)
            if error is not None
        ]
        flat = [text for pair in pairs for text in pair]
        rows.append((row.base, f"{result.truth[i]:.5g}", result.units[i], *flat))
    headings = [text for name in names for text in (name, "here")]
    return table(("parameter", "true", "unit", *headings), rows)


def as_printed() -> str:
    rows = [row for row in TABLE if row.speed_power]
    return ", ".join(f"{row.quantity} = {row.true:.5g} {row.unit}" for row in rows)


def _numbered(result: DemoResult) -> Sequence[tuple[PaperRow, int]]:
    return [(row, result.names.index(row.base)) for row in TABLE]


COLOURS = {"batch-100": BLUE, "batch-10": SKY, "sequential": GREEN, "ls": RED}
SHOWN_CHANNEL, SHOWN_LINE = "x1", 180.0
SHOWN_WIDTH = 1.6
"""Hz on either side of the line that is shown by itself."""


def filter_panels(result: DemoResult) -> list[Panel]:
    """Return the spectrum before and after the line filter, the paper's Fig. 2."""
    example, near = result.example, (SHOWN_LINE - SHOWN_WIDTH, SHOWN_LINE + SHOWN_WIDTH)
    return [
        line_filter(example.record, example.periods, SHOWN_CHANNEL),
        line_filter(example.record, example.periods, SHOWN_CHANNEL, near),
    ]


def example_evidence(result: DemoResult, estimator: str) -> RecordEvidence:
    """Return the first record as an estimator predicts it."""
    example = result.example
    (found,) = record_evidence(example.estimates[estimator], example.model, [example.periods])
    return found


def error_panels(result: DemoResult) -> list[Panel]:
    return [_errors(result, row) for row in TABLE]


def _errors(result: DemoResult, row: PaperRow) -> Panel:
    index = result.names.index(row.base)
    place = np.arange(len(result.estimators), dtype=float)
    errors = np.array([result.errors(name)[:, index] for name in result.estimators])
    low, first, middle, third, high = np.percentile(errors, (5, 25, 50, 75, 95), axis=1)
    printed = [printed_error(row, name) for name in result.estimators]
    both = [(sign * p, k) for k, p in zip(place, printed, strict=True) if p for sign in (-1, 1)]
    marks = np.array(both or np.zeros((0, 2)))
    return Panel(
        row.base,
        Axis("error in %"),
        Axis(names=result.estimators),
        (
            _bars(low, high, place, f"5 to 95 % of {result.runs} records", "line"),
            _bars(first, third, place, "the middle half", "thick"),
            Curve(middle, place, "median", RED, "dots"),
            Curve(marks[:, 0], marks[:, 1], "printed in the paper, sign unknown", GREY, "diamonds"),
        ),
        upright=0.0,
        height=1.9,
    )


def _bars(low: Floats, high: Floats, place: Floats, label: str, look: str) -> Curve:
    gap = np.full_like(low, np.nan)
    x = np.column_stack([low, high, gap]).ravel()
    return Curve(x, np.repeat(place, 3), label, BLUE, "thick" if look == "thick" else "line")


def rms_panel(result: DemoResult) -> Panel:
    order = [result.names.index(row.base) for row in TABLE]
    place = np.arange(len(order), dtype=float)
    curves = [
        Curve(result.rms(name)[order], place, name, COLOURS.get(name, PINK), "dots")
        for name in result.estimators
    ]
    bound = Curve(result.bound_percent[order], place, "the least possible", GREY, "diamonds")
    axis = Axis(f"rms error in %, {result.runs} records", log=True)
    return Panel("", axis, Axis(names=tuple(row.base for row in TABLE)), (*curves, bound), height=4)


def machine_page(result: MachineResult) -> Page:
    """Return what was done, in sentences, and every quantity beside its truth."""
    periods, seconds = result.periods, result.periods.periods / result.periods.fundamental
    fixed = [f"{v.name} = {v.value:g} {v.unit}" for v in result.estimate.parameters if v.fixed]
    return [
        "A levitated rotor from its bearings: four position sensors, four coil currents",
        f"simulated: {seconds:g} s at {periods.sample_rate:g} Hz, "
        f"{periods.speed * 30 / math.pi:.0f} rpm, under a controller",
        f"inspected: {result.inspection.verdict}. {result.inspection.sentence}",
        f"known beforehand: {', '.join(fixed)}, {MASS} by a scale; the constants of the bearings "
        f"were stated {100 * (1 - STATED):.0f} % too small, and are unknown",
        f"identified: {verdict_of(result.estimate).sentence}",
        beside_the_truth(result),
    ]


def beside_the_truth(result: MachineResult) -> Table:
    rows = []
    for value in result.estimate.free:
        if value.name not in result.truth or not value.std:
            continue
        truth = result.truth[value.name]
        off = (value.value - truth) / value.std
        size = f"{100 * value.std / abs(truth):.2g}"
        unit = "" if value.unit == "1" else value.unit
        rows.append((value.name, f"{truth:.6g}", f"{value.value:.6g}", size, f"{off:+.1f}", unit))
    return table(("parameter", "true", "found", "std %", "off by std", "unit"), rows)


SHOWN = "ml"
"""The estimator whose prediction is drawn."""


def demo_report(result: DemoResult) -> str:
    first, *others = findings(result)
    return answer(
        "rotorid demo",
        first,
        "ok",
        [Section("What the figures show", items=tuple(others)), *_sections(result)],
        heading="Identification of a flexible rotor on magnetic bearings",
        lead=f"The numerical example of Levy and Arogeti, section 3, simulated {result.runs} times "
        "with fresh noise and identified by each of their estimators and by maximum likelihood.",
    )


CONDITIONS = Markup(
    "The paper lists the unbalance terms times Omega²; errors in % are the same. Model "
    "<code>three-mass</code>, the paper's equations (7), turning at 140 rev/s; forces on the "
    f"bearings at 20, 60, 100, 140, 180 and 220 Hz; {PERIODS} periods of 20 Hz. The paper states "
    f"neither sample rate nor noise; here they are {SAMPLE_RATE:g} Hz, and white noise of "
    f"{FORCE_NOISE:g} N on every sample of a force and of {1e6 * POSITION_NOISE:g} µm or µrad on "
    "every sample of a position, at which its errors come out at their own size. Units of the "
    "paper's stiffnesses are corrected."
)
PRINTED = Markup("; ").join(Markup("<code>{}</code>: {}").format(*each) for each in COLUMNS.items())


def _sections(result: DemoResult) -> Iterator[Section]:
    runs, example = f"{result.runs} records", result.example
    name = SHOWN if SHOWN in result.estimators else result.estimators[0]
    yield Section(
        "Errors of every estimator, in figures",
        f"Root mean square in %, over {runs}. The bound is the least that an unbiased estimate can "
        "have (Cramer and Rao).",
        sizes(result),
    )
    yield Section(
        "Errors of every estimator",
        f"Root mean square over {runs}, parameter by parameter, and the least that an unbiased "
        "estimate can have.",
        panels=(rms_panel(result),),
    )
    yield Section(
        "Table 1 of the paper",
        "Size of the error of the one run that the paper prints, in %, and beside it the median "
        f"here of {runs}. " + PRINTED + ".",
        beside_the_paper(result),
        after=CONDITIONS,
    )
    yield Section("Bias", f"Mean of the errors in %, over {runs}.", means(result))
    yield Section(
        "Spectrum before and after the line filter",
        f"The paper's Fig. 2, from the first record: {SHOWN_CHANNEL}. Before: all lines that the "
        f"record of {example.periods.periods} periods resolves. After: the excited ones, all "
        "others set to zero.",
        panels=tuple(filter_panels(result)),
    )
    yield Section(
        "Forces measured and predicted",
        f"One period of the first record; the prediction is the paper's (12) with {name}. The "
        "band holds 95 % of what noise makes of the difference.",
        panels=tuple(drawn.waves(example_evidence(result, name))),
    )
    yield Section(
        "Distribution of the errors",
        f"Errors of {runs}, parameter by parameter. The paper prints the size of one run's error, "
        "so its marks stand on both sides.",
        panels=tuple(error_panels(result)),
    )
    yield Section(
        "Do the stated deviations hold?",
        "Scatter of the estimates over the standard deviation that they state; 1 is right. Bias "
        "is not in it.",
        _deviations(result),
    )
