"""Where the search starts: fewer lines, fewer shapes, several starting points.

On each line the whole rotor's other coordinates follow exactly from those that are kept. What the
forces on the kept coordinates then differ by, whitened, is a change of the residual, and moves the
estimate like any other: to first order by ``-C J^T dr``.

Further ways are taken where the homotopy from the given start ends at a cost that noise does not
explain. It is believed once two different starts have led to it; where a mass has vanished on the
way, only once all ways have been tried; and where unknowns are open that the start would tell,
never (docs/maximum-likelihood.md, section 1).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotorid.core.values import Floats, Integers, frozen
from rotorid.data.lines import SampledClock
from rotorid.data.observation import Observation, Records, bind, combined
from rotorid.likelihood.cost import Evaluation
from rotorid.likelihood.inference import Inference, infer
from rotorid.likelihood.problem import Point, Problem, outside
from rotorid.likelihood.relations import Relation
from rotorid.likelihood.solver import STAGES, Solution, hopeless, joins, settle, solve
from rotorid.models.knowledge import Mode
from rotorid.models.rotor.fem import force
from rotorid.models.rotor.rotor_model import RotorModel

FEW = 400
"""Lines that lead to the minimum: half of them the strongest, where the machine shows, half evenly
spaced. Against a hundred unknowns and the ends of the window they are many."""
PLAIN_LINES = 100
"""Lines of a record on which such a mistake shows. Of four records of 13 s with two sensors
exchanged, 60 and 120 put the right pair first, at half of the next cost or less; 30 do not."""
WORTH = 2  # times as many lines from which on some are left out


def thinned(records: Records, few: int = FEW, *, periodic: bool = False) -> Records | None:
    """Return the records with fewer lines, those of periods on demand; None where they have few."""
    found = [_thinned(record, few, periodic) for record in records]
    same = all(new is old for new, old in zip(found, records, strict=True))
    return None if same else found


def _thinned(record: Observation, few: int, periodic: bool) -> Observation:
    lines, clock = record.lines, record.lines.clock
    if len(lines.frequency) <= WORTH * few:
        return record
    if not isinstance(clock, SampledClock) or (lines.transient is None and not periodic):
        return record
    if clock.orders:  # one of its lines is the rotation's own
        return record
    return record.with_lines(replace(lines.among(_chosen(record, few)), scatter=None))


def _chosen(record: Observation, few: int) -> Integers:
    """Return the strongest lines, in units of their noise, and others evenly spaced."""
    lines = record.lines
    noise = np.diagonal(lines.covariance.matrices, axis1=1, axis2=2).real
    power = np.abs(lines.mean) ** 2
    strength = (power / np.where(noise > 0, noise, 1.0)).sum(axis=1)
    strongest = np.argsort(-strength, kind="stable")[: few // 2]
    spaced = np.linspace(0, len(strength) - 1, few - few // 2).round().astype(np.int64)
    return np.unique(np.concatenate([strongest, spaced]))


ROUGH = 1e-4  # shapes that come to less of the largest are left out on the way to the minimum
SHARE = 1e-6  # the same at the minimum, at first: records tell no more digits
FINER = 1e-2  # by how much smaller shapes are taken too, where those at the minimum do not do
SMALLEST = 1e-13  # shapes below are rounding: where these do not do, the whole rotor is solved
NEGLIGIBLE = 0.01  # deviations by which the reduction may move any parameter: no print shows it
LINES = 200  # lines on which the whole rotor is solved: they stand for the others


def reduced(
    records: Records, values: Mapping[str, float], modes: Sequence[Mode] = (), share: float = SHARE
) -> tuple[Observation, ...]:
    """Bind records to a model with fewer coordinates, where that pays; `modes` were measured."""
    model = records[0].model
    if modes or not isinstance(model, RotorModel):  # modes of others, and beyond the band
        return tuple(records)
    reads = {model.coordinates[t.coordinate] for r in records for s in r.sensors for t in s.terms}
    for record in records:
        for channel in record.inputs:
            position = {} if channel.drive is None else channel.drive.position
            terms = combined(position, model, "a force law at", channel.name)
            reads |= {model.coordinates[t.coordinate] for t in terms}
    omega = np.concatenate([r.lines.omega for r in records])
    speed = np.concatenate([r.lines.speed for r in records])
    smaller = model.reduced(reads, omega, speed, values, share if share > SMALLEST else 0.0)
    return tuple(records) if smaller is model else tuple(bind(smaller, r) for r in records)


def shift_by_reduction(point: Point, covariance: Floats, records: Records) -> float:
    """Return the deviations by which the whole rotor would move the parameter it moves most."""
    pairs = zip(point.records, records, strict=True)
    parts = [_change(at, record, point, number) for number, (at, record) in enumerate(pairs)]
    known = np.zeros(len(point.known))
    change = point.jacobian.T @ np.concatenate([*parts, known])
    std = np.sqrt(np.diag(covariance).clip(0))
    shift = covariance @ change
    return float(np.max(np.abs(shift[std > 0]) / std[std > 0], initial=0.0))


def _change(at: Evaluation, record: Observation, point: Point, number: int) -> Floats:
    """Return what the whitened residual of a record changes by, as if all lines were solved."""
    rows = np.zeros((at.problem.lines, at.problem.all_rows, 1), dtype=np.complex128)
    model = record.model
    if isinstance(model, RotorModel) and model.whole is not None and model.kept is not None:
        held = point.problem.layout.of_record(number).held
        count, kept = at.problem.lines, model.kept
        chosen = np.unique(np.linspace(0, count - 1, min(count, LINES)).round().astype(np.int64))
        motion = at.corrected()[1][chosen] * at.problem.scales.coordinates
        values, lines, linear = point.unknowns[held], record.lines, model.require_linear()
        whole = model.whole.require_linear()
        missing = np.empty((len(chosen), len(kept)), dtype=np.complex128)
        for k, line in enumerate(chosen.tolist()):
            omega, speed = float(lines.omega[line]), float(lines.speed[line])
            stiffness = linear.dynamic_stiffness([omega], values, speed)[0, : len(kept)]
            of_whole = whole.sparse_stiffness(values, omega, speed)
            moved = force(of_whole, kept, motion[k, : len(kept)])
            missing[k] = moved - stiffness @ motion[k]
        scaled = missing / at.problem.scales.rows[: len(kept)]
        rows[chosen, : len(kept), 0] = -scaled * (count / len(chosen))
    return at.whiten(rows)[:, 0]


FINE_STAGES = (*(10.0 ** (2 - j / 2) for j in range(13)), 0.0)
"""A homotopy from further off and in smaller steps: for starts a thousand times off."""
STARTS = 8
"""Further starts. Of random rotors from +-60 % one of two leads to the minimum at worst: 8 fail
together in less than 1 in 200 of the few that fail at first."""
WAYS = 4  # ways besides: from the given one, with bounds, in finer stages, and held near it
SPREAD = 1.4  # further starts lie within this factor of the given one, log-uniform
GENERATOR = 20260  # what the further starts are drawn from: the same records, the same answer
AGREE = 1e-6  # share, or a thousandth, by which the costs of two starts may differ and be the same
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
    number: int
    start: Floats
    stages: Sequence[float] = STAGES
    bounded: bool = False
    held: bool = False


def _ways(problem: Problem, start: Floats) -> Iterator[_Way]:
    yield _Way(0, start)
    if len(problem.bounds):
        yield _Way(0, start, bounded=True)
    for number, other in enumerate(further_starts(problem, start, STARTS * problem.effort), 1):
        yield _Way(number, other, bounded=bool(number % 2 and len(problem.bounds)))
        if number == 2:  # two starts beside the given one failed: that one may be far off
            yield _Way(0, start, FINE_STAGES)


def search(problem: Problem, start: Floats) -> Iterator[Solution]:
    """Yield the lowest minimum so far after each way, last the answer; nothing if none leads on."""
    best: Solution | None = None
    first: Solution | None = None
    # where ways ended, by the numbers of their starts, and the costs
    arrived, lost, opened = (list[tuple[int, float]]() for _ in range(3))
    ways = deque(_ways(problem, start))
    while ways:
        way = ways.popleft()
        if best is not None and first is not None and _known(problem, way, first):
            arrived.append((way.number, first.point.cost))
            if _agreed(arrived, best):
                break
            continue
        try:
            found = _gone(problem, way, best)
            inference = found.inference
        except np.linalg.LinAlgError:  # the way led where the equations lose their meaning
            continue
        if best is None or found.point.cost < best.point.cost:
            best = found
        if found.converged:
            ends = arrived
            if _opened(problem, start, inference):
                ends = opened
            elif vanished(problem, start, found):
                ends = lost
            else:
                first = first or found
            if ends is not arrived and not lost and not opened:
                ways.appendleft(_Way(0, start, held=True))
            ends.append((way.number, found.point.cost))
        agreed = _agreed(arrived, best) or _agreed(opened, best)
        if best.converged and (best.inference.explained or agreed):
            break
        yield best
    if best is None:
        return
    explained = best.inference.explained
    yield best if explained or _agreed([*arrived, *lost], best) else replace(best, converged=False)


def searched(problem: Problem, start: Floats) -> Solution | None:
    ends = deque(search(problem, start), maxlen=1)
    return ends.pop() if ends else None


def _gone(problem: Problem, way: _Way, best: Solution | None) -> Solution:
    """Go a way; where the best so far only crawls, at a cost beyond hope, in few steps."""
    brief = best is not None and not best.converged and hopeless(best.point)
    if not way.held:
        return solve(problem, way.start, way.stages, way.bounded, brief=brief)
    within = solve(_within(problem, way.start), way.start, way.stages, True)
    return settle(problem, within.point.unknowns)


def _within(problem: Problem, start: Floats) -> Problem:
    layout, linear = problem.layout, set(problem.affine.tolist())
    rows = [
        Relation({(i,): way / start[i], (): -way * limit}, layout.unknowns[i].name)
        for i in layout.free.tolist()
        if start[i] != 0 and i not in linear and not layout.unknowns[i].nuisance
        for way, limit in ((1.0, 1 / WITHIN), (-1.0, WITHIN))
    ]
    bounds = problem.bounds.joined(rows)
    sketch = None if problem.sketch is None else replace(problem.sketch, bounds=bounds)
    return replace(problem, bounds=bounds, sketch=sketch)


def _opened(problem: Problem, start: Floats, inference: Inference) -> bool:
    """Tell whether a minimum leaves more open than the start does: that is no lack of the records.

    Where a mass and its spring have vanished together any of their size will do.
    """
    if not inference.linear.null.shape[1]:
        return False
    there = infer(problem.best_at(start))
    return bool(inference.linear.null.shape[1] > there.linear.null.shape[1])


def vanished(problem: Problem, start: Floats, solution: Solution) -> bool:
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


def _agreed(ends: Sequence[tuple[int, float]], best: Solution) -> bool:
    lowest, expected = best.point.cost, best.inference.expectation.mean
    most = lowest * (1 + max(AGREE, ALIKE / max(expected, 1.0))) + 1e-3
    return len({number for number, cost in ends if cost <= most}) > 1
