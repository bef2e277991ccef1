"""What is plainly wrong with whole records: two channels exchanged, or one of the other sign.

Nothing then fits, and thousands of lines would be gone through from a dozen starts, for minutes,
to say so. A hundred lines of each record tell as much: where the way to the minimum ends on them
at several times what noise explains, single mistakes are tried on these lines first, and where one
explains the records it is what is wrong. Where none does, and the cost is hopeless, the ways from
other starts are gone on the few lines too, and the best of them alone is followed on more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.estimators.likelihood.inference import Inference, infer
from rotorid.estimators.likelihood.leads import GROSS, Lead, discrete_leads
from rotorid.estimators.likelihood.preparation import Prepared
from rotorid.estimators.likelihood.problem import Point, Problem
from rotorid.estimators.likelihood.refits import assembled, minimized, screened
from rotorid.estimators.likelihood.search import explained, search
from rotorid.estimators.likelihood.solver import HOPELESS, STAGES, Solution, solve
from rotorid.estimators.likelihood.thinning import PLAIN_LINES, thinned
from rotorid.frozen import frozen
from rotorid.observation import Observation

LIKELY = 2.0
"""Mistakes that are followed have a screened cost within this factor of the lowest."""
FOLLOWED = 4
"""Of these the first. A wrong one takes seconds, the right one tenths."""


@frozen
class Plain:
    """Where the search ended on few lines, what explains the records, and what does not."""

    solution: Solution
    inference: Inference
    leads: tuple[Lead, ...] = ()
    tried: frozenset[str] = frozenset()


def plainly(prepared: Prepared, records: Sequence[Observation], problem: Problem) -> Plain | None:
    """Return what is plainly wrong with records of many lines; None where nothing is.

    The unknowns are those of the records without the mistake, the unbalance the best with it.
    """
    fewer = thinned(records, PLAIN_LINES)
    if problem.sketch is None or fewer is None:
        return None
    point = minimized(prepared, fewer, prepared.layout.start, STAGES)
    if point is None or not _costs(point, GROSS):
        return None
    leads, _ = discrete_leads(fewer, None, {})
    right = _without_a_mistake(prepared, fewer, leads)
    if right:
        # The start may have been bad, and nothing else: from there the records as they are.
        near = minimized(prepared, fewer, right[0][0].unknowns, (0.0,))
        if near is not None and not _costs(near, GROSS):
            return None
        return _on_all_lines(problem, right[0][0], tuple(lead for _, lead in right))
    ended = _searched(prepared, fewer, problem) if _costs(point, HOPELESS) else None
    plain = None if ended is None else _on_all_lines(problem, ended, ())
    return plain and replace(plain, tried=frozenset(lead.term for lead in leads))


def _searched(prepared: Prepared, fewer: Sequence[Observation], problem: Problem) -> Point | None:
    """Return where the best of all ways on few lines leads on more; None where one is not bad."""
    found = search(assembled(prepared, fewer), prepared.layout.start)
    if found is None or not (found[0].converged and _costs(found[0].point, HOPELESS)):
        return None
    try:
        return solve(problem, found[0].point.unknowns, (0.0,)).point
    except np.linalg.LinAlgError:
        return None


def _costs(point: Point, times: float) -> bool:
    """Tell whether a cost is more than so many times what noise explains."""
    try:
        expected = infer(point, point.problem.exact).expectation.mean
    except np.linalg.LinAlgError:
        return False
    return point.cost > times * max(expected, 1.0)


def _without_a_mistake(
    prepared: Prepared, records: Sequence[Observation], leads: Sequence[Lead]
) -> list[tuple[Point, Lead]]:
    """Return the mistakes without which noise explains the records, the best first."""
    if not leads:
        return []
    costs = [screened(prepared, lead.undo(records)) for lead in leads]
    order = np.argsort(costs, kind="stable")
    likely = [leads[k] for k in order[:FOLLOWED] if costs[k] <= LIKELY * costs[order[0]]]
    found = []
    for lead in likely:
        point = minimized(prepared, lead.undo(records), prepared.layout.start, STAGES)
        if point is not None and not _costs(point, GROSS):
            found.append((point, lead))
    return sorted(found, key=lambda pair: pair[0].cost)


def _on_all_lines(problem: Problem, point: Point, leads: tuple[Lead, ...]) -> Plain | None:
    """Return what a minimum on few lines is on all; None where noise explains it there."""
    try:
        found = Solution(problem.best_at(point.unknowns), converged=True, iterations=0)
        inference = infer(found.point, problem.exact)
    except np.linalg.LinAlgError:
        return None
    return None if explained(found, inference) else Plain(found, inference, leads)
