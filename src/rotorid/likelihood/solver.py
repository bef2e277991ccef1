"""Levenberg-Marquardt on the whitened residual, led by a homotopy.

Errors granted to every equation of motion smooth local minima away, fewer from stage to stage
(docs/maximum-likelihood.md, section 1).

Where the records inform some combination of the unknowns only weakly, the minimum lies at the end
of a narrow, bent valley. Straight steps along it leave its floor, and ever shorter ones hardly
get on: hundreds of iterations, or none that ends. So a step that does not lower the cost is given
a few Gauss-Newton steps square to itself, which lead back to the floor, before it is judged. They
converge fast, since the one weak direction is out of them; steps a thousand times as long succeed.

Exact relations are eliminated: steps are taken in the null space of their derivative, and Newton
steps lead back to them. Bounds wait until the end, since the way to the minimum may well lead
through a negative mass. Where the minimum violates one, the way is gone again inside: each step
solves the linear least-squares problem with the linearized bounds as inequalities.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.core.values import Floats
from rotorid.likelihood.problem import Point, Problem, Tangent, inside, outside, retract, tangent
from rotorid.likelihood.relations import Polynomial, Relations

STAGES = (10.0, 1.0, 0.1, 0.01, 0.0)
"""The homotopy: sigma of each stage, in units of the mean force."""
LIMIT = 200
"""Steps of the last stage. The bent valleys of weakly excited rotors take up to 40."""
EFFORT = 1000
"""Jacobians of one way. The longest of the bank that arrived took 500."""
BRIEF = 60
"""Jacobians of the last stage from a further start that only checks an answer, and of a suspect."""
HOPELESS = 10.0
"""Cost per residual from which a way is not worth going on with: a brief one, or on all lines."""
JOINED = 0.01
"""Ways whose stages end no further apart, relative to each unknown, have joined."""
BENDS = 4
"""Gauss-Newton steps that may lead a step back to the floor of its valley."""
ARRIVED = 1e-3
"""Gain of the cost, hidden from steps by rounding, that leaves every value within a thirtieth of
its deviation from the minimum."""
HELD = 1e-9
"""Distance from a bound, relative to the size of its terms, at which it is active."""


@frozen
class Solution:
    point: Point
    converged: bool
    iterations: int  # evaluations of the Jacobian, over all stages
    active: tuple[int, ...] = ()  # bounds that hold with equality
    # sequence of array: unknowns at the end of each stage before the last
    trail: tuple[Floats, ...] = ()


class _Walk:
    def __init__(self, problem: Problem, unknowns: Floats, bounded: bool) -> None:
        self.problem, self.unknowns, self.bounded = problem, unknowns, bounded
        self.iterations, self.effort = 0, EFFORT

    def descend(self, relaxation: float, tolerance: float, limit: int) -> tuple[Point, bool]:
        point, radius = self.problem.best_at(self.unknowns, relaxation), np.inf
        floor = 1e-14 if relaxation > 0 else 1.0
        for _ in range(limit):
            where = self._tangent(point)
            if where.decrease <= tolerance * max(point.cost, floor):
                return point, True
            trial, radius = self._forward(point, where, radius, relaxation)
            if trial is None:
                # No step helps: rounding, if what was left to gain is next to nothing.
                least = 0.0 if relaxation > 0 else ARRIVED
                return point, where.decrease <= max(least, 1e-6 * max(point.cost, floor))
            point = trial
            self.unknowns = point.unknowns
        return point, False

    def _tangent(self, point: Point) -> Tangent:
        self.iterations += 1
        return tangent(point, self.bounded)

    def _forward(
        self, point: Point, where: Tangent, radius: float, relaxation: float
    ) -> tuple[Point | None, float]:
        """Return a point with a lower cost, and the radius to try next."""
        for attempt in range(25):
            along = where.step(radius)
            if along is None or self.iterations > self.effort:
                return None, radius
            length = float(np.linalg.norm(along))
            if length == 0:  # the bounds leave no way
                return None, radius
            trial = self._stepped(point, where, along, relaxation)
            for _ in range(BENDS):
                if trial is None or trial.cost < point.cost:
                    break
                trial = self._corrected(trial, point, relaxation)
            if trial is not None and trial.cost < point.cost:
                return trial, 4 * length if attempt == 0 else length
            radius = length / 4
        return None, radius

    def _corrected(self, trial: Point, point: Point, relaxation: float) -> Point | None:
        """Step back to the floor of the valley, square to the way; None where it leads up."""
        try:
            moved = self.across(trial, point, relaxation)
        except np.linalg.LinAlgError:
            return None
        if moved is None or moved.cost >= max(point.cost, 0.5 * trial.cost):
            return None
        return moved

    def across(self, trial: Point, point: Point, relaxation: float = 0.0) -> Point | None:
        free, there = self.problem.layout.free, self._tangent(trial)
        across = there.across(trial.unknowns[free] - point.unknowns[free])
        return self._stepped(trial, there, across, relaxation)

    def _stepped(
        self, point: Point, where: Tangent, along: Floats, relaxation: float
    ) -> Point | None:
        """Evaluate a step away, back on the relations; None where there is no finite cost."""
        problem, free = self.problem, self.problem.layout.free
        aimed = point.unknowns.copy()
        aimed[free] += where.spread(along)
        target = _kept(problem, aimed, where.scale, self.bounded)
        return None if target is None else evaluated(problem, target, relaxation)


def evaluated(problem: Problem, unknowns: Floats, relaxation: float = 0.0) -> Point | None:
    if not np.abs(unknowns).max(initial=0.0) < 1e150:
        return None
    try:
        with np.errstate(all="ignore"):
            point = problem.best_at(unknowns, relaxation)
            return point if np.isfinite(point.cost) else None
    except np.linalg.LinAlgError:
        return None


def solve(
    problem: Problem,
    start: Floats,
    stages: Sequence[float] = STAGES,
    bounded: bool = False,
    *,
    brief: bool = False,
) -> Solution:
    """Minimize the cost from a start, within the bounds; `bounded`: also on the way.

    With `brief`, a way that is hopeless after a few steps is left there.

    The start itself is a candidate: where it costs less than what the homotopy led to, the
    minimum nearest to it is looked for too, and the lower one taken. A `LinAlgError` says that no
    point on the way has a finite cost, or that no point near keeps the bounds.
    """
    with np.errstate(all="ignore"):  # what overflows on the way is refused there
        candidates = _within(problem, start, stages, bounded, brief=brief)
        best = _lowest(candidates)
        there = evaluated(problem, start, stages[-1])
        if there is not None and (best is None or there.cost < best.point.cost):
            again = _within(problem, start, stages[-1:], bounded, brief=brief)
            best = _lowest([*candidates, *again])
    if best is None:
        raise np.linalg.LinAlgError("no way from this start")
    return best


def settle(problem: Problem, near: Floats) -> Solution:
    """Return the minimum near a point, on all lines from the first step: few would lead away."""
    with np.errstate(all="ignore"):
        best = _lowest(_within(problem, near, STAGES[-1:], False, near=True))
    if best is None:
        raise np.linalg.LinAlgError("no way from this point")
    return best


def _within(
    problem: Problem,
    start: Floats,
    stages: Sequence[float],
    bounded: bool,
    *,
    brief: bool = False,
    near: bool = False,
) -> list[Solution]:
    """Descend freely; where that ends outside, again from its end and from the start inside."""
    descended = partial(_descended, problem, brief=brief, near=near)
    found = None if bounded else descended(start, stages, False)
    if found is not None and not len(outside(problem.bounds, found.point.unknowns)):
        return [found]
    ways = [(start, stages)]
    if found is not None:
        ways.append((found.point.unknowns, stages[-1:]))
        if brief and _hopeless(found.point):  # bounds only add to that
            del ways[0]
    inner = [descended(x, way, True) for x, way in ways]
    return [solution for solution in inner if solution is not None]


def few_steps(problem: Problem, start: Floats, stages: Sequence[float], steps: int) -> Point | None:
    """Return where a few steps at each stage lead, bounds left aside; None where nowhere."""
    walk, point = _walk(problem, start, bounded=False), None
    if walk is None:
        return None
    for relaxation in stages:
        point, _ = walk.descend(relaxation, tolerance=1e-2, limit=steps)
    return point


def beside(point: Point, change: Floats) -> Point | None:
    """Return the floor of the valley beside a change of the free unknowns, if it is found.

    Gauss-Newton steps square to the change, so that what the change moves stays moved.
    """
    problem, free = point.problem, point.problem.layout.free
    walk = _Walk(problem, point.unknowns, bounded=False)
    aimed = point.unknowns.copy()
    aimed[free] += change
    trial = evaluated(problem, aimed)
    for _ in range(BENDS):
        if trial is None:
            return None
        try:
            moved = walk.across(trial, point)
        except np.linalg.LinAlgError:
            return None
        if moved is None or moved.cost > trial.cost - 1e-3:
            break
        trial = moved
    return trial


def _lowest(candidates: Sequence[Solution]) -> Solution | None:
    return min(candidates, key=lambda c: c.point.cost, default=None)


def elsewhere(
    problem: Problem, start: Floats, solution: Solution, stages: Sequence[float] = STAGES
) -> Solution | None:
    """Solve from another start; None where its way joins that of the solution.

    In the first stage the cost is that of a regression: where the records inform all unknowns,
    every start ends there at the same point, and the rest of the way is known already.
    """
    with np.errstate(all="ignore"):
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
    try:
        found = _descended(sketch, start, stages, False, known, brief=True)
    except np.linalg.LinAlgError:
        return False
    if found is None or found.point.cost > _hopeless_cost(found.point, problem):
        return True
    near = found.point.cost <= lowest.cost * (1 + 2 * sketch.tolerance) + 1e-3
    return near and _same(problem, found.point.unknowns, lowest.unknowns)


def _hopeless_cost(point: Point, problem: Problem) -> float:
    floor = 0.0 if problem.lowest is None else problem.lowest.cost
    return HOPELESS * (len(point.residual) + floor)


def joins(problem: Problem, start: Floats, known: Sequence[Floats], bounded: bool = False) -> bool:
    """Tell whether a way from another start joins a known one by the end of its first stage.

    See `elsewhere` for the reason.
    """
    if not known or any(len(outside(problem.bounds, point)) for point in known):
        return False
    with np.errstate(all="ignore"), suppress(np.linalg.LinAlgError):
        walk = _walk(problem, start, bounded)
        if walk is None:
            return False
        walk.descend(STAGES[0], tolerance=1e-2, limit=30)
        return _same(problem, walk.unknowns, known[0])
    return False


def _walk(problem: Problem, start: Floats, bounded: bool) -> _Walk | None:
    free = problem.layout.free
    scale = np.maximum(np.abs(start[free]), 1e-12 * np.abs(start[free]).max(initial=0.0))
    scale = np.where(scale > 0, scale, 1.0)
    x = _kept(problem, start, scale, bounded)
    if x is None and bounded:
        return None
    return _Walk(anchored(problem.sketch or problem, start), start if x is None else x, bounded)


def _kept(problem: Problem, unknowns: Floats, scale: Floats, bounded: bool) -> Floats | None:
    """Return the nearest point that keeps the exact relations and, if `bounded`, the bounds."""
    if bounded:
        return inside(problem, unknowns, scale)
    if len(problem.exact):
        return retract(unknowns, problem.layout.free, problem.exact, scale)
    return unknowns


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
    """Go through the stages; None for no finite cost, or where a stage ends as the known way's."""
    walk = _walk(problem, start, bounded)
    if walk is None:
        return None
    trail: list[Floats] = []
    for stage, relaxation in enumerate(stages[:-1]):
        with suppress(np.linalg.LinAlgError):
            walk.descend(relaxation, tolerance=1e-2, limit=30)
        trail.append(walk.unknowns)
        if stage < len(known) and _same(problem, walk.unknowns, known[stage]):
            return None
    ended = _ended(problem, walk, stages[-1], brief, near)
    if ended is None:
        return None
    point, converged = ended
    active = bounds_held(problem, point.unknowns) if bounded else ()
    return Solution(point, converged, walk.iterations, active, tuple(trail))


