"""What an estimate says, as panels: measured and predicted, misfit, correlation, deviations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from rotorid.plots.panel import (
    BLUE,
    COLOURS,
    GREY,
    MOST_PANELS,
    RED,
    Axis,
    Curve,
    Floats,
    Look,
    Matrix,
    Panel,
    label,
    shown_unit,
    time_unit,
)

Shown = Any  # a RecordEvidence, which lies above

MOST_DOTS = 60
"""Lines up to which each is a dot."""
TWO = 2.0
"""Deviations to either side that a band of noise holds."""
LEAST = 0.01
"""Misfit over its expectation at or below which a line is drawn at the bottom."""
WORST = 5.0
"""Differences over their noise from which on a colour is at its end."""
RPM = 30 / np.pi


def waves(record: Shown) -> list[Panel]:
    """Return each predicted channel over time, measured and predicted, with the band of noise."""
    return _over_time(record, wave)


def _over_time(record: Shown, draw: Callable[[Any, Floats, str], Panel]) -> list[Panel]:
    """Draw the channels that are predicted over time, in a unit of time that suits."""
    time = np.asarray(record.time_s, dtype=float)
    if not len(time):
        return []
    title, stretch = time_unit(float(time[-1]))
    shown = [c for c in record.channels if len(c.wave_measured) and len(c.wave_predicted)]
    return [draw(c, stretch * time, title) for c in shown[:MOST_PANELS]]


def wave(channel: Any, time: Floats, title: str) -> Panel:
    """Return one channel over time, `time` in the unit that the title of its axis says."""
    unit, factor = shown_unit(channel.unit)
    measured = factor * np.asarray(channel.wave_measured)
    predicted = factor * np.asarray(channel.wave_predicted)
    curves = []
    noise = TWO * factor * channel.wave_noise
    if np.isfinite(noise) and noise > 0:
        told = "95 % band about it"
        curves.append(Curve(time, predicted + noise, told, BLUE, "band", base=predicted - noise))
    look: Look = "dots" if len(time) <= MOST_DOTS else "thick"
    curves += [
        Curve(time, measured, "measured", GREY, look),
        Curve(time, predicted, "predicted", BLUE, "line"),
    ]
    axis = Axis(f"{label(channel.name)} in {unit}")
    return Panel(_headline(channel), Axis(title), axis, tuple(curves))


def differences(record: Shown) -> list[Panel]:
    """Return what is left of each predicted channel over time, and the band of its noise."""
    return _over_time(record, _difference)


def _difference(channel: Any, time: Floats, title: str) -> Panel:
    unit, factor = shown_unit(channel.unit)
    away = factor * (np.asarray(channel.wave_predicted) - np.asarray(channel.wave_measured))
    curves = [Curve(time, away, "predicted less measured", RED, "line")]
    noise = TWO * factor * channel.wave_noise
    if np.isfinite(noise) and noise > 0:
        level = np.full_like(time, noise)
        told = "95 % band"
        curves.insert(0, Curve(time, level, told, GREY, "band", base=-level))
    name = label(channel.name, 36)
    return Panel(name, Axis(title), Axis(f"difference in {unit}"), tuple(curves))


def _headline(channel: Any) -> str:
    name = label(channel.name, 36)
    if not np.isfinite(channel.error):
        return name
    percent = 100 * channel.error
    return f"{name}: off by {percent:.0f} %" if percent >= 10 else f"{name}: off by {percent:.2g} %"


def lines(record: Shown) -> list[Panel]:
    """Return each channel on its lines: measured, predicted, their difference, and the noise."""
    x, axis = _abscissa(record)
    drawn = []
    for channel in record.channels[:MOST_PANELS]:
        unit, factor = shown_unit(channel.unit)
        curves = _line_curves(channel, x, factor)
        if curves:
            shown = Axis(f"amplitude in {unit}", log=True)
            drawn.append(Panel(_headline(channel), axis, shown, tuple(curves)))
        elif channel.measured:
            drawn.append(Panel(f"{label(channel.name, 36)}: zero", axis, Axis(unit)))
    return drawn


def _abscissa(record: Shown) -> tuple[Floats, Axis]:
    return _over(record.frequency_hz, turning=record.kind == "phasors")


def _over(hertz: Sequence[float], *, turning: bool) -> tuple[Floats, Axis]:
    """Return what lines are drawn over, frequencies or the speeds of a rotation of these."""
    x = np.asarray(hertz, dtype=float)
    return (60 * x, Axis("speed in rpm")) if turning else (x, Axis("frequency in Hz"))


def _line_curves(channel: Any, x: Floats, factor: float) -> list[Curve]:
    def shown(values: Sequence[float]) -> Floats:
        made = factor * np.asarray(values, dtype=float)
        return np.where(made > 1e-10 * top, made, np.nan)

    top = factor * max((*channel.measured, *channel.predicted), default=0.0)
    if not top > 0:
        return []
    few = len(x) <= MOST_DOTS
    dots: Look = "dots" if few else "line"
    curves = []
    if channel.noise:
        told = "noise, up to two deviations"
        noise = shown(channel.noise)
        curves.append(Curve(x, TWO * noise, told, RED, "band", base=noise / 10))
    curves.append(Curve(x, shown(channel.measured), "measured", GREY, dots))
    if channel.predicted:
        look: Look = "diamonds" if few else "thin"
        curves.append(Curve(x, shown(channel.predicted), "predicted", BLUE, look))
        points: Look = "points" if not few else "dots"
        away = shown(channel.difference)
        curves.append(Curve(x, away, "predicted less measured", RED, points))
    return [curve for curve in curves if np.isfinite(curve.y).any()]


def residual(record: Shown) -> list[Panel]:
    """Return the difference of every predicted channel on every line, over its noise."""
    x, axis = _abscissa(record)
    shown = [c for c in record.channels if c.difference and c.noise][:MOST_PANELS]
    if not shown or len(x) < 2:
        return []
    with np.errstate(divide="ignore", invalid="ignore"):
        values = np.array([np.divide(c.difference, c.noise) for c in shown])
    values = np.where(np.isfinite(values), values, np.nan)
    names = tuple(label(c.name) for c in shown)
    matrix = Matrix(names, x, values, 0.0, WORST, "difference / noise")
    return [Panel("", axis, Axis(), matrix=matrix, height=1.1 + 0.26 * len(names))]


def misfit(
    records: Sequence[int],
    frequency: Sequence[float],
    cost: Sequence[float],
    expected: Sequence[float],
    *,
    turning: bool = False,
) -> Panel:
    """Return the misfit of every line over what noise leaves of it, a colour per record.

    turning: the lines are those of the rotation, over its speed.
    """
    over, axis = _over(frequency, turning=turning)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.asarray(cost, dtype=float) / np.asarray(expected, dtype=float)
    ratio = np.where(np.isfinite(ratio) & (ratio > 0), ratio, np.nan)
    least = max(float(np.nanmin(ratio, initial=1.0)), LEAST)
    ratio = np.where(ratio > least, ratio, least)  # a line that is met whole has no place there
    where, numbers = np.asarray(records), sorted(set(records))
    curves = []
    for place, number in enumerate(numbers):
        own = where == number
        told = f"record {number + 1}" if len(numbers) > 1 else "misfit of a line"
        x, colour = over[own], COLOURS[place % len(COLOURS)]
        look: Look = "dots" if own.sum() <= MOST_DOTS else "points"
        curves.append(Curve(x, ratio[own], told, colour, look))
    ends = (min(float(ratio.min()) / 1.2, 0.5), max(1.2 * float(ratio.max()), 2.0))
    return Panel(
        "",
        axis,
        Axis("misfit / expected", log=True, ends=ends),
        tuple(curves),
        level=1.0,
        height=2.8,
    )


def correlation(names: Sequence[str], matrix: Floats) -> Panel:
    """Return a correlation matrix, shape (name, name)."""
    short = tuple(label(name) for name in names)
    shown = Matrix(short, short, matrix, -1.0, 1.0, "correlation", written=len(short) <= 20)
    return Panel(matrix=shown, height=min(max(3.0, 0.28 * len(short) + 1.8), 12.0))


def deviations(names: Sequence[str], percent: Floats) -> Panel:
    """Return the deviations of parameters in percent."""
    seen = np.where(percent > 0, percent, np.nan)
    curve = Curve(seen, np.arange(len(names), dtype=float), "", BLUE, "dots")
    return Panel(
        "",
        Axis("standard deviation in %", log=True),
        Axis(names=tuple(map(label, names))),
        (curve,),
        height=min(max(2.6, 0.3 * len(names) + 1.2), 14.0),
    )
