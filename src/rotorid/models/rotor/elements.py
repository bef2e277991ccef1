"""Lateral Timoshenko beam elements with rotary inertia and gyroscopic moments.

Notation (Friswell, Penny, Garvey, Lees 2010, section 5.4; Nelson 1980): an element of length L,
area A, second moment I, shear coefficient kappa has ``Phi = 12 E I / (kappa G A L^2)``. In one
plane its coordinates are displacement and slope at its left and right node; the slope is theta_y
in the plane of x and -theta_x in that of y.
"""

from __future__ import annotations

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.core.values import Floats

PLANES = 4
"""Coordinates of a node: x, y, theta_x, theta_y."""


@frozen
class Beam:
    """A round element of one material; lengths in m, E and G in Pa, density in kg/m^3."""

    length: float
    outer: float
    inner: float
    E: float
    G: float
    density: float

    @property
    def area(self) -> float:
        return float(np.pi / 4 * (self.outer**2 - self.inner**2))

    @property
    def second_moment(self) -> float:
        """Second moment of the cross section about a diameter, in m^4."""
        return float(np.pi / 64 * (self.outer**4 - self.inner**4))

    @property
    def shear_coefficient(self) -> float:
        """Kappa of a round section after Cowper (1966), solid or hollow."""
        poisson = self.E / (2 * self.G) - 1
        square = (self.inner / self.outer) ** 2
        thick = (1 + square) ** 2
        below = thick * (7 + 6 * poisson) + square * (20 + 12 * poisson)
        return float(6 * thick * (1 + poisson) / below)

    @property
    def phi(self) -> float:
        """The share of shear in what an element gives way."""
        shear = self.shear_coefficient * self.G * self.area * self.length**2
        return 12 * self.E * self.second_moment / shear

    def stiffness(self) -> Floats:
        """Return K of one plane, shape (4, 4)."""
        length, phi = self.length, self.phi
        factor = self.E * self.second_moment / ((1 + phi) * length**3)
        a, b = (4 + phi) * length**2, (2 - phi) * length**2
        return factor * _in_plane(12.0, 6 * length, -12.0, 6 * length, a, b)

    def translation(self) -> Floats:
        """Return what the mass of the element adds to M of one plane, shape (4, 4)."""
        length, phi = self.length, self.phi
        factor = self.density * self.area * length / (840 * (1 + phi) ** 2)
        return factor * _in_plane(
            312 + 588 * phi + 280 * phi**2,
            (44 + 77 * phi + 35 * phi**2) * length,
            108 + 252 * phi + 140 * phi**2,
            -(26 + 63 * phi + 35 * phi**2) * length,
            (8 + 14 * phi + 7 * phi**2) * length**2,
            -(6 + 14 * phi + 7 * phi**2) * length**2,
        )

    def rotation(self) -> Floats:
        """Return what its rotary inertia adds; the polar inertia, of G, is twice that."""
        length, phi = self.length, self.phi
        factor = self.density * self.second_moment / (30 * (1 + phi) ** 2 * length)
        b = (3 - 15 * phi) * length
        c = (4 + 5 * phi + 10 * phi**2) * length**2
        d = (-1 - 5 * phi + 5 * phi**2) * length**2
        return factor * _in_plane(36.0, b, -36.0, b, c, d)


def _in_plane(a: float, b: float, c: float, d: float, e: float, f: float) -> Floats:
    """Return the symmetric pattern that all matrices of an element have."""
    return np.array([[a, b, c, d], [b, e, -d, f], [c, -d, a, -b], [d, f, -b, e]])


def both_planes(plane: Floats) -> Floats:
    """Return a matrix of displacements and slopes in both planes, (4 node, 4 node)."""
    nodes = len(plane) // 2
    out = np.zeros((PLANES * nodes, PLANES * nodes))
    along, across = slots(nodes)
    sign = signs(nodes)
    out[np.ix_(along, along)] = plane
    out[np.ix_(across, across)] = plane * np.outer(sign, sign)
    return out


def turned(nodes: int) -> Floats:
    """Return S, which takes x to y and y to -x, the slopes alike: minus a quarter turn."""
    turn = np.zeros((PLANES * nodes, PLANES * nodes))
    for node in range(nodes):
        x, y, theta_x, theta_y = range(PLANES * node, PLANES * node + PLANES)
        turn[x, y], turn[y, x] = 1.0, -1.0
        turn[theta_x, theta_y], turn[theta_y, theta_x] = 1.0, -1.0
    return turn


def slots(nodes: int) -> tuple[list[int], list[int]]:
    """Return where displacements and slopes stand in the plane of x, and in that of y."""
    starts = [PLANES * node for node in range(nodes)]
    along = [start + k for start in starts for k in (0, 3)]
    across = [start + k for start in starts for k in (1, 2)]
    return along, across


def signs(nodes: int) -> Floats:
    """Return by what displacements and slopes in the plane of y are multiplied to be like x's."""
    return np.tile([1.0, -1.0], nodes)
