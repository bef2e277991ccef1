"""The pages of the demonstration: what it prints, and its report."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from markupsafe import Markup

from rotorid.core.tables import Page, Table, table
from rotorid.core.values import Floats
from rotorid.demo.findings import findings
from rotorid.demo.levitated import MASS, STATED, MachineResult
from rotorid.demo.paper import (
    COLUMNS,
    FORCE_NOISE,
    PERIODS,
    POSITION_NOISE,
    SAMPLE_RATE,
    TABLE,
    DemoResult,
    printed_error,
)
from rotorid.report.estimate_report import verdict_of
from rotorid.report.html import Passage, answer
from rotorid.report.panels import BLUE, GREEN, GREY, PINK, RED, SKY, Axis, Curve, Panel


def demo_page(result: DemoResult) -> Page:
    printed = ", ".join(
        f"{row.quantity} = {row.true:.5g} {row.unit}" for row in TABLE if row.speed_power
    )
    return [
        f"Error in %, root mean square of {_records(result)}; first the least that the data allow,",
        "the Cramer-Rao bound",
        sizes(result),
        "Table 1, |error| in %: of one run, as the paper prints it;",
        f"and beside it the median of {_records(result)} here",
        beside_the_paper(result),
        f"The paper lists the unbalance times Omega^2: {printed}",
        "",
        *findings(result),
    ]


def _records(result: DemoResult) -> str:
    return f"{result.runs} records" if result.runs > 1 else "one record"


def sizes(result: DemoResult) -> Table:
    order = sorted(result.estimators, key=lambda name: name != "ml")  # it stands beside the bound
    columns: Mapping[str, Floats] = {
        "bound": result.bound_percent,
        **{name: result.rms(name) for name in order},
    }
    rows = [
        (name, *(f"{values[i]:.3f}" for values in columns.values()))
        for i, name in enumerate(result.names)
    ]
    return table(("parameter", *columns), rows)


def beside_the_paper(result: DemoResult) -> Table:
    """Return the errors that the paper prints, each with the median here; and the truth."""
    names = [name for name in result.estimators if name in COLUMNS]
    medians = {name: result.median(name) for name in names}
    rows = [
        (
            row.base,
            f"{result.truth[i]:.5g}",
            result.units[i],
            *(f"{e:.3f}" for name in names for e in (printed_error(row, name), medians[name][i])),
        )
        for i, row in enumerate(TABLE)
    ]
    headings = [text for name in names for text in (name, "here")]
    return table(("parameter", "true", "unit", *headings), rows)


COLOURS = {"batch-100": BLUE, "batch-10": SKY, "sequential": GREEN, "ls": RED}


def rms_panel(result: DemoResult) -> Panel:
    place = np.arange(len(result.names), dtype=float)
    curves = [
        Curve(result.rms(name), place, name, COLOURS.get(name, PINK), "dots")
        for name in result.estimators
    ]
    bound = Curve(result.bound_percent, place, "the least possible", GREY, "diamonds")
    axis = Axis(f"rms error in %, {_records(result)}", log=True)
    return Panel("", axis, Axis(names=result.names), (*curves, bound), height=4)


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


def demo_report(result: DemoResult) -> str:
    first, *others = findings(result)
    sections = [
        Passage("What the figures show", items=tuple(others)),
        Passage(
            "Errors of every estimator",
            f"Root mean square in %, over {_records(result)}. The bound is the least that an "
            "unbiased estimate can have (Cramer and Rao).",
            sizes(result),
            panels=(rms_panel(result),),
        ),
        Passage(
            "Table 1 of the paper",
            "Size of the error of the one run that the paper prints, in %, and beside it the "
            f"median here of {_records(result)}. " + PRINTED + ".",
            beside_the_paper(result),
            after=CONDITIONS,
        ),
    ]
    return answer(
        "rotorid demo",
        first,
        "ok",
        sections,
        heading="Identification of a flexible rotor on magnetic bearings",
        lead=f"The numerical example of Levy and Arogeti, section 3, simulated {result.runs} times "
        "with fresh noise and identified by each of their estimators and by maximum likelihood.",
    )
