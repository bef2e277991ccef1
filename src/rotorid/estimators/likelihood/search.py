"""Where to look for the minimum: one way where one is enough, further ones where there is reason.

The homotopy from the given start finds the minimum of nearly every record that informs all
unknowns, and its cost says so. Where it does not (the iteration ended nowhere, or at a cost that
noise does not explain), the next ways are taken: the start with the bounds kept all the way, then
starts spread about the given one, and from each the homotopy. A cost that noise does not explain
is believed, and put down to the model or to the data, once two different starts have led to it;
where a mass has vanished on the way, only once all ways have been tried.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from rotorid.estimators.likelihood.inference import Inference, infer
from rotorid.estimators.likelihood.problem import Problem
from rotorid.estimators.likelihood.solver import STAGES, Solution, joins, solve
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


def _ways(problem: Problem, start: Floats) -> Iterator[_Way]:
    """Yield the ways to look for the minimum, in the order in which they are tried."""
    yield _Way(0, start)
    if len(problem.bounds):
        yield _Way(0, start, bounded=True)
    for number, other in enumerate(further_starts(problem, start), 1):
        yield _Way(number, other, bounded=bool(number % 2 and len(problem.bounds)))
        if number == 2:  # two starts beside the given one failed: that one may be far off
            yield _Way(0, start, FINE_STAGES)


def search(problem: Problem, start: Floats) -> tuple[Solution, Inference] | None:
    """Return the lowest minimum found and what it tells; None where there is none at all."""
    best: tuple[Solution, Inference] | None = None
    costs: list[tuple[int, float]] = []
    lost: list[tuple[int, float]] = []
    first: Solution | None = None
    for way in _ways(problem, start):
        if first is not None and _known(problem, way, first):
            costs.append((way.number, first.point.cost))
            if best is not None and _agreed(costs, best):
                break
            continue
        try:
            solution = solve(problem, way.start, way.stages, way.bounded)
            found = solution, infer(solution.point, problem.exact)
        except np.linalg.LinAlgError:  # the way led where the equations lose their meaning
            continue
        if best is None or solution.point.cost < best[0].point.cost:
            best = found
        if solution.converged:
            if vanished(problem, start, solution):
                lost.append((way.number, solution.point.cost))
            else:
                costs.append((way.number, solution.point.cost))
                first = first or solution
        if best[0].converged and (explained(*best) or _agreed(costs, best)):
            break
    costs += lost
    if best is not None and not explained(*best) and not _agreed(costs, best):
        return replace(best[0], converged=False), best[1]
    return best


def vanished(problem: Problem, start: Floats, solution: Solution) -> bool:
    """Tell whether an unknown has come to nothing without a bound that holds it there."""
    free = problem.layout.free
    small = np.abs(solution.point.unknowns[free]) < VANISHED * np.abs(start[free])
    return bool(small.any()) and not solution.active


def _known(problem: Problem, way: _Way, first: Solution) -> bool:
    """Tell whether a way on thousands of lines would only be the first one again."""
    if problem.sketch is None or way.stages is not STAGES:
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
