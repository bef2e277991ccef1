"""Whether the solver arrives: random rotors and lightly damped structures from far starts.

    OPENBLAS_NUM_THREADS=1 python benchmarks/solver.py 300 [setting ...]

Each row counts the records whose minimum costs more than the one that a start at the truth finds
(by more than 1e-3), those that did not converge, those called doubtful, and those called right
with an error beyond 5 stated deviations; then the CPU time of the search and of the questions
asked after it. A setting is any part of a row's name.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from rotor_bank import (
    ADVERSE,
    SETTINGS,
    Case,
    Structure,
    modal_case,
    rotor_case,
    structure_case,
)

from rotorid.data.observation import bind_all
from rotorid.likelihood.other_answers import questioned
from rotorid.likelihood.preparation import prepare
from rotorid.likelihood.problem import Problem
from rotorid.likelihood.solver import solve
from rotorid.likelihood.starts import searched
from rotorid.likelihood.symmetric_answers import Mirrors
from rotorid.likelihood.unknowns import Nuisances, unknowns_of
from rotorid.models.knowledge import Knowledge


def problem_of(case: Case, start: dict[str, float]) -> Problem:
    told = {name: value for name, value in start.items() if name not in case.fixed}
    records = bind_all(case.model, case.records)
    nuisances = unknowns_of(records, Nuisances())
    prepared = prepare(case.model, Knowledge(fixed=case.fixed, start=told), nuisances, False, {})
    return prepared.of(records)


def count(name: str, make: Callable[[int], Case], seeds: int) -> None:
    missed, lost, doubtful, wrong = [], 0, 0, []
    taken, asked = [], []
    for seed in range(seeds):
        case = make(seed)
        true = problem_of(case, dict(case.truth))
        problem = problem_of(case, dict(case.start))
        begin = time.process_time()
        found = searched(problem, problem.layout.start)
        taken.append(time.process_time() - begin)
        if found is None or not found.converged:
            lost += 1
        best = solve(true, true.layout.start, (0.0,)).point.cost
        if found is None or found.point.cost > best + 1e-3:
            missed.append(seed)
        if found is None or not found.converged:
            continue
        begin = time.process_time()
        solution, inference, _, doubt = questioned(found, Mirrors(problem.layout))
        asked.append(time.process_time() - begin)
        if doubt or inference.linear.null.shape[1]:
            doubtful += 1
            continue
        free = problem.layout.free
        truth = np.array([case.truth[problem.layout.unknowns[i].name] for i in free])
        error = np.abs(solution.point.unknowns[free] - truth)
        if (error / np.sqrt(np.diag(inference.covariance))).max() > 5:
            wrong.append(seed)
    print(
        f"{name:42s} missed {len(missed)}/{seeds}, not converged {lost}, doubtful {doubtful}, "
        f"wrong but ok {len(wrong)}; search {1e3 * np.median(taken):.0f} ms (mean "
        f"{1e3 * np.mean(taken):.0f}), questions {1e3 * np.median(asked or [0]):.0f} ms (mean "
        f"{1e3 * np.mean(asked or [0]):.0f}) {missed[:8]} {wrong[:8]}",
        flush=True,
    )


def main(seeds: int, parts: list[str]) -> None:
    makers: dict[str, Callable[[int], Case]] = {}
    for name, setting in {**SETTINGS, **ADVERSE}.items():
        makers[name] = lambda seed, setting=setting: rotor_case(setting, seed)
    for modes in (3, 5, 8):
        tower = Structure(modes=modes)
        makers[f"tower, {modes} modes"] = lambda seed, t=tower: structure_case(t, seed)
        makers[f"modes of known shape, {modes}"] = lambda seed, t=tower: modal_case(t, seed)
    for name, make in makers.items():
        if not parts or any(part in name for part in parts):
            count(name, make, seeds)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 30, sys.argv[2:])
