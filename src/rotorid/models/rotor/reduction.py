"""Fewer coordinates for a rotor: the shapes that it takes on the lines that were measured.

On some lines the whole rotor is solved, at the values at hand, for a force on each coordinate that
is kept: those that are driven, read, or hold an unbalance. The shapes found, of both planes
together, span the space in which the rotor moves; their singular values say how many of them count.
A rotor projected on that space from both sides answers as the whole one at these values, and near
them but for the square of the difference, as the shapes are those of its readings too (a reduced
basis: Quarteroni, Manzoni and Negri 2016). Whether it is near enough is told at the estimate, where
shapes are taken again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from rotorid.core.values import Complexes, Floats, Integers
from rotorid.models.rotor.drawing import PLANES, Factors
from rotorid.models.rotor.fem import Piece, UnbalanceLoad, signs, slots

WORTH = 4e7
"""Lines times the cube of the coordinates up to which the whole rotor is solved: some seconds."""
SHAPES = 24
"""Lines of each speed on which the whole rotor is solved: eight for each mode of a usual band."""
SPEEDS = 3
"""Speeds at which it is, of all that there are."""
BELOW = 0.3
"""Share of the lowest line at which it is solved too: near rest."""


@dataclass(frozen=True, eq=False)
class Reduction:
    """The basis of a reduced rotor: ``q = transform @ r``; the first of r are `kept` of q."""

    kept: Integers
    transform: Floats

    def of_pieces(self, pieces: Sequence[Piece]) -> tuple[Piece, ...]:
        basis = self.transform
        sparse = scipy.sparse.csr_array
        return tuple(replace(p, matrix=sparse(basis.T @ (p.matrix @ basis))) for p in pieces)

    def of_loads(self, loads: Sequence[UnbalanceLoad]) -> tuple[UnbalanceLoad, ...]:
        basis = self.transform.T
        return tuple(UnbalanceLoad(x.factors, basis @ x.cosine, basis @ x.sine) for x in loads)


@dataclass(frozen=True, eq=False)
class Band:
    """What a reduced rotor is for: lines and speeds in rad/s, values of the parameters."""

    omega: Floats
    speed: Floats
    values: Mapping[str, float]

    def points(self) -> list[tuple[float, float]]:
        """Return the lines, with their speeds, on which the whole rotor is solved."""
        speeds = np.unique(self.speed)
        chosen = speeds[np.unique(np.linspace(0, len(speeds) - 1, SPEEDS).round().astype(int))]
        found: list[tuple[float, float]] = []
        for speed in chosen:
            lines = np.unique(self.omega[(self.speed == speed) & (self.omega > 0)])
            if len(lines):
                every = np.quantile(lines, np.linspace(0, 1, SHAPES))
                found += [(float(omega), float(speed)) for omega in {BELOW * lines[0], *every}]
        return found


@dataclass(frozen=True, eq=False)
class Banded:
    """Z of a whole rotor, whose entries stand near its diagonal, line by line."""

    pieces: tuple[Piece, ...]
    width: int  # entries on either side of the diagonal
    # (piece, 2 width + 1, coordinate): entry (row, column) of each stands at (width + row - column,
    # column)
    bands: Floats
    size: Floats  # (coordinate,): one over the root of the diagonal of K: metres and radians alike
    values: Mapping[str, float]

    @classmethod
    def of(cls, pieces: Sequence[Piece], values: Mapping[str, float]) -> Banded:
        """Take the matrices of a rotor at some values of its parameters."""
        entries = [piece.matrix.tocoo() for piece in pieces]
        width = max(int(np.abs(e.row - e.col).max(initial=0)) for e in entries)
        bands = np.zeros((len(pieces), 2 * width + 1, pieces[0].matrix.shape[0]))
        for band, e in zip(bands, entries, strict=True):
            np.add.at(band, (width + e.row - e.col, e.col), e.data)
        bands *= np.array([_value(p.factors, values) for p in pieces])[:, None, None]
        still = [p.order == 0 and not p.power and not p.structural for p in pieces]
        diagonal = np.abs(bands[still, width].sum(axis=0))
        size = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
        return cls(tuple(pieces), width, bands, size, values)

    def at(self, omega: float, speed: float) -> Complexes:
        """Return the bands of Z on one line, rows and columns in units of `size`."""
        weights = np.array([_weight(piece, omega, speed) for piece in self.pieces])
        bands = np.tensordot(weights, self.bands, 1) * self.size
        for k, band in enumerate(bands, start=-self.width):  # row - column
            band[max(-k, 0) : len(band) - max(k, 0)] *= self.size[max(k, 0) : len(band) + min(k, 0)]
        return np.asarray(bands, dtype=np.complex128)

    def motion(self, places: Integers, omega: float, speed: float) -> Complexes:
        """Return the motion by a force on each place, (coordinate, place), in units of `size`."""
        forces = np.zeros((len(self.size), len(places)), dtype=np.complex128)
        forces[places, np.arange(len(places))] = 1.0
        return self.solved(self.at(omega, speed), forces)

    def solved(self, bands: Complexes, right: Complexes) -> Complexes:
        """Solve with the bands of a line."""
        ends = (self.width, self.width)
        return np.asarray(scipy.linalg.solve_banded(ends, bands, right, check_finite=False))

    def force(self, kept: Integers, motion: Complexes, omega: float, speed: float) -> Complexes:
        """Return the forces on what is kept where nothing acts on the rest, which follows.

        motion, shape (kept,), is theirs in SI, and so are the forces.
        """
        bands, width = self.at(omega, speed), self.width
        held, right = bands.copy(), np.zeros(len(self.size), dtype=np.complex128)
        columns = np.arange(-width, width + 1)[:, None] + kept  # of the rows that are kept
        inside = (columns >= 0) & (columns < len(self.size))
        rows = np.broadcast_to(kept, columns.shape)
        entries = (width + rows - columns)[inside], columns[inside]
        held[entries] = 0.0
        held[width, kept] = 1.0
        right[kept] = motion / self.size[kept]
        follow = self.solved(held, right)
        shares = np.zeros(columns.shape, dtype=np.complex128)
        shares[inside] = bands[entries] * follow[columns[inside]]
        return np.asarray(shares.sum(axis=0) / self.size[kept])


def reduction(pieces: Sequence[Piece], kept: Integers, band: Band, share: float) -> Reduction:
    """Return the basis of the shapes that come to more than a share of the largest.

    What is `kept` stays a coordinate, with its partner in the other plane: where anything acts or
    reads.
    """
    whole = Banded.of(pieces, band.values)
    shapes = np.concatenate([whole.motion(kept, *p) for p in band.points()], axis=1)
    along, across = _in_planes(shapes)
    both = np.concatenate([part for s in (along, across) for part in (s.real, s.imag)], axis=1)
    length = np.linalg.norm(both, axis=0)
    triangle = np.asarray(np.linalg.qr((both[:, length > 0] / length[length > 0]).T, mode="r"))
    left, values, _ = np.linalg.svd(triangle.T, full_matrices=False)
    places = np.unique(2 * (kept // PLANES) + (kept % PLANES >= 2))
    count = max(int((values > share * values[0]).sum()), len(places))
    basis = left[:, :count] * whole.size.reshape(-1, PLANES)[:, [0, 3]].ravel()[:, None]
    basis = basis @ _showing(basis[places])
    transform = _both(basis)
    where = []
    for k, place in enumerate(places.tolist()):
        first, angle = PLANES * (place // 2), place % 2
        where += [first + 3, first + 2] if angle else [first, first + 1]
        transform[:, 2 * k + 1] *= -1 if angle else 1  # theta_x is the slope of -y
    return Reduction(np.array(where, dtype=np.int64), transform)


def _both(basis: Floats) -> Floats:
    """Return shapes of one plane, (2 node, shape), as shapes of x and of y by turns."""
    along, across = slots(len(basis) // 2)
    out = np.zeros((2 * len(basis), 2 * basis.shape[1]))
    out[along, 0::2] = basis
    out[across, 1::2] = signs(len(basis) // 2)[:, None] * basis
    return out


def _in_planes(shapes: Complexes) -> tuple[Complexes, Complexes]:
    """Return displacement and slope in the plane of x, and in that of y."""
    nodes = len(shapes) // PLANES
    along, across = slots(nodes)
    return shapes[along], signs(nodes)[:, None] * shapes[across]


def _showing(rows: Floats) -> Floats:
    """Return a change of basis after which `rows` are the first coordinates."""
    left, values, right = np.linalg.svd(rows)
    first = right[: len(rows)].T / values @ left.T
    return np.concatenate([first, right[len(rows) :].T], axis=1)


def _weight(piece: Piece, omega: float, speed: float) -> complex:
    lag = 1j if piece.structural else 1.0
    return complex((1j * omega) ** piece.order * speed**piece.power * lag)


def _value(factors: Factors, values: Mapping[str, float]) -> float:
    return float(np.prod([values[name] ** power for name, power in factors]))
