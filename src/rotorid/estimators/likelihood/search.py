"""Where to look for the minimum: one way where one is enough, further ones where there is reason.

The homotopy from the given start finds the minimum of nearly every record that informs all
unknowns, and its cost says so. Where it does not (the iteration ended nowhere, or at a cost that
noise does not explain), the next ways are taken: the start with the bounds kept all the way, then
starts spread about the given one, and from each the homotopy. A cost that noise does not explain
is believed, and put down to the model or to the data, once two different starts have led to it;
where a mass has vanished on the way, only once all ways have been tried; and where unknowns are
open that the start would tell, never: a mass that is hidden behind its spring, say, may vanish with
it, and their ratio is all that is left. There a further way keeps every unknown within a factor of
ten of its start, until it is settled.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from rotorid.estimators.likelihood.inference import Inference, infer
from rotorid.estimators.likelihood.problem import Problem
from rotorid.estimators.likelihood.relations import Polynomial, Relations
from rotorid.estimators.likelihood.solver import STAGES, Solution, joins, settle, solve
from rotorid.estimators.likelihood.tangent import outside
from rotorid.frozen import frozen
from rotorid.record import Floats

FINE_STAGES = (*(10.0 ** (2 - j / 2) for j in range(13)), 0.0)
"""A homotopy from further off and in smaller steps: for starts a thousand times off."""
SUSPICIOUS = 1e-6
"""Below this p-value a minimum may be a local one."""
STARTS = 8
"""Further starts. Of random rotors from +-60 % one of two leads to the minimum at worst: 8 fail
together in less than 1 in 200 of the few that fail at first."""
SPREAD = 1.4
"""Further starts lie within this factor of the given one, log-uniform."""
GENERATOR = 20260
"""The fixed number from which the further starts are drawn: the same records, the same answer."""
AGREE = 1e-6
"""Two starts led to the same cost if it differs by no more than this share, or a thousandth."""
WITHIN = 10.0
"""Factor of its start within which each unknown is held where others went astray. Starts are off by
less; 3 and 100 lead to the same minima."""
ALIKE = 0.01
"""Or by this much with the deviations that the misfit makes of the stated ones, which is a tenth of
such a deviation: the cost of a rotor of many coordinates is rounded to some millionths of it."""

VANISHED = 1e-9
"""An unknown below this share of its start, no bound holding it there, has left the equations:
no noise brings a value so near to zero. A mass that vanishes beside an unbalance without end, say,
is where many ways end, and no machine."""


def further_starts(problem: Problem, start: Floats, count: int = STARTS) -> Iterator[Floats]:
    """Yield starts spread about the given one; what starts from zero stays there."""
    layout, rng = problem.layout, np.random.default_rng(GENERATOR)
    moved = [i for i in layout.free if not layout.unknowns[i].nuisance]
    for _ in range(count):
        factor = np.ones(len(start))
        factor[moved] = SPREAD ** rng.uniform(-1, 1, len(moved))
        yield start * factor


@frozen
class _Way:
    """A way to look for the minimum: the number of its start, its stages, bounds kept or not."""

    number: int
    start: Floats
    stages: Sequence[float] = STAGES
    bounded: bool = False
    held: bool = False


def _ways(problem: Problem, start: Floats) -> Iterator[_Way]:
    """Yield the ways to look for the minimum, in the order in which they are tried."""
    yield _Way(0, start)
    if len(problem.bounds):
        yield _Way(0, start, bounded=True)
    for number, other in enumerate(further_starts(problem, start), 1):
        yield _Way(number, other, bounded=bool(number % 2 and len(problem.bounds)))
        if number == 2:  # two starts beside the given one failed: that one may be far off
            yield _Way(0, start, FINE_STAGES)


def _and_held(ways: Iterator[_Way], start: Floats, astray: Callable[[], bool]) -> Iterator[_Way]:
    """Yield ways, and one with each unknown held near its start once one has led astray."""
    held = False
    for way in ways:
        yield way
        if astray() and not held:
            held = True
            yield _Way(0, start, held=True)


def search(problem: Problem, start: Floats) -> tuple[Solution, Inference] | None:
    """Return the lowest minimum found and what it tells; None where there is none at all."""
    best: tuple[Solution, Inference] | None = None
    costs: list[tuple[int, float]] = []
    lost: list[tuple[int, float]] = []
    opened: list[tuple[int, float]] = []
    first: Solution | None = None
    kept = False
    for way in _and_held(_ways(problem, start), start, lambda: bool(lost or opened)):
        kept = kept or way.held
        if first is not None and _known(problem, way, first):
            costs.append((way.number, first.point.cost))
            if best is not None and _agreed(costs, best):
                break
            continue
        try:
            solution = _gone(problem, way)
            found = solution, infer(solution.point, problem.exact)
        except np.linalg.LinAlgError:  # the way led where the equations lose their meaning
            continue
        if best is None or solution.point.cost < best[0].point.cost:
            best = found
        if solution.converged:
            if _opened(problem, start, found[1]):
                opened.append((way.number, solution.point.cost))
            elif vanished(problem, start, solution):
                lost.append((way.number, solution.point.cost))
            else:
                costs.append((way.number, solution.point.cost))
                first = first or solution
        if best[0].converged and (
            explained(*best) or any(_agreed(c, best) for c in (costs, opened))
        ):
            break
    if best is not None and not explained(*best) and not _agreed(costs + lost, best):
        return replace(best[0], converged=False), best[1]
    return best


def _gone(problem: Problem, way: _Way) -> Solution:
    """Return where a way leads."""
    if not way.held:
        return solve(problem, way.start, way.stages, way.bounded)
    within = solve(_within(problem, way.start), way.start, way.stages, True)
    return settle(problem, within.point.unknowns)


def _within(problem: Problem, start: Floats) -> Problem:
    """Return the problem with each unknown held within a factor of its start."""
    layout, count = problem.layout, len(start)
    rows: list[tuple[Polynomial, float, str]] = []
    linear, nothing = set(problem.affine.tolist()), (0,) * count
    for i in layout.free.tolist():
        unknown = layout.unknowns[i]
        if start[i] == 0 or i in linear or unknown.nuisance:
            continue
        alone = tuple(int(k == i) for k in range(count))
        rows.append(({alone: 1 / start[i], nothing: -1 / WITHIN}, 1.0, unknown.name))
        rows.append(({alone: -1 / start[i], nothing: WITHIN}, 1.0, unknown.name))
    bounds = problem.bounds.joined(Relations.build(rows, count))
    sketch = None if problem.sketch is None else replace(problem.sketch, bounds=bounds)
    return replace(problem, bounds=bounds, sketch=sketch)


def _opened(problem: Problem, start: Floats, inference: Inference) -> bool:
    """Tell whether a minimum leaves more open than the start does: that is no lack of the records.

    Where a mass and its spring have vanished together any of their size will do.
    """
    if not inference.null.shape[1]:
        return False
    there = infer(problem.best_at(start), problem.exact)
    return bool(inference.null.shape[1] > there.null.shape[1])


def vanished(problem: Problem, start: Floats, solution: Solution) -> bool:
    """Tell whether an unknown has come to nothing without a bound that holds it there."""
    free = problem.layout.free
    small = np.abs(solution.point.unknowns[free]) < VANISHED * np.abs(start[free])
    return bool(small.any()) and not solution.active


def _known(problem: Problem, way: _Way, first: Solution) -> bool:
    """Tell whether a way on thousands of lines would only be the first one again."""
    if problem.sketch is None or way.held or way.stages is not STAGES:
        return False
    if len(outside(problem.bounds, first.point.unknowns)):
        return False
    return joins(problem, way.start, first.trail, way.bounded)


def explained(solution: Solution, inference: Inference) -> bool:
    """Tell whether noise alone explains the cost."""
    return inference.expectation.p_value(solution.point.cost) >= SUSPICIOUS


def _agreed(costs: list[tuple[int, float]], best: tuple[Solution, Inference]) -> bool:
    """Tell whether two different starts led to the lowest cost."""
    most = _as_low(best[0].point.cost, best[1].expectation.mean)
    return len({number for number, cost in costs if cost <= most}) > 1


def _as_low(lowest: float, expected: float) -> float:
    """Return the highest cost that is the lowest one, to rounding."""
    return lowest * (1 + max(AGREE, ALIKE / max(expected, 1.0))) + 1e-3
