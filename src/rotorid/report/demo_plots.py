"""Pictures of the demonstration: the errors of every estimator over all records."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from rotorid.demo import DemoResult
from rotorid.demo.paper import TABLE, PaperRow, printed_error
from rotorid.evidence import RecordEvidence
from rotorid.plots.estimates import waves
from rotorid.plots.panel import BLUE, GREEN, GREY, PINK, RED, SKY, Axis, Curve, Floats, Panel
from rotorid.plots.records import line_filter
from rotorid.results.evidence import record_evidence

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
    """Return the distribution of the errors, one panel per parameter."""
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
    """Return a bar from low to high at each place."""
    gap = np.full_like(low, np.nan)
    x = np.column_stack([low, high, gap]).ravel()
    return Curve(x, np.repeat(place, 3), label, BLUE, "thick" if look == "thick" else "line")


def rms_panel(result: DemoResult) -> Panel:
    """Return the rms error of every estimator and parameter, and the bound."""
    order = [result.names.index(row.base) for row in TABLE]
    place = np.arange(len(order), dtype=float)
    curves = [
        Curve(result.rms(name)[order], place, name, COLOURS.get(name, PINK), "dots")
        for name in result.estimators
    ]
    bound = Curve(result.bound_percent[order], place, "the least possible", GREY, "diamonds")
    axis = Axis(f"rms error in %, {result.runs} records", log=True)
    return Panel("", axis, Axis(names=tuple(row.base for row in TABLE)), (*curves, bound), height=4)


def draw_overview(result: DemoResult) -> Figure:
    """Draw the whole story in one picture: line filter, predicted force, errors."""
    from rotorid.plots.still import figure_of

    example = result.example
    kept = f"1. Keep the excited lines of {example.periods.periods} periods"
    force = waves(example_evidence(result, "ml"))[0]
    errors = rms_panel(result)
    room = replace(errors.x, ends=(0.03, 60.0))  # for the key beside the points
    return figure_of(
        [
            replace(filter_panels(result)[0], title=kept, height=3.9),
            replace(force, title="2. Fit the equations of motion to the forces"),
            replace(errors, x=room, title="3. Read the rotor's parameters"),
        ],
        columns=3,
        apart=True,
    )
