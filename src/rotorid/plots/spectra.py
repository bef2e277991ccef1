"""Pictures of spectra: the line filter at work, and every channel of a record."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rotorid.plots.style import (
    BLUE,
    GREY,
    RED,
    decades,
    label,
    new_figure,
    panels,
    shown_unit,
    styled,
)

MOST_DOTS = 400  # of other lines in a panel
MOST_SAMPLES = 4000  # of a channel over time
MOST_STEMS = 40  # kept lines that are drawn one by one


# Pictures lie below records, whose types they cannot import.
Samples = Any  # a Record
Periods = Any  # a PeriodicRecord
Whole = Any  # Lines


@styled
def draw_filter(record: Samples, periods: Periods, channel: str, near: float) -> Figure:
    """Draw the spectrum of a channel before and after the line filter, the paper's Fig. 2."""
    figure = new_figure(9.0, 3.3)
    whole, zoom = figure.subplots(1, 2, sharey=True, width_ratios=(1.7, 1.0))
    draw_line_filter(whole, record, periods, channel)
    draw_line_filter(zoom, record, periods, channel, (near - 1.6, near + 1.6))
    whole.legend(loc="upper right", ncols=2)
    low, high = whole.get_ylim()
    whole.set_ylim(low, high * 3)
    zoom.set_ylabel("")
    whole.set_title(f"{channel}, {periods.periods} periods", loc="left")
    zoom.set_title(f"the same beside {near:g} Hz", loc="left")
    return figure


def draw_line_filter(
    axes: Axes,
    record: Samples,
    periods: Periods,
    channel: str,
    band: tuple[float, float] | None = None,
) -> None:
    """Draw the lines of the whole record and those that the filter keeps."""
    count = periods.periods * periods.samples
    first = round(float(periods.time[0, 0]) * record.sample_rate)
    x = record.column(channel)[first : first + count]
    amplitude = 2 * np.abs(np.fft.rfft(x, norm="forward"))
    frequency = np.arange(len(amplitude)) * record.sample_rate / count
    low, high = band or (0.0, 1.2 * float(periods.frequency.max()))
    shown = (frequency > low) & (frequency <= high)
    unit, factor = shown_unit(record.channels[record.names.index(channel)].unit)
    axes.plot(
        frequency[shown],
        factor * amplitude[shown],
        color=GREY,
        lw=0.6 if band is None else 0.9,
        marker="." if band else None,
        label="before: every line of the record",
    )
    kept = factor * periods.multiplicity * np.abs(periods.mean_spectrum[:, periods.index(channel)])
    inside = (periods.frequency > low) & (periods.frequency <= high)
    floor = factor * np.quantile(amplitude[shown], 0.02) / 2
    axes.vlines(periods.frequency[inside], 1e-3 * floor, kept[inside], color=BLUE, lw=1.6)
    decades(axes, y=True)
    axes.set_ylim(floor, 3 * float(kept.max()))
    axes.plot(
        periods.frequency[inside], kept[inside], "o", color=BLUE, ms=5, label="after: kept lines"
    )
    axes.set_xlim(low, high)
    axes.set_xlabel("frequency in Hz")
    axes.set_ylabel(f"amplitude in {unit}")


