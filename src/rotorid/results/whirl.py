"""Which way a mode whirls: from the orbits of its shape.

Where a coordinate x and its partner y move as ``Re(X exp(i omega t))``, ``Re(Y exp(i omega t))``,
the orbit is the sum of a circle of radius ``|X + i Y| / 2`` run through from x to y and one of
radius ``|X - i Y| / 2`` run through the other way. Tilts turn as positions do.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Literal

import numpy as np

from rotorid.record import Complexes, Floats

Whirl = Literal["forward", "backward", "planar", "mixed"]
PLANAR = 0.02
"""Orbits with a smaller ratio of axes are lines: no probe tells their sense."""
SILENT = 0.02
"""Places with a smaller share of the kinetic energy do not say how a mode whirls."""
_X = re.compile("[xX]")


def partners(coordinates: Sequence[str]) -> list[tuple[int, int]]:
    """Return the coordinates that are one of x and one of y at the same place, by their names.

    >>> partners(["x1", "y1", "theta_x", "theta_y", "q"])
    [(0, 1), (2, 3)]
    """
    places = {name: i for i, name in enumerate(coordinates)}
    found: list[tuple[int, int]] = []
    taken: set[int] = set()
    for name, i in places.items():
        for match in _X.finditer(name):
            letter = "Y" if match.group() == "X" else "y"
            other = name[: match.start()] + letter + name[match.end() :]
            if other in places and not {i, places[other]} & taken:
                found.append((i, places[other]))
                taken |= {i, places[other]}
    return found


def whirl_of(
    shape: Complexes, pairs: Sequence[tuple[int, int]], weight: Floats, speed: float
) -> Whirl:
    """Return how a mode whirls, forward being the way the rotor turns.

    `weight` holds the inertia of each coordinate, so that places of rest do not count.
    """
    if not pairs:
        return "planar"
    x, y = (np.array([pair[side] for pair in pairs]) for side in (0, 1))
    inertia = weight[x] + weight[y]
    if not inertia.any():
        inertia = np.ones(len(x))
    forward, backward = np.abs(shape[x] + 1j * shape[y]), np.abs(shape[x] - 1j * shape[y])
    energy = inertia * (forward**2 + backward**2)
    if not energy.any():
        return "planar"
    speaks = energy > SILENT * energy.sum()
    whole = forward + backward
    ratio = np.where(whole > 0, (forward - backward) / np.where(whole > 0, whole, 1.0), 0.0)
    ratio = ratio[speaks] * (-1.0 if speed < 0 else 1.0)
    if (np.abs(ratio) < PLANAR).all():
        return "planar"
    if ratio.min() < -PLANAR and ratio.max() > PLANAR:
        return "mixed"
    return "forward" if ratio.sum() > 0 else "backward"