def _ended(
    problem: Problem, walk: _Walk, relaxation: float, brief: bool, near: bool
) -> tuple[Point, bool] | None:
    """Go through the last stage; return its end and whether it converged there."""
    if brief:
        walk.effort = walk.iterations + BRIEF
    converged = None if near else _astray(problem, walk, relaxation)
    walk.problem = problem
    if brief:
        walk.effort = walk.iterations + BRIEF
    try:
        if converged is None:
            point, converged = walk.descend(relaxation, problem.tolerance, limit=LIMIT)
            if brief and not converged and not _hopeless(point):
                walk.effort = EFFORT  # a bent valley, not another mountain
                point, converged = walk.descend(relaxation, problem.tolerance, limit=LIMIT)
            return point, converged
    except np.linalg.LinAlgError:
        converged = False
    last = evaluated(problem, walk.unknowns, relaxation)
    return None if last is None else (last, converged)


def _hopeless(point: Point) -> bool:
    return point.cost >= HOPELESS * len(point.residual)


def _astray(problem: Problem, walk: _Walk, relaxation: float) -> bool | None:
    """Tell whether the sketch converges at a hopeless cost; None: all lines are to be asked."""
    if problem.sketch is None:
        return None
    walk.problem = problem.sketch
    try:
        point, converged = walk.descend(relaxation, tolerance=1e-2, limit=30)
        hopeless = _hopeless_cost(point, problem)
        if point.cost <= hopeless:
            return None
        point, converged = walk.descend(relaxation, tolerance=1e-10, limit=LIMIT)
    except np.linalg.LinAlgError:
        return None
    return converged if point.cost > hopeless else None


