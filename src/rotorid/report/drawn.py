"""Panels, what a picture shows, said once: of records, estimates, machines, loops and rotors."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.core.values import Complexes, Floats

Source = Any  # what is drawn: records, answers and rotors, whose types lie above

GREY = "#80868b"
BLUE, SKY, GREEN, RED, PINK = "#0072b2", "#56b4e9", "#009e73", "#d55e00", "#cc79a7"
# Okabe and Ito: told apart by every eye, and on black as on white
COLOURS = (BLUE, RED, GREEN, PINK, SKY)  # of records

Look = Literal[
    "line", "thin", "thick", "dashed", "dots", "points", "stems", "band", "diamonds", "named"
]
MOST_PANELS = 24  # channels with a panel of their own: what a page still shows


@frozen
class Curve:
    # (point,): naN leaves a gap
    x: Floats
    y: Floats
    label: str  # what it is; alike in all panels of a picture, whose key lists it once
    colour: str = BLUE
    look: Look = "line"
    base: Floats | None = None  # (point,): the lower edge of a band; `y` is the upper one
    error: Floats | None = None  # (point,): half-lengths of bars along x
    told: tuple[str, ...] = ()  # what is said of each point besides


@frozen
class Matrix:
    """Numbers by row and column, as colours from `low` to `high`."""

    rows: tuple[str, ...]
    columns: tuple[str, ...] | Floats  # sequence of str, or array of numbers on the axis
    values: Floats  # (row, column)
    low: float
    high: float
    label: str
    written: bool = False  # whether numbers of note stand in their cells


@frozen
class Axis:
    title: str = ""
    log: bool = False
    ends: tuple[float, float] | None = None
    names: tuple[str, ...] = ()


@frozen
class Panel:
    title: str = ""
    x: Axis = Axis()
    y: Axis = Axis()
    curves: tuple[Curve, ...] = ()
    matrix: Matrix | None = None
    level: float | None = None  # where a thin line goes across
    upright: float | None = None
    height: float = 2.1  # inches
    equal: bool = False  # whether both axes have one scale, so that a circle is one


def key_of(panels: Sequence[Panel]) -> list[Curve]:
    found = {c.label: c for panel in panels for c in panel.curves if c.label}
    return list(found.values())


def label(name: str, most: int = 24) -> str:
    """Return a name as a picture can hold it: printable, on one line, not too long."""
    text = "".join(c if c.isprintable() else " " for c in name)
    return text if len(text) <= most else text[: most - 1].rstrip() + "…"


def shown_unit(unit: str) -> tuple[str, float]:
    """Return a handy unit for small motion, and the factor from SI."""
    return {"m": ("µm", 1e6), "rad": ("µrad", 1e6)}.get(unit, (label(unit, 12) or "1", 1.0))


def thinned(panel: Panel, most: int) -> Panel:
    return replace(panel, curves=tuple(_thinned(curve, most) for curve in panel.curves))


def _thinned(curve: Curve, most: int) -> Curve:
    """Return a curve with the lowest and the highest point of each of `most` / 2 stretches."""
    if len(curve.x) <= most or curve.look == "stems" or curve.error is not None:
        return curve
    bounds = np.linspace(0, len(curve.x), max(1, most // 2) + 1).astype(int)
    if curve.base is not None:
        middle, starts = (bounds[:-1] + bounds[1:] - 1) // 2, bounds[:-1]
        high, low = np.maximum.reduceat(curve.y, starts), np.minimum.reduceat(curve.base, starts)
        return replace(curve, x=curve.x[middle], y=high, base=low, told=())
    low_first = np.where(np.isfinite(curve.y), curve.y, np.inf)
    high_first = np.where(np.isfinite(curve.y), curve.y, -np.inf)
    picked = {
        int(a + find(values[a:b]))
        for a, b in pairwise(bounds)
        for find, values in ((np.argmin, low_first), (np.argmax, high_first))
    }
    kept = np.array(sorted(picked))
    told = tuple(curve.told[i] for i in kept) if curve.told else ()
    return replace(curve, x=curve.x[kept], y=curve.y[kept], told=told)


GMM = 1e6  # g mm in a kg m
ROUND = 121  # points of a circle
TWO = 1.959964  # deviations to either side that a band holds
ROOM = 1.25  # how much wider a plane is drawn than what stands in it


def corrections(found: Source) -> list[Panel]:
    pairs = zip(found.corrections, found.residual, strict=True)
    return [_plane(one, left) for one, left in list(pairs)[:MOST_PANELS]]


def _plane(one: Any, left: Any) -> Panel:
    tip = GMM * one.unbalance_kg_m * np.exp(1j * one.angle_rad)
    way = np.array([0j, tip])
    told = (f"{abs(tip):.4g} g mm at {np.degrees(one.angle_rad):.1f} deg",) * 2
    curves = [Curve(way.real, way.imag, "to be added", BLUE, "thick", told=told)]
    curves.append(Curve(way.real[1:], way.imag[1:], "", BLUE, "dots"))
    reach = abs(tip)
    if left.unbalance_kg_m is not None:
        radius = GMM * left.unbalance_kg_m
        ring = tip + radius * np.exp(1j * np.linspace(0, 2 * np.pi, ROUND))
        curves.append(Curve(ring.real, ring.imag, "the right one, with 95 %", RED, "line"))
        reach = max(reach, float(np.abs(ring).max()))
    if one.masses and reach > 0:
        # Where on the rim a mass goes counts, not how far out this picture draws it.
        counts = Counter(one.masses).items()  # one upon the other they would seem to be one
        rim = 1.1 * reach * np.exp(1j * np.array([angle for (_, angle), _ in counts]))
        named = tuple(f"{n} x {1e3 * m:.4g} g at {np.degrees(a):.1f} deg" for (m, a), n in counts)
        curves.append(Curve(rim.real, rim.imag, "masses", GREEN, "named", told=named))
        reach *= 1.1
    ends = (-ROOM * reach, ROOM * reach) if reach > 0 else (-1.0, 1.0)
    return Panel(
        label(one.plane, 48),
        Axis("g mm towards 0 deg", ends=ends),
        Axis("g mm towards 90 deg", ends=ends),
        tuple(curves),
        level=0.0,
        upright=0.0,
        height=3.2,
        equal=True,
    )


def loops(found: Sequence[Source], limits: dict[str, float]) -> list[Panel]:
    return [_loop(one, limits) for one in found[:MOST_PANELS]]


def _loop(one: Any, limits: dict[str, float]) -> Panel:
    frequency = np.asarray(one.frequency_hz, dtype=float)
    size, std = np.abs(one.sensitivity), np.asarray(one.std, dtype=float)
    ends, at = np.array([frequency.min(), frequency.max()]), np.full(2, one.peak_hz)
    curves = [
        Curve(ends, np.full(2, limit), f"end of zone {zone}", colour, "dashed")
        for (zone, limit), colour in zip(limits.items(), (GREEN, PINK, COLOURS[1]), strict=True)
    ]
    curves += [
        _band(frequency, size, std, "95 % of each line"),
        Curve(frequency, size, "measured", BLUE, "line"),
        Curve(at, np.array(one.interval), "the peak, with 95 %", GREY, "thick"),
        Curve(at[:1], np.array([one.peak]), "", GREY, "dots"),
    ]
    title = f"{label(one.axis, 36)}: {one.peak:.3g} at {one.peak_hz:.4g} Hz, {one.verdict}"
    y = Axis("sensitivity |S|", log=True)
    return Panel(title, HERTZ, y, tuple(curves), height=2.6)


LOW = 1.4  # inches of a panel, of which a first screen holds three
BIAS = 0.1  # rad by which a phase of 180 deg may be less, and is -180 all the same


def force_response(found: Source, hertz: Floats, model: Complexes, std: Floats) -> list[Panel]:
    """Return a measured response and the model's, whose `std` are along it and across it."""
    x, seen = np.array(found.frequency_hz), np.array(found.real) + 1j * np.array(found.imag)
    bar, size = np.array(found.std) / np.sqrt(2), np.abs(model)  # half of the variance each way
    # Without damping responses turn by 180 deg at once: from 0 to -180, and not on.
    phase = np.unwrap(np.angle(model * np.exp(1j * BIAS)) - BIAS, 1.1 * np.pi)
    here = np.searchsorted(hertz, x)
    turned = phase[here] + np.angle(seen / model[here])
    axis = Axis(HERTZ.title, log=True, ends=(float(hertz[0]), float(hertz[-1])))
    told = "measured, with 95 %"
    panels: list[Panel] = []
    for y, line, wide, least, points, half in (
        (Axis(found.unit, log=True), size, std[0], size / 100, np.abs(seen), bar),
        (
            Axis("deg"),
            *np.degrees([phase, np.minimum(std[1] / size, np.pi / TWO), phase - 4]),
            *np.degrees([turned, bar / np.abs(seen)]),
        ),
    ):
        low, high = np.maximum(line - TWO * wide, least), line + TWO * wide
        curves = [Curve(hertz, high, "95 % of the model", BLUE, "band", base=low)]
        curves += [Curve(hertz, line, "model", BLUE), Curve(x, points, told, RED, "dots")]
        base = np.maximum(points - TWO * half, least.min())
        curves += [Curve(x, points + TWO * half, "", RED, "stems", base=base)]
        panels.append(
            Panel(("Magnitude", "Phase")[len(panels)], axis, y, tuple(curves), height=LOW)
        )
    if bar.all():
        away = (seen / model[here] - 1) * size[here] / bar
        curves = [Curve(x, away.real, "residual along the response", RED, "dots")]
        curves += [Curve(x, away.imag, "residual across it", GREEN, "diamonds")]
        panels.append(Panel("Residual", axis, Axis("std"), tuple(curves), level=0.0, height=LOW))
    return panels


