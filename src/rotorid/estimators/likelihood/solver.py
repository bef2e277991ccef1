"""Levenberg-Marquardt on the whitened residual, led by a homotopy.

Far from the truth the likelihood has local minima. Granting every equation of motion an error of
its own, ``V + sigma^2 S`` with S scaled per row, smooths them away: with a large sigma the cost
is that of an ordinary regression. Each stage starts where the last one ended, with sigma a tenth
of the last, and none in the end.

Exact relations are eliminated: steps are taken in the null space of their derivative, and Newton
steps lead back to them. Bounds wait until the end, since the way to the minimum may well lead
through a negative mass: one that the minimum violates becomes an exact relation, for as long as
the cost would not fall by leaving it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rotorid.estimators.likelihood.problem import Point, Problem
from rotorid.estimators.likelihood.relations import Relations
from rotorid.record import Floats, Integers

STAGES = (10.0, 1.0, 0.1, 0.01, 0.0)
"""sigma of each stage, in units of the mean force."""
ANCHOR = 0.3
"""Relative deviation with which the gains are held while errors are granted."""
RANK = 1e-10
"""Singular values below this share of the largest count as zero."""


@dataclass(frozen=True)
class Solution:
    """Where the solver ended.

    Parameters
    ----------
    point : Point
    converged : bool
    iterations : int
        Evaluations of the Jacobian, over all stages.
    active : sequence of int
        Bounds that hold with equality.
    """

    point: Point
    converged: bool
    iterations: int
    active: tuple[int, ...] = ()


@dataclass(frozen=True)
class Tangent:
    """The scaled directions in which the exact relations do not change.

    Parameters
    ----------
    scale : array, shape (free,)
        Unit of each unknown.
    basis : array, shape (free, direction), or None
        Directions in those units; None where each unknown is one.
    triangle : array, shape (direction, direction)
        R of the scaled Jacobian along the directions.
    projected : array, shape (direction,)
        The residual along its range.
    """

    scale: Floats
    basis: Floats | None
    triangle: Floats
    projected: Floats

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

    def step(self, damping: float) -> Floats:
        """Return the Levenberg-Marquardt step of the free unknowns."""
        if damping == 0 and self.regular:
            along = -np.linalg.solve(self.triangle, self.projected)
        else:
            values, right, projected = self._spectrum
            along = right.T @ (-values / (values**2 + damping) * projected)
        return np.asarray(self.scale * (along if self.basis is None else self.basis @ along))

    @property
    def decrease(self) -> float:
        """The drop of the cost that a full Gauss-Newton step would bring."""
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


def tangent_basis(normal: Floats) -> Floats:
    """Return an orthonormal basis of what is orthogonal to the rows, (free, free - relations)."""
    length = np.sqrt((normal**2).sum(axis=1, keepdims=True))
    if not (np.isfinite(length).all() and length.min() > 0):
        raise np.linalg.LinAlgError("a relation without a free unknown")
    orthogonal, _ = np.linalg.qr((normal / length).T, mode="complete")
    return np.asarray(orthogonal[:, len(normal) :])


def tangent(point: Point, exact: Relations) -> Tangent:
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
    rows = np.column_stack([scaled, point.residual])
    triangle = np.asarray(np.linalg.qr(rows, mode="r"))
    width = scaled.shape[1]
    return Tangent(scale, basis, triangle[:width, :width], triangle[:width, width])


def retract(unknowns: Floats, free: Integers, exact: Relations, scale: Floats) -> Floats | None:
    """Return the nearest point that satisfies the exact relations, or None where none is near."""
    x = unknowns.copy()
    for _ in range(30):
        gap = exact.values(x)
        if (np.abs(gap) <= 1e-14 * exact.sizes(x)).all():
            return x
        derivative = exact.jacobian(x)[:, free] * scale
        change = scale * np.linalg.lstsq(derivative, gap, rcond=1e-12)[0]
        x[free] -= change
        if not np.isfinite(x).all():
            return None
        if (np.abs(change) <= 1e-15 * np.abs(x[free])).all():
            return x
    return x if (np.abs(exact.values(x)) <= 1e-10 * exact.sizes(x)).all() else None


class _Walk:
    """The current point and the bounds that hold it."""

    def __init__(self, problem: Problem, unknowns: Floats) -> None:
        self.problem, self.unknowns = problem, unknowns
        self.active: list[int] = []
        self.iterations = 0

    @property
    def exact(self) -> Relations:
        if not self.active:
            return self.problem.exact
        return self.problem.exact.joined(self.problem.bounds.subset(np.array(self.active)))

    def hold(self, point: Point) -> bool:
        """Make the bounds that a point violates exact relations; tell whether there were any."""
        bounds = self.problem.bounds
        if not len(bounds):
            return False
        outside = bounds.values(point.unknowns) < -1e-12 * bounds.sizes(point.unknowns)
        fresh = [int(i) for i in np.flatnonzero(outside) if i not in self.active]
        self.active += fresh
        return bool(fresh)

    def release(self, point: Point) -> bool:
        """Drop a bound whose multiplier says that the cost falls on its inner side."""
        if not self.active:
            return False
        scale = tangent(point, self.exact).scale
        gradient = (point.jacobian.T @ point.residual) * scale
        normal = relation_jacobian(self.exact, point) * scale
        length = np.sqrt((normal**2).sum(axis=1))
        multiplier = np.linalg.lstsq((normal / length[:, None]).T, gradient, rcond=1e-12)[0]
        inner = multiplier[len(self.problem.exact) :]
        worst = int(np.argmin(inner))
        if inner[worst] >= -1e-6:  # in deviations of the whitened residual
            return False
        del self.active[worst]
        return True

    def descend(self, relaxation: float, tolerance: float, limit: int) -> tuple[Point, bool]:
        """Minimize at one relaxation."""
        problem, free = self.problem, self.problem.layout.free
        point, damping = problem.best_at(self.unknowns, relaxation), 0.0
        for _ in range(limit):
            where = tangent(point, self.exact)
            self.iterations += 1
            floor = 1e-14 if relaxation > 0 else 1.0
            if where.decrease <= tolerance * max(point.cost, floor):
                return point, True
            top = where.size**2
            for _attempt in range(25):
                aimed = point.unknowns.copy()
                aimed[free] += where.step(damping)
                exact = self.exact
                target = retract(aimed, free, exact, where.scale) if len(exact) else aimed
                trial = None if target is None else _evaluated(problem, target, relaxation)
                if trial is not None and trial.cost < point.cost:
                    damping = 0.0 if damping < 1e-6 * top else damping / 10
                    break
                damping = max(1e-3 * top, 8 * damping)
            else:
                # No step helps: rounding, if what was left to gain is next to nothing.
                return point, where.decrease <= 1e-6 * max(point.cost, floor)
            point = trial
            self.unknowns = point.unknowns
        return point, False


def _evaluated(problem: Problem, unknowns: Floats, relaxation: float) -> Point | None:
    """Evaluate, or return None where the point has no finite cost."""
    if not np.abs(unknowns).max(initial=0.0) < 1e150:
        return None
    try:
        with np.errstate(all="ignore"):
            point = problem.best_at(unknowns, relaxation)
    except np.linalg.LinAlgError:
        return None
    return point if np.isfinite(point.cost) else None


def solve(problem: Problem, start: Floats, stages: Sequence[float] = STAGES) -> Solution:
    """Minimize the cost from a start."""
    free, x = problem.layout.free, start
    if len(problem.exact):
        scale = np.maximum(np.abs(start[free]), 1e-12 * np.abs(start[free]).max(initial=0.0))
        moved = retract(start, free, problem.exact, scale)
        x = start if moved is None else moved
    walk = _Walk(_anchored(problem, start), x)
    for relaxation in stages[:-1]:
        walk.descend(relaxation, tolerance=1e-2, limit=30)
    walk.problem = problem
    point, converged = walk.descend(stages[-1], tolerance=1e-10, limit=100)
    try:
        for _ in range(2 * len(problem.bounds)):
            if not (walk.hold(point) or walk.release(point)):
                break
            held = retract(point.unknowns, free, walk.exact, tangent(point, problem.exact).scale)
            if held is None:
                raise np.linalg.LinAlgError("bounds that cannot all hold")
            walk.unknowns = held
            point, converged = walk.descend(stages[-1], tolerance=1e-10, limit=100)
    except np.linalg.LinAlgError:
        converged = False
    return Solution(point, converged, walk.iterations, tuple(walk.active))


def _anchored(problem: Problem, start: Floats) -> Problem:
    """Hold the gains of the inputs loosely to their start.

    While errors are granted to the equations in units of force, the cost would fall with the
    forces themselves: without an anchor, all gains, masses and stiffnesses go to zero together.
    """
    layout, count = problem.layout, len(problem.layout.unknowns)
    rows = []
    for index in layout.free:
        unknown = layout.unknowns[index]
        if unknown.anchored and start[index]:
            alone = tuple(int(i == index) for i in range(count))
            polynomial = {alone: 1.0, (0,) * count: -float(start[index])}
            rows.append((polynomial, ANCHOR * abs(float(start[index])), unknown.name))
    if not rows:
        return problem
    return replace(problem, known=problem.known.joined(Relations.build(rows, count)))
