"""Pictures of an estimate: forces measured and predicted, deviations, correlations, misfit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rotorid.plots.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    PINK,
    RED,
    SKY,
    label,
    new_figure,
    panels,
    ratios,
    shown_unit,
    styled,
)

Floats = NDArray[np.float64]
COLOURS = (BLUE, RED, GREEN, PINK, SKY)  # of records
MOST_POINTS = 2000  # of a curve
MOST_DOTS = 400  # samples up to which each is a dot


@dataclass(frozen=True)
class ForceWaves:
    """One period of the inputs, on the kept lines.

    Parameters
    ----------
    time : array, shape (sample,)
        s.
    measured, predicted : array, shape (sample, input)
    error : array, shape (input,)
        |lines(predicted - measured)| / |lines(measured)|; NaN for an input that is zero.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    time: Floats
    measured: Floats
    predicted: Floats
    error: Floats


@styled
def draw_forces(waves: ForceWaves) -> Figure:
    """Draw the forces over one period, measured and predicted."""
    count = len(waves.names)
    figure, axes = panels(count, 2, 2.1 if count > 1 else 3.0)
    for index, panel in zip(range(count), axes, strict=False):
        draw_force(panel, waves, index)
        panel.set_xlabel(_time_unit(waves)[0] if index >= count - 2 else "")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=len(labels))
    return figure


def _time_unit(waves: ForceWaves) -> tuple[str, float]:
    return ("time in s", 1.0) if waves.time[-1] > 1 else ("time in ms", 1e3)


def draw_force(axes: Axes, waves: ForceWaves, index: int) -> None:
    """Draw one input over one period, measured and predicted."""
    text, factor = _time_unit(waves)
    time = factor * waves.time
    unit, size = shown_unit(waves.units[index])
    measured, predicted = size * waves.measured[:, index], size * waves.predicted[:, index]
    step = slice(None, None, -(-len(time) // MOST_POINTS))
    dotted: dict[str, Any] = {"marker": "o", "ms": 3.5, "ls": "none"}
    look = dotted if len(time) <= MOST_DOTS else {"lw": 3.0}
    axes.plot(time[step], measured[step], color=GREY, label="measured, kept lines", **look)
    axes.plot(time[step], predicted[step], color=BLUE, label="predicted")
    difference = 10 * (predicted - measured)[step]
    axes.plot(time[step], difference, color=RED, lw=0.9, label="10 x (predicted - measured)")
    error = waves.error[index]
    said = f"relative error {100 * error:.2g} %" if np.isfinite(error) else "not driven"
    name = label(waves.names[index])
    axes.set_title(f"{name}: {said}", loc="left")
    axes.set_ylabel(f"{name} in {unit}")
    axes.set_xlabel(text)
    axes.margins(x=0.01)


@styled
def draw_correlation(names: Sequence[str], matrix: Floats) -> Figure:
    """Draw a correlation matrix, shape (name, name)."""
    names = [label(name) for name in names]
    size = min(max(3.2, 0.32 * len(names) + 2.2), 14.0)
    figure = new_figure(size + 0.6, size)
    _draw_matrix(figure, figure.subplots(), names, matrix)
    return figure


def _draw_matrix(figure: Figure, axes: Axes, names: Sequence[str], matrix: Floats) -> None:
    image = axes.imshow(matrix, cmap="RdBu_r", vmin=-1, vmax=1)
    axes.set_xticks(range(len(names)), names, rotation=90)
    axes.set_yticks(range(len(names)), names)
    axes.grid(False)
    if len(names) <= 20:
        for (row, column), value in np.ndenumerate(matrix):
            if row != column and abs(value) >= 0.3:
                colour = "white" if abs(value) > 0.7 else INK
                text = f"{value:.1f}".replace("0.", ".").replace("-", "\N{MINUS SIGN}")
                axes.text(column, row, text, ha="center", va="center", color=colour, fontsize=6.5)
    figure.colorbar(image, ax=axes, shrink=0.8, label="correlation")


@styled
def draw_misfit(
    records: Sequence[int],
    frequency: Sequence[float],
    cost: Sequence[float],
    expected: Sequence[float],
) -> Figure:
    """Draw the cost of every line over its expectation, a colour per record."""
    figure = new_figure(9.0, 2.8)
    axes = figure.subplots()
    ratio = np.asarray(cost, dtype=float) / np.asarray(expected, dtype=float)
    least = float(np.nanmin(np.where(ratio > 0, ratio, np.nan), initial=1.0))
    ratio = np.maximum(ratio, least)  # a line without any misfit has no place on the axis
    where = np.asarray(records)
    numbers = sorted(set(records))
    for place, number in enumerate(numbers):
        own = where == number
        text = f"record {number + 1}" if len(numbers) > 1 else "cost / expected"
        x, colour = np.asarray(frequency)[own], COLOURS[place % len(COLOURS)]
        axes.plot(
            x, ratio[own], "o", color=colour, ms=4 if own.sum() < MOST_DOTS else 2, label=text
        )
    axes.axhline(1.0, color=INK, lw=0.8)
    ratios(axes, y=True)
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, 0.5), max(high, 2.0))
    axes.set_xlabel("frequency in Hz")
    axes.set_ylabel("cost / expected")
    if 1 < len(numbers) <= len(COLOURS):
        figure.legend(loc="outside upper left", ncols=len(numbers))
    return figure


@styled
def draw_estimate(names: Sequence[str], percent: Floats, matrix: Floats) -> Figure:
    """Draw the deviations of parameters in percent, and beside them their correlation."""
    names = [label(name) for name in names]
    height = min(max(2.6, 0.3 * len(names) + 1.2), 14.0)
    figure = new_figure(10.5, height)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.25))
    place = np.arange(len(names))
    left.plot(np.where(percent > 0, percent, np.nan), place, "o", color=BLUE, ms=5)
    left.set_yticks(place, names)
    left.set_ylim(len(names) - 0.5, -0.5)
    ratios(left, x=True)
    left.set_xlabel("standard deviation in %")
    _draw_matrix(figure, right, names, matrix)
    return figure
