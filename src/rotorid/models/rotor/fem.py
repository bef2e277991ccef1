"""Matrices of a drawing, and how many elements are enough."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from rotorid.core.errors import ModelError
from rotorid.core.values import Floats
from rotorid.models.rotor.drawing import SAME, SPEED, Factors, Quantity, Rotor, Section
from rotorid.models.rotor.elements import PLANES, Beam, both_planes, turned

Key = tuple[Factors, int, int, bool]


@dataclass(frozen=True, eq=False)
class Piece:
    """``factors * Omega^power * matrix @ d^order q / dt^order``, turned by i where structural."""

    factors: Factors  # tuple of (str, int): names of parameters and their powers
    order: int
    power: int
    structural: bool
    matrix: scipy.sparse.csr_array  # sparse array, shape (row, coordinate)


@dataclass(frozen=True, eq=False)
class UnbalanceLoad:
    """``factors * Omega^2 (cosine cos(phi) + sine sin(phi))``, (row,) each, on the right side."""

    factors: Factors
    cosine: Floats
    sine: Floats


class _Gatherer:
    """Blocks of matrices, by what multiplies them."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.blocks: dict[Key, list[tuple[int, Floats]]] = defaultdict(list)

    def add(
        self, quantity: Quantity, order: int, first: int, block: Floats, *, structural: bool = False
    ) -> None:
        """Add a block whose first coordinate is `first`, times a quantity."""
        for factors, coefficient in quantity.terms:
            kept = tuple((name, n) for name, n in factors if name != SPEED)
            power = dict(factors).get(SPEED, 0)
            self.blocks[kept, order, power, structural].append((first, coefficient * block))

    def pieces(self) -> tuple[Piece, ...]:
        return tuple(Piece(*key, self._matrix(blocks)) for key, blocks in self.blocks.items())

    def _matrix(self, blocks: list[tuple[int, Floats]]) -> scipy.sparse.csr_array:
        rows, columns, values = [], [], []
        for first, block in blocks:
            r, c = np.nonzero(block)
            rows.append(r + first)
            columns.append(c + first)
            values.append(block[r, c])
        where = (np.concatenate(rows), np.concatenate(columns))
        shape = (self.size, self.size)
        entries = scipy.sparse.coo_array((np.concatenate(values), where), shape=shape)
        return scipy.sparse.csr_array(entries)


def pieces_of(rotor: Rotor) -> tuple[Piece, ...]:
    """Return the matrices of a rotor, in the coordinates of its nodes."""
    gathered = _Gatherer(PLANES * len(rotor.nodes))
    for span in rotor.spans():
        _add_element(gathered, rotor, *span)
    for disc in rotor.discs.values():
        first = PLANES * rotor.node(disc.at)
        gathered.add(disc.mass, 2, first, np.diag([1.0, 1.0, 0.0, 0.0]))
        gathered.add(disc.I_t, 2, first, np.diag([0.0, 0.0, 1.0, 1.0]))
        spin = np.zeros((PLANES, PLANES))
        spin[2, 3], spin[3, 2] = 1.0, -1.0
        gathered.add(disc.I_p.times(_SPEED), 1, first, spin)
    for support in rotor.supports.values():
        first = PLANES * rotor.node(support.at)
        for order, table in ((0, support.stiffness), (1, support.damping)):
            for (row, column), quantity in zip(np.ndindex(2, 2), table, strict=True):
                block = np.zeros((2, 2))
                block[row, column] = 1.0
                gathered.add(quantity, order, first, block)
    return gathered.pieces()


_SPEED = Quantity(((((SPEED, 1),), 1.0),))


def _add_element(
    gathered: _Gatherer, rotor: Rotor, node: int, section: Section, beam: Beam
) -> None:
    first = PLANES * node
    _add_elastic(gathered, rotor, first, section, beam)
    mass = both_planes(beam.translation() + beam.rotation())
    gathered.add(section.density, 2, first, mass)
    gathered.add(section.density.times(rotor.external), 1, first, mass)
    polar = both_planes(2 * beam.rotation()) @ turned(2)
    gathered.add(section.density.times(_SPEED), 1, first, polar)


def _add_elastic(
    gathered: _Gatherer, rotor: Rotor, first: int, section: Section, beam: Beam
) -> None:
    """Add the stiffness of an element, with the damping that goes with it."""
    stiffness = both_planes(beam.stiffness()) / section.modulus
    elastic = section.E.times(section.stiffness)
    gathered.add(elastic, 0, first, stiffness)
    spun = elastic.times(rotor.internal)
    gathered.add(spun, 1, first, stiffness)
    gathered.add(spun.times(_SPEED), 0, first, stiffness @ turned(2))
    gathered.add(elastic.times(rotor.structural), 0, first, stiffness, structural=True)