def _band(x: Floats, size: Floats, std: Floats, told: str) -> Curve:
    """Return what holds sizes with 95 %, on a logarithmic axis."""
    low = np.maximum(size - TWO * std, size / 100)
    return Curve(x, size + TWO * std, told, BLUE, "band", base=low)


MOST_DOTS = 60  # lines up to which each is a dot
NOISE_BAND = 2.0  # deviations to either side that a band of noise holds
LEAST = 0.01  # misfit over its expectation at or below which a line is drawn at the bottom
WORST = 5.0  # differences over their noise from which on a colour is at its end
RPM = 30 / np.pi
HERTZ = Axis("frequency in Hz")


def over_time(record: Source) -> list[Panel]:
    time = np.asarray(record.time_s, dtype=float)
    if not len(time):
        return []
    title, stretch = ("time in s", 1.0) if time[-1] > 1 else ("time in ms", 1e3)
    shown = [c for c in record.channels if len(c.wave_measured) and len(c.wave_predicted)]
    return [_difference(c, stretch * time, title) for c in shown[:MOST_PANELS]]


def _difference(channel: Any, time: Floats, title: str) -> Panel:
    unit, factor = shown_unit(channel.unit)
    away = factor * (np.asarray(channel.wave_predicted) - np.asarray(channel.wave_measured))
    curves = [Curve(time, away, "predicted less measured", RED, "line")]
    noise = np.full_like(time, NOISE_BAND * factor * channel.wave_noise)
    if 0 < noise[0] < np.inf:
        curves.insert(0, Curve(time, noise, "95 % band", GREY, "band", base=-noise))
    axis = Axis(f"difference in {unit}")
    return Panel(_headline(channel), Axis(title), axis, tuple(curves))