@styled
def draw_samples(record: Samples) -> Figure:
    """Draw every channel of a record over time."""
    count = len(record.channels)
    figure, axes = panels(count, 3, 1.8)
    step = max(1, len(record.samples) // MOST_SAMPLES)
    time = np.arange(0, len(record.samples), step) / record.sample_rate
    for index, panel in zip(range(count), axes, strict=False):
        unit, factor = shown_unit(record.channels[index].unit)
        panel.plot(time, factor * record.samples[::step, index], color=BLUE, lw=0.5)
        panel.set_title(label(record.channels[index].name, 36), loc="left")
        panel.set_ylabel(unit)
        if index >= count - 3:
            panel.set_xlabel("time in s")
    return figure


@styled
def draw_lines(record: Whole, predicted: Any = None) -> Figure:
    """Draw every channel's lines of a whole record, their noise, and those that are predicted."""
    count = len(record.channels)
    figure, axes = panels(count, 3, 1.8)
    noise = np.sqrt(np.diagonal(record.covariance.matrices, axis1=1, axis2=2).real)
    told = (
        {} if predicted is None else dict(zip(predicted.names, predicted.predicted.T, strict=True))
    )
    for index, panel in zip(range(count), axes, strict=False):
        channel = record.channels[index]
        unit, factor = shown_unit(channel.unit)
        panel.set_title(label(channel.name, 36), loc="left")
        panel.set_ylabel(f"amplitude in {unit}")
        for lines, color, width in (
            (np.abs(record.mean[:, index]), GREY, 0.6),
            (np.abs(told.get(channel.name, np.zeros(0))), BLUE, 0.6),
            (noise[:, index], RED, 1.0),
        ):
            if len(lines) and (lines > 0).any():
                amplitude = factor * record.multiplicity * lines
                panel.plot(
                    record.frequency,
                    np.where(amplitude > 0, amplitude, np.nan),
                    color=color,
                    lw=width,
                )
        decades(panel, y=True)
        if index >= count - 3:
            panel.set_xlabel("frequency in Hz")
    key = [
        Line2D([], [], color=GREY, label="measured"),
        *([Line2D([], [], color=BLUE, label="predicted")] if told else []),
        Line2D([], [], color=RED, label="noise of a line, one standard deviation"),
    ]
    figure.legend(handles=key, loc="outside upper left", ncols=len(key))
    return figure


@styled
def draw_spectra(record: Periods) -> Figure:
    """Draw the spectrum of the mean period of every channel, kept lines and noise level marked."""
    count = len(record.channels)
    figure, axes = panels(count, 3, 1.8)
    for index, panel in zip(range(count), axes, strict=False):
        _draw_spectrum(panel, record, index)
        if index >= count - 3:
            panel.set_xlabel("frequency in Hz")
    key = [
        Line2D([], [], color=BLUE, marker="o", ms=4, label="kept lines"),
        Line2D([], [], color=GREY, marker="o", ms=2.5, ls="none", label="other lines of the mean"),
        Line2D([], [], color=RED, lw=1.5, label="noise of the mean, one standard deviation"),
    ]
    figure.legend(handles=key, loc="outside upper left", ncols=len(key))
    return figure


def _draw_spectrum(axes: Axes, record: Periods, index: int) -> None:
    channel = record.channels[index]
    unit, factor = shown_unit(channel.unit)
    axes.set_title(label(channel.name, 36), loc="left")
    axes.set_ylabel(f"amplitude in {unit}")
    amplitude = 2 * factor * np.abs(np.fft.rfft(record.mean[:, index], norm="forward"))
    amplitude[0] /= 2
    kept = factor * record.multiplicity * np.abs(record.mean_spectrum[:, index])
    top = max(float(kept.max()), float(amplitude.max()))
    if top == 0:
        axes.text(0.5, 0.5, "zero", transform=axes.transAxes, ha="center")
        return
    highest = 1.5 * max(float(record.frequency.max()), record.fundamental)
    others = np.setdiff1d(np.arange(len(amplitude)), record.harmonics)
    others = others[others * record.fundamental <= highest]
    others = others[:: -(-len(others) // MOST_DOTS) or 1]
    scatter = np.sqrt(record.spectra[..., index].var(axis=0, ddof=1) / record.periods)
    noise = factor * record.multiplicity * scatter
    least = 1e-10 * top  # below it there is rounding only
    levels = [amplitude[others], noise, kept]
    seen = [x[x > least].min() for x in levels if (x > least).any()]
    floor = 0.4 * min(seen)
    decades(axes, y=True)
    axes.set_ylim(floor, 3 * top)
    axes.plot(others * record.fundamental, amplitude[others], "o", color=GREY, ms=2)
    if len(record.frequency) <= MOST_STEMS:
        axes.vlines(record.frequency, floor, kept, color=BLUE, lw=1.0)
        axes.plot(record.frequency, kept, "o", color=BLUE, ms=3.5)
        axes.plot(record.frequency, noise, "_", color=RED, ms=7, mew=1.5)
    else:
        axes.plot(record.frequency, kept, "o", color=BLUE, ms=2)
        axes.plot(record.frequency, noise, color=RED, lw=0.8)
