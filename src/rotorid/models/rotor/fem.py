"""Matrices of a drawing: lateral Timoshenko beam elements, how many are enough, fewer coordinates.

Notation (Friswell, Penny, Garvey, Lees 2010, section 5.4; Nelson 1980): an element of length L,
area A, second moment I, shear coefficient kappa has ``Phi = 12 E I / (kappa G A L^2)``. In one
plane its coordinates are displacement and slope at its left and right node; the slope is theta_y
in the plane of x and -theta_x in that of y.

A rotor on fewer coordinates is projected, from both sides, on the shapes in which it moves on some
lines: a reduced basis (Quarteroni, Manzoni and Negri 2016; docs/rotors.md).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise, product
from typing import Any

import numpy as np
import scipy

from rotorid.core.errors import ModelError
from rotorid.core.values import Complexes, Floats, Integers, frozen
from rotorid.models.expressions import Monomial
from rotorid.models.rotor.drawing import (
    AXES,
    MAX_ELEMENTS,
    ONE,
    PLANES,
    SAME,
    SPEED,
    Factors,
    Quantity,
    Rotor,
    Section,
)


@frozen
class Beam:
    """A round element of one material, of density 1 kg/m^3; lengths in m, E and G in Pa."""

    length: float
    outer: float
    inner: float
    E: float
    G: float

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
        factor = self.area * length / (840 * (1 + phi) ** 2)
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
        factor = self.second_moment / (30 * (1 + phi) ** 2 * length)
        b = (3 - 15 * phi) * length
        c = (4 + 5 * phi + 10 * phi**2) * length**2
        d = (-1 - 5 * phi + 5 * phi**2) * length**2
        return factor * _in_plane(36.0, b, -36.0, b, c, d)


def _in_plane(a: float, b: float, c: float, d: float, e: float, f: float) -> Floats:
    """Return the symmetric pattern that all matrices of an element have."""
    return np.array([[a, b, c, d], [b, e, -d, f], [c, -d, a, -b], [d, f, -b, e]])


# Of a node: displacement and slope in the plane of x, and in that of y; and S, which takes x to y
# and y to -x, the slopes alike: minus a quarter turn.
_IN_X = np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
_IN_Y = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 0.0]])
_TURN = np.kron(np.eye(2), [[0.0, 1.0], [-1.0, 0.0]])


def _planes(nodes: int) -> tuple[Floats, Floats]:
    """Return the coordinates of nodes by displacements and slopes in either plane."""
    return np.kron(np.eye(nodes), _IN_X), np.kron(np.eye(nodes), _IN_Y)


_ALONG, _ACROSS = _planes(2)
_TURN_BOTH = np.kron(np.eye(2), _TURN)


def _both_planes(plane: Floats) -> Floats:
    return _ALONG @ plane @ _ALONG.T + _ACROSS @ plane @ _ACROSS.T


Span = tuple[int, Section, Beam]


def spans(rotor: Rotor) -> Iterator[Span]:
    """Yield every element: its left node, its section, and its beam."""
    borders, place = np.cumsum([s.length for s in rotor.sections]), rotor.positions
    for k, (left, right) in enumerate(pairwise(place)):
        section = rotor.sections[int(np.searchsorted(borders, (left + right) / 2))]
        yield k, section, _beam(section, float(right - left))


def _beam(section: Section, length: float) -> Beam:
    moduli = section.material.E.nominal, section.material.G.nominal
    return Beam(length, section.outer, section.inner, *moduli)


@dataclass(frozen=True, eq=False)
class Piece:
    """``factors * Omega^power * matrix @ d^order q / dt^order``, turned by i where structural.

    Of a load, on the right side: ``factors * matrix @ (cos(phi), sin(phi))``.
    """

    factors: Factors  # tuple of (str, int): names of parameters and their powers
    order: int
    power: int
    structural: bool
    matrix: Any  # sparse array, shape (row, coordinate); of a load an array, shape (row, 2)

    def value(self, values: Mapping[str, float]) -> float:
        return float(np.prod([values[name] ** power for name, power in self.factors]))

    def monomial(self, names: Sequence[str]) -> Monomial:
        powers = dict(self.factors)
        return tuple(powers.get(name, 0) for name in names)

    def substituted(self, fixed: Mapping[str, float]) -> Piece:
        inside = [factor for factor in self.factors if factor[0] in fixed]
        left = tuple(factor for factor in self.factors if factor[0] not in fixed)
        size = replace(self, factors=tuple(inside)).value(fixed)
        return replace(self, factors=left, matrix=size * self.matrix)


Block = tuple[Quantity, int, int, Floats, bool]
"""A quantity, the order of the derivative that it multiplies, the first of its coordinates, its
matrix, and whether it is structural damping."""


def gathered(rotor: Rotor, blocks: Iterable[Block]) -> tuple[Piece, ...]:
    """Add up blocks of matrices by what multiplies them."""
    entries: dict[tuple[Factors, int, int, bool], list[tuple[Floats, Integers, Integers]]]
    entries = defaultdict(list)
    for quantity, order, first, block, structural in blocks:
        row, column = np.nonzero(block)
        for factors, coefficient in quantity.terms:
            kept = tuple((name, n) for name, n in factors if name != SPEED)
            power = dict(factors).get(SPEED, 0)
            entry = coefficient * block[row, column], row + first, column + first
            entries[kept, order, power, structural].append(entry)
    found, size = [], PLANES * len(rotor.nodes)
    for key, parts in entries.items():
        values, rows, columns = (np.concatenate(each) for each in zip(*parts, strict=True))
        matrix = scipy.sparse.csr_array((values, (rows, columns)), shape=(size, size))
        found.append(Piece(*key, matrix))
    return tuple(found)


_SPEED = Quantity(((((SPEED, 1),), 1.0),))


def blocks_of(rotor: Rotor) -> Iterator[Block]:
    for node, section, beam in spans(rotor):
        yield from _elastic(rotor, PLANES * node, section, beam)
        yield from _inertial(rotor, PLANES * node, section, beam)
    for disc in rotor.discs.values():
        first = PLANES * rotor.node(disc.at)
        yield disc.mass, 2, first, np.diag([1.0, 1.0, 0.0, 0.0]), False
        yield disc.I_t, 2, first, np.diag([0.0, 0.0, 1.0, 1.0]), False
        yield disc.I_p.times(_SPEED), 1, first, _TURN * [[0], [0], [1], [1]], False
    for support in rotor.supports.values():
        first = PLANES * rotor.node(support.at)
        for (order, *place), quantity in zip(
            np.ndindex(2, 2, 2), support.constants.values(), strict=True
        ):
            block = np.zeros((2, 2))
            block[*place] = 1.0
            yield quantity, order, first, block, False


def _elastic(rotor: Rotor, first: int, section: Section, beam: Beam) -> Iterator[Block]:
    stiffness = _both_planes(beam.stiffness()) / section.material.E.nominal
    elastic = section.material.E.times(section.stiffness)
    yield elastic, 0, first, stiffness, False
    spun = elastic.times(rotor.damping.internal)
    yield spun, 1, first, stiffness, False
    yield spun.times(_SPEED), 0, first, stiffness @ _TURN_BOTH, False
    yield elastic.times(rotor.damping.structural), 0, first, stiffness, True


def _inertial(rotor: Rotor, first: int, section: Section, beam: Beam) -> Iterator[Block]:
    density, mass = section.material.density, _both_planes(beam.translation() + beam.rotation())
    yield density, 2, first, mass, False
    yield density.times(rotor.damping.external), 1, first, mass, False
    polar = _both_planes(2 * beam.rotation()) @ _TURN_BOTH
    yield density.times(_SPEED), 1, first, polar, False


STEP = 1e-3  # share of a length or a diameter of central differences: they err by its square, 1e-6


def by_share(rotor: Rotor, number: str, elements: Iterable[Span]) -> list[Block]:
    """Return the derivative of the matrices by a share of a number of some elements.

    `number`: E, density, or one of a beam. Nodes go along with their elements, and so does what
    sits on them.
    """
    blocks = list[Block]()
    for node, section, beam in elements:
        of = (rotor, PLANES * node, section)
        if number in ("E", "density"):
            blocks += _elastic(*of, beam) if number == "E" else _inertial(*of, beam)
            continue
        for step in (STEP, -STEP):
            other = replace(beam, **{number: (1 + step) * getattr(beam, number)})
            every = (*_elastic(*of, other), *_inertial(*of, other))
            blocks += [(q, n, at, block / (2 * step), lags) for q, n, at, block, lags in every]
    return blocks


def exact_numbers(rotor: Rotor) -> dict[str, dict[str, tuple[str, list[Span]]]]:
    """Return by kind what is drawn as numbers: by its name, of which elements it is which one."""
    every = list(spans(rotor))
    found: dict[str, dict[str, tuple[str, list[Span]]]] = {"E": {}, "density": {}}
    for name, material in rotor.materials.items():
        own = [span for span in every if span[1].material == material]
        for number in ("E", "density"):
            if own and getattr(material, number).number is not None:
                found[number][name] = number, own
    sides = {
        f"{side} {k}": (side, [span for span in every if span[1] is section])
        for k, section in enumerate(rotor.sections, 1)
        for side in ("outer", "inner")
        if getattr(section, side)
    }
    return {**found, "lengths": {"all": ("length", every)}, "diameters": sides}


def pushed(
    blocks: Iterable[Block], values: Mapping[str, float], omega: Floats, speed: Floats, q: Complexes
) -> Complexes:
    """Return ``Z q`` of some blocks on lines, (line, coordinate); omega and speed are (line,)."""
    found, known = np.zeros_like(q), dict[str, Any](values) | {SPEED: speed}
    powers, lags = (1j * omega) ** np.arange(3)[:, None], 1j * (omega > 0)
    for quantity, order, first, block, structural in blocks:
        if quantity.terms:
            weight = quantity.value(known) * powers[order] * (lags if structural else 1.0)
            where = slice(first, first + len(block))
            found[:, where] += weight[:, None] * (q[:, where] @ block.T)
    return found


def loads_of(rotor: Rotor) -> tuple[Piece, ...]:
    """Return what unbalances do: ``Omega^2`` times a force that turns with the rotor."""
    found = []
    for plane in rotor.unbalance.values():
        first = PLANES * rotor.node(plane.at)
        for quantity, force in ((plane.x, np.eye(2)), (plane.y, [[0.0, -1.0], [1.0, 0.0]])):
            matrix = np.zeros((PLANES * len(rotor.nodes), 2))
            matrix[first : first + 2] = force
            found += [Piece(factors, 0, 2, False, c * matrix) for factors, c in quantity.terms]
    return tuple(found)


def inputs_of(rotor: Rotor) -> Floats:
    matrix = np.zeros((PLANES * len(rotor.nodes), 2 * len(rotor.actuators)))
    for k, actuator in enumerate(rotor.actuators.values()):
        first = PLANES * rotor.node(actuator.at)
        matrix[first, 2 * k] = matrix[first + 1, 2 * k + 1] = 1.0
    return matrix


def readings_of(rotor: Rotor) -> dict[str, dict[str, float]]:
    """Return what names besides the coordinates read, as combinations of these.

    They are further names of a place, and sensors whose place is made of parameters: polynomials of
    it within the element where it is at nominal values, or was found (`RotorModel.redrawn`).
    """
    found = {
        f"{axis}_{name}": {own: 1.0}
        for node in rotor.nodes
        for name in node.names[1:]
        for axis, own in zip(AXES, node.coordinates, strict=True)
    }
    elements = list(spans(rotor)) if rotor.floating else []
    for name, at in rotor.floating.items():
        number = int(np.searchsorted(rotor.positions[1:-1], at.nominal, side="right"))
        left, right = rotor.nodes[number : number + 2]
        beam, ends = elements[number][2], (*left.coordinates, *right.coordinates)
        share = Quantity((*at.terms, ((), -left.position))).times(Quantity.of(1 / beam.length))
        powers = list(accumulate([ONE, share, share, share], Quantity.times))
        for axis, shapes in zip(AXES, _shapes(beam), strict=True):
            reading = found[f"{axis}_{name}"] = defaultdict(float)
            for power, row in zip(powers, shapes, strict=True):
                for (factors, size), k in product(power.terms, np.flatnonzero(row).tolist()):
                    levers = [p for p, n in factors for _ in range(n)]
                    reading["*".join([*levers, ends[k]])] += size * float(row[k])
    return found


def _shapes(beam: Beam) -> tuple[Floats, ...]:
    """Return x, y, theta_x, theta_y within an element by those at its ends, (power of u, 8) each.

    At rest, with u from 0 to 1 along the element, ``w = sum a_j u^j`` and, the shear being even,
    ``slope = (w' + a_3 phi / 2) / length``.
    """
    sheared, length = beam.phi / 2, beam.length
    held = [[1, 0, 0, 0], [0, 1, 0, sheared], [1, 1, 1, 1], [0, 1, 2, 3 + sheared]]
    cubic = np.linalg.solve(np.array(held), np.diag([1.0, length, 1.0, length]))
    slope = np.array([cubic[1] + sheared * cubic[3], 2 * cubic[2], 3 * cubic[3], 0 * cubic[0]])
    shown = (cubic, _ALONG), (cubic, _ACROSS), (-slope / length, _ACROSS), (slope / length, _ALONG)
    return tuple(shapes @ plane.T for shapes, plane in shown)


CONVERGED = 1e-3  # change of the first 3 free bending frequencies that twice the elements may bring
BENDING = 3
FINER = 1.25  # how much shorter the elements are that are tried next


def divided(rotor: Rotor) -> Rotor:
    """Return a rotor whose sections have the elements asked for, the others as many as needed.

    They are enough where twice as many move bending frequencies of the free shaft by no more than
    `CONVERGED`.
    """
    size = max(section.length for section in rotor.sections)
    while True:
        counts = [
            section.elements or max(1, int(np.ceil(section.length / size - SAME)))
            for section in rotor.sections
        ]
        if sum(counts) + len(rotor.places) > MAX_ELEMENTS:
            expected = "as many as the bending modes in the band of the records need"
            cure = "leave elements out, or draw fewer sections"
            told = f"more than {MAX_ELEMENTS} elements"
            raise ModelError(told, expected, cure, place="sections")
        found = rotor.with_elements(counts)
        if all(section.elements for section in rotor.sections):
            return found
        # Twice as many of a section need not be: a place in its middle divides it already.
        mine, theirs = bending(found), bending(found, parts=2)
        if len(mine) == BENDING and (np.abs(mine - theirs) <= CONVERGED * theirs).all():
            return found
        size /= FINER


def bending(rotor: Rotor, parts: int = 1) -> Floats:
    """Return bending frequencies of the free shaft in one plane, rad/s, each element in `parts`."""
    nodes = parts * (len(rotor.nodes) - 1) + 1
    mass, stiffness = np.zeros((2 * nodes, 2 * nodes)), np.zeros((2 * nodes, 2 * nodes))
    for number, section, whole in spans(rotor):
        beam = _beam(section, whole.length / parts)
        for node in range(parts * number, parts * (number + 1)):
            where = slice(2 * node, 2 * node + 4)
            stiffness[where, where] += beam.stiffness()
            inertia = beam.translation() + beam.rotation()
            mass[where, where] += section.material.density.nominal * inertia
    scale = 1 / np.sqrt(np.diag(mass))
    scaled = [scale[:, None] * matrix * scale for matrix in (stiffness, mass)]
    squares = scipy.linalg.eigh(*scaled, eigvals_only=True)
    return np.asarray(np.sqrt(squares[2 : 2 + BENDING].clip(0)))


SHAPES = 24  # lines of each speed on which the whole rotor is solved: 8 a mode of a usual band
SPEEDS = 3  # speeds at which it is, of all that there are
BELOW = 0.3  # share of the lowest line at which it is solved too: near rest


def points_of(omega: Floats, speed: Floats) -> list[tuple[float, float]]:
    """Return the lines, with their speeds, on which the whole rotor is solved; in rad/s."""
    speeds = np.unique(speed)
    chosen = speeds[np.unique(np.linspace(0, len(speeds) - 1, SPEEDS).round().astype(int))]
    found: list[tuple[float, float]] = []
    for each in chosen:
        lines = np.unique(omega[(speed == each) & (omega > 0)])
        if len(lines):
            every = np.quantile(lines, np.linspace(0, 1, SHAPES))
            found += [(float(line), float(each)) for line in {BELOW * lines[0], *every}]
    return found


def solved(stiffness: Any, right: Complexes) -> Complexes:
    """Solve ``Z q = right`` on one line, Z a sparse array; LinAlgError where it is singular."""
    try:
        return np.asarray(scipy.sparse.linalg.splu(stiffness).solve(right))
    except RuntimeError as error:
        raise np.linalg.LinAlgError(str(error)) from None


def force(stiffness: Any, kept: Integers, motion: Complexes) -> Complexes:
    """Return the forces on what is kept by its motion, (kept,); none act on the rest."""
    moved = np.zeros(stiffness.shape[1], dtype=np.complex128)
    moved[kept] = motion
    rest = np.setdiff1d(np.arange(len(moved)), kept)
    moved[rest] = solved(stiffness[rest][:, rest].tocsc(), -(stiffness @ moved)[rest])
    return np.asarray((stiffness @ moved)[kept])


def reduction(
    stiffness: Callable[[float, float], Any],
    kept: Integers,
    points: Sequence[tuple[float, float]],
    share: float,
) -> tuple[Integers, Floats]:
    """Return the basis of the shapes that come to more than a share of the largest.

    `stiffness`: Z of the whole rotor on a line at a speed, in rad/s, as a sparse array.

    ``q = basis @ r``; the first of r are those coordinates q that are returned too: what is `kept`,
    where anything acts or reads, with its partner in the other plane.
    """
    still = np.abs(stiffness(0.0, 0.0).diagonal().real)
    size = 1 / np.sqrt(np.where(still > 0, still, 1.0))  # metres and radians alike
    forces = np.eye(len(size), dtype=np.complex128)[:, kept]
    shapes = np.concatenate([solved(stiffness(*point), forces) for point in points], axis=1)
    shapes /= size[:, None]
    planes = _planes(len(shapes) // PLANES)
    seen = [plane.T @ shapes for plane in planes]
    both = np.concatenate([part for s in seen for part in (s.real, s.imag)], axis=1)
    length = np.linalg.norm(both, axis=0)
    triangle = np.asarray(np.linalg.qr((both[:, length > 0] / length[length > 0]).T, mode="r"))
    left, values, _ = np.linalg.svd(triangle.T, full_matrices=False)
    places = np.unique(2 * (kept // PLANES) + (kept % PLANES >= 2))
    count = max(int((values > share * values[0]).sum()), len(places))
    basis = left[:, :count] * size.reshape(-1, PLANES)[:, [0, 3]].ravel()[:, None]
    # The places that are shown come first.
    left, values, right = np.linalg.svd(basis[places])
    shown = right[: len(places)].T / values @ left.T
    basis = basis @ np.concatenate([shown, right[len(places) :].T], axis=1)
    transform = np.stack([plane @ basis for plane in planes], axis=2).reshape(len(shapes), -1)
    where = []
    for k, place in enumerate(places.tolist()):
        first, angle = PLANES * (place // 2), place % 2
        where += [first + 3, first + 2] if angle else [first, first + 1]
        transform[:, 2 * k + 1] *= -1 if angle else 1  # theta_x is the slope of -y
    return np.array(where, dtype=np.int64), transform