def elastic_pieces(rotor: Rotor, elements: Collection[int]) -> tuple[Piece, ...]:
    """Return what some elements of the shaft, by their left nodes, add by their stiffness."""
    gathered = _Gatherer(PLANES * len(rotor.nodes))
    for node, section, beam in rotor.spans():
        if node in elements:
            _add_elastic(gathered, rotor, PLANES * node, section, beam)
    return gathered.pieces()


def loads_of(rotor: Rotor) -> tuple[UnbalanceLoad, ...]:
    """Return the unbalance loads."""
    found = []
    size = PLANES * len(rotor.nodes)
    for plane in rotor.unbalance.values():
        first = PLANES * rotor.node(plane.at)
        along, across = np.zeros(size), np.zeros(size)
        along[first], across[first + 1] = 1.0, 1.0
        found += [UnbalanceLoad(f, c * along, c * across) for f, c in plane.x.terms]
        found += [UnbalanceLoad(f, c * across, -c * along) for f, c in plane.y.terms]
    return tuple(found)


def inputs_of(rotor: Rotor) -> Floats:
    matrix = np.zeros((PLANES * len(rotor.nodes), 2 * len(rotor.actuators)))
    for k, at in enumerate(rotor.actuators.values()):
        first = PLANES * rotor.node(at)
        matrix[first, 2 * k] = matrix[first + 1, 2 * k + 1] = 1.0
    return matrix


def coordinates_of(rotor: Rotor) -> tuple[str, ...]:
    return tuple(name for node in rotor.nodes for name in node.coordinates)


CONVERGED = 1e-3
"""Change of the first three bending frequencies, free, that twice the elements may bring."""
BENDING = 3
FINER = 1.25
"""How much shorter the elements are that are tried next."""


def divided(rotor: Rotor, elements: Sequence[int | None], limit: int) -> Rotor:
    """Return a rotor whose sections have the elements asked for, the others as many as needed.

    As many as make the first three bending frequencies of the free shaft, without what stands on
    it, converge: elements of about one length, shortened until
    twice as many change the frequencies by no more than `CONVERGED`.
    """
    size = max(section.length for section in rotor.sections)
    while True:
        counts = [
            given or max(1, int(np.ceil(section.length / size - SAME)))
            for section, given in zip(rotor.sections, elements, strict=True)
        ]
        if sum(counts) + len(rotor.places) > limit:
            raise ModelError(
                f"more than {limit} elements",
                "as many as the bending modes in the band of the records need",
                "leave elements out, or draw fewer sections",
                place="sections",
            )
        found = _meshed(rotor, counts)
        if None not in elements:
            return found
        # Twice as many of a section need not be: a place in its middle divides it already.
        mine, theirs = bending(found), bending(found, parts=2)
        if len(mine) == BENDING and (np.abs(mine - theirs) <= CONVERGED * theirs).all():
            return found
        size /= FINER


def _meshed(rotor: Rotor, elements: Sequence[int]) -> Rotor:
    sections = zip(rotor.sections, elements, strict=True)
    return replace(rotor, sections=tuple(replace(s, elements=count) for s, count in sections))


def bending(rotor: Rotor, parts: int = 1) -> Floats:
    """Return the first bending frequencies of the shaft alone in one plane, free, in rad/s.

    Each of its elements is divided into so many parts.
    """
    nodes = parts * (len(rotor.nodes) - 1) + 1
    mass, stiffness = np.zeros((2 * nodes, 2 * nodes)), np.zeros((2 * nodes, 2 * nodes))
    for number, section, whole in rotor.spans():
        beam = section.beam(whole.length / parts)
        for node in range(parts * number, parts * (number + 1)):
            where = slice(2 * node, 2 * node + 4)
            stiffness[where, where] += beam.stiffness()
            mass[where, where] += section.heaviness * (beam.translation() + beam.rotation())
    scale = 1 / np.sqrt(np.diag(mass))
    scaled = [scale[:, None] * matrix * scale for matrix in (stiffness, mass)]
    squares = scipy.linalg.eigh(*scaled, eigvals_only=True)
    return np.asarray(np.sqrt(squares[2 : 2 + BENDING].clip(0)))