def _same(problem: Problem, one: Floats, other: Floats) -> bool:
    """Tell whether two points are the same but for what is linear."""
    rigid = np.setdiff1d(problem.layout.free, problem.affine)
    a, b = one[rigid], other[rigid]
    return bool((np.abs(a - b) <= JOINED * np.maximum(np.abs(a), np.abs(b))).all())


def bounds_held(problem: Problem, unknowns: Floats) -> tuple[int, ...]:
    bounds = problem.bounds
    reached = bounds.values(unknowns) <= HELD * bounds.sizes(unknowns)
    return tuple(int(i) for i in np.flatnonzero(reached))


ANCHOR = 0.3
"""Relative deviation with which the gains are held while errors are granted."""
HELD_SCALE = 0.01
"""Deviation of a common scale that nothing tells: any value is right, but for zero. With the
deviation of the gains zero would still cost less than the errors of a bad start."""


def anchored(problem: Problem, start: Floats) -> Problem:
    """Hold gains loosely to their start, and a scale that nothing tells.

    While errors are granted to the equations in units of force, the cost would fall with the
    forces themselves: without an anchor, all gains, masses and stiffnesses go to zero together.
    """
    layout, rows = problem.layout, list[tuple[Polynomial, float, str]]()
    for index in layout.free:
        unknown = layout.unknowns[index]
        if unknown.anchored and start[index]:
            polynomial = {(int(index),): 1.0, (): -float(start[index])}
            rows.append((polynomial, ANCHOR * abs(float(start[index])), unknown.name))
    if scale_is_open(problem, start):
        moved = [i for i in layout.free if start[i]]
        common = {(int(m),): 1 / float(start[m]) for m in moved}
        rows.append((common | {(): -float(len(moved))}, HELD_SCALE, "scale"))
    if not rows:
        return problem
    held = Relations.build(rows, len(layout.unknowns))
    return replace(problem, known=problem.known.joined(held))


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
    return all(
        np.allclose(2 * record.coefficients(start), record.coefficients(twice), rtol=1e-12)
        and not record.loads_at(start).any()
        for record in problem.likelihoods
    )
