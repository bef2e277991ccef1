"""What is in a record, as panels: samples, lines, periods, noise."""

from __future__ import annotations

from typing import Any

import numpy as np

from rotorid.plots.panel import (
    BLUE,
    GREEN,
    GREY,
    MOST_PANELS,
    PINK,
    RED,
    Axis,
    Curve,
    Floats,
    Look,
    Matrix,
    Panel,
    envelope,
    label,
    shown_unit,
)

# Pictures lie below records, whose types they cannot import.
Record = Any
Periods = Any  # a PeriodicRecord
Whole = Any  # Lines

MOST_BLOCKS = 600
"""Steps of the band in which a long record is drawn."""
MOST_DOTS = 400
"""Other lines that a panel shows: of more, every so many."""
MOST_STEMS = 40
"""Kept lines that are drawn one by one."""
ROUNDING = 1e-10
"""Of the largest line: below it there is rounding only."""
HERTZ = Axis("frequency in Hz")


def samples(record: Record, whole_blocks: int = 1) -> list[Panel]:
    """Return every channel over the record: as it is, or as the band between its extremes.

    `whole_blocks` is a number of samples of which a step of the band holds whole ones: else the
    steps beat with a period.
    """
    drawn = []
    count = len(record.samples)
    size = -(-count // MOST_BLOCKS) or 1
    if 1 < whole_blocks <= 12 * size:
        size = -(-size // whole_blocks) * whole_blocks
    used = record.samples[: count // size * size] if count >= size else record.samples
    size = size if count >= size else 1
    time = (np.arange(len(used) // size) + (size - 1) / 2) * size / record.sample_rate
    if size > 1:
        time = (np.arange(len(used) // size) + 0.5) * size / record.sample_rate
    for c, channel in list(enumerate(record.channels))[:MOST_PANELS]:
        unit, factor = shown_unit(channel.unit)
        low, high, _ = envelope(factor * used[:, c], len(time))
        curve = (
            Curve(time, high, "from lowest to highest sample", BLUE, "band", base=low)
            if size > 2
            else Curve(time, high, "samples", BLUE, "thin")
        )
        drawn.append(
            Panel(
                label(channel.name, 36),
                Axis("time in s"),
                Axis(f"{label(channel.name)} in {unit}"),
                (curve,),
            )
        )
    return drawn


def spectra(record: Periods) -> list[Panel]:
    """Return the lines of the mean period of every channel: kept, other odd and even, noise."""
    return [_spectrum(record, c) for c in range(min(len(record.channels), MOST_PANELS))]


def _spectrum(record: Periods, c: int) -> Panel:
    channel = record.channels[c]
    unit, factor = shown_unit(channel.unit)
    amplitude = 2 * factor * np.abs(np.fft.rfft(record.mean[:, c], norm="forward"))
    amplitude[0] /= 2
    kept = factor * record.multiplicity * np.abs(record.mean_spectrum[:, c])
    top = max(float(kept.max(initial=0.0)), float(amplitude.max(initial=0.0)))
    title, axis = label(channel.name, 36), Axis(f"amplitude in {unit}", log=True)
    if top == 0:
        return Panel(f"{title}: zero", HERTZ, Axis(f"amplitude in {unit}"))
    highest = 1.5 * max(float(record.frequency.max()), record.fundamental)
    others = np.setdiff1d(np.arange(len(amplitude)), [0, *record.harmonics])
    others = others[others * record.fundamental <= highest]
    others = others[:: -(-len(others) // MOST_DOTS) or 1]
    scatter = record.spectra[..., c].var(axis=0, ddof=1) if record.periods > 1 else 0 * kept
    noise = factor * record.multiplicity * np.sqrt(scatter / record.periods)
    levels = [amplitude[others], noise, kept]
    seen = [x[x > ROUNDING * top].min() for x in levels if (x > ROUNDING * top).any()]
    floor = 0.4 * float(min(seen))
    few = len(record.frequency) <= MOST_STEMS
    lines = record.frequency.astype(float)
    curves = []
    for odd, colour, told in (
        (1, GREEN, "odd multiples, not used"),
        (0, PINK, "even multiples, not used"),
    ):
        here = others[(others % 2 == odd) & (amplitude[others] > ROUNDING * top)]
        curves.append(Curve(here * record.fundamental, amplitude[here], told, colour, "points"))
    if few:
        curves.append(Curve(lines, kept, "", BLUE, "stems", base=np.full_like(kept, floor)))
    curves.append(Curve(lines, kept, "used", BLUE, "dots" if few else "points"))
    if (noise > ROUNDING * top).any():
        curves.append(Curve(lines, noise, "noise of the mean, one standard deviation", RED, "line"))
    drawn = tuple(curve for curve in curves if len(curve.x))
    return Panel(title, HERTZ, Axis(axis.title, log=True, ends=(floor, 3 * top)), drawn)


def rows(record: Whole, *, turning: bool) -> list[Panel]:
    """Return every channel of a table, by its speed or its frequency, and the noise."""
    axis = Axis("speed in rpm") if turning else HERTZ
    x = 30 / np.pi * record.speed if turning else record.frequency
    drawn = []
    noise = np.sqrt(np.diagonal(record.covariance.matrices, axis1=1, axis2=2).real.clip(0))
    look: Look = "line" if len(record.frequency) > MOST_STEMS else "dots"
    for c, channel in list(enumerate(record.channels))[:MOST_PANELS]:
        unit, factor = shown_unit(channel.unit)
        curves = []
        for values, told, colour in (
            (np.abs(record.mean[:, c]), "measured", GREY),
            (noise[:, c], "noise, one deviation", RED),
        ):
            if (values > 0).any():
                shown = factor * record.multiplicity * values
                shown = np.where(shown > 0, shown, np.nan)
                curves.append(Curve(x, shown, told, colour, look))
        y = Axis(f"amplitude in {unit}", log=bool(curves))
        drawn.append(Panel(label(channel.name, 36), axis, y, tuple(curves)))
    return drawn


def line_filter(
    record: Record, periods: Periods, channel: str, band: tuple[float, float] | None = None
) -> Panel:
    """Return the lines of the whole record and those that the line filter keeps."""
    count = periods.periods * periods.samples
    first = round(float(periods.time[0, 0]) * record.sample_rate)
    amplitude = 2 * np.abs(
        np.fft.rfft(record.column(channel)[first : first + count], norm="forward")
    )
    frequency = np.arange(len(amplitude)) * record.sample_rate / count
    low, high = band or (0.0, 1.2 * float(periods.frequency.max()))
    shown = (frequency > low) & (frequency <= high)
    unit, factor = shown_unit(record.channels[record.names.index(channel)].unit)
    kept = factor * periods.multiplicity * np.abs(periods.mean_spectrum[:, periods.index(channel)])
    inside = (periods.frequency > low) & (periods.frequency <= high)
    floor = factor * float(np.quantile(amplitude[shown], 0.02)) / 2
    lines, sizes = periods.frequency[inside].astype(float), kept[inside]
    title = f"{label(channel)}, {periods.periods} periods"
    return Panel(
        title if band is None else f"from {low:g} to {high:g} Hz",
        Axis(HERTZ.title, ends=(low, high)),
        Axis(f"amplitude in {unit}", log=True, ends=(floor, 4 * float(kept.max()))),
        (
            Curve(
                frequency[shown],
                factor * amplitude[shown],
                "before: every line of the record",
                GREY,
                "thin",
            ),
            Curve(lines, sizes, "", BLUE, "stems", base=np.full_like(sizes, floor)),
            Curve(lines, sizes, "after: the lines of the excitation", BLUE, "dots"),
        ),
        height=3.0,
    )


def each_period(record: Periods) -> Panel:
    """Return the deviation of each period from the mean, over its scatter, channel by channel."""
    z = record.spectra - record.mean_spectrum
    scatter = np.sqrt(np.median(np.abs(z) ** 2, axis=0).mean(axis=0))
    size = np.sqrt((np.abs(z) ** 2).mean(axis=1)) / np.where(scatter > 0, scatter, np.inf)
    time = record.time[:, 0]
    channels = [
        Curve(time, size[:, c], "each channel", GREY, "thin")
        for c in range(min(size.shape[1], MOST_PANELS))
    ]
    middle = Curve(time, np.median(size, axis=1), "their median", BLUE, "line")
    top = 1.05 * float(size.max(initial=1.0))
    return Panel(
        "",
        Axis("start of the period in s"),
        Axis("deviation over scatter", ends=(0.0, top)),
        (*channels, middle),
        height=2.8,
    )


def noise_correlation(names: list[str], matrix: Floats) -> Panel:
    """Return the size of the correlation of the noise between channels."""
    short = tuple(label(name, 14) for name in names)
    shown = Matrix(short, short, matrix, 0.0, 1.0, "correlation")
    return Panel(matrix=shown, height=min(9.0, 1.6 + 0.3 * len(short)))
