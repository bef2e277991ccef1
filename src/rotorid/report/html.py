"""Reports as single HTML files: pictures inside, no script, nothing fetched from anywhere."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from rotorid.demo import DemoResult, findings
from rotorid.demo.paper import COLUMNS, TABLE, PaperRow, printed_error
from rotorid.demo.run import FORCE_NOISE, PERIODS, POSITION_NOISE, SAMPLE_RATE
from rotorid.estimate import Estimate
from rotorid.models import Model
from rotorid.record import PeriodicRecord
from rotorid.report import demo_plots, plots
from rotorid.report.style import data_uri

NUMERIC = {"value", "std", "std %", "inflated"}


@dataclass(frozen=True)
class Picture:
    """An image with what it shows in words."""

    uri: str
    title: str
    caption: str


@cache
def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("rotorid.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _render(template: str, **content: Any) -> str:
    from rotorid import __version__

    return _environment().get_template(template).render(version=__version__, **content)


def _picture(figure: Figure, title: str, caption: str) -> Picture:
    return Picture(data_uri(figure), title, caption)


def estimate_report(estimate: Estimate, model: Model, records: Sequence[PeriodicRecord]) -> str:
    """Return the report of an estimate as HTML."""
    pictures = [
        p for i in range(len(records)) for p in _record_pictures(estimate, model, records, i)
    ]
    names = [value.name for value in estimate.free]
    if 1 < len(names) == len(estimate.covariance):
        pictures.append(
            _picture(
                plots.draw_correlation(names, estimate.correlation),
                "Correlation of the parameters",
                "Near +1 or -1 two parameters are known as a combination better than one by one.",
            )
        )
    return _render(
        "estimate.html",
        estimate=estimate,
        model=model,
        tables=list(estimate.tables.values()),
        numeric=NUMERIC,
        notes=[note for note in estimate.notes if not note.startswith("warning: ")],
        records=records,
        pictures=pictures,
    )


def _record_pictures(
    estimate: Estimate, model: Model, records: Sequence[PeriodicRecord], index: int
) -> Iterator[Picture]:
    record = records[index]
    where = f", record {index + 1}" if len(records) > 1 else ""
    waves = plots.force_waves(model, estimate, record)
    if waves is not None:
        yield _picture(
            plots.draw_forces(waves),
            f"Measured and predicted{where}",
            "One period on the kept lines. Where every coordinate is measured, the prediction lays "
            "what the equations of motion leave over to the inputs; else it is what the sensors "
            "should read of the measured inputs.",
        )
    yield _picture(
        plots.draw_spectra(record),
        f"Spectra{where}",
        f"Mean of {record.periods} periods, channel by channel. Lines that were not kept took no "
        "part. The noise is the scatter of the kept lines between periods, of their mean.",
    )


def write_estimate_report(
    estimate: Estimate, model: Model, records: Sequence[PeriodicRecord], path: str | Path
) -> None:
    """Write the report of an estimate."""
    Path(path).write_text(estimate_report(estimate, model, records), encoding="utf-8")


def demo_report(result: DemoResult) -> str:
    """Return the report of the demonstration as HTML."""
    return _render(
        "demo.html",
        result=result,
        findings=findings(result),
        rows=[_table_row(result, row) for row in TABLE],
        columns=COLUMNS,
        deviations=_deviation_rows(result),
        pictures=_demo_pictures(result),
        conditions={
            "force": FORCE_NOISE,
            "position": POSITION_NOISE,
            "rate": SAMPLE_RATE,
            "periods": PERIODS,
        },
    )


def _table_row(result: DemoResult, row: PaperRow) -> dict[str, Any]:
    index = result.names.index(row.base)
    cells = []
    for name in result.estimators:
        printed = printed_error(row, name)
        cells += [
            "" if printed is None else f"{printed:.3f}",
            f"{result.median(name)[index]:.3f}",
            f"{result.rms(name)[index]:.3f}",
            f"{result.bias(name)[index]:+.3f}".replace("-", "\N{MINUS SIGN}"),
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
    if result.seeds < 2:
        return []
    ratios = [result.scatter_over_stated(name) for name in result.estimators]
    order = [result.names.index(row.base) for row in TABLE]
    return [(result.names[i], *(f"{ratio[i]:.2f}" for ratio in ratios)) for i in order]


def _demo_pictures(result: DemoResult) -> list[Picture]:
    example, first = result.example, result.estimators[0]
    channel, line = demo_plots.SHOWN_CHANNEL, demo_plots.SHOWN_LINE
    return [
        _picture(
            plots.draw_filter(example.record, example.periods, channel, line),
            "Spectrum before and after the line filter",
            f"The paper's Fig. 2, from the first record: {channel}. Before: all lines that the "
            f"record of {example.periods.periods} periods resolves. After: the excited ones, all "
            "others set to zero.",
        ),
        _picture(
            plots.draw_forces(demo_plots.example_waves(result, first)),
            "Forces measured and predicted",
            f"One period of the first record; the prediction is the paper's (12) with {first}.",
        ),
        _picture(
            demo_plots.draw_errors(result),
            "Distribution of the errors",
            f"Errors of {result.seeds} records, parameter by parameter. The paper prints the size "
            "of one run's error, so its marks stand on both sides.",
        ),
    ]


def write_demo_report(result: DemoResult, path: str | Path) -> None:
    """Write the report of the demonstration."""
    Path(path).write_text(demo_report(result), encoding="utf-8")
