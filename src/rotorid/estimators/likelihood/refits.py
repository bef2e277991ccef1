"""Minimizing again: with other lines, with further unknowns, or with what was fixed set free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import zip_longest

import numpy as np

from rotorid.estimators.likelihood.assembly import assemble
from rotorid.estimators.likelihood.noise import Noise
from rotorid.estimators.likelihood.nuisances import Nuisance
from rotorid.estimators.likelihood.polynomial import Monomials
from rotorid.estimators.likelihood.preparation import Prepared, generic
from rotorid.estimators.likelihood.problem import Point, Problem
from rotorid.estimators.likelihood.relations import Relations
from rotorid.estimators.likelihood.solver import STAGES, anchored, evaluated, solve
from rotorid.estimators.likelihood.tangent import inside, outside, retract, tangent
from rotorid.frozen import frozen
from rotorid.observation import Observation
from rotorid.record import Floats

COARSE = (10.0, 1.0)
"""Stages of a screening: errors as large as the mean force are granted to the end, with which a
few steps suffice. What is right still stands out: noise is a thousandth of the forces, a mistake is
as large as they are."""


STEPS = 6
"""Steps of a screening at each stage. What is right needs three or four, and the few per cent that
would be left to gain after six decide nothing."""
SHORTER = (1.0, 0.3, 0.1)
"""Shares of a step that are tried while screening."""


@frozen
class Case:
    """What was estimated: unknowns and relations, records, the minimum."""

    prepared: Prepared
    records: tuple[Observation, ...]
    point: Point

    def with_unknowns(self, nuisances: Sequence[Nuisance]) -> Case:
        """Return the case with further nuisances, at their starts; `point` is evaluated again."""
        prepared = extended(self.prepared, nuisances)
        starts = [u.start for n in nuisances for u in n.unknowns]
        unknowns = np.concatenate([self.point.unknowns, starts])
        noises = [likelihood.noise for likelihood in self.point.problem.likelihoods]
        problem = assembled(prepared, self.records, noises)
        return Case(prepared, self.records, problem.at(unknowns, like=self.point))

    def freed(self, name: str) -> Case:
        """Return the case with a known value, or a measured mode, set free."""
        layout, known = self.prepared.layout, self.prepared.known
        unknowns = tuple(replace(u, std=None) if u.name == name else u for u in layout.unknowns)
        prepared = replace(
            self.prepared, layout=replace(layout, unknowns=unknowns), known=known.without(name)
        )
        problem = assembled(prepared, self.records)
        return Case(prepared, self.records, problem.at(self.point.unknowns))

    def near(self) -> Point | None:
        """Minimize from the present estimate."""
        return minimized(self.prepared, self.records, self.point.unknowns, (0.0,))

    def far(self) -> Point | None:
        """Minimize from the starts, by the homotopy."""
        ends = [minimized(self.prepared, self.records, x, STAGES) for x in starts(self.prepared)]
        return min((p for p in ends if p is not None), key=lambda p: p.cost, default=None)


def starts(prepared: Prepared) -> list[Floats]:
    """Return the start, and the nominal values where it is not made of them.

    A start that comes from the records is as wrong as they are.
    """
    layout, found = prepared.layout, [prepared.layout.start]
    nominal = layout.start.copy()
    for name, value in ({} if layout.base else layout.model.nominal).items():
        unknown = layout.unknowns[layout.index[name]]
        if not unknown.fixed and unknown.start != 0:
            nominal[layout.index[name]] = value
    if not np.allclose(nominal, layout.start, rtol=1e-3, atol=0.0):
        found.append(nominal)
    return found


def extended(prepared: Prepared, nuisances: Sequence[Nuisance]) -> Prepared:
    """Return what is prepared with further nuisances behind the others."""
    layout = prepared.layout
    added = tuple(u for n in nuisances for u in n.unknowns)
    wider = replace(
        layout,
        unknowns=(*layout.unknowns, *added),
        nuisances=(*layout.nuisances, *nuisances),
    )
    exact, relations, bounds = (
        _widened(r, len(added)) for r in (prepared.exact, prepared.known.relations, prepared.bounds)
    )
    known = prepared.known.within(wider, relations, generic(wider, exact))
    return replace(prepared, layout=wider, exact=exact, known=known, bounds=bounds)


def _widened(relations: Relations, added: int) -> Relations:
    """Return relations over more unknowns."""
    old = relations.monomials
    count = old.unknowns + added
    factors = np.where(old.factors == old.unknowns, count, old.factors)
    return replace(relations, monomials=Monomials(factors, count))


def assembled(
    prepared: Prepared, records: Sequence[Observation], noises: Sequence[Noise] = ()
) -> Problem:
    """Return the problem of some records, whose noise may have been factored before."""
    likelihoods = tuple(
        assemble(prepared.layout, record, number, noise)
        for number, (record, noise) in enumerate(zip_longest(records, noises))
    )
    return Problem(prepared.layout, likelihoods, prepared.exact, prepared.known, prepared.bounds)


def minimized(
    prepared: Prepared, records: Sequence[Observation], start: Floats, stages: Sequence[float]
) -> Point | None:
    """Return the minimum, or None where the way leads nowhere.

    What leaves a misfit beyond all hope explains nothing: how much exactly is not found out.
    """
    try:
        with np.errstate(all="ignore"):
            point = solve(assembled(prepared, records), start, stages, brief=True).point
    except np.linalg.LinAlgError:
        return None
    return point if np.isfinite(point.cost) else None


def screened(prepared: Prepared, records: Sequence[Observation]) -> float:
    """Return the cost after a few steps from the starts, errors granted to the equations."""
    try:
        with np.errstate(all="ignore"):
            problem = assembled(prepared, records)
            return min(_approached(anchored(problem, x), x) for x in starts(prepared))
    except np.linalg.LinAlgError:
        return np.inf


def _approached(problem: Problem, start: Floats) -> float:
    """Return the cost after a few steps at each stage of a screening, at the bounds if beyond.

    All forces upside down are a rotor of negative mass: only its bounds tell it from the right one.
    """
    x, cost = start, np.inf
    for relaxation in COARSE:
        point = evaluated(problem, x, relaxation)
        for _ in range(STEPS):
            further = None if point is None else _step(problem, point, relaxation)
            if further is None:
                break
            point = further
        if point is None:
            return np.inf
        x, cost = point.unknowns, point.cost
    return cost if not len(outside(problem.bounds, x)) else _cost_inside(problem, x)


def _cost_inside(problem: Problem, unknowns: Floats) -> float:
    """Return the cost of a screening at the nearest point that keeps the bounds."""
    size = np.abs(unknowns[problem.layout.free])
    within = inside(problem, unknowns, np.where(size > 0, size, 1.0))
    held = None if within is None else evaluated(problem, within, COARSE[-1])
    return np.inf if held is None else held.cost


def _step(problem: Problem, point: Point, relaxation: float) -> Point | None:
    """Return a point a Gauss-Newton step on, or None where little is left to gain."""
    where, free = tangent(point, problem.exact), problem.layout.free
    if where.decrease <= 1e-2 * point.cost:
        return None
    along = where.step()
    if along is None:
        return None
    for share in SHORTER:
        aimed = point.unknowns.copy()
        aimed[free] += share * where.spread(along)
        target = retract(aimed, free, problem.exact, where.scale) if len(problem.exact) else aimed
        trial = None if target is None else evaluated(problem, target, relaxation)
        if trial is not None and trial.cost < point.cost:
            return trial
    return None
