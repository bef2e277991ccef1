"""Modes, Campbell diagram and unbalance response, as panels."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rotorid.plots.panel import (
    BLUE,
    GREEN,
    GREY,
    PINK,
    RED,
    Axis,
    Curve,
    Floats,
    Panel,
    label,
    shown_unit,
)

Diagram = Any  # a Campbell, which lies above
Modes = Any
Response = Any  # an UnbalanceResponse

RPM = 30 / np.pi
TWO = 1.959964
"""Deviations to either side that a band holds."""
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
_NODE = re.compile(r"node\d+$")


def campbell(found: Diagram) -> Panel:
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
    ends = (0.0, _highest(found.frequency_hz, float(turning.max())))
    return Panel(
        "", Axis("speed in rpm"), Axis("frequency in Hz", ends=ends), tuple(curves), height=4.2
    )


def _highest(frequency: Floats, turning: float) -> float:
    """Return the frequency up to which a diagram is drawn."""
    tops = np.where(np.isfinite(frequency), frequency, 0.0).max(axis=0, initial=0.0)
    near = tops[tops <= HIGHEST * turning]
    return 1.08 * float(max([turning, *(near if len(near) else np.sort(tops)[:1])]))


def shapes(
    found: Modes,
    pairs: Sequence[tuple[int, int]],
    alone: Sequence[int],
    positions: Floats | None = None,
) -> list[Panel]:
    """Return the shape of each mode: the part that whirls forward, and the part that goes back.

    `pairs` are coordinates x and y of one place, `alone` those without a partner; all of one kind.
    `positions` along the rotor are those of the pairs, in m, where a drawing tells them.
    Motion in a plane is one line: its parts are alike, and those of two modes of one frequency any.
    A single place has no shape.
    """
    frequency = np.array([mode.frequency_hz for mode in found.modes])
    return [
        _shape(k, mode, found.coordinates, pairs, alone, positions, twice=_meets(frequency, k))
        for k, mode in enumerate(found.modes[:MOST_SHAPES])
        if len(pairs) > 1 or len(alone) > 1
    ]


def _meets(frequency: Floats, k: int) -> bool:
    """Tell whether another mode has the same frequency: the shapes of the two are any mixture."""
    return int((np.abs(frequency - frequency[k]) <= SAME * frequency[k]).sum()) > 1


def _shape(
    k: int,
    mode: Any,
    coordinates: Sequence[str],
    pairs: Sequence[tuple[int, int]],
    alone: Sequence[int],
    positions: Floats | None,
    *,
    twice: bool,
) -> Panel:
    value = np.asarray(mode.shape)
    x, y = (np.array([pair[side] for pair in pairs], dtype=int) for side in (0, 1))
    parts = {
        "forward": (value[x] + 1j * value[y]) / 2,
        "backward": (value[x] - 1j * value[y]) / 2,
    }
    if twice and mode.whirl in parts:
        parts = {mode.whirl: parts[mode.whirl]}
    if alone:
        parts = {"planar": value[list(alone)]}
    elif mode.whirl == "planar" and (one := _in_plane(value[x], value[y])) is not None:
        parts = {"planar": one}
    names = [coordinates[i] for i in (alone or x)]
    whole = max(float(np.abs(part).max(initial=0.0)) for part in parts.values())
    place = np.arange(len(names), dtype=float) if positions is None else 1e3 * positions
    curves = []
    for way, part in parts.items():
        told = "motion" if alone else "in a plane" if way == "planar" else f"{way} part"
        shown = _signed(part) / whole if whole > 0 else np.zeros(len(part))
        curves.append(Curve(place, shown, told, WAYS[way], "line"))
        told_of = tuple(label(name) for name in names)
        curves.append(Curve(place, shown, "", WAYS[way], "points", told=told_of))
    title = f"Mode {k + 1}: {mode.frequency_hz:.5g} Hz, {mode.whirl}"
    ends = (-1.15, 1.15)
    height = Axis("share of the largest", ends=ends)
    return Panel(title, _along(names, positions), height, tuple(curves), level=0.0)


def _along(names: Sequence[str], positions: Floats | None) -> Axis:
    """Return the axis along the rotor: mm where positions are known, else the names of places."""
    if positions is not None:
        return Axis("mm from the left end")
    few = tuple(label(name, 12) for name in names) if len(names) <= MOST_PLACES else ()
    return Axis("" if few else "places along the shaft, in the model's order", names=few)


def _in_plane(x: Any, y: Any) -> Any:
    """Return the shape of a motion whose directions are alike at all places; else ``None``."""
    left, sizes, _ = np.linalg.svd(np.column_stack([x, y]), full_matrices=False)
    return sizes[0] * left[:, 0] if sizes[1] < FLAT * sizes[0] else None


def _signed(part: Any) -> Floats:
    """Return a part of a shape as it stands at the moment when its largest is at its largest."""
    size = np.abs(part)
    if not size.any():
        return np.zeros(len(part))
    turned = part * np.exp(-1j * np.angle(part[int(size.argmax())]))
    return np.asarray(turned.real)


def response(found: Response, units: Mapping[str, str]) -> list[Panel]:
    """Return the amplitude that unbalance makes of each coordinate, over the speed."""
    rpm = RPM * np.asarray(found.speed)
    panels = []
    names = list(enumerate(found.coordinates))
    if len(names) > MOST_PLACES:  # those of a drawing that are no node alone
        names = [(c, name) for c, name in names if not _NODE.search(name)]
    for c, name in names[:MOST_PLACES]:
        unit, factor = shown_unit(units.get(name, ""))
        size = factor * np.abs(found.motion[:, c])
        if not (np.isfinite(size) & (size > 0)).any():
            continue
        curves = [Curve(rpm, np.where(size > 0, size, np.nan), "amplitude", BLUE, "line")]
        std = factor * np.asarray(found.std[:, c])
        if np.isfinite(std).any():
            low = np.maximum(size - TWO * std, size / 100)  # of a logarithmic axis
            high = size + TWO * std
            curves.insert(0, Curve(rpm, high, "95 % band", BLUE, "band", base=low))
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