def _headline(channel: Any) -> str:
    name = label(channel.name, 36)
    if not np.isfinite(channel.error):
        return name
    percent = 100 * channel.error
    return f"{name}: off by {percent:.0f} %" if percent >= 10 else f"{name}: off by {percent:.2g} %"


def lines(record: Source) -> list[Panel]:
    x, axis = _over(record.frequency_hz, turning=record.kind == "phasors")
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


def _over(hertz: Sequence[float] | Floats, *, turning: bool) -> tuple[Floats, Axis]:
    """Return what lines are drawn over, frequencies or the speeds of a rotation of these."""
    x = np.asarray(hertz, dtype=float)
    return (60 * x, Axis("speed in rpm")) if turning else (x, HERTZ)


def _line_curves(channel: Any, x: Floats, factor: float) -> list[Curve]:
    def shown(values: Sequence[float]) -> Floats:
        made = factor * np.asarray(values, dtype=float)
        return np.where(made > 1e-10 * top, made, np.nan)

    top = factor * max((*channel.measured, *channel.predicted), default=0.0)
    if not top > 0:
        return []
    looks: tuple[Look, Look, Look] = ("line", "thin", "points")
    if len(x) <= MOST_DOTS:
        looks = ("dots", "diamonds", "dots")
    curves = []
    if channel.noise:
        told = "noise, up to two std"
        noise = shown(channel.noise)
        curves.append(Curve(x, NOISE_BAND * noise, told, RED, "band", base=noise / 10))
    curves.append(Curve(x, shown(channel.measured), "measured", GREY, looks[0]))
    if channel.predicted:
        away = shown(channel.difference)
        curves.append(Curve(x, shown(channel.predicted), "predicted", BLUE, looks[1]))
        curves.append(Curve(x, away, "predicted less measured", RED, looks[2]))
    return [curve for curve in curves if np.isfinite(curve.y).any()]


