"""All records and all knowledge as one least-squares problem in the unknowns.

`Point` is the problem evaluated, `Tangent` what the solver makes of a point: steps along exact
relations and within bounds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import field, replace
from functools import cache, cached_property
from itertools import pairwise, zip_longest
from typing import TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from rotorid.core.linalg import column_lengths, triangle
from rotorid.core.values import Floats, Integers, frozen
from rotorid.data.observation import Records
from rotorid.likelihood.assembly import assemble
from rotorid.likelihood.cost import Evaluation, Likelihood
from rotorid.likelihood.layout import Layout
from rotorid.likelihood.linear import RANK, Linearized, tangent_basis
from rotorid.likelihood.mode_rows import ModalRows
from rotorid.likelihood.relations import Relation, Relations

Number = TypeVar("Number", np.float64, np.int64)
NOTHING = 1e-9  # deviations by which an unknown that is zero but for rounding moves all residuals
KEPT = 20_000  # rows of all points that a problem keeps: a dozen megabytes
OUTSIDE = 1e-12  # what a bound may be violated by, relative to the size of its terms: rounding


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
        measured = self.modes.values(unknowns, relaxation)
        return np.concatenate([self.relations.values(unknowns), measured])

    def jacobian(self, unknowns: Floats, relaxation: float = 0.0) -> Floats:
        measured = self.modes.jacobian(unknowns, relaxation)
        return np.concatenate([self.relations.jacobian(unknowns), measured])

    def joined(self, rows: Iterable[Relation]) -> Known:
        return replace(self, relations=self.relations.joined(rows))

    def without(self, text: str) -> Known:
        kept = self.relations.where(lambda row: row.stated != text)
        return Known(kept, self.modes.of_mode(text, others=True))


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
    effort: int = 1  # times as many starts, and refits of mistakes, as are enough nearly always

    def of(self, records: Records, alike: Sequence[Likelihood] = ()) -> Problem:
        """Return the problem of some records; `alike`: likelihoods of the same ones."""
        pairs = enumerate(zip_longest(records, alike))
        likelihoods = tuple(assemble(self.layout, of, k, like) for k, (of, like) in pairs)
        kept = self.layout, self.exact, self.known, self.bounds
        return Problem(*kept, likelihoods, self.substituted, effort=self.effort)

    def at(
        self,
        unknowns: Floats,
        relaxation: float = 0.0,
        like: Point | None = None,
        affine: Integers | None = None,
    ) -> Point:
        """Evaluate at all unknowns, shape (unknown,); `like`: where the same rotor was, perhaps."""
        before = [] if like is None else like.records
        pairs = zip_longest(self.likelihoods, before)
        records = [Evaluation(each, unknowns, relaxation, affine, at) for each, at in pairs]
        known = self.known.values(unknowns, relaxation)
        return Point(self, unknowns, records, known, relaxation)

    def best_at(self, unknowns: Floats, relaxation: float = 0.0) -> Point:
        """Evaluate with the affine unknowns at their best for the others, by linear regression.

        It takes the solver through points where a load loses its factor, as where I_t = I_p, which
        no path of steps in all unknowns could cross. Ways from one start that differ in what they
        may do at bounds come by the same points: the last ones are kept.
        """
        at = unknowns.tobytes(), relaxation
        if (point := self._visited.get(at)) is None:
            point = self._visited[at] = self._best_at(unknowns, relaxation)
            if len(self._visited) > KEPT // len(point.residual):
                self._visited.pop(next(iter(self._visited)), None)
        return point

    @cached_property
    def _visited(self) -> dict[tuple[bytes, float], Point]:
        return {}

    def _best_at(self, unknowns: Floats, relaxation: float) -> Point:
        affine = self.affine
        at = self.at(unknowns, relaxation, affine=affine)
        if not len(affine):
            return at
        slopes = self.known.jacobian(unknowns, relaxation)[:, affine]
        matrix = np.concatenate([*(record.affine_jacobian for record in at.records), slopes])
        residual = at.residual
        size = np.sqrt((matrix**2).sum(axis=0))
        if not (np.isfinite(size).all() and np.isfinite(residual).all()):
            raise np.linalg.LinAlgError("a residual beyond all bounds")
        scale = 1 / np.where(size > 0, size, 1.0)
        change = -scale * np.linalg.lstsq(matrix * scale, residual, rcond=1e-10)[0]
        for record in at.records:
            record.shift(change)
        moved = unknowns.copy()
        moved[affine] += change
        return Point(self, moved, at.records, at.known + slopes @ change, relaxation)

    @cached_property
    def affine(self) -> Integers:
        """Unknowns on which the residual depends linearly, and its whitening not at all."""
        loads = self.layout.load_only()
        added = {int(i) for at in self.likelihoods for i in at.calibration.affine}
        entangled = self.known.relations.holds(2) | self.exact.holds() | self.bounds.holds()
        free = {int(i) for i in self.layout.free}
        return np.array(sorted((loads | added) & free - entangled), dtype=np.int64)

    @cached_property
    def rigid(self) -> Integers:
        return np.setdiff1d(self.layout.free, self.affine)

    @cached_property
    def holding(self) -> Callable[[tuple[int, ...]], Relations]:
        """The exact relations, and bounds that hold with equality: many points ask for the same."""
        return cache(lambda held: self.exact.joined(self.bounds.rows[i] for i in held))

    @property
    def real_equations(self) -> int:
        """Real equations of all lines, and one per row of what is known with a deviation."""
        lines = sum(float(at.multiplicity.sum()) * at.equations for at in self.likelihoods)
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
    def columns(self) -> Floats:
        """The derivative of the residual by all unknowns, fixed ones included."""
        known = self.problem.known.jacobian(self.unknowns, self.relaxation)
        return np.concatenate([*(record.jacobian() for record in self.records), known])

    @cached_property
    def jacobian(self) -> Floats:
        return np.ascontiguousarray(self.columns[:, self.problem.layout.free])

    def by(self, *names: str) -> Floats:
        return self.columns[:, self.problem.layout.where(*names)]

    def slack(self, text: str) -> Floats:
        """Return the columns that take what is known of something out of the residual."""
        texts, count = self.problem.known.texts, len(self.residual)
        rows = np.flatnonzero([each == text for each in texts]) + count - len(texts)
        return np.asarray(np.arange(count)[:, None] == rows, dtype=float)

    @cached_property
    def sizes(self) -> Floats:
        """The size of each unknown: that of its start, where what is left of it moves nothing.

        A step to a bound of zero leaves rounding there, whose size says nothing of the unknown.
        """
        free, sizes = self.problem.layout.free, np.abs(self.unknowns)
        effect = sizes[free] * np.linalg.norm(self.jacobian, axis=0)
        nothing = free[effect <= NOTHING]
        sizes[nothing] = np.abs(self.problem.layout.start[nothing])
        return sizes

    @cached_property
    def linear(self) -> Linearized:
        layout, free = self.problem.layout, self.problem.layout.free
        size = self.sizes[free]
        typical = np.where(size > 0, size, 1.0)
        relations = self.problem.exact.jacobian(self.unknowns)[:, free]
        shifts = layout.additive[free]
        return Linearized.of(self.jacobian, self.residual, relations, typical, shifts)

    @cached_property
    def by_triangle(self) -> Linearized:
        """The problem made linear for steps: its rows are a triangle, which tells them as well.

        Every column counts here, for none is rounding on the way to the minimum.
        """
        free = self.problem.layout.free
        rows = np.column_stack([self.jacobian, self.residual])
        if not np.abs(rows).max(initial=0.0) < 1e150:  # LAPACK would print a line of its own
            raise np.linalg.LinAlgError("a residual or its derivative beyond all bounds")
        rows = triangle(rows)
        typical = np.maximum(np.abs(self.unknowns[free]), 1e-300)
        relations = self.problem.exact.jacobian(self.unknowns)[:, free]
        moving = np.abs(rows[:, :-1]).max(axis=0, initial=0.0) > 1e-150
        return Linearized.of(rows[:, :-1], rows[:, -1], relations, typical, moving)

    @cached_property
    def rows(self) -> tuple[slice, ...]:
        """The rows of each record in the residual; those of what is known stand behind them."""
        sizes = [2 * at.problem.lines * at.problem.equations for at in self.records]
        return tuple(slice(*ends) for ends in pairwise(np.cumsum([0, *sizes]).tolist()))

    def by_line(self, rows: NDArray[Number]) -> list[NDArray[Number]]:
        """Return each record's rows of (row, ...), (line, row of a line, ...)."""
        pairs = zip(self.rows, self.records, strict=True)
        return [rows[own].reshape(at.problem.lines, -1, *rows.shape[1:]) for own, at in pairs]

    def of_known(self, rows: Floats) -> Floats:
        return rows[len(rows) - len(self.known) :]


