"""Pictures of the demonstration: the errors of every estimator over all records."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rotorid.demo import DemoResult
from rotorid.demo.paper import TABLE, PaperRow, printed_error
from rotorid.plots.pictures import ForceWaves, draw_force
from rotorid.plots.spectra import draw_line_filter
from rotorid.plots.style import BLUE, GREEN, INK, PINK, RED, SKY, new_figure, panels, styled
from rotorid.report.plots import force_waves

COLOURS = {"batch-100": BLUE, "batch-10": SKY, "sequential": GREEN, "ls": RED}
SHOWN_CHANNEL, SHOWN_LINE = "x1", 180.0


def _colour(estimator: str) -> str:
    return COLOURS.get(estimator, PINK)


@styled
def draw_errors(result: DemoResult) -> Figure:
    """Draw the distribution of the errors, one panel per parameter."""
    count = len(TABLE)
    figure, axes = panels(count + 1, 3, 1.55)
    for panel, row in zip(axes, TABLE, strict=False):
        _draw_parameter(panel, result, row)
    for panel in axes[count - 2 : count + 1]:
        panel.set_xlabel("error in %")
    key = axes[count]
    key.set_axis_off()
    key.legend(handles=_key(result), loc="center left")
    return figure


def _draw_parameter(axes: Axes, result: DemoResult, row: PaperRow) -> None:
    index = result.names.index(row.base)
    for place, name in enumerate(result.estimators):
        errors, colour = result.errors(name)[:, index], _colour(name)
        low, first, middle, third, high = np.percentile(errors, (5, 25, 50, 75, 95))
        axes.plot((low, high), (place, place), color=colour, lw=1.4)
        axes.plot((first, third), (place, place), color=colour, lw=6, solid_capstyle="butt")
        axes.plot(middle, place, "o", color="white", ms=3)
        printed = printed_error(row, name)
        if printed is not None:
            both = (-printed, printed)
            axes.plot(both, (place, place), "D", mfc="none", mec=INK, ms=4.5, mew=0.9, ls="none")
    axes.axvline(0, color=INK, lw=0.8)
    axes.set_yticks(range(len(result.estimators)), result.estimators)
    axes.set_ylim(len(result.estimators) - 0.5, -0.5)
    axes.grid(False, axis="y")
    axes.set_title(row.base, loc="left")


def _key(result: DemoResult) -> list[Line2D]:
    return [
        Line2D([], [], color=INK, lw=1.4, label=f"5 to 95 % of {result.runs} records"),
        Line2D([], [], color=INK, lw=6, solid_capstyle="butt", label="the middle half"),
        Line2D([], [], color=INK, marker="o", mfc="white", ls="none", ms=5, label="median"),
        Line2D(
            [],
            [],
            marker="D",
            mfc="none",
            mec=INK,
            ls="none",
            label="printed in the paper,\nsign unknown",
        ),
    ]


def draw_rms(axes: Axes, result: DemoResult) -> None:
    """Draw the rms error of every estimator and parameter as points in one panel."""
    order = [result.names.index(row.base) for row in TABLE]
    place = np.arange(len(order))
    shifts = np.linspace(-0.24, 0.24, len(result.estimators))
    for name, shift in zip(result.estimators, shifts, strict=True):
        axes.plot(
            result.rms(name)[order], place + shift, "o", ms=4, color=_colour(name), label=name
        )
    axes.set_yticks(place, [row.base for row in TABLE])
    axes.set_ylim(len(order) - 0.5, -0.5)
    axes.set_xscale("log")
    axes.set_xticks((0.2, 0.5, 1, 2, 5), ("0.2", "0.5", "1", "2", "5"))
    axes.minorticks_off()
    axes.set_xlabel(f"rms error in %, {result.runs} records")


def example_waves(result: DemoResult, estimator: str) -> ForceWaves:
    """Return the forces of the first record, measured and predicted by an estimator."""
    example = result.example
    waves = force_waves(example.model, example.estimates[estimator], example.periods)
    assert waves is not None, "every coordinate of the demonstration is measured"
    return waves


@styled
def draw_overview(result: DemoResult) -> Figure:
    """Draw the whole story in one picture: line filter, predicted force, errors."""
    figure = new_figure(12.0, 3.9)
    left, middle, right = figure.subplots(1, 3, width_ratios=(1.15, 1.15, 1.0))
    example = result.example
    draw_line_filter(left, example.record, example.periods, SHOWN_CHANNEL)
    low, high = left.get_ylim()
    left.set_ylim(low, high * 10)
    left.legend(loc="upper left")
    left.set_title(
        f"1. Keep the excited lines of {example.periods.periods} periods ({SHOWN_CHANNEL})",
        loc="left",
    )
    waves = example_waves(result, result.estimators[0])
    draw_force(middle, waves, 0)
    low, high = middle.get_ylim()
    middle.set_ylim(low, high + 0.55 * (high - low))
    middle.legend(loc="upper left")
    middle.set_title("2. Fit the equations of motion to the forces", loc="left")
    draw_rms(right, result)
    right.set_xlim(right=12)
    right.legend(loc="center right", handletextpad=0.1)
    right.set_title("3. Read the rotor's parameters", loc="left")
    return figure
