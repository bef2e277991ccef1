"""A rotor as it is drawn, with what stands on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from rotorid.plots.panel import BLUE, GREEN, GREY, PINK, RED, SKY, Axis, Curve, Panel


class Drawn(Protocol):
    """What a picture needs of a rotor: sections, and what stands on it by name, in m."""

    @property
    def sections(self) -> Sequence[Any]:
        """Cylinders with `length`, `outer` and `inner`, from left to right."""

    @property
    def discs(self) -> Mapping[str, Any]:
        """Discs, with `at`."""


MARKS = (
    ("discs", "disc", GREY, 1.1),
    ("actuators", "actuator", RED, 1.7),
    ("sensors", "sensor", GREEN, 2.3),
    ("supports", "support", BLUE, 2.0),
    ("unbalance", "unbalance", PINK, 1.4),
)
"""What stands on a rotor: its key, its word, its colour, and its height over the
widest section: names of marks at one place stand above each other."""


def drawing(rotor: Drawn) -> Panel:
    """Return a rotor seen from the side; what stands on it is marked above, bores are left open."""
    widest = 1e3 * max(section.outer for section in rotor.sections) / 2
    curves = [_edge(rotor, 1.0, "shaft"), _edge(rotor, -1.0, "shaft")]
    for key, word, colour, height in MARKS:
        table = getattr(rotor, key)
        if table:
            at = [getattr(member, "at", member) for member in table.values()]
            curves.append(_marks(word, colour, at, tuple(table), height * widest))
    return Panel(
        "The rotor as it is drawn",
        Axis("mm from the left end"),
        Axis("radius in mm", ends=(-1.2 * widest, 2.7 * widest)),
        tuple(curves),
        height=2.8,
    )


def _edge(rotor: Drawn, side: float, label: str) -> Curve:
    """Return the metal above or below the axis, as a band from bore to surface."""
    borders = np.cumsum([0.0, *(section.length for section in rotor.sections)])
    x = np.repeat(borders, 2)[1:-1]
    outer = np.repeat([section.outer / 2 for section in rotor.sections], 2)
    inner = np.repeat([section.inner / 2 for section in rotor.sections], 2)
    upper, lower = (outer, inner) if side > 0 else (-inner, -outer)
    return Curve(1e3 * x, 1e3 * upper, label, SKY, "band", base=1e3 * lower)


def _marks(
    word: str, colour: str, at: Sequence[float], names: tuple[str, ...], height: float
) -> Curve:
    """Return marks above the shaft, each with its name."""
    place = 1e3 * np.asarray(at, dtype=float)
    return Curve(place, np.full(len(place), height), word, colour, "named", told=names)