@frozen
class Tangent:
    """Steps from a point: along the directions in which the exact relations do not change."""

    linear: Linearized
    # (bound, direction) and (bound,): ``normals @ step >= -distances`` keeps the bounds; empty
    # where none is looked at
    normals: Floats
    distances: Floats

    @cached_property
    def projected(self) -> Floats:
        """The residual along the directions, shape (direction,)."""
        return np.asarray(self.linear.residual @ self.linear.left)

    @cached_property
    def _told(self) -> tuple[Floats, Floats]:
        """Singular values, and the residual, along the directions that are determined."""
        told = slice(self.linear.rank)
        return self.linear.values[told], self.projected[told]

    def _along(self, damping: float) -> Floats:
        (values, projected), along = self._told, np.zeros(len(self.projected))
        along[: len(values)] = -(values / (values**2 + damping) * projected)
        return along

    def _damping(self, radius: float) -> float:
        """Return the damping with which a step is as long as the radius, to a tenth."""
        values, projected = self._told
        low, high = 0.0, _length(values * projected) / radius
        damping = 1e-3 * high
        for _ in range(40):
            length = _length(values / (values**2 + damping) * projected)
            if abs(length - radius) <= 0.1 * radius:
                break
            low, high = (damping, high) if length > radius else (low, damping)
            damping = np.sqrt(low * high) if low > 0 else 0.01 * high
        return float(damping)

    @cached_property
    def whole(self) -> Floats | None:
        """The Gauss-Newton step."""
        return self._bounded(np.inf)

    def step(self, radius: float) -> Floats | None:
        """Return the best step no longer than a radius that keeps the bounds, if there is one."""
        return self.whole if radius == np.inf else self._bounded(radius)

    def _bounded(self, radius: float) -> Floats | None:
        damping, along = 0.0, self._along(0.0)
        if not _length(along) <= radius:
            damping = self._damping(radius)
            along = self._along(damping)
        if not len(self.normals) or (self.normals @ along >= -self.distances).all():
            return along
        return self._within(damping)

    def _within(self, damping: float) -> Floats | None:
        """Return the damped step within the bounds (Lawson and Hanson, chapter 23)."""
        values = self.linear.values
        root = np.sqrt(values**2 + max(damping, RANK * values.max(initial=0.0) ** 2))
        free, sides = -values / root * self.projected, self.normals / root
        gap = -self.distances - sides @ free
        # A bound that holds with equality, and that no step moves, is a column of zeros.
        rows = np.vstack([sides.T, gap])
        rows = rows / column_lengths(rows)
        target = np.append(np.zeros(len(root)), 1.0)
        if not np.isfinite(rows).all():
            return None
        try:
            weights, left = scipy.optimize.nnls(rows, target)
        except RuntimeError:
            return None
        distance = rows @ weights - target
        if left < 1e-12 or not distance[-1] < 0:  # the bounds contradict one another
            return None
        along = (free - distance[:-1] / distance[-1]) / root
        return along if np.isfinite(along).all() else None

    def across(self, change: Floats) -> Floats:
        """Return the Gauss-Newton step square to a change of the free unknowns."""
        with np.errstate(over="ignore", invalid="ignore"):
            direction = self.linear.directions.T @ (change / self.linear.scale)
        rest = tangent_basis(direction[None])
        moved = self.linear.values[:, None] * rest
        return np.asarray(rest @ np.linalg.lstsq(moved, -self.projected, RANK)[0])

    def spread(self, along: Floats) -> Floats:
        return np.asarray(self.linear.scale * (self.linear.directions @ along))

    @cached_property
    def decrease(self) -> float:
        """The drop of the cost that a full Gauss-Newton step would bring."""
        return 0.0 if self.whole is None else self.promised(self.whole)

    def promised(self, along: Floats) -> float:
        """Return the drop of the cost that a step would bring, were the residual linear."""
        values, reached = self._told
        left = values * along[: len(values)] + reached
        return float(reached @ reached - left @ left)


