"""The report of the demonstration."""

from __future__ import annotations

from typing import Any

from rotorid.demo import DemoResult, findings
from rotorid.demo.paper import COLUMNS, TABLE, PaperRow, printed_error
from rotorid.demo.run import FORCE_NOISE, PERIODS, POSITION_NOISE, SAMPLE_RATE
from rotorid.plots import pictures, spectra
from rotorid.report import demo_plots
from rotorid.report.html import Picture, picture, render


def demo_report(result: DemoResult) -> str:
    """Return the report of the demonstration as HTML."""
    return render(
        "demo.html",
        result=result,
        findings=findings(result),
        rows=[_table_row(result, row) for row in TABLE],
        columns=COLUMNS,
        deviations=_deviation_rows(result),
        pictures=_pictures(result),
        conditions={
            "force": FORCE_NOISE,
            "position": POSITION_NOISE,
            "rate": SAMPLE_RATE,
            "periods": PERIODS,
        },
    )


def _table_row(result: DemoResult, row: PaperRow) -> dict[str, Any]:
    index = result.names.index(row.base)
    cells: list[tuple[str, str]] = []
    for name in result.estimators:
        printed = printed_error(row, name)
        cells += [] if printed is None else [(f"{printed:.3f}", "first")]
        cells += [
            (f"{result.median(name)[index]:.3f}", "first" if printed is None else ""),
            (f"{result.rms(name)[index]:.3f}", "rms"),
            (f"{result.bias(name)[index]:+.3f}".replace("-", "\N{MINUS SIGN}"), ""),
        ]
    return {
        "name": row.base,
        "true": f"{result.truth[index]:.5g} {result.units[index]}",
        "printed": f"{row.quantity} = {row.true:.5g} {row.unit}" if row.speed_power else "",
        "cells": cells,
        "bound": f"{result.bound_percent[index]:.3f}",
    }


def _deviation_rows(result: DemoResult) -> list[tuple[str, ...]]:
    """Return scatter over stated deviation, a row per parameter; none from a single record."""
    if result.runs < 2:
        return []
    ratios = [result.scatter_over_stated(name) for name in result.estimators]
    order = [result.names.index(row.base) for row in TABLE]
    return [(result.names[i], *(f"{ratio[i]:.2f}" for ratio in ratios)) for i in order]


def _pictures(result: DemoResult) -> list[Picture]:
    example, first = result.example, result.estimators[0]
    channel, line = demo_plots.SHOWN_CHANNEL, demo_plots.SHOWN_LINE
    return [
        picture(
            spectra.draw_filter(example.record, example.periods, channel, line),
            "Spectrum before and after the line filter",
            f"The paper's Fig. 2, from the first record: {channel}. Before: all lines that the "
            f"record of {example.periods.periods} periods resolves. After: the excited ones, all "
            "others set to zero.",
        ),
        picture(
            pictures.draw_forces(demo_plots.example_waves(result, first)),
            "Forces measured and predicted",
            f"One period of the first record; the prediction is the paper's (12) with {first}.",
        ),
        picture(
            demo_plots.draw_errors(result),
            "Distribution of the errors",
            f"Errors of {result.runs} records, parameter by parameter. The paper prints the size "
            "of one run's error, so its marks stand on both sides.",
        ),
    ]
