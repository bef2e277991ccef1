"""Fewer coordinates for a rotor: the shapes that it takes on the lines that were measured.

On some lines the whole rotor is solved, at the values at hand, for its inputs and its unbalance,
and for what each unknown changes in the answer. The shapes found, of both planes together, span the
space in which the rotor moves; their singular values say how many of them count. A rotor projected
on that space is the whole one at these values and near them (a reduced basis: Quarteroni, Manzoni
and Negri 2016); whether it is near enough is told at the estimate, where shapes are taken again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from rotorid.models.rotor.assembly import Load, Piece
from rotorid.models.rotor.elements import PLANES
from rotorid.models.rotor.quantity import Factors
from rotorid.record import Complexes, Floats, Integers

WORTH = 4e7
"""Lines times the cube of the coordinates up to which the whole rotor is solved: some seconds."""
SHAPES = 12
"""Lines of each speed on which the whole rotor is solved: four for each mode of a usual band."""
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
        """Return the matrices in the reduced coordinates."""
        basis = self.transform
        sparse = scipy.sparse.csr_array
        return tuple(replace(p, matrix=sparse(basis.T @ (p.matrix @ basis))) for p in pieces)

    def of_loads(self, loads: Sequence[Load]) -> tuple[Load, ...]:
        """Return the loads on the reduced coordinates."""
        basis = self.transform.T
        return tuple(Load(x.factors, basis @ x.cosine, basis @ x.sine) for x in loads)


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


def reduction(
    pieces: Sequence[Piece],
    pushed: Floats,
    kept: Integers,
    band: Band,
    share: float,
) -> Reduction:
    """Return the basis of the shapes that come to more than a share of the largest.

    Parameters
    ----------
    pieces : sequence of Piece
        Of the whole rotor.
    pushed : array, shape (coordinate, force)
        Where the inputs and the unbalance act.
    kept : int array
        What stays a coordinate, with its partner in the other plane.
    """
    points = band.points()
    shapes = np.concatenate([_shapes(pieces, pushed, band.values, *p) for p in points], axis=1)
    along, across = _in_planes(shapes)
    both = np.concatenate([part for s in (along, across) for part in (s.real, s.imag)], axis=1)
    size = _sizes(pieces, band.values).reshape(-1, PLANES)[:, [0, 3]].ravel()
    both *= size[:, None]
    length = np.linalg.norm(both, axis=0)
    left, values, _ = np.linalg.svd(both[:, length > 0] / length[length > 0], full_matrices=False)
    places = np.unique(2 * (kept // PLANES) + (kept % PLANES >= 2))
    count = max(int((values > share * values[0]).sum()), len(places))
    basis = left[:, :count] / size[:, None]
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
    nodes, count = len(basis) // 2, basis.shape[1]
    out = np.zeros((4 * nodes, 2 * count))
    out[0::4, 0::2], out[3::4, 0::2] = basis[0::2], basis[1::2]
    out[1::4, 1::2], out[2::4, 1::2] = basis[0::2], -basis[1::2]
    return out


def _in_planes(shapes: Complexes) -> tuple[Complexes, Complexes]:
    """Return displacement and slope in the plane of x, and in that of y."""
    size = (len(shapes) // 2, shapes.shape[1])
    along, across = np.zeros(size, dtype=complex), np.zeros(size, dtype=complex)
    along[0::2], along[1::2] = shapes[0::4], shapes[3::4]
    across[0::2], across[1::2] = shapes[1::4], -shapes[2::4]
    return along, across


def _showing(rows: Floats) -> Floats:
    """Return a change of basis after which `rows` are the first coordinates."""
    left, values, right = np.linalg.svd(rows)
    first = right[: len(rows)].T / values @ left.T
    return np.concatenate([first, right[len(rows) :].T], axis=1)


def _sizes(pieces: Sequence[Piece], values: Mapping[str, float]) -> Floats:
    """Return the roots of the diagonal of K: metres and radians alike."""
    diagonal = np.zeros(pieces[0].matrix.shape[0])
    for p in pieces:
        if p.order == 0 and not p.power and not p.structural:
            diagonal += _value(p.factors, values) * p.matrix.diagonal()
    return np.sqrt(np.abs(diagonal))


def _shapes(
    pieces: Sequence[Piece],
    pushed: Floats,
    values: Mapping[str, float],
    omega: float,
    speed: float,
) -> Complexes:
    """Return the motion by each force on one line, and what each unknown changes in it."""
    stiffness: Any = 0.0
    for p in pieces:
        stiffness = stiffness + _weight(p, omega, speed) * _value(p.factors, values) * p.matrix
    factors = scipy.linalg.lu_factor(stiffness.toarray())
    motion: Any = scipy.linalg.lu_solve(factors, pushed.astype(np.complex128))
    forces = []
    for name in dict.fromkeys(name for p in pieces for name, _ in p.factors):
        slope: Any = np.zeros_like(motion)
        for p in pieces:
            if any(name == held for held, _ in p.factors):
                by = _weight(p, omega, speed) * _slope(p.factors, values, name)
                slope = slope + by * (p.matrix @ motion)
        forces.append(slope)
    if not forces:
        return np.asarray(motion)
    changes = scipy.linalg.lu_solve(factors, np.concatenate(forces, axis=1))
    return np.concatenate([motion, changes], axis=1)


def _weight(piece: Piece, omega: float, speed: float) -> complex:
    lag = 1j if piece.structural else 1.0
    return complex((1j * omega) ** piece.order * speed**piece.power * lag)


def _value(factors: Factors, values: Mapping[str, float]) -> float:
    return float(np.prod([values[name] ** power for name, power in factors]))


def _slope(factors: Factors, values: Mapping[str, float], name: str) -> float:
    """Return the derivative of a product by one of its names."""
    power = dict(factors)[name]
    rest = tuple((held, n) for held, n in factors if held != name)
    return power * values[name] ** (power - 1) * _value(rest, values)
