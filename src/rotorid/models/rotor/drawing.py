"""A rotor as it is drawn: sections from left to right, and what stands on them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import field
from functools import cached_property
from itertools import pairwise
from math import ceil

import numpy as np

from rotorid.frozen import frozen
from rotorid.models.rotor.elements import Beam
from rotorid.models.rotor.quantity import NONE, ONE, Quantity
from rotorid.record import Floats

SAME = 1e-9
"""Share of the length within which two places are one: less than any drawing states, and a beam
as short as that would have no stiffness that double precision holds."""

AXES = ("x", "y", "theta_x", "theta_y")
"""Coordinates of a place, before its name."""
ENDS = ("left_end", "right_end")
"""Names of the shaft's ends where no place with a name stands there."""


@frozen
class Section:
    """A cylinder of one material; lengths in m.

    Parameters
    ----------
    length, outer, inner : float
    E, density : Quantity
        Pa, kg/m^3.
    ratio : float
        E / G.
    modulus, heaviness : float
        Nominal E in Pa and density in kg/m^3.
    stiffness : Quantity
        Factor on E of this section: a shrink fit.
    elements : int
    """

    length: float
    outer: float
    inner: float
    E: Quantity
    density: Quantity
    ratio: float
    modulus: float
    heaviness: float
    stiffness: Quantity = ONE
    elements: int = 1

    def beam(self, length: float) -> Beam:
        """Return an element of unit density."""
        return Beam(length, self.outer, self.inner, self.modulus, self.modulus / self.ratio, 1.0)


@frozen
class Disc:
    """A rigid disc: kg, kg m^2."""

    at: float
    mass: Quantity
    I_t: Quantity
    I_p: Quantity


@frozen
class Support:
    """Stiffness and damping to ground: xx, xy, yx, yy, in N/m and N s/m."""

    at: float
    stiffness: tuple[Quantity, Quantity, Quantity, Quantity]
    damping: tuple[Quantity, Quantity, Quantity, Quantity]


@frozen
class Unbalance:
    """Unbalance in the rotor's frame, in kg m."""

    at: float
    x: Quantity
    y: Quantity


@frozen
class Place:
    """A node: its position in m, and the names that places on it have; the first names it."""

    position: float
    names: tuple[str, ...]
    named: bool

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of its coordinates."""
        return tuple(f"{axis}_{self.names[0]}" for axis in AXES)


@frozen
class Rotor:
    """A rotor from its drawing; positions in m from the left end.

    Parameters
    ----------
    sections : sequence of Section
    discs, supports, unbalance, actuators, sensors : mapping
        By the name of the place; the last two are positions.
    internal, external, structural : Quantity
        Damping of the shaft: that turns with it, in s, times its K; of the air, in 1/s, times its
        M; and the loss factor.
    """

    sections: tuple[Section, ...]
    discs: Mapping[str, Disc] = field(default_factory=dict)
    supports: Mapping[str, Support] = field(default_factory=dict)
    unbalance: Mapping[str, Unbalance] = field(default_factory=dict)
    actuators: Mapping[str, float] = field(default_factory=dict)
    sensors: Mapping[str, float] = field(default_factory=dict)
    internal: Quantity = NONE
    external: Quantity = NONE
    structural: Quantity = NONE

    @property
    def length(self) -> float:
        """Length in m."""
        return sum(section.length for section in self.sections)

    @cached_property
    def places(self) -> Mapping[str, float]:
        """Position of each named place; what names channels comes first."""
        found = {**self.sensors, **{n: at for n, at in self.actuators.items()}}
        for table in (self.discs, self.supports, self.unbalance):
            for name, member in table.items():
                found.setdefault(name, member.at)
        return found

    @cached_property
    def nodes(self) -> tuple[Place, ...]:
        """Nodes from left to right: borders of sections, places, and what divides the rest."""
        borders = np.concatenate([[0.0], np.cumsum([s.length for s in self.sections])])
        held = self._merged([*borders, *self.places.values()])
        cuts = [held[0]]
        for section, left, right in zip(self.sections, borders[:-1], borders[1:], strict=True):
            inside = [z for z in held if left + self._near < z < right - self._near]
            for one, other in zip([left, *inside], [*inside, right], strict=True):
                share = section.elements * (other - one) / section.length
                count = max(1, ceil(share - SAME))
                cuts += list(np.linspace(one, other, count + 1)[1:])
        return tuple(self._place(k, z) for k, z in enumerate(self._merged(cuts)))

    @property
    def _near(self) -> float:
        return SAME * self.length

    def _merged(self, positions: list[float]) -> list[float]:
        """Return positions in ascending order, each once."""
        found: list[float] = []
        for z in sorted(positions):
            if not found or z - found[-1] > self._near:
                found.append(float(z))
        return found

    def _place(self, number: int, position: float) -> Place:
        names = [n for n, at in self.places.items() if abs(at - position) <= self._near]
        if not names and (position <= self._near or position >= self.length - self._near):
            names = [ENDS[number > 0]]
        return Place(position, tuple(names) or (f"node{number}",), bool(names))

    @cached_property
    def positions(self) -> Floats:
        """Positions of the nodes in m."""
        return np.array([node.position for node in self.nodes])

    def node(self, at: float) -> int:
        """Return the number of the node at a position."""
        return int(np.abs(self.positions - at).argmin())

    def spans(self) -> Iterator[tuple[int, Section, Beam]]:
        """Yield every element: its left node, its section, and its beam."""
        borders, place = np.cumsum([s.length for s in self.sections]), self.positions
        for k, (left, right) in enumerate(pairwise(place)):
            number = int(np.searchsorted(borders, (left + right) / 2))
            section = self.sections[number]
            yield k, section, section.beam(float(right - left))
