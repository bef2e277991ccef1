"""Intervals by the profile of the likelihood, where the cost is no parabola.

The profile of an unknown is the least cost with the unknown held, the others following (Venzon and
Moolgavkar 1988). Two deviations to either side it is asked to second order, which costs one
residual: with r the residual, U its range and u the direction in it of the unknown, of length one,
a step of t deviations along a straight line gives ``r + t U u + q``. The others take over what of q
lies in U, save along u; q is the same on both sides. Where that is no parabola, minima are sought.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from functools import cache

import numpy as np
import scipy

from rotorid.answer.estimate import Estimate
from rotorid.answer.parts import Interval
from rotorid.core.distributions import HALF_WIDTH
from rotorid.core.values import Floats
from rotorid.core.watch import watch
from rotorid.likelihood.fit import Fit
from rotorid.likelihood.problem import Point, outside
from rotorid.likelihood.relations import Relation
from rotorid.likelihood.solver import evaluated, settle

ASKED = 2.0  # deviations to either side at which the cost's rise is held against that of a parabola
PARABOLA = 0.25  # share by which it may differ from that: ends of the interval are off by an eighth
NEARLY = 0.1  # the same to second order: what that lacks is seldom more than as much again
REACH = 1000.0  # deviations from which on an interval has no end: so far off nothing is said


def profiled(estimate: Estimate, fit: Fit) -> Estimate:
    """Return an accepted answer with the intervals of parameters whose deviations do not hold.

    Bounds count for nothing here, as in deviations; beside an active one neither tells much.
    """
    layout, found, point = fit.layout, dict[str, Interval](), fit.solution.point
    few = _on_few_lines(point)
    of = {value.name: value for value in estimate.parameters if not fit.solution.active}
    for k, name in enumerate(layout.names(layout.free < layout.named)):
        watch("looking at the profiles of the parameters", k, layout.named)
        if name not in of or not (std := of[name].std_inflated):
            continue
        # What widened deviations in a bent valley is just what is asked here.
        bend = 1.0 if fit.shared else float(fit.inference.bend[k])
        told = float(np.linalg.norm(point.linear.root[k]))
        held = _Held(point, k, std / bend / told)
        with suppress(np.linalg.LinAlgError):
            if few is not None and _Held(few, k, held.wider).straight:
                continue
            if held.bent:
                low, high = (of[name].value + held.std * end for end in held.ends())
                found[name] = low, high
    kinds = {
        kind: tuple(replace(v, interval=found.get(v.name)) for v in getattr(estimate, kind))
        for kind in ("parameters", "derived")
    }
    return estimate.with_(**kinds) if found else estimate


def _on_few_lines(point: Point) -> Point | None:
    """Return the minimum on the few lines that led to one on thousands.

    Deviations are wider there: what is straight that far is straight on all lines.
    """
    if point.problem.sketch is None:
        return None
    with suppress(np.linalg.LinAlgError):
        few = settle(point.problem.sketch, point.unknowns)
        if few.converged and few.point.linear.rank == point.linear.rank:
            return few.point
    return None


class _Held:
    """One unknown held some of its deviations away; rises are in squares of them.

    `wider`: by how much these are wider than the information tells, by few periods and the like.
    """

    def __init__(self, point: Point, k: int, wider: float) -> None:
        self.point, self.wider, free = point, wider, point.problem.layout.free
        self.i, root = int(free[k]), point.linear.root[k]
        size = float(np.linalg.norm(root))
        self.unit, self.std = root / size, wider * size
        # a deviation of it: alone, and with the others following along a straight line
        self.steps = np.zeros((2, len(point.unknowns)))
        self.steps[0, self.i] = self.std
        self.steps[1, free] = self.wider * (point.linear.root @ self.unit)
        # where the unknown is held, or nearly so: the ways from there are short
        self.near = [point.unknowns + ASKED * side * self.steps[1] for side in (0, 1, -1)]
        self.rise = cache(self._rise)

    @property
    def straight(self) -> bool:
        return bool((np.abs(self._to_second_order() / ASKED**2 - 1) <= NEARLY).all())

    @property
    def bent(self) -> bool:
        sides = () if self.straight else (1, -1)
        return any(abs(self.rise(s * ASKED) / ASKED**2 - 1) > PARABOLA for s in sides)

    def _to_second_order(self) -> Floats:
        point, told = self.point, self.point.linear.range
        if point.problem.exact.holds(2):  # no straight line keeps to that
            return np.array([np.inf])
        with np.errstate(all="ignore"):
            there = point.problem.at(self.near[1])
            turned = [a.residual_like(b) for a, b in zip(there.records, point.records, strict=True)]
        straight = ASKED * self.wider * (told @ self.unit)
        missed = np.concatenate([*turned, there.known]) - point.residual - straight
        taken = told.T @ missed
        missed -= told @ (taken - self.unit * (self.unit @ taken))
        both = point.residual + missed + np.outer([1, -1], straight)
        return np.asarray(((both**2).sum(axis=1) - point.cost) / self.wider**2)

    def _rise(self, away: float) -> float:
        point, value = self.point, self.point.unknowns[self.i] + away * self.std
        held = Relation({(self.i,): 1.0, (): -value}, "held")
        problem = replace(
            point.problem,
            exact=point.problem.exact.joined([held]),
            bounds=point.problem.bounds.where(lambda _: False),
            sketch=None,
            lowest=None,
            tolerance=0.02 * self.wider**2 / max(point.cost, 1.0),
        )
        near = min(self.near, key=lambda x: abs(x[self.i] - value))
        # Alone it leaves a narrow valley; the straight line leaves one that is bent.
        ways = near + (value - near[self.i]) / self.std * self.steps
        costs = [math.inf if (at := evaluated(problem, x)) is None else at.cost for x in ways]
        found = settle(problem, ways[np.argmin(costs)]).point
        self.near.append(found.unknowns)
        return (found.cost - point.cost) / self.wider**2

    def ends(self) -> Interval:
        """Return the ends of the 95 % interval in deviations, infinite where the cost stays low.

        A ratio whose denominator may be zero has values beyond infinity: where the cost is as low
        on that side, and no bound forbids it, neither end tells anything.
        """
        low, high = -self._end(-1), self._end(1)
        beyond, there = REACH * (math.isinf(low) - math.isinf(high)), self.point.unknowns.copy()
        there[self.i] += beyond * self.std
        told = not beyond or len(outside(self.point.problem.bounds, there))
        open_ = not told and self.rise(beyond) < HALF_WIDTH**2
        return (-math.inf, math.inf) if open_ else (low, high)

    def _end(self, side: int) -> float:
        inner, outer = 0.0, ASKED

        def beyond(away: float) -> float:  # nearly linear
            return math.sqrt(max(self.rise(side * away), 0.0)) - HALF_WIDTH

        while beyond(outer) < 0:
            if outer >= REACH:
                return math.inf
            inner, outer = outer, min(4 * outer, REACH)
        return float(scipy.optimize.brentq(beyond, inner, outer, xtol=0.01))