def residual(record: Source) -> list[Panel]:
    x, axis = _over(record.frequency_hz, turning=record.kind == "phasors")
    shown = [c for c in record.channels if c.difference and c.noise][:MOST_PANELS]
    if not shown or len(x) < 2:
        return []
    with np.errstate(divide="ignore", invalid="ignore"):
        values = np.array([np.divide(c.difference, c.noise) for c in shown])
    values = np.where(np.isfinite(values), values, np.nan)
    names = tuple(label(c.name) for c in shown)
    matrix = Matrix(names, x, values, 0.0, WORST, "difference / noise")
    return [Panel("", axis, Axis(), matrix=matrix, height=max(1.8, 1.1 + 0.26 * len(names)))]


def misfit(rows: Source, *, turning: bool = False) -> Panel:
    """Return misfit over what noise leaves, a colour per record; over the speed if `turning`."""
    figures = [(row.record, row.frequency_hz, row.cost, row.expected) for row in rows]
    where, frequency, cost, expected = np.array(figures, dtype=float).T
    over, axis = _over(frequency, turning=turning)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = cost / expected
    ratio = np.where(np.isfinite(ratio) & (ratio > 0), ratio, np.nan)
    least = max(float(np.nanmin(ratio, initial=1.0)), LEAST)
    ratio = np.where(ratio > least, ratio, least)  # a line that is met whole has no place there
    numbers, curves = np.unique(where).tolist(), []
    for place, number in enumerate(numbers):
        own = where == number
        told = f"record {number + 1:.0f}" if len(numbers) > 1 else "misfit of a line"
        x, colour = over[own], COLOURS[place % len(COLOURS)]
        look: Look = "dots" if own.sum() <= MOST_DOTS else "points"
        curves.append(Curve(x, ratio[own], told, colour, look))
    ends = (min(float(ratio.min()) / 1.2, 0.5), max(1.2 * float(ratio.max()), 2.0))
    y = Axis("misfit / expected", log=True, ends=ends)
    return Panel("", axis, y, tuple(curves), level=1.0, height=2.8)


def correlation(names: Sequence[str], matrix: Floats) -> Panel:
    short = tuple(label(name) for name in names)
    shown = Matrix(short, short, matrix, -1.0, 1.0, "correlation", written=len(short) <= 20)
    return Panel(matrix=shown, height=min(max(3.0, 0.28 * len(short) + 1.8), 12.0))


def deviations(names: Sequence[str], percent: Floats) -> Panel:
    seen = np.where(percent > 0, percent, np.nan)
    ends = (float(np.nanmin(seen)) / 2, 2 * float(np.nanmax(seen))) if (percent > 0).any() else None
    curve = Curve(seen, np.arange(len(names), dtype=float), "", BLUE, "dots")
    return Panel(
        "",
        Axis("standard deviation in %", log=True, ends=ends),
        Axis(names=tuple(map(label, names))),
        (curve,),
        height=min(max(2.6, 0.3 * len(names) + 1.2), 14.0),
    )


WAYS: Mapping[str, str] = {"forward": BLUE, "backward": RED, "planar": GREEN, "mixed": PINK}
FLAT = 0.05
"""Share of a motion across its plane below which it is drawn as one in a plane."""
MOST_SHAPES = 9
"""Modes whose shape is drawn: the lowest."""
MOST_PLACES = 12
"""Coordinates whose response is drawn."""
SAME = 1e-9
"""Relative difference of two frequencies up to which they are one."""
HIGHEST = 3.0
"""Curves of a diagram are shown up to this many times the fastest rotation."""
EVEN = 1.5
"""Largest amplitude over the least up to which an axis begins at 0. A rigid rotor moves alike at
every speed, and on an axis of its own would seem to be known badly."""
NODE = re.compile(r"node\d+$")


