"""The problem at one point, made linear: steps along exact relations and within bounds."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy

from rotorid.core.frozen import frozen
from rotorid.core.values import Floats, Integers
from rotorid.likelihood.linear import RANK, tangent_basis
from rotorid.likelihood.problem import Point, Problem
from rotorid.likelihood.relations import Relations

OUTSIDE = 1e-12
"""What a bound may be violated by, relative to the size of its terms: rounding."""


@frozen
class Tangent:
    """The scaled directions in which the exact relations do not change."""

    scale: Floats  # (free,): unit of each unknown
    # (free, direction), or None: directions in those units; None where each unknown is one
    basis: Floats | None
    triangle: Floats  # (direction, direction): R of the scaled Jacobian along the directions
    projected: Floats  # (direction,): the residual along its range
    # (bound, direction) and (bound,): ``normals @ step >= -distances`` keeps the bounds; empty
    # where none is looked at
    normals: Floats
    distances: Floats

    @cached_property
    def regular(self) -> bool:
        """Whether the Jacobian has full rank by far."""
        diagonal = np.abs(np.diag(self.triangle))
        return bool(diagonal.min(initial=1.0) > 1e-5 * diagonal.max(initial=0.0))

    @cached_property
    def _spectrum(self) -> tuple[Floats, Floats, Floats]:
        """Singular values, right singular vectors as rows, residual along the left ones."""
        left, values, right = np.linalg.svd(self.triangle)
        kept = values > RANK * values.max(initial=0.0)
        return values[kept], right[kept], left.T[kept] @ self.projected

    def _along(self, damping: float) -> Floats:
        """Return the Levenberg-Marquardt step along the directions, bounds left aside."""
        if damping == 0 and self.regular:
            return np.asarray(-np.linalg.solve(self.triangle, self.projected))
        values, right, projected = self._spectrum
        return np.asarray(right.T @ (-values / (values**2 + damping) * projected))

    def _damping(self, radius: float) -> float:
        """Return the damping with which a step is as long as the radius, to a tenth."""
        values, _, projected = self._spectrum
        low, high = 0.0, float(np.linalg.norm(values * projected)) / radius
        damping = 1e-3 * high
        for _ in range(40):
            length = np.linalg.norm(values / (values**2 + damping) * projected)
            if abs(length - radius) <= 0.1 * radius:
                break
            low, high = (damping, high) if length > radius else (low, damping)
            damping = np.sqrt(low * high) if low > 0 else 0.01 * high
        return float(damping)

    def step(self, radius: float = np.inf) -> Floats | None:
        """Return the best step no longer than a radius that keeps the bounds, if there is one."""
        damping, along = 0.0, self._along(0.0)
        if not np.linalg.norm(along) <= radius:
            damping = self._damping(radius)
            along = self._along(damping)
        if (self.normals @ along >= -self.distances).all():
            return along
        return self._within(damping)

    def _within(self, damping: float) -> Floats | None:
        """Return the damped step within the bounds (Lawson and Hanson, chapter 23)."""
        width = len(self.projected)
        least = max(damping, RANK * self.size**2)
        rows = np.concatenate([self.triangle, np.sqrt(least) * np.eye(width)])
        basis, triangle = np.linalg.qr(rows)
        free = -basis[:width].T @ self.projected
        sides = np.linalg.solve(triangle.T, self.normals.T).T
        gap = -self.distances - sides @ free
        length = np.sqrt((sides**2).sum(axis=1) + gap**2)
        sides, gap = sides / length[:, None], gap / length
        target = np.append(np.zeros(width), 1.0)
        try:
            weights, left = scipy.optimize.nnls(np.concatenate([sides.T, gap[None]]), target)
        except RuntimeError:
            return None
        if left < 1e-12:  # the bounds contradict one another
            return None
        distance = np.concatenate([sides.T, gap[None]]) @ weights - target
        if not distance[-1] < 0:
            return None
        along = np.linalg.solve(triangle, free - distance[:-1] / distance[-1])
        return along if np.isfinite(along).all() else None

    def across(self, change: Floats) -> Floats:
        """Return the Gauss-Newton step square to a change of the free unknowns."""
        with np.errstate(over="ignore", invalid="ignore"):
            direction = change / self.scale
        if self.basis is not None:
            direction = self.basis.T @ direction
        rest = tangent_basis(direction[None])
        return np.asarray(rest @ np.linalg.lstsq(self.triangle @ rest, -self.projected, RANK)[0])

    def spread(self, along: Floats) -> Floats:
        """Return a step along the directions as a change of the free unknowns."""
        return np.asarray(self.scale * (along if self.basis is None else self.basis @ along))

    @cached_property
    def decrease(self) -> float:
        """The drop of the cost that a full Gauss-Newton step would bring."""
        if len(self.normals):
            along = self.step()
            if along is None:
                return 0.0
            left = self.triangle @ along + self.projected
            return float(self.projected @ self.projected - left @ left)
        reached = self.projected if self.regular else self._spectrum[2]
        return float(reached @ reached)

    @property
    def size(self) -> float:
        """Largest column of the Jacobian, to measure the damping by."""
        return float(np.sqrt((self.triangle**2).sum(axis=0).max(initial=0.0)))


def relation_jacobian(exact: Relations, point: Point) -> Floats:
    """Return dh by the free unknowns, each row of length about one in relative changes."""
    free = point.problem.layout.free
    return exact.jacobian(point.unknowns)[:, free]


def tangent(point: Point, exact: Relations, bounds: Relations | None = None) -> Tangent:
    """Linearize the problem at a point, in the null space of the exact relations."""
    jacobian, free = point.jacobian, point.problem.layout.free
    if not np.abs(jacobian).max(initial=0.0) < 1e150:
        raise np.linalg.LinAlgError("a derivative beyond all bounds")
    size = np.sqrt((jacobian**2).sum(axis=0))
    typical = np.maximum(np.abs(point.unknowns[free]), 1e-300)
    seen = size > 1e-150
    scale = np.where(seen, 1 / np.where(seen, size, 1.0), typical)
    scaled = jacobian * scale
    basis = None
    if len(exact):
        basis = tangent_basis(relation_jacobian(exact, point) * scale)
        scaled = scaled @ basis
    width = scaled.shape[1]
    rows = np.zeros((max(len(scaled), width + 1), width + 1))  # perhaps fewer than unknowns
    rows[: len(scaled), :width], rows[: len(scaled), width] = scaled, point.residual
    if not np.isfinite(rows).all():  # LAPACK would print a line of its own
        raise np.linalg.LinAlgError("a residual beyond all bounds")
    triangle = np.asarray(np.linalg.qr(rows, mode="r"))
    normals, distances = np.zeros((0, width)), np.zeros(0)
    if bounds is not None and len(bounds):
        normals = relation_jacobian(bounds, point) * scale
        normals = normals if basis is None else normals @ basis
        length = np.sqrt((normals**2).sum(axis=1))
        moved = length > 0
        normals = normals[moved] / length[moved, None]
        distances = bounds.values(point.unknowns)[moved].clip(0) / length[moved]
    projected = triangle[:width, width]
    return Tangent(scale, basis, triangle[:width, :width], projected, normals, distances)


def retract(unknowns: Floats, free: Integers, exact: Relations, scale: Floats) -> Floats | None:
    """Return the nearest point that satisfies the exact relations, or None where none is near."""
    x = unknowns.copy()
    for _ in range(30):
        gap = exact.values(x)
        if (np.abs(gap) <= 1e-14 * exact.sizes(x)).all():
            return x
        derivative = exact.jacobian(x)[:, free] * scale
        if not (np.isfinite(derivative).all() and np.isfinite(gap).all()):
            return None
        change = scale * np.linalg.lstsq(derivative, gap, rcond=1e-12)[0]
        x[free] -= change
        if not np.isfinite(x).all():
            return None
        if (np.abs(change) <= 1e-15 * np.abs(x[free])).all():
            return x
    return x if (np.abs(exact.values(x)) <= 1e-10 * exact.sizes(x)).all() else None


def outside(bounds: Relations, unknowns: Floats, margin: float = OUTSIDE) -> Integers:
    """Return the bounds that a point violates."""
    return np.flatnonzero(bounds.values(unknowns) < -margin * bounds.sizes(unknowns))


def inside(problem: Problem, unknowns: Floats, scale: Floats) -> Floats | None:
    """Return the nearest point that keeps relations and bounds, or None where none is near."""
    held: list[int] = []
    x: Floats | None = unknowns
    for _ in range(len(problem.bounds) + 1):
        relations = problem.exact
        if held:
            relations = relations.joined(problem.bounds.subset(np.array(held)))
        x = retract(unknowns, problem.layout.free, relations, scale) if len(relations) else unknowns
        if x is None:
            return None
        fresh = [int(i) for i in outside(problem.bounds, x) if i not in held]
        if not fresh:
            return None if len(outside(problem.bounds, x, 1e-9)) else x
        held += fresh
    return None
