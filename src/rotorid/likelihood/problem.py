"""All records and all knowledge as one least-squares problem in the unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise, zip_longest
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rotorid.core.frozen import frozen
from rotorid.core.values import Floats, Integers
from rotorid.likelihood.cost import Evaluation, Likelihood
from rotorid.likelihood.known import Known
from rotorid.likelihood.layout import Layout
from rotorid.likelihood.linear import Linear
from rotorid.likelihood.relations import Relations

Number = TypeVar("Number", np.float64, np.int64)


@frozen
class Problem:
    """Minimize the sum of the records' costs and of the squared rows of what is known."""

    layout: Layout
    likelihoods: tuple[Likelihood, ...]  # one per record
    exact: Relations  # h = 0
    known: Known  # h of deviation one, and measured modes
    bounds: Relations  # h >= 0
    # the same with few of the lines, or of the shapes, for the way to the minimum
    sketch: Problem | None = None
    lowest: Lowest | None = None  # the minimum of the sketch, where it is known
    # share of the cost left to gain at which the search for the minimum ends
    tolerance: float = 1e-10

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
        linear = [i for i in self.known.linear_in() if i in held]
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
class Lowest:
    """The minimum of a problem: all unknowns, and what they cost."""

    unknowns: Floats
    cost: float


@frozen
class Point:
    """The problem at one point."""

    problem: Problem
    unknowns: Floats
    records: Sequence[Evaluation]
    known: Floats
    relaxation: float = 0.0

    @cached_property
    def cost(self) -> float:
        """J: the squared length of `residual`."""
        return sum(record.cost for record in self.records) + float(self.known @ self.known)

    @cached_property
    def residual(self) -> Floats:
        """Whitened residual of the records in order, then of what is known."""
        return np.concatenate([*(record.residual for record in self.records), self.known])

    @cached_property
    def jacobian(self) -> Floats:
        """Derivative of `residual` by the unknowns that are not fixed."""
        free = self.problem.layout.free
        blocks = [record.jacobian()[:, free] for record in self.records]
        known = self.problem.known.jacobian(self.unknowns, self.relaxation)
        return np.concatenate([*blocks, known[:, free]])

    @cached_property
    def linear(self) -> Linear:
        """The problem made linear here, in the unknowns that are not fixed."""
        layout, free = self.problem.layout, self.problem.layout.free
        size = np.abs(self.unknowns[free])
        typical = np.where(size > 0, size, 1.0)
        relations = self.problem.exact.jacobian(self.unknowns)[:, free]
        shifts = np.array([layout.unknowns[i].additive for i in free], dtype=bool)
        return Linear.of(self.jacobian, self.residual, relations, typical, shifts)

    @cached_property
    def rows(self) -> tuple[slice, ...]:
        """The rows of each record in the residual; those of what is known stand behind them."""
        sizes = [2 * at.problem.lines * at.problem.equations for at in self.records]
        return tuple(slice(*ends) for ends in pairwise(np.cumsum([0, *sizes]).tolist()))

    def by_line(self, rows: NDArray[Number]) -> list[NDArray[Number]]:
        """Return of something by rows, (row, ...), each record's, (line, row of a line, ...)."""
        return [
            rows[own].reshape(at.problem.lines, -1, *rows.shape[1:])
            for own, at in zip(self.rows, self.records, strict=True)
        ]

    def of_known(self, rows: Floats) -> Floats:
        """Return of something by rows, (row, ...), those of what is known."""
        return rows[len(rows) - len(self.known) :]