def campbell(found: Source) -> Panel:
    """Return natural frequencies over the speed with their bands, and the critical speeds."""
    rpm = RPM * np.asarray(found.speed)
    turning = np.abs(found.speed) / (2 * np.pi)
    curves = [Curve(rpm, turning, "the rotation, 1x", GREY, "dashed")]
    for k, whirl in enumerate(found.whirl):
        frequency, std = found.frequency_hz[:, k], found.std_hz[:, k]
        colour = WAYS.get(whirl, GREY)
        if np.isfinite(std).any():
            half = TWO * np.where(np.isfinite(std), std, 0.0)
            edge = frequency - half
            curves.append(Curve(rpm, frequency + half, "95 % band", colour, "band", base=edge))
        curves.append(Curve(rpm, frequency, whirl, colour, "line"))
    if found.critical:
        speed = np.array([each.speed_rad_s for each in found.critical])
        std = np.array([np.nan if each.std is None else each.std for each in found.critical])
        error = RPM * TWO * std if np.isfinite(std).all() else None
        told = tuple(f"{RPM * each.speed_rad_s:.6g} rpm, {each.whirl}" for each in found.critical)
        marks = (RPM * speed, np.abs(speed) / (2 * np.pi))
        curves.append(Curve(*marks, "critical speeds", PINK, "diamonds", error=error, told=told))
    frequency, fastest = np.asarray(found.frequency_hz), float(turning.max())
    tops = np.where(np.isfinite(frequency), frequency, 0.0).max(axis=0, initial=0.0)
    near = tops[tops <= HIGHEST * fastest]
    ends = (0.0, 1.08 * float(max([fastest, *(near if len(near) else np.sort(tops)[:1])])))
    return Panel(
        "", Axis("speed in rpm"), Axis("frequency in Hz", ends=ends), tuple(curves), height=4.2
    )


def shapes(
    found: Source, places: Sequence[tuple[int, ...]], positions: Floats | None = None
) -> list[Panel]:
    """Return the shape of each mode: the part that whirls forward, and the part that goes back.

    Places are pairs of coordinates x and y, or all of a single one; their `positions` along the
    rotor are in m. Motion in a plane is one line: its parts are alike, and those of two modes of
    one frequency any. A single place has no shape.
    """
    if len(places) < 2:
        return []
    names, alone = [found.coordinates[place[0]] for place in places], len(places[0]) == 1
    few = tuple(label(name, 12) for name in names) if len(names) <= MOST_PLACES else ()
    along = Axis("" if few else "places along the shaft, in the model's order", names=few)
    if positions is not None:
        along = Axis("mm from the left end")
    place = np.arange(len(names), dtype=float) if positions is None else 1e3 * positions
    frequency = np.array([mode.frequency_hz for mode in found.modes])
    height, drawn = Axis("share of the largest", ends=(-1.15, 1.15)), []
    for k, mode in enumerate(found.modes[:MOST_SHAPES]):
        # Shapes of two modes of one frequency are any mixture.
        twice = int((np.abs(frequency - frequency[k]) <= SAME * frequency[k]).sum()) > 1
        parts, curves = _ways(mode, places, twice=twice), []
        whole = max(float(np.abs(part).max(initial=0.0)) for part in parts.values())
        for way, part in parts.items():
            told = "motion" if alone else "in a plane" if way == "planar" else f"{way} part"
            largest = part[int(np.abs(part).argmax())]  # at the moment when it is at its largest
            shown = (part * np.exp(-1j * np.angle(largest))).real / (whole or 1.0)
            curves.append(Curve(place, shown, told, WAYS[way], "line"))
            named = tuple(map(label, names))
            curves.append(Curve(place, shown, "", WAYS[way], "points", told=named))
        title = f"Mode {k + 1}: {mode.frequency_hz:.5g} Hz, {mode.whirl}"
        drawn.append(Panel(title, along, height, tuple(curves), level=0.0))
    return drawn


def _ways(mode: Any, places: Sequence[tuple[int, ...]], *, twice: bool) -> dict[str, Any]:
    """Return the parts of a shape; one alone where directions are alike at all places."""
    x, *others = np.asarray(mode.shape)[np.array(places)].T
    if not others:
        return {"planar": x}
    (y,) = others
    parts = {"forward": (x + 1j * y) / 2, "backward": (x - 1j * y) / 2}
    if mode.whirl == "planar":
        left, sizes, _ = np.linalg.svd(np.column_stack([x, y]), full_matrices=False)
        return {"planar": sizes[0] * left[:, 0]} if sizes[1] < FLAT * sizes[0] else parts
    return {mode.whirl: parts[mode.whirl]} if twice and mode.whirl in parts else parts


