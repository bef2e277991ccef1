"""All records and all knowledge as one least-squares problem in the unknowns.

`Point` is the problem evaluated, `Tangent` what the solver makes of a point: steps along exact
relations and within bounds.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from itertools import pairwise, zip_longest
from typing import TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from rotorid.core.frozen import frozen
from rotorid.core.values import Floats, Integers
from rotorid.data.observation import Observation
from rotorid.likelihood.assembly import assemble
from rotorid.likelihood.cost import Evaluation, Likelihood
from rotorid.likelihood.layout import Layout
from rotorid.likelihood.linear import RANK, Linearized, tangent_basis
from rotorid.likelihood.mode_rows import ModalRows, modal_rows
from rotorid.likelihood.relations import Relation, Relations

Number = TypeVar("Number", np.float64, np.int64)

OUTSIDE = 1e-12
"""What a bound may be violated by, relative to the size of its terms: rounding."""


@frozen
class Known:
    """What is known with a deviation, rows beside the lines: relations, then measured modes."""

    relations: Relations
    modes: ModalRows = field(default_factory=ModalRows)

    def __len__(self) -> int:
        return len(self.relations) + len(self.modes)

    @property
    def texts(self) -> tuple[str, ...]:
        return self.relations.texts + self.modes.texts

    def values(self, unknowns: Floats, relaxation: float = 0.0) -> Floats:
        """Return the residuals, of deviation one, shape (row,)."""
        modes = self.modes.values(unknowns, relaxation)
        return np.concatenate([self.relations.values(unknowns), modes])

    def jacobian(self, unknowns: Floats, relaxation: float = 0.0) -> Floats:
        """Return their derivative, shape (row, unknown)."""
        modes = self.modes.jacobian(unknowns, relaxation)
        return np.concatenate([self.relations.jacobian(unknowns), modes])

    def joined(self, rows: Iterable[Relation]) -> Known:
        return replace(self, relations=self.relations.joined(rows))

    def without(self, text: str) -> Known:
        kept = self.relations.where(lambda row: row.stated != text)
        return Known(kept, self.modes.of_mode(text, others=True))

    def within(self, layout: Layout, relations: Relations, generic: Floats) -> Known:
        """Return the rows over the unknowns of a wider layout."""
        return Known(relations, modal_rows(layout, self.modes.modes, generic))


@frozen
class Problem:
    """Minimize the sum of the records' costs and of the squared rows of what is known."""

    layout: Layout
    exact: Relations  # h = 0
    known: Known  # h of deviation one, and measured modes
    bounds: Relations  # h >= 0
    likelihoods: tuple[Likelihood, ...] = ()  # one per record
    # what was put into the model, where base parameters are asked for
    substituted: Mapping[str, float] = field(default_factory=dict)
    # the same with few of the lines, or of the shapes, for the way to the minimum
    sketch: Problem | None = None
    lowest: Point | None = None  # the minimum of the sketch, where it is known
    # share of the cost left to gain at which the search for the minimum ends
    tolerance: float = 1e-10

    def of(self, records: Sequence[Observation], alike: Sequence[Likelihood] = ()) -> Problem:
        """Return the problem of some records; `alike`: likelihoods of the same ones."""
        likelihoods = tuple(
            assemble(self.layout, record, number, like)
            for number, (record, like) in enumerate(zip_longest(records, alike))
        )
        kept = self.layout, self.exact, self.known, self.bounds
        return Problem(*kept, likelihoods, self.substituted)

    def at(self, unknowns: Floats, relaxation: float = 0.0, like: Point | None = None) -> Point:
        """Evaluate at all unknowns, shape (unknown,); `like`: where the same rotor was, perhaps."""
        before = [] if like is None else like.records
        records = [
            likelihood.evaluate(unknowns, relaxation, like=at)
            for likelihood, at in zip_longest(self.likelihoods, before)
        ]
        known = self.known.values(unknowns, relaxation)
        return Point(self, unknowns, records, known, relaxation)

    def best_at(self, unknowns: Floats, relaxation: float = 0.0) -> Point:
        """Evaluate with the affine unknowns at their best for the others.

        The residual is linear in them, so one linear regression finds it. It also takes the
        solver through points where a load loses its factor (I_t - I_p = 0 for the dynamic
        unbalance), which no path of steps in all unknowns could cross.
        """
        affine = self.affine
        if not len(affine):
            return self.at(unknowns, relaxation)
        records = [
            likelihood.evaluate(unknowns, relaxation, affine) for likelihood in self.likelihoods
        ]
        known = self.known.values(unknowns, relaxation)
        slopes = self.known.jacobian(unknowns, relaxation)[:, affine]
        matrix = np.concatenate([*(record.affine_jacobian for record in records), slopes])
        residual = np.concatenate([*(record.residual for record in records), known])
        size = np.sqrt((matrix**2).sum(axis=0))
        if not (np.isfinite(size).all() and np.isfinite(residual).all()):
            raise np.linalg.LinAlgError("a residual beyond all bounds")
        scale = 1 / np.where(size > 0, size, 1.0)
        change = -scale * np.linalg.lstsq(matrix * scale, residual, rcond=1e-10)[0]
        for record in records:
            record.shift(change)
        moved = unknowns.copy()
        moved[affine] += change
        return Point(self, moved, records, known + slopes @ change, relaxation)

    @cached_property
    def affine(self) -> Integers:
        """Unknowns on which the residual depends linearly, and its whitening not at all."""
        layout = self.layout
        loads = layout.load_only()
        held = {int(i) for i in layout.free}
        for relations in (self.exact, self.bounds):
            held -= {int(i) for i in relations.monomials.factors.ravel()}
        linear = [i for i in self.known.relations.linear_in() if i in held]
        added = {int(i) for at in self.likelihoods for i in at.calibration.affine}
        return np.array([i for i in linear if i in loads or i in added], dtype=np.int64)

    @property
    def real_equations(self) -> int:
        """Real equations of all lines, and one per row of what is known with a deviation."""
        lines: float = sum(
            float(likelihood.multiplicity.sum()) * likelihood.equations
            for likelihood in self.likelihoods
        )
        return round(lines) + len(self.known)


