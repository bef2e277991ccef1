"""Levenberg-Marquardt on the whitened residual, led by a homotopy.

Errors granted to every equation of motion smooth local minima away, fewer from stage to stage
(docs/maximum-likelihood.md, section 1).

Where the records inform some combination of the unknowns only weakly, the minimum lies at the end
of a narrow, bent valley. Straight steps along it leave its floor, and ever shorter ones hardly
get on. So a step that does not lower the cost is given a few Gauss-Newton steps square to itself,
which lead back to the floor, before it is judged: steps a thousand times as long succeed.

Exact relations are eliminated: steps are taken in the null space of their derivative, and Newton
steps lead back to them. Bounds wait until the end, since the way to the minimum may well lead
through a negative mass. Where the minimum violates one, the way is gone again inside: each step
solves the linear least-squares problem with the linearized bounds as inequalities.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property

import numpy as np

from rotorid.core.values import Floats, frozen
from rotorid.core.watch import watch
from rotorid.likelihood.inference import Inference, infer
from rotorid.likelihood.problem import Point, Problem, Tangent, inside, outside, retract, tangent
from rotorid.likelihood.relations import Relation

STAGES = (10.0, 1.0, 0.1, 0.01, 0.0)  # the homotopy: sigma of each, in units of the mean force
LIMIT = 200  # steps of the last stage; the bent valleys of weakly excited rotors take up to 40
EFFORT = 1000  # Jacobians of one way; the longest of the bank that arrived took 500
BRIEF = 60  # Jacobians of the last stage of a start that only checks an answer, and of a suspect
PROMISE = 1e-3  # share of the cost below which a shortened step of a screening promises too little
HOPELESS = 10.0  # cost per residual from which on a way, brief or on all lines, is not gone further
JOINED = 0.01  # ways whose stages end no further apart, relative to each unknown, have joined
BENDS = 4  # Gauss-Newton steps that may lead a step back to the floor of its valley
ARRIVED = 1e-3
"""Gain of the cost, hidden from steps by rounding, that leaves every value within a thirtieth of
its deviation from the minimum."""
RUN_AWAY = 1e10
"""Times its start from which on an unknown is on its way to infinity. Beside it all others keep
six digits at most: soon the cost is rounding, which steps of no length lower."""
HELD = 1e-9  # distance from a bound, relative to the size of its terms, at which it is active


@frozen
class Solution:
    point: Point
    converged: bool
    iterations: int  # evaluations of the Jacobian, over all stages
    active: tuple[int, ...] = ()  # bounds that hold with equality
    # sequence of array: unknowns at the end of each stage before the last
    trail: tuple[Floats, ...] = ()

    @cached_property
    def inference(self) -> Inference:
        return infer(self.point)


class Interrupted(KeyboardInterrupt):
    """An interrupt on a way, with the unknowns where it has led."""

    def __init__(self, unknowns: Floats) -> None:
        super().__init__()
        self.unknowns = unknowns


class _Walk:
    """A way from the nearest point that keeps the relations, on few lines where there are some."""

    def __init__(
        self, problem: Problem, start: Floats, bounded: bool, *, brief: bool = False
    ) -> None:
        size = np.abs(start[problem.layout.free])
        scale = np.maximum(size, 1e-12 * size.max(initial=0.0))
        x = _kept(problem, start, np.where(scale > 0, scale, 1.0), bounded)
        if x is None and bounded:
            raise np.linalg.LinAlgError("no point near keeps the bounds")
        self.problem, self.bounded = anchored(problem.sketch or problem, start), bounded
        self.unknowns = start if x is None else x
        self.iterations, self.trials, self.effort = 0, 0, EFFORT
        # what a start at a bound of zero has lost, it may find again
        sizes = np.maximum(np.abs(start), np.abs(problem.layout.start))
        sized = ~problem.layout.additive & (sizes > 0)
        self.rigid = problem.rigid[sized[problem.rigid]]
        self.reach = RUN_AWAY * sizes[self.rigid] if brief else np.inf

    @property
    def lost(self) -> bool:
        return bool((np.abs(self.unknowns[self.rigid]) > self.reach).any())

    def descend(
        self,
        relaxation: float,
        tolerance: float = 1e-2,
        limit: int = 30,
        known: Floats | None = None,
        promise: float = 0.0,
    ) -> tuple[Point, bool]:
        """Go down one stage, no further than to a known point: where to, and if to the minimum."""
        point, radius = self.problem.best_at(self.unknowns, relaxation), np.inf
        floor = 1e-14 if relaxation > 0 else 1.0
        for _ in range(limit):
            if known is not None and _same(self.problem, point.unknowns, known):
                return point, True
            self.iterations += 1
            where = tangent(point, self.bounded)
            if where.decrease <= tolerance * max(point.cost, floor):
                return point, True
            trial, radius = self._forward(point, where, radius, promise * point.cost)
            if trial is None:
                # No step helps: rounding, if what was left to gain is next to nothing.
                least = 0.0 if relaxation > 0 else ARRIVED
                return point, where.decrease <= max(least, 1e-6 * max(point.cost, floor))
            point = trial
            self.unknowns = point.unknowns
            if relaxation > 0 and self.lost:
                break
        return point, False

    def _forward(
        self, point: Point, where: Tangent, radius: float, worth: float
    ) -> tuple[Point | None, float]:
        """Return a point with a lower cost, and the radius to try next."""
        for attempt in range(25):
            along = where.step(radius)
            if along is None or self.iterations > self.effort:
                return None, radius
            length = math.sqrt(along @ along)
            if length == 0 or (attempt and where.promised(along) < worth):
                return None, radius  # the bounds leave no way, or shorter steps gain nothing
            self.trials += 1
            watch("", self.trials)
            trial = _stepped(point, where, along, self.bounded)
            for _ in range(BENDS):
                if trial is None or trial.cost < point.cost:
                    break
                self.iterations += 1
                moved = _across(trial, point, self.bounded)
                leads_down = moved is not None and moved.cost < max(point.cost, 0.5 * trial.cost)
                trial = moved if leads_down else None
            if trial is not None and trial.cost < point.cost:
                return trial, 4 * length if attempt == 0 else length
            radius = length / 4
        return None, radius

    def ended(
        self, problem: Problem, relaxation: float, brief: bool, near: bool
    ) -> tuple[Point, bool] | None:
        self._hurry(brief)
        converged = None if near else self._astray(problem, relaxation)
        self.problem = problem
        self._hurry(brief)
        try:
            if converged is None:
                point, converged = self.descend(relaxation, problem.tolerance, LIMIT)
                if brief and not converged and not hopeless(point):
                    self.effort = EFFORT  # a bent valley, not another mountain
                    point, converged = self.descend(relaxation, problem.tolerance, LIMIT)
                return point, converged
        except np.linalg.LinAlgError:
            converged = False
        last = evaluated(problem, self.unknowns, relaxation)
        return None if last is None else (last, converged)

    def _hurry(self, brief: bool) -> None:
        if brief:
            self.effort = self.iterations + BRIEF

    def _astray(self, problem: Problem, relaxation: float) -> bool | None:
        """Tell whether the sketch converges at a hopeless cost; None: all lines are to be asked."""
        if problem.sketch is None:
            return None
        self.problem = problem.sketch
        with suppress(np.linalg.LinAlgError):
            point, converged = self.descend(relaxation)
            if hopeless(point, problem.lowest):
                point, converged = self.descend(relaxation, 1e-10, LIMIT)
                return converged if hopeless(point, problem.lowest) else None
        return None


def _stepped(point: Point, where: Tangent, along: Floats, bounded: bool) -> Point | None:
    """Evaluate a step away, back on the relations; None where there is no finite cost."""
    problem, aimed = point.problem, point.unknowns.copy()
    aimed[problem.layout.free] += where.spread(along)
    target = _kept(problem, aimed, where.linear.scale, bounded)
    return None if target is None else evaluated(problem, target, point.relaxation)


def _across(trial: Point, point: Point, bounded: bool = False) -> Point | None:
    """Step back to the floor of the valley, square to the way from a point to a trial."""
    free = point.problem.layout.free
    with suppress(np.linalg.LinAlgError):
        there = tangent(trial, bounded)
        across = there.across(trial.unknowns[free] - point.unknowns[free])
        return _stepped(trial, there, across, bounded)
    return None


def evaluated(problem: Problem, unknowns: Floats, relaxation: float = 0.0) -> Point | None:
    if not np.abs(unknowns).max(initial=0.0) < 1e150:
        return None
    with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
        point = problem.best_at(unknowns, relaxation)
        return point if np.isfinite(point.cost) else None
    return None


def _kept(problem: Problem, unknowns: Floats, scale: Floats, bounded: bool) -> Floats | None:
    if bounded:
        return inside(problem, unknowns, scale)
    if len(problem.exact):
        return retract(unknowns, problem.layout.free, problem.exact, scale)
    return unknowns


def hopeless(point: Point, above: Point | None = None) -> bool:
    """Tell whether a cost is hopeless, `above` that of the minimum on few lines."""
    least = 0.0 if above is None else above.cost
    return point.cost >= HOPELESS * (len(point.residual) + least)


@np.errstate(all="ignore")  # what overflows on the way is refused there
def solve(
    problem: Problem,
    start: Floats,
    stages: Sequence[float] = STAGES,
    bounded: bool = False,
    *,
    brief: bool = False,
) -> Solution:
    """Minimize the cost from a start, within the bounds; `bounded`: also on the way.

    With `brief` a way that is hopeless after a few steps is left there. Where the start itself
    costs less than what the homotopy led to, the minimum nearest to it is looked for too. A
    `LinAlgError` says that no point on the way has a finite cost, or that none near is in bounds.
    """
    ends = _ends(problem, start, stages, bounded, brief=brief)
    there = evaluated(problem, start, stages[-1])
    if there is not None and all(there.cost < end.point.cost for end in ends):
        ends += _ends(problem, start, stages[-1:], bounded, brief=brief)
    return _lowest(ends)


@np.errstate(all="ignore")
def settle(problem: Problem, near: Floats) -> Solution:
    """Return the minimum near a point, on all lines from the first step: few would lead away."""
    return _lowest(_ends(problem, near, STAGES[-1:], False, near=True))


def _lowest(ends: Sequence[Solution]) -> Solution:
    if not ends:
        raise np.linalg.LinAlgError("no way from this start")
    return min(ends, key=lambda end: end.point.cost)


def _ends(
    problem: Problem,
    start: Floats,
    stages: Sequence[float],
    bounded: bool,
    *,
    brief: bool = False,
    near: bool = False,
) -> list[Solution]:
    """Descend freely; where that ends outside, again from its end and from the start inside."""
    ways = [(start, stages)]
    if not bounded:
        found = _descended(problem, start, stages, False, brief=brief, near=near)
        if found is not None and not len(outside(problem.bounds, found.point.unknowns)):
            return [found]
        if found is not None:
            ways.append((found.point.unknowns, stages[-1:]))
            if brief and hopeless(found.point):  # bounds only add to that
                del ways[0]
    inner = [_descended(problem, *way, True, brief=brief, near=near) for way in ways]
    return [end for end in inner if end is not None]


def _descended(
    problem: Problem,
    start: Floats,
    stages: Sequence[float],
    bounded: bool,
    known: Sequence[Floats] = (),
    *,
    brief: bool = False,
    near: bool = False,
) -> Solution | None:
    """Go through the stages; None for no finite cost, or where a stage ends as the known way's.

    And for a brief way, beside which others stand, on which an unknown runs off to infinity.
    """
    try:
        walk = _Walk(problem, start, bounded, brief=brief)
    except np.linalg.LinAlgError:
        return None
    trail: list[Floats] = []
    try:
        for stage, relaxation in enumerate(stages[:-1]):
            there = known[stage] if known else None
            with suppress(np.linalg.LinAlgError):
                walk.descend(relaxation, known=there)
            if walk.lost:  # no stage leads back from there
                return None
            trail.append(walk.unknowns)
            if there is not None and _same(problem, walk.unknowns, there):
                return None
        ended = walk.ended(problem, stages[-1], brief, near)
    except KeyboardInterrupt as stop:
        raise Interrupted(walk.unknowns) from stop
    if ended is None:
        return None
    active = bounds_held(ended[0]) if bounded else ()
    return Solution(*ended, walk.iterations, active, tuple(trail))


@np.errstate(all="ignore")
def few_steps(
    problem: Problem, start: Floats, stages: Sequence[float], steps: int, most: float = np.inf
) -> Point:
    """Take a few steps at each stage, to the first that ends above `most`: later ones cost more."""
    walk = _Walk(problem, start, bounded=False)
    for relaxation in stages:
        point, _ = walk.descend(relaxation, limit=steps, promise=PROMISE)
        if point.cost > most:
            break
    return point


def beside(point: Point, change: Floats) -> Point | None:
    """Return the floor of the valley beside a change of the free unknowns, if it is found.

    Gauss-Newton steps square to the change, so that what the change moves stays moved.
    """
    problem, aimed = point.problem, point.unknowns.copy()
    aimed[problem.layout.free] += change
    trial = evaluated(problem, aimed)
    for _ in range(BENDS):
        moved = None if trial is None else _across(trial, point)
        if trial is None or moved is None or moved.cost > trial.cost - 1e-3:
            break
        trial = moved
    return trial


@np.errstate(all="ignore")
def elsewhere(
    problem: Problem, start: Floats, solution: Solution, stages: Sequence[float] = STAGES
) -> Solution | None:
    """Solve from another start; None where its way joins that of the solution.

    In the first stage the cost is that of a regression: where the records inform all unknowns,
    every start ends there at the same point, and the rest of the way is known already.
    """
    known = solution.trail if stages == STAGES else ()
    if problem.lowest is not None and _idle(problem, start, stages, known):
        return None
    found = _descended(problem, start, stages, False, known, brief=True)
    if found is not None and len(outside(problem.bounds, found.point.unknowns)):
        found = _descended(problem, start, stages, True, brief=True)
    return found


def _idle(
    problem: Problem, start: Floats, stages: Sequence[float], known: Sequence[Floats]
) -> bool:
    """Tell whether on a sketch a way leads to its minimum, which is known, or to no answer."""
    sketch, lowest = problem.sketch, problem.lowest
    assert sketch is not None
    assert lowest is not None
    found = _descended(sketch, start, stages, False, known, brief=True)
    if found is None or hopeless(found.point, lowest):
        return True
    near = found.point.cost <= lowest.cost * (1 + 2 * sketch.tolerance) + 1e-3
    return near and _same(problem, found.point.unknowns, lowest.unknowns)


@np.errstate(all="ignore")
def joins(problem: Problem, start: Floats, known: Sequence[Floats], bounded: bool = False) -> bool:
    """Tell whether a way joins a known one in its first stage; see `elsewhere` for the reason."""
    if not known or any(len(outside(problem.bounds, point)) for point in known):
        return False
    with suppress(np.linalg.LinAlgError):
        walk = _Walk(problem, start, bounded)
        walk.descend(STAGES[0], known=known[0])
        return _same(problem, walk.unknowns, known[0])
    return False


def _same(problem: Problem, one: Floats, other: Floats) -> bool:
    """Tell whether two points are the same but for what is linear."""
    a, b = one[problem.rigid], other[problem.rigid]
    return bool((np.abs(a - b) <= JOINED * np.maximum(np.abs(a), np.abs(b))).all())


def bounds_held(point: Point) -> tuple[int, ...]:
    bounds = point.problem.bounds
    reached = bounds.values(point.unknowns) <= HELD * bounds.sizes(point.sizes)
    return tuple(int(i) for i in np.flatnonzero(reached))


ANCHOR = 0.3  # relative deviation with which the gains are held while errors are granted
HELD_SCALE = 0.01
"""Deviation of a common scale that nothing tells: any value is right, but for zero. With the
deviation of the gains zero would still cost less than the errors of a bad start."""


def anchored(problem: Problem, start: Floats) -> Problem:
    """Hold gains loosely to their start, and a scale that nothing tells.

    While errors are granted to the equations in units of force, the cost would fall with the
    forces themselves: without an anchor, all gains, masses and stiffnesses go to zero together.
    """
    unknowns, values = problem.layout.unknowns, start.tolist()
    moved = [i for i in problem.layout.free.tolist() if values[i]]
    rows = [
        Relation({(i,): 1.0, (): -values[i]}, unknowns[i].name, ANCHOR * abs(values[i]))
        for i in moved
        if unknowns[i].anchored
    ]
    if scale_is_open(problem, start):
        common = {(i,): 1 / values[i] for i in moved}
        rows.append(Relation(common | {(): -float(len(moved))}, "scale", HELD_SCALE))
    return replace(problem, known=problem.known.joined(rows)) if rows else problem


def scale_is_open(problem: Problem, start: Floats) -> bool:
    """Tell whether twice every unknown is the same rotor: no force and no value is known."""
    twice = start.copy()
    twice[problem.layout.free] *= 2
    if any(record.data[:, : record.inputs].any() for record in problem.likelihoods):
        return False
    known = problem.known.values(start), problem.known.values(twice)
    exact = problem.exact.values(start), problem.exact.values(twice)
    if not (np.array_equal(*known) and np.allclose(2 * exact[0], exact[1], rtol=1e-12)):
        return False
    one, other = problem.at(start), problem.at(twice)
    return all(
        np.allclose(2 * a.stiffness, b.stiffness, rtol=1e-12) and not a.loads.any()
        for a, b in zip(one.records, other.records, strict=True)
    )