def response(found: Source, units: Mapping[str, str]) -> list[Panel]:
    rpm = RPM * np.asarray(found.speed)
    panels = []
    names = list(enumerate(found.coordinates))
    if len(names) > MOST_PLACES:  # those of a drawing that are no node alone
        names = [(c, name) for c, name in names if not NODE.search(name)]
    for c, name in names[:MOST_PLACES]:
        unit, factor = shown_unit(units.get(name, ""))
        size = factor * np.abs(found.motion[:, c])
        if not (np.isfinite(size) & (size > 0)).any():
            continue
        look: Look = "line" if len(rpm) > 1 else "dots"
        curves = [Curve(rpm, np.where(size > 0, size, np.nan), "amplitude", BLUE, look)]
        std = factor * np.asarray(found.std[:, c])
        if np.isfinite(std).any():
            curves.insert(0, _band(rpm, size, std, "95 % band"))
        axis = _amplitude(unit, curves)
        panels.append(Panel(label(name, 36), Axis("speed in rpm"), axis, tuple(curves)))
    return panels


def _amplitude(unit: str, curves: Sequence[Curve]) -> Axis:
    """Return the axis of amplitudes: logarithmic, but from 0 on where they are nearly one."""
    every = [np.asarray(v) for c in curves for v in (c.y, c.base) if v is not None]
    low, high = (f(np.concatenate(every)) for f in (np.nanmin, np.nanmax))
    title = f"amplitude in {unit}"
    if high < EVEN * low:
        return Axis(title, ends=(0.0, 1.25 * float(high)))
    return Axis(title, log=True)


MOST_BLOCKS = 600  # steps of the band in which a long record is drawn
MOST_MARKS = 400  # other lines that a panel shows: of more, every so many
MOST_STEMS = 40  # kept lines that are drawn one by one
ROUNDING = 1e-10  # of the largest line: below it there is rounding only