@frozen
class Point:
    problem: Problem
    unknowns: Floats
    records: Sequence[Evaluation]
    known: Floats
    relaxation: float = 0.0

    @cached_property
    def cost(self) -> float:
        return sum(record.cost for record in self.records) + float(self.known @ self.known)

    @cached_property
    def residual(self) -> Floats:
        return np.concatenate([*(record.residual for record in self.records), self.known])

    @cached_property
    def jacobian(self) -> Floats:
        free = self.problem.layout.free
        blocks = [record.jacobian()[:, free] for record in self.records]
        known = self.problem.known.jacobian(self.unknowns, self.relaxation)
        return np.concatenate([*blocks, known[:, free]])

    @cached_property
    def linear(self) -> Linearized:
        layout, free = self.problem.layout, self.problem.layout.free
        size = np.abs(self.unknowns[free])
        typical = np.where(size > 0, size, 1.0)
        relations = self.problem.exact.jacobian(self.unknowns)[:, free]
        shifts = np.array([layout.unknowns[i].additive for i in free], dtype=bool)
        return Linearized.of(self.jacobian, self.residual, relations, typical, shifts)

    @cached_property
    def rows(self) -> tuple[slice, ...]:
        """The rows of each record in the residual; those of what is known stand behind them."""
        sizes = [2 * at.problem.lines * at.problem.equations for at in self.records]
        return tuple(slice(*ends) for ends in pairwise(np.cumsum([0, *sizes]).tolist()))

    def by_line(self, rows: NDArray[Number]) -> list[NDArray[Number]]:
        """Return each record's rows of (row, ...), (line, row of a line, ...)."""
        return [
            rows[own].reshape(at.problem.lines, -1, *rows.shape[1:])
            for own, at in zip(self.rows, self.records, strict=True)
        ]

    def of_known(self, rows: Floats) -> Floats:
        """Return the rows of (row, ...) that are of what is known."""
        return rows[len(rows) - len(self.known) :]


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
        left, values, right = np.linalg.svd(self.triangle)
        kept = values > RANK * values.max(initial=0.0)
        return values[kept], right[kept], left.T[kept] @ self.projected

    def _along(self, damping: float) -> Floats:
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


def tangent(point: Point, bounded: bool = False) -> Tangent:
    """Linearize the problem at a point, in the null space of the exact relations."""
    jacobian, free = point.jacobian, point.problem.layout.free
    exact, bounds = point.problem.exact, point.problem.bounds
    if not np.abs(jacobian).max(initial=0.0) < 1e150:
        raise np.linalg.LinAlgError("a derivative beyond all bounds")
    size = np.sqrt((jacobian**2).sum(axis=0))
    typical = np.maximum(np.abs(point.unknowns[free]), 1e-300)
    seen = size > 1e-150
    scale = np.where(seen, 1 / np.where(seen, size, 1.0), typical)
    scaled = jacobian * scale
    basis = None
    if len(exact):
        basis = tangent_basis(exact.jacobian(point.unknowns)[:, free] * scale)
        scaled = scaled @ basis
    width = scaled.shape[1]
    rows = np.zeros((max(len(scaled), width + 1), width + 1))  # perhaps fewer than unknowns
    rows[: len(scaled), :width], rows[: len(scaled), width] = scaled, point.residual
    if not np.isfinite(rows).all():  # LAPACK would print a line of its own
        raise np.linalg.LinAlgError("a residual beyond all bounds")
    triangle = np.asarray(np.linalg.qr(rows, mode="r"))
    normals, distances = np.zeros((0, width)), np.zeros(0)
    if bounded and len(bounds):
        normals = bounds.jacobian(point.unknowns)[:, free] * scale
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
    return np.flatnonzero(bounds.values(unknowns) < -margin * bounds.sizes(unknowns))


def inside(problem: Problem, unknowns: Floats, scale: Floats) -> Floats | None:
    """Return the nearest point that keeps relations and bounds, or None where none is near."""
    held: list[int] = []
    x: Floats | None = unknowns
    for _ in range(len(problem.bounds) + 1):
        relations = problem.exact.joined(problem.bounds.rows[i] for i in held)
        x = retract(unknowns, problem.layout.free, relations, scale) if len(relations) else unknowns
        if x is None:
            return None
        fresh = [int(i) for i in outside(problem.bounds, x) if i not in held]
        if not fresh:
            return None if len(outside(problem.bounds, x, 1e-9)) else x
        held += fresh
    return None
