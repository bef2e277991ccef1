"""All records and all knowledge as one least-squares problem in the unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import zip_longest

import numpy as np

from rotorid.estimators.likelihood.cost import Evaluation, Likelihood
from rotorid.estimators.likelihood.known import Known
from rotorid.estimators.likelihood.relations import Relations
from rotorid.estimators.likelihood.unknowns import Layout
from rotorid.frozen import frozen
from rotorid.record import Floats, Integers


@frozen
class Problem:
    """Minimize the sum of the records' costs and of the squared rows of what is known.

    Parameters
    ----------
    layout : Layout
    likelihoods : sequence of Likelihood
        One per record.
    exact : Relations
        h = 0.
    known : Known
        h of deviation one, and measured modes.
    bounds : Relations
        h >= 0.
    sketch : Problem, optional
        The same with few of the lines, or of the shapes, for the way to the minimum.
    lowest : Lowest, optional
        The minimum of the sketch, where it is known.
    tolerance : float
        Share of the cost left to gain at which the search for the minimum ends.
    """

    layout: Layout
    likelihoods: tuple[Likelihood, ...]
    exact: Relations
    known: Known
    bounds: Relations
    sketch: Problem | None = None
    lowest: Lowest | None = None
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