def samples(record: Source, whole_blocks: int = 1) -> list[Panel]:
    """Return every channel over the record: as it is, or between its extremes: no spike is lost.

    Steps of the band hold whole blocks of `whole_blocks` samples: else they beat with a period.
    """
    drawn = []
    count = len(record.samples)
    size = -(-count // MOST_BLOCKS) or 1
    if 1 < whole_blocks <= 12 * size:
        size = -(-size // whole_blocks) * whole_blocks
    if count < size:
        size = 1
    steps = record.samples[: count // size * size].reshape(-1, size, len(record.channels))
    lows, highs = steps.min(axis=1), steps.max(axis=1)
    middle = 0.5 if size > 1 else 0.0
    time = (np.arange(len(steps)) + middle) * size / record.sample_rate
    for c, channel in list(enumerate(record.channels))[:MOST_PANELS]:
        unit, factor = shown_unit(channel.unit)
        low, high = factor * lows[:, c], factor * highs[:, c]
        curve = (
            Curve(time, high, "from lowest to highest sample", BLUE, "band", base=low)
            if size > 2
            else Curve(time, high, "samples", BLUE, "thin")
        )
        y = Axis(f"{label(channel.name)} in {unit}")
        drawn.append(Panel(label(channel.name, 36), Axis("time in s"), y, (curve,)))
    return drawn


def spectra(record: Source) -> list[Panel]:
    """Return the lines of the mean period of every channel: kept, other odd and even, noise."""
    return [_spectrum(record, c) for c in range(min(len(record.channels), MOST_PANELS))]


def _spectrum(record: Source, c: int) -> Panel:
    channel = record.channels[c]
    unit, factor = shown_unit(channel.unit)
    amplitude = 2 * factor * np.abs(np.fft.rfft(record.mean[:, c], norm="forward"))
    amplitude[0] /= 2
    kept = factor * record.multiplicity * np.abs(record.mean_spectrum[:, c])
    top = max(float(kept.max(initial=0.0)), float(amplitude.max(initial=0.0)))
    title, axis = label(channel.name, 36), Axis(f"amplitude in {unit}")
    if top == 0:
        return Panel(f"{title}: zero", HERTZ, axis)
    highest = 1.5 * max(float(record.frequency.max()), record.fundamental)
    others = np.setdiff1d(np.arange(len(amplitude)), [0, *record.harmonics])
    others = others[others * record.fundamental <= highest]
    others = others[:: -(-len(others) // MOST_MARKS) or 1]
    scatter = record.spectra[..., c].var(axis=0, ddof=1) if record.periods > 1 else 0 * kept
    noise = factor * record.multiplicity * np.sqrt(scatter / record.periods)
    levels = [amplitude[others], noise, kept]
    seen = [x[x > ROUNDING * top].min() for x in levels if (x > ROUNDING * top).any()]
    floor = 0.4 * float(min(seen))
    few = len(record.frequency) <= MOST_STEMS
    lines = record.frequency.astype(float)
    curves = []
    for odd, colour, told in ((1, GREEN, "odd"), (0, PINK, "even")):
        here = others[(others % 2 == odd) & (amplitude[others] > ROUNDING * top)]
        marks = (here * record.fundamental, amplitude[here])
        curves.append(Curve(*marks, f"{told} multiples, not used", colour, "points"))
    if few:
        curves.append(Curve(lines, kept, "", BLUE, "stems", base=np.full_like(kept, floor)))
    curves.append(Curve(lines, kept, "used", BLUE, "dots" if few else "points"))
    if (noise > ROUNDING * top).any():
        curves.append(Curve(lines, noise, "noise of the mean, one std", RED, "line"))
    drawn = tuple(curve for curve in curves if len(curve.x))
    return Panel(title, HERTZ, Axis(axis.title, log=True, ends=(floor, 3 * top)), drawn)


def rows(record: Source, *, turning: bool) -> list[Panel]:
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
            (noise[:, c], "noise, one std", RED),
        ):
            if (values > 0).any():
                shown = factor * record.multiplicity * values
                shown = np.where(shown > 0, shown, np.nan)
                curves.append(Curve(x, shown, told, colour, look))
        y = Axis(f"amplitude in {unit}", log=bool(curves))
        drawn.append(Panel(label(channel.name, 36), axis, y, tuple(curves)))
    return drawn


def each_period(record: Source) -> Panel:
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
    short = tuple(label(name, 14) for name in names)
    shown = Matrix(short, short, matrix, 0.0, 1.0, "correlation")
    return Panel(matrix=shown, height=min(9.0, 1.6 + 0.3 * len(short)))


MARKS = (
    ("discs", "disc", "D", GREY, 1.1),
    ("actuators", "actuator", "A", RED, 1.7),
    ("sensors", "sensor", "s", GREEN, 2.3),
    ("supports", "support", "^", BLUE, 2.0),
    ("unbalance", "unbalance", "u", PINK, 1.4),
)
"""What stands on a rotor: its key, its word, its letter, its colour, and its height over the
widest section: names of marks at one place stand above each other."""


def drawing(rotor: Source) -> Panel:
    widest = 1e3 * max(section.outer for section in rotor.sections) / 2
    curves = [_edge(rotor, 1.0), _edge(rotor, -1.0)]
    for key, word, _, colour, height in MARKS:
        table = getattr(rotor, key)
        if table:
            at = [float(member.at) for member in table.values()]
            place = 1e3 * np.asarray(at, dtype=float)
            level = np.full(len(place), height * widest)
            curves.append(Curve(place, level, word, colour, "named", told=tuple(table)))
    return Panel(
        "The rotor as it is drawn",
        Axis("mm from the left end"),
        Axis("radius in mm", ends=(-1.2 * widest, 2.7 * widest)),
        tuple(curves),
        height=2.8,
    )


def _edge(rotor: Source, side: float) -> Curve:
    """Return the metal above or below the axis, as a band from bore to surface."""
    borders = np.cumsum([0.0, *(section.length for section in rotor.sections)])
    x = np.repeat(borders, 2)[1:-1]
    outer = np.repeat([section.outer / 2 for section in rotor.sections], 2)
    inner = np.repeat([section.inner / 2 for section in rotor.sections], 2)
    upper, lower = (outer, inner) if side > 0 else (-inner, -outer)
    return Curve(1e3 * x, 1e3 * upper, "shaft", SKY, "band", base=1e3 * lower)