def _length(vector: Floats) -> float:
    return math.sqrt(vector @ vector)


def tangent(point: Point, bounded: bool = False) -> Tangent:
    """Return the steps from a point, with the bounds where they are to be kept."""
    problem, free, linear = point.problem, point.problem.layout.free, point.by_triangle
    normals, distances = np.zeros((0, len(linear.values))), np.zeros(0)
    if bounded and len(problem.bounds):
        normals = problem.bounds.jacobian(point.unknowns)[:, free] * linear.scale
        normals = normals @ linear.directions
        length = np.sqrt((normals**2).sum(axis=1))
        moved = length > 0
        normals = normals[moved] / length[moved, None]
        distances = problem.bounds.values(point.unknowns)[moved].clip(0) / length[moved]
    return Tangent(linear, normals, distances)


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
    held: tuple[int, ...] = ()
    x: Floats | None = unknowns
    for _ in range(len(problem.bounds) + 1):
        relations = problem.holding(held)
        x = retract(unknowns, problem.layout.free, relations, scale) if len(relations) else unknowns
        if x is None:
            return None
        if not (fresh := [i for i in outside(problem.bounds, x).tolist() if i not in held]):
            return None if len(outside(problem.bounds, x, 1e-9)) else x
        held = (*held, *fresh)
    return None
