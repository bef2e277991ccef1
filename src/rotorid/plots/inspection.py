"""Pictures of what is in a record: samples, lines, periods, noise."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rotorid.plots.style import (
    BLUE,
    GREEN,
    GREY,
    PINK,
    RED,
    decades,
    label,
    new_figure,
    panels,
    shown_unit,
    styled,
)

Found = Any  # an Inspection, which lies above

_POINTS = 600  # of a band over the record
_MOST = 24  # channels with a panel of their own


@styled
def draw_time(found: Found) -> Figure:
    """Draw every channel over the record as the band between its extremes."""
    record = found.record
    count = min(len(record.channels), _MOST)
    figure, axes = panels(count, 2, 1.5)
    size = max(1, len(record.samples) // _POINTS)
    if found.periods is not None and found.periods.periods > _POINTS // 12:
        size = found.periods.samples  # else the blocks beat with the excitation
    blocks = len(record.samples) // size
    time = (np.arange(blocks) + 0.5) * size / record.sample_rate
    for c, panel in zip(range(count), axes, strict=False):
        unit, factor = shown_unit(record.channels[c].unit)
        part = factor * record.samples[: blocks * size, c].reshape(blocks, size)
        low, high = part.min(axis=1), part.max(axis=1)
        if size > 4:
            panel.fill_between(time, low, high, color=BLUE, lw=0)
        else:
            panel.plot(
                np.arange(len(record.samples)) / record.sample_rate, factor * record.samples[:, c]
            )
        panel.set_title(label(record.names[c], 36), loc="left")
        panel.set_ylabel(unit)
        if c >= count - 2:
            panel.set_xlabel("time in s")
    return figure


@styled
def draw_lines(found: Found) -> Figure:
    """Draw the lines of the mean period: kept, odd, even, noise."""
    periods = found.periods
    count = min(len(periods.channels), _MOST)
    figure, axes = panels(count, 2, 1.8)
    for c, panel in zip(range(count), axes, strict=False):
        _draw_lines(panel, periods, c)
        if c >= count - 2:
            panel.set_xlabel("frequency in Hz")
    key = [
        Line2D([], [], color=BLUE, marker="o", ms=4, ls="none", label="kept lines"),
        Line2D([], [], color=GREEN, marker="o", ms=3, ls="none", label="other odd lines"),
        Line2D([], [], color=PINK, marker="o", ms=3, ls="none", label="other even lines"),
        Line2D([], [], color=RED, lw=1.5, label="noise of the mean"),
    ]
    figure.legend(handles=key, loc="outside upper left", ncols=len(key))
    return figure


def _draw_lines(axes: Axes, periods: Any, c: int) -> None:
    size, spacing = periods.samples, periods.fundamental
    unit, factor = shown_unit(periods.channels[c].unit)
    amplitude = 2 * factor * np.abs(np.fft.rfft(periods.mean[:, c], norm="forward"))
    highest = min(len(amplitude), 2 * int(periods.harmonics.max()) + 2)
    lines = np.arange(1, highest)
    kept = np.isin(lines, periods.harmonics)
    noise = 2 * factor * np.sqrt(float(periods.variance[:, c].mean()) / (size * periods.periods))
    axes.set_title(label(periods.names[c], 36), loc="left")
    axes.set_ylabel(unit)
    shown = amplitude[lines]
    if not (shown > 0).any():
        axes.text(0.5, 0.5, "zero", transform=axes.transAxes, ha="center")
        return
    decades(axes, y=True)
    for chosen, colour, mark in (
        (~kept & (lines % 2 == 1), GREEN, 2.0),
        (~kept & (lines % 2 == 0), PINK, 2.0),
        (kept, BLUE, 3.5),
    ):
        visible = chosen & (shown > 1e-10 * shown.max())
        axes.plot(lines[visible] * spacing, shown[visible], "o", color=colour, ms=mark)
    if noise > 1e-10 * shown.max():
        axes.axhline(noise, color=RED, lw=1.2)


@styled
def draw_each_period(found: Found) -> Figure:
    """Draw the deviation of each period from the mean, over its scatter, channel by channel."""
    periods = found.periods
    figure = new_figure(9.0, 3.0)
    axes = figure.subplots()
    z = periods.spectra - periods.mean_spectrum
    scatter = np.sqrt(np.median(np.abs(z) ** 2, axis=0).mean(axis=0))
    size = np.sqrt((np.abs(z) ** 2).mean(axis=1)) / np.where(scatter > 0, scatter, np.inf)
    for c in range(min(size.shape[1], _MOST)):
        axes.plot(periods.time[:, 0], size[:, c], "-", color=GREY, lw=0.8)
    axes.plot(periods.time[:, 0], np.median(size, axis=1), "o-", color=BLUE, ms=3)
    axes.set_xlabel("start of the period in s")
    axes.set_ylabel("deviation over scatter")
    axes.set_ylim(bottom=0)
    key = [
        Line2D([], [], color=GREY, label="each channel"),
        Line2D([], [], color=BLUE, marker="o", ms=3, label="their median"),
    ]
    axes.legend(handles=key, loc="upper right", ncols=2)
    return figure


@styled
def draw_correlation(found: Found) -> Figure:
    """Draw the correlation of the noise between channels."""
    names = [label(facts.name, 14) for facts in found.channels]
    side = min(9.0, 2.2 + 0.42 * len(names))
    figure = new_figure(side, side - 0.8)
    axes = figure.subplots()
    image = axes.imshow(found.noise_correlation, vmin=0.0, vmax=1.0, cmap="Blues")
    axes.set_xticks(range(len(names)), names, rotation=60, ha="right")
    axes.set_yticks(range(len(names)), names)
    axes.grid(visible=False)
    figure.colorbar(image, ax=axes, shrink=0.8)
    return figure
