"""The speed that the lines of whole records show, where it is not the one stated.

With a speed that is off by a few lines nothing fits: dozens of starts and suspects would be tried
on thousands of lines. What the lines say by themselves is tried first. Where a model at the speed
that they show explains them, and at the speed stated does not, that is what is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.estimators.likelihood.inference import Inference, infer
from rotorid.estimators.likelihood.leads import Lead, turning
from rotorid.estimators.likelihood.preparation import Prepared
from rotorid.estimators.likelihood.problem import Point, Problem
from rotorid.estimators.likelihood.refits import minimized
from rotorid.estimators.likelihood.search import explained
from rotorid.estimators.likelihood.solver import STAGES, Solution
from rotorid.estimators.likelihood.thinning import thinned
from rotorid.observation import Observation


def shown_lead(records: Sequence[Observation]) -> Lead | None:
    """Return the lead that the rotation is the one that the lines of records show."""
    ratios = [_ratio(record) for record in records]
    moved = [ratio for ratio in ratios if ratio != 1.0]
    if not moved:
        return None
    first = ratios.index(moved[0])
    speed = float(np.abs(records[first].lines.speed).mean()) * ratios[first]
    where = f" of record {first + 1}" if len(moved) < len(records) else ""
    told = f"{speed * 30 / np.pi:.6g} rpm ({speed / (2 * np.pi):.6g} Hz)"
    return Lead(
        "speed",
        f"a speed{where} of {told}, which its lines show",
        f"correct speed: {told}",
        lambda chosen: [turning(r, x) for r, x in zip(chosen, ratios, strict=True)],
        speed,
        "rad/s",
    )


def _ratio(record: Observation) -> float:
    """Return the speed that a record shows over the one stated; 1 where that is as stated."""
    shown, stated = record.lines.shown, float(record.lines.speed[0])
    return 1.0 if shown is None or stated == 0 else shown / stated


def by_shown_speed(
    prepared: Prepared, records: Sequence[Observation], problem: Problem
) -> tuple[Solution, Inference] | None:
    """Return what the records are at the speed stated, the rotor that they show at their own.

    Its unbalance is the best at the speed stated. None where the records show no other speed, or
    where that does not explain them, or the one stated does.
    """
    lead = shown_lead(records)
    if lead is None:
        return None
    turned = lead.undo(records)
    point = minimized(prepared, thinned(turned) or turned, prepared.layout.start, STAGES)
    try:
        if point is None or not _explains(point):
            return None
        found = Solution(problem.best_at(point.unknowns), converged=True, iterations=0)
        inference = infer(found.point, problem.exact)
    except np.linalg.LinAlgError:
        return None
    return None if explained(found, inference) else (found, inference)


def _explains(point: Point) -> bool:
    """Tell whether noise alone explains the cost of a point."""
    return explained(Solution(point, True, 0), infer(point, point.problem.exact))
