"""The report of the demonstration."""

from __future__ import annotations

from rotorid.demo import DemoResult, findings
from rotorid.demo.paper import COLUMNS, TABLE
from rotorid.demo.run import FORCE_NOISE, PERIODS, POSITION_NOISE, SAMPLE_RATE
from rotorid.plots import estimates as drawn
from rotorid.report import demo_plots
from rotorid.report.demo_page import beside_the_paper, means, sizes, verdict_of
from rotorid.report.html import Picture, render
from rotorid.tables import Table, table

SHOWN = "ml"
"""The estimator whose prediction is drawn."""


def demo_report(result: DemoResult) -> str:
    """Return the report of the demonstration as HTML."""
    return render(
        "demo.html",
        result=result,
        verdict=verdict_of(result),
        findings=findings(result),
        sizes=sizes(result),
        beside=beside_the_paper(result),
        means=means(result),
        columns=COLUMNS,
        deviations=_deviations(result),
        pictures=_pictures(result),
        conditions={
            "force": FORCE_NOISE,
            "position": POSITION_NOISE,
            "rate": SAMPLE_RATE,
            "periods": PERIODS,
        },
    )


def _deviations(result: DemoResult) -> Table | None:
    """Return scatter over stated deviation, a row per parameter; none from a single record."""
    if result.runs < 2:
        return None
    names = result.estimators
    ratios = [result.scatter_over_stated(name) for name in names]
    order = [result.names.index(row.base) for row in TABLE]
    rows = [(result.names[i], *(f"{ratio[i]:.2f}" for ratio in ratios)) for i in order]
    return table(("parameter", *names), rows)


def _pictures(result: DemoResult) -> list[Picture]:
    example = result.example
    name = SHOWN if SHOWN in result.estimators else result.estimators[0]
    evidence = demo_plots.example_evidence(result, name)
    return [
        Picture(
            "Errors of every estimator",
            f"Root mean square over {result.runs} records, parameter by parameter, and the least "
            "that an unbiased estimate can have.",
            (demo_plots.rms_panel(result),),
        ),
        Picture(
            "Spectrum before and after the line filter",
            f"The paper's Fig. 2, from the first record: {demo_plots.SHOWN_CHANNEL}. Before: all "
            f"lines that the record of {example.periods.periods} periods resolves. After: the "
            "excited ones, all others set to zero.",
            tuple(demo_plots.filter_panels(result)),
        ),
        Picture(
            "Forces measured and predicted",
            f"One period of the first record; the prediction is the paper's (12) with {name}. The "
            "band holds 95 % of what noise makes of the difference.",
            tuple(drawn.waves(evidence)),
        ),
        Picture(
            "Distribution of the errors",
            f"Errors of {result.runs} records, parameter by parameter. The paper prints the size "
            "of one run's error, so its marks stand on both sides.",
            tuple(demo_plots.error_panels(result)),
        ),
    ]
