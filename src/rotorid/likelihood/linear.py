"""The problem made linear at a point: one factorization, and what is asked of it.

Notation: J the Jacobian of the whitened residual r by the free unknowns, D their scale, N an
orthonormal basis of the directions along which the exact relations do not change.

    J D N = U S W'                     singular values; those below `RANK` of the largest are none
    root = D N W S^-1                  of the covariance of the free unknowns, root root'
    C = U U' C + (1 - U U') C          of columns C beside J: what the unknowns take over, the rest

Freeing what columns C stand for lowers the cost by the squared length of r along the rest of C, to
first order (a score test). Leaving out rows k lowers it by r_k' (1 - U_k U_k')^-1 r_k. How far an
error of what is taken as exact moves the unknowns unseen: docs/maximum-likelihood.md, section 6.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from rotorid.core.linalg import column_lengths, leave_out, triangle, whole_svd
from rotorid.core.values import Booleans, Floats, Integers, frozen

RANK = 1e-10  # singular values below this share of the largest count as zero
IDLE = 1e-6  # deviations by which a parameter's whole value moves the residual: fewer are rounding
ROUNDING = 1e-12  # the same as a share of the largest such effect
OPEN = 1e-6  # part in an open direction from which on an unknown is open too: beyond rounding
DISTINCT = 1e-5  # share of a column, at least, that unknowns do not take over: less is rounding
CERTAIN = 1e-6  # share of what a row tells that others tell, at least: with less it fits itself


@frozen
class Linearized:
    """The residual and its scaled Jacobian along the exact relations, factored."""

    residual: Floats  # (row,): r
    scale: Floats  # (free,): D
    left: Floats  # (row, direction): U
    values: Floats  # (direction,): S, falling
    directions: Floats  # (free, direction): N W, orthonormal, of the scaled unknowns
    rank: int  # how many directions, the first, the rows determine

    @classmethod
    def of(
        cls, jacobian: Floats, residual: Floats, relations: Floats, sizes: Floats, shifts: Booleans
    ) -> Linearized:
        """Factor a Jacobian (row, free) where relations (relation, free) of the unknowns hold.

        `sizes` are those of the unknowns. A column that is rounding for an unknown of that size is
        zero: scaled to length one, it would count as information. What `shifts` (a phase,
        a delay) may well be zero itself; its column counts all the same.
        """
        with np.errstate(over="ignore"):
            length = np.sqrt((jacobian**2).sum(axis=0))
        if not np.isfinite(length).all():
            raise np.linalg.LinAlgError("a derivative beyond all bounds")
        effect = length * sizes
        seen = (effect > IDLE) & (effect > ROUNDING * effect.max(initial=0.0))
        seen |= shifts & (length > 0)
        scale = np.where(seen, 1 / np.where(seen, length, 1.0), sizes)
        scaled, basis = np.where(seen, jacobian, 0.0) * scale, None
        if len(relations):
            basis = tangent_basis(relations * scale)
            scaled = scaled @ basis
        left, values, right = whole_svd(scaled)
        directions = right.T if basis is None else basis @ right.T
        rank = int(np.count_nonzero(values > RANK * values.max(initial=0.0)))
        return cls(residual, scale, left, values, directions, rank)

    def cut(self, share: float) -> Linearized:
        """Return the same with the directions below a share of the largest taken for open."""
        told = self.values > share * self.values.max(initial=0.0)
        return replace(self, rank=int(told.sum()))

    def filled(self, share: float) -> Linearized:
        """Return the same with no direction open: all have a share of the largest at least."""
        values = np.maximum(self.values, share * self.values.max(initial=0.0))
        return replace(self, values=values, rank=len(values))

    def weighted(self, weights: Floats) -> Linearized:
        """Return the same with weighted rows; as many directions as before count."""
        rows = weights[:, None] * (self.left * self.values)
        left, values, right = whole_svd(rows)
        residual = weights * self.residual
        return Linearized(residual, self.scale, left, values, self.directions @ right.T, self.rank)

    @property
    def determined(self) -> Linearized:
        n = self.rank
        parts = self.left[:, :n], self.values[:n], self.directions[:, :n]
        return Linearized(self.residual, self.scale, *parts, n)

    @property
    def range(self) -> Floats:
        """What the unknowns can explain, orthonormal, (row, rank)."""
        return self.left[:, : self.rank]

    @property
    def null(self) -> Floats:
        """Directions of the scaled unknowns that are open, (free, n)."""
        return self.directions[:, self.rank :]

    @property
    def undetermined(self) -> Booleans:
        return np.asarray((np.abs(self.null) > OPEN).any(axis=1))

    def left_open(self, slopes: Floats) -> Booleans:
        """Return which quantities, of slopes (quantity, free), are not determined."""
        scaled = slopes * self.scale
        largest = np.abs(scaled).max(axis=1, initial=0.0, keepdims=True)
        scaled = scaled / np.where(largest > 0, largest, 1.0)  # squares of what is far off overflow
        unit = scaled / column_lengths(scaled.T)[:, None]
        return np.asarray((np.abs(unit @ self.null) > OPEN).any(axis=1))

    @property
    def condition_number(self) -> float:
        """Of the scaled Jacobian, over the directions that are determined."""
        return float(self.values[0] / self.values[self.rank - 1]) if self.rank else np.inf

    @cached_property
    def root(self) -> Floats:
        """A root of the covariance of the unknowns, (free, rank): how they answer to `range`."""
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # far from any minimum
            along = self.directions[:, : self.rank] / self.values[: self.rank]
            return np.asarray(self.scale[:, None] * along)

    @property
    def std(self) -> Floats:
        with np.errstate(over="ignore", invalid="ignore"):
            found = np.sqrt((self.root**2).sum(axis=1))
        return np.asarray(np.nan_to_num(found, nan=np.inf, posinf=np.inf))

    @cached_property
    def leverage(self) -> Floats:
        """How much of each row its own noise explains, (row,); they sum to the rank."""
        return np.asarray((self.range**2).sum(axis=1))

    def told_by(self) -> Floats:
        """Return the share of each row in what tells each unknown, (free, row)."""
        size = np.linalg.norm(self.root, axis=1, keepdims=True)
        unit = self.root / np.where(size > 0, size, 1.0)
        return np.asarray((unit @ self.range.T) ** 2)

    def taken(self, columns: Floats) -> Floats:
        """Return the change of the unknowns that takes columns over as far as they can."""
        return np.asarray(self.root @ (self.range.T @ columns))

    def rest(self, columns: Floats) -> Floats:
        for _ in range(2):  # once more, against rounding
            columns = columns - self.range @ (self.range.T @ columns)
        return columns

    def score(self, columns: Floats) -> tuple[float, Floats]:
        """Return the drop of the cost with further columns, and the change of their unknowns."""
        unit = column_lengths(columns)
        basis, values, right = np.linalg.svd(self.rest(columns / unit), full_matrices=False)
        kept = values > DISTINCT
        along = basis[:, kept].T @ self.residual
        change = -right[kept].T @ (along / values[kept])
        return float(along @ along), change / unit

    def evidence(self, columns: Floats, most: float) -> float:
        """Return twice the logarithm of the Bayes factor for errors, normal and of size one.

        `columns` are what they do to the residual. They lower the cost by ``a^2 s^2 / (1 + s^2)``
        in each direction and pay ``log(1 + s^2)`` for it, s its size and a the residual along it;
        minus infinity if an error would have to be larger than `most`.
        """
        basis, sizes, ways = np.linalg.svd(self.rest(columns), full_matrices=False)
        along = basis.T @ self.residual
        errors = ways.T @ (along * sizes / (1 + sizes**2))
        if np.abs(errors).max(initial=0.0) > most:
            return -np.inf
        share = sizes**2 / (1 + sizes**2)
        return float((along**2 * share - np.log1p(sizes**2)).sum())

    def unseen(self, columns: Floats, excess: float) -> Floats:
        """Return how large errors may be unseen, in ways apart from one another, (error, way).

        `columns` are what errors of a plausible size do to the residual; `excess` is what may be
        added to the cost.
        """
        _, sizes, ways = np.linalg.svd(triangle(self.rest(columns)))
        weight = np.ones(len(ways))
        weight[: len(sizes)] /= np.sqrt(1 + sizes**2 / excess)
        return np.asarray(ways.T * weight)

    def without(self, rows: Integers) -> float:
        """Return the drop of the cost without some rows."""
        own, residual = self.range[rows], self.residual[rows]
        return float(residual @ leave_out(own @ own.T, residual, CERTAIN)[0])


def tangent_basis(normal: Floats) -> Floats:
    """Return an orthonormal basis of what is orthogonal to the rows, (free, free - relations)."""
    with np.errstate(over="ignore"):
        length = np.sqrt((normal**2).sum(axis=1, keepdims=True))
    if not (np.isfinite(length).all() and length.min() > 0):
        raise np.linalg.LinAlgError("a relation without a free unknown")
    orthogonal, _ = np.linalg.qr((normal / length).T, mode="complete")
    return np.asarray(orthogonal[:, len(normal) :])
