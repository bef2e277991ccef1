"""Pictures of records and estimates: spectra, forces measured and predicted, correlations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rotorid.estimate import Estimate
from rotorid.models import Model
from rotorid.predict import missing_values, predict_lines
from rotorid.record import Floats, PeriodicRecord, Record
from rotorid.report.style import BLUE, GREY, INK, RED, decades, label, new_figure, panels, styled
from rotorid.signals.spectrum import synthesize

MOST_POINTS = 2000  # of a curve
MOST_DOTS = 400
MOST_STEMS = 40


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


def force_waves(model: Model, estimate: Estimate, record: PeriodicRecord) -> ForceWaves | None:
    """Return a record's channels as measured and as an estimate predicts them.

    ``None`` where the estimate leaves a parameter open or is of another model, and where the
    phase of the rotor is not known.
    """
    known = all(np.isfinite(v.value) for v in estimate.parameters) and record.phase_known
    if not known or missing_values(model, estimate):
        return None
    (found,) = predict_lines(model, estimate, [record])
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.where(found.size > 0, np.sqrt(found.wrong / found.size), np.nan)
    return ForceWaves(
        found.names,
        found.units,
        np.arange(record.samples) / record.sample_rate,
        synthesize(found.measured, record.harmonics, record.samples),
        synthesize(found.predicted, record.harmonics, record.samples),
        error,
    )


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
    measured, predicted = waves.measured[:, index], waves.predicted[:, index]
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
    axes.set_ylabel(f"{name} in {label(waves.units[index], 12)}")
    axes.set_xlabel(text)
    axes.margins(x=0.01)


@styled
def draw_filter(record: Record, periods: PeriodicRecord, channel: str, near: float) -> Figure:
    """Draw the spectrum of a channel before and after the line filter, the seed's Fig. 2."""
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
    record: Record,
    periods: PeriodicRecord,
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
    unit, factor = _shown_unit(record.channels[record.names.index(channel)].unit)
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


def _shown_unit(unit: str) -> tuple[str, float]:
    """Return a handy unit for small motion, and the factor from SI."""
    return {"m": ("µm", 1e6), "rad": ("µrad", 1e6)}.get(unit, (label(unit, 12) or "1", 1.0))


@styled
def draw_spectra(record: PeriodicRecord) -> Figure:
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


def _draw_spectrum(axes: Axes, record: PeriodicRecord, index: int) -> None:
    channel = record.channels[index]
    unit, factor = _shown_unit(channel.unit)
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


@styled
def draw_correlation(names: Sequence[str], matrix: Floats) -> Figure:
    """Draw a correlation matrix, shape (name, name)."""
    names = [label(name) for name in names]
    size = min(max(3.2, 0.32 * len(names) + 2.2), 14.0)
    figure = new_figure(size + 0.6, size)
    axes = figure.subplots()
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
    return figure
