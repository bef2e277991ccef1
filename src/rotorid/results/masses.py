"""What can be mounted: masses at a radius, of those that there are, in holes or anywhere."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from rotorid.errors import InputError
from rotorid.frozen import frozen
from rotorid.record import Complexes, Floats
from rotorid.units import quantity

FREE = 360
"""Angles that are tried where masses may be mounted anywhere: one degree is what hands can do."""
NEAREST = 24
"""Ways to mount masses in a plane that are tried with those of the other planes: the nearest."""
MOST = 4_000
"""Places times masses: more make more pairs of masses than are tried in a second."""

Mounted = tuple[tuple[float, float], ...]
"""Masses and angles in one plane."""


@frozen
class Masses:
    """What can be mounted in a plane: radius in m, masses in kg, number of holes."""

    radius: float | None
    masses: tuple[float, ...]
    holes: int | None

    @classmethod
    def of(
        cls, radius: float | str | None, masses: Sequence[float | str], holes: int | None
    ) -> Masses:
        """Return a kit, in SI.

        Raises
        ------
        InputError
            For masses or holes without a radius, and for what is not positive.
        """
        if (masses or holes is not None) and radius is None:
            raise InputError(
                "masses or holes without the radius at which they are",
                "a radius",
                'give it: --radius "30 mm"',
                place="radius",
            )
        if holes is not None and (holes < 1 or holes != int(holes)):
            raise InputError(
                f"{holes} holes", "a whole number, 1 or more", "count them", place="holes"
            )
        sizes = tuple(_positive(mass, "kg", "masses") for mass in masses)
        if len(sizes) * (holes or FREE) > MOST:
            raise InputError(
                f"{len(sizes)} masses in {holes or FREE} places",
                f"{MOST} choices at the most",
                "leave out masses that hardly differ",
                place="masses",
            )
        return cls(None if radius is None else _positive(radius, "m", "radius"), sizes, holes)


def _positive(value: float | str, unit: str, place: str) -> float:
    found = quantity(value, unit, place=place)
    if not 0 < found < np.inf:
        raise InputError(f"{value}", "a number above 0", f"give it in {unit}", place=place)
    return float(found)


def chosen(
    kit: Masses, ideal: Complexes, weighed: tuple[Complexes, Complexes]
) -> tuple[Complexes, list[Mounted]]:
    """Return the corrections that a kit allows, kg m, and what is mounted in each plane.

    Of the nearest ways to mount two masses or fewer in each plane those that leave the least of
    what is weighed, all planes together.
    """
    if kit.radius is None:
        return ideal, [() for _ in ideal]
    if not kit.masses and kit.holes is None:
        single = [((float(abs(w) / kit.radius), float(np.angle(w))),) for w in ideal]
        return ideal, list(single)
    if not kit.masses:
        split = [_between_holes(w, kit.holes or 1, kit.radius) for w in ideal]
        mounted = np.array([_sum(each, kit.radius) for each in split])
        return mounted, split
    ways = [_nearest(kit, complex(w)) for w in ideal]
    effects, load = weighed
    best, cost = None, np.inf
    if len(ideal) > 3:  # more planes than can be tried together: each by itself
        ways = [each[:1] for each in ways]
    for way in product(*ways):
        left = float(np.linalg.norm(load + effects @ np.array([value for value, _ in way])))
        if left < cost:
            best, cost = way, left
    assert best is not None
    return np.array([value for value, _ in best]), [mounted for _, mounted in best]


def _sum(mounted: Mounted, radius: float) -> complex:
    return complex(sum(mass * radius * np.exp(1j * angle) for mass, angle in mounted))


def _between_holes(ideal: complex, holes: int, radius: float) -> Mounted:
    """Split a correction between the two holes beside it."""
    if holes < 3:
        raise InputError(
            f"{holes} holes and masses of any size",
            "3 holes or more, which reach every direction",
            "leave holes out, or give the masses that there are",
            place="holes",
        )
    step = 2 * np.pi / holes
    first = np.floor(np.angle(ideal) / step) * step
    sides = np.array([first, first + step])
    matrix = np.array([np.cos(sides), np.sin(sides)])
    shares = np.linalg.solve(matrix, np.array([ideal.real, ideal.imag])) / radius
    pairs = zip(shares.tolist(), sides.tolist(), strict=True)
    return tuple((float(m), _turned(a)) for m, a in pairs if m > 1e-9 * abs(ideal) / radius)


def _turned(angle: float) -> float:
    """Return an angle between - pi and pi."""
    return float(np.angle(np.exp(1j * angle)))


def _nearest(kit: Masses, ideal: complex) -> list[tuple[complex, Mounted]]:
    """Return the ways to mount no mass, one or two that come nearest to a correction."""
    assert kit.radius is not None
    count = kit.holes or FREE
    first = 0.0 if kit.holes else float(np.angle(ideal))
    angles = first + 2 * np.pi * np.arange(count) / count
    each: Floats = np.array([(m, a) for m in kit.masses for a in angles])
    values = kit.radius * each[:, 0] * np.exp(1j * each[:, 1])
    found: list[tuple[complex, Mounted]] = [(0j, ())]
    found += [(complex(values[i]), _of(each, i)) for i in _closest(values - ideal)]
    # The second mass is the one nearest to what the first leaves.
    for i, value in enumerate(values):
        for j in np.argsort(np.abs(values + value - ideal), kind="stable")[:2]:
            found.append((complex(value + values[j]), _of(each, i, int(j))))
    found.sort(key=lambda way: (round(abs(way[0] - ideal) / (abs(ideal) or 1.0), 9), len(way[1])))
    unique: dict[complex, tuple[complex, Mounted]] = {}
    for way in found:
        unique.setdefault(np.round(way[0] / (abs(ideal) or 1.0), 9), way)
    return list(unique.values())[:NEAREST]


def _closest(away: Complexes) -> list[int]:
    found: list[int] = np.argsort(np.abs(away), kind="stable")[:NEAREST].tolist()
    return found


def _of(each: Floats, *rows: int) -> Mounted:
    return tuple((float(each[i, 0]), _turned(float(each[i, 1]))) for i in rows)
