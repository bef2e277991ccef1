"""What a picture shows, said once: drawn as it is in a page, or as a figure of matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rotorid.core.frozen import frozen

Floats = NDArray[np.float64]

GREY = "#80868b"
BLUE, SKY, GREEN, RED, PINK = "#0072b2", "#56b4e9", "#009e73", "#d55e00", "#cc79a7"
# Okabe and Ito: told apart by every eye, and on black as on white
COLOURS = (BLUE, RED, GREEN, PINK, SKY)  # of records

Look = Literal[
    "line", "thin", "thick", "dashed", "dots", "points", "stems", "band", "diamonds", "named"
]
MOST_PANELS = 24
"""Channels with a panel of their own: what a page still shows."""


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
    """An axis: its title with the unit, whether it is logarithmic, its ends, names at its ticks."""

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


def time_unit(longest: float) -> tuple[str, float]:
    """Return the title of an axis of time, and the factor from s."""
    return ("time in s", 1.0) if longest > 1 else ("time in ms", 1e3)


def thinned(panel: Panel, most: int) -> Panel:
    return replace(panel, curves=tuple(_thinned(curve, most) for curve in panel.curves))


def _thinned(curve: Curve, most: int) -> Curve:
    """Return a curve with the lowest and the highest point of each of `most` / 2 stretches."""
    if len(curve.x) <= most or curve.look == "stems" or curve.error is not None:
        return curve
    bounds = np.linspace(0, len(curve.x), max(1, most // 2) + 1).astype(int)
    if curve.base is not None:
        pairs = list(pairwise(bounds))
        middle = np.array([(a + b - 1) // 2 for a, b in pairs])
        high = np.array([np.max(curve.y[a:b]) for a, b in pairs])
        low = np.array([np.min(curve.base[a:b]) for a, b in pairs])
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


def envelope(values: Floats, most: int) -> tuple[Floats, Floats, int]:
    """Return the lowest and highest of each `size` samples along axis 0, and that size.

    At most `most` of them, so that no spike is lost where a long record is drawn.
    """
    size = -(-len(values) // most) or 1
    blocks = values[: len(values) // size * size].reshape(-1, size, *values.shape[1:])
    return blocks.min(axis=1), blocks.max(axis=1), size
