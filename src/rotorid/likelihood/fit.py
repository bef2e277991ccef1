"""From records to the minimum of their likelihood."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from typing import Literal

import numpy as np

from rotorid.answer.derived import physical_start
from rotorid.core.errors import InputError, NotConvergedError
from rotorid.core.frozen import frozen
from rotorid.core.notes import Note
from rotorid.core.values import Floats
from rotorid.core.watch import watch
from rotorid.data.observation import Observation
from rotorid.likelihood.doubts_angle import Creep, creeps
from rotorid.likelihood.expected_cost import by_equation_errors
from rotorid.likelihood.inference import Inference, SharedNoise, infer, shared_noise
from rotorid.likelihood.layout import Layout, physical_factors
from rotorid.likelihood.other_answers import Doubt, questioned
from rotorid.likelihood.preparation import Knowledge, Prepared, prepare
from rotorid.likelihood.problem import Lowest, Problem, outside
from rotorid.likelihood.rivals import Plain, by_shown_speed, plainly
from rotorid.likelihood.solver import Solution, settle, solve
from rotorid.likelihood.starts import WAYS, Minimum, explained, search, thinned
from rotorid.likelihood.symmetric_answers import Mirrors
from rotorid.likelihood.unknowns import Nuisances, unknowns_of
from rotorid.linear.estimators import Batch
from rotorid.models import Model
from rotorid.signals.covariance import correlated_covariance, is_correlated

CovarianceChoice = Literal["auto", "white", "correlated"]


@frozen
class Fit:
    prepared: Prepared
    solution: Solution
    inference: Inference
    records: tuple[Observation, ...]  # with the covariance that was chosen
    doubt: Doubt = field(default_factory=Doubt)  # why the minimum may not be the answer
    creeps: tuple[Creep | None, ...] = ()  # how the rotation of each record moves against its angle
    plain: Plain | None = None  # what the search itself came upon that is plainly wrong
    shared: SharedNoise | None = None  # noise that sensors share, by which deviations were widened
    signs: tuple[Note, ...] = ()  # which signs no record tells

    @property
    def problem(self) -> Problem:
        return self.solution.point.problem

    @property
    def covariance(self) -> Floats:
        layout, free = self.prepared.layout, self.prepared.layout.free
        covariance = np.zeros((len(layout.unknowns), len(layout.unknowns)))
        covariance[np.ix_(free, free)] = self.inference.covariance
        return covariance


SEARCHING = "trying further starts"
"""What comes next while the minimum is looked for."""
FEW = 120
"""Lines on which a rotor of few shapes is found: six times as many as it has unknowns, usually."""
NEAR = 500
"""Lines from which shapes are taken again: all lines move no unknown much further then."""
ROUGHLY = 1e-4
"""Share of its cost that is left to gain there: the shapes that it lacks move it further."""


@frozen
class Rough:
    """The minimum of a simpler problem in the same unknowns, near which that of the whole is."""

    problem: Problem  # the simpler one: ways from other starts are led by it too
    trail: tuple[Floats, ...]  # sequence of array: of the way to its minimum
    lowest: Lowest  # its minimum
    unknowns: Floats  # (unknown,): A better one that was found since

    @classmethod
    def of(cls, found: Fit, before: Rough | None) -> Rough:
        mine, solution = found.problem, found.solution
        if before is None:
            lowest = Lowest(solution.point.unknowns, solution.point.cost)
            return cls(mine.sketch or mine, solution.trail, lowest, solution.point.unknowns)
        index, unknowns = found.prepared.layout.index, before.unknowns.copy()
        for k, unknown in enumerate(before.problem.layout.unknowns):
            unknowns[k] = solution.point.unknowns[index[unknown.name]]
        return replace(before, unknowns=unknowns)

    @property
    def values(self) -> dict[str, float]:
        names = (u.name for u in self.problem.layout.unknowns)
        return dict(zip(names, self.unknowns.tolist(), strict=True))

    def leads(self, layout: Layout) -> bool:
        """Tell whether the unknowns are the same still."""
        mine = self.problem.layout.unknowns
        return [u.name for u in mine] == [u.name for u in layout.unknowns]


def approached(
    records: Sequence[Observation],
    knowledge: Knowledge,
    nuisances: Nuisances,
    shapes: Callable[[Mapping[str, float]], Sequence[Observation]],
) -> Rough | None:
    """Follow the homotopy once with few shapes on few lines; None where it leads nowhere.

    `shapes` binds all lines to a model with those at the minimum; the last steps take these.
    """
    _refuse_silence(records)
    model, asked = records[0].model, unknowns_of(records, nuisances)
    guess = starting_values(model, records, knowledge, base=False)
    watch("finding a rotor of fewer shapes")

    def posed(chosen: Sequence[Observation], few: int) -> Problem:
        chosen = thinned(chosen, few, periodic=True) or chosen
        prepared = prepare(chosen[0].model, knowledge, asked, False, guess)
        return replace(_problem(prepared, chosen), sketch=None, tolerance=ROUGHLY)

    try:
        found = solve(problem := posed(records, FEW), problem.layout.start)
        if not found.converged:
            return None
        lowest = Lowest(found.point.unknowns, found.point.cost)
        rough = Rough(problem, found.trail, lowest, found.point.unknowns)
        nearer = settle(posed(shapes(rough.values), NEAR), rough.unknowns)
    except np.linalg.LinAlgError:
        return None
    return replace(rough, unknowns=nearer.point.unknowns) if nearer.converged else rough


@frozen
class Step:
    """Between two ways of a search: the best minimum so far, what comes next and how far it is."""

    fit: Fit
    say: str = "asking whether other answers fit as well"
    done: int = 0
    of: int | None = None
    # chooses the covariance, and lets rotor angles creep: only what a minimum tells can ask for it
    refine: Callable[[Fit], Fit] | None = None

    @property
    def best(self) -> Fit:
        """The best so far, with its deviations."""
        return self.fit if self.refine is None else answered(self.refine(self.fit), ask=False)


def located(
    model: Model,
    records: Sequence[Observation],
    knowledge: Knowledge,
    nuisances: Nuisances,
    *,
    base: bool = False,
    covariance: CovarianceChoice = "auto",
    neighbours: int | None = None,
    rough: Rough | None = None,
) -> Iterator[Step]:
    """Look for the minimum, from that of a simpler problem where there is one.

    Each step holds the best so far, the last one the minimum.
    """
    _refuse_silence(records)
    guess = starting_values(model, records, knowledge, base)
    prepared = prepare(model, knowledge, unknowns_of(records, nuisances), base, guess)

    def refined(found: Fit) -> Fit:
        if covariance == "auto" and found.plain is None:
            chosen = _chosen(found.solution, found.records, neighbours)
            if any(new is not old for new, old in zip(chosen, found.records, strict=True)):
                again = _solve(prepared, chosen, found.solution, found.solution.point.unknowns)
                found = Fit(prepared, *again, tuple(chosen))
        solution, known = found.solution, found.records
        crept = creeps(solution.point, known)
        if not any(c is not None and c.creeps for c in crept):
            return replace(found, creeps=crept)
        loose = [_less_sure(record, c) for record, c in zip(known, crept, strict=True)]
        wider = prepare(model, knowledge, unknowns_of(loose, nuisances), base, guess)
        again = _solve(wider, loose, solution, _carried(wider, solution))
        return Fit(wider, *again, tuple(loose), creeps=crept, plain=found.plain)

    if covariance == "correlated":
        records = [_correlated(record, neighbours) for record in records]
    for step in _globally(prepared, records, rough):
        yield replace(step, refine=refined)
    yield Step(refined(step.fit), refine=lambda found: found)


def answered(found: Fit, *, ask: bool = True) -> Fit:
    """Return a minimum with its deviations, after asking whether it is the answer."""
    solution, inference, doubt = found.solution, found.inference, Doubt()
    mirrors = Mirrors.of(found.problem, found.records, solution.point.unknowns)
    turned = mirrors.best(solution) if found.plain is None else solution
    if turned is not solution:
        solution, inference = turned, infer(turned.point)
    # Where noise does not explain the cost, the model is wrong, and its leads come first.
    if ask and solution.converged and explained(solution, inference):
        start, problem = found.prepared.layout.start, solution.point.problem
        solution, inference, doubt = questioned(problem, start, solution, inference, mirrors)
    inference = by_equation_errors(inference, solution.point, found.records)
    inference = _by_misfit(solution, inference)
    common = None
    if solution.converged and explained(solution, inference):
        common = shared_noise(solution.point, inference, found.records)
    if common is not None:
        inference = replace(inference, covariance=common.covariance)
    signs = tuple(mirrors.notes(solution, inference)) if solution.converged else ()
    answer = replace(found, solution=solution, inference=inference, doubt=doubt)
    return replace(answer, shared=common, signs=signs)


def _by_misfit(solution: Solution, inference: Inference) -> Inference:
    """Widen deviations by a misfit where few periods leave the noise itself unsure.

    The misfit then tells its size as well as the scatter between two or three periods does.
    """
    unsure = any(at.problem.noise.shrunk > 0 for at in solution.point.records)
    mean = inference.expectation.mean
    if not unsure or not 0 < mean < solution.point.cost:
        return inference
    return replace(inference, covariance=inference.covariance * (solution.point.cost / mean))


def _carried(prepared: Prepared, solution: Solution) -> Floats:
    """Return the start of further unknowns, and the minimum found of those that were there."""
    start, layout = prepared.layout.start.copy(), solution.point.problem.layout
    for unknown, value in zip(layout.unknowns, solution.point.unknowns, strict=True):
        start[prepared.layout.index[unknown.name]] = value
    return start


def _less_sure(record: Observation, creep: Creep | None) -> Observation:
    """Return a record whose angle is known no better than by its creep."""
    if creep is None or not creep.creeps:
        return record
    std = float(np.hypot(record.lines.phase_std, creep.angle))
    return record.with_lines(replace(record.lines, phase_std=std))


def _refuse_silence(records: Sequence[Observation]) -> None:
    """Refuse records whose sensors read nothing: any machine at rest fits them."""
    for record in records:
        columns = [sensor.column for sensor in record.sensors]
        if not np.abs(record.lines.mean[:, columns]).any():
            names = ", ".join(sensor.channel.name for sensor in record.sensors)
            raise InputError(
                f"zero on every line of {names}",
                "sensors that read the motion",
                "check their columns and cables",
                file=record.lines.source,
            )


def _globally(
    prepared: Prepared, records: Sequence[Observation], rough: Rough | None
) -> Iterator[Step]:
    """Look for the minimum from the start, and from others where there is reason.

    And for mistakes that are plain before thousands of lines are searched.
    """

    def fitted(found: Minimum, plain: Plain | None = None) -> Fit:
        return Fit(prepared, *found, tuple(records), plain=plain)

    problem, ends = _problem(prepared, records), list[Minimum]()
    if rough is not None and rough.leads(prepared.layout):
        problem = replace(problem, sketch=rough.problem, lowest=rough.lowest)
        ends += _near(problem, rough)
        for end in ends:
            yield Step(fitted(end), SEARCHING)
            if explained(*end):
                return
    if problem.sketch is not None:
        watch("looking for gross mistakes on few lines")
    found: Minimum | None = by_shown_speed(prepared, records, problem)
    plain = plainly(prepared, records, problem) if found is None else None
    if plain is not None:
        yield Step(fitted((plain.solution, plain.inference), plain))
        return
    start = _in_order(problem, prepared.layout.start, records)
    if found is None:
        for number, found in enumerate(search(problem, start), 1):
            yield Step(fitted(found), SEARCHING, min(number, WAYS), WAYS)
    if found is None or not (found[0].converged and explained(*found)):
        for other in _in_other_places(problem, start, records):
            found = other or found
            if found is not None:
                yield Step(fitted(found), "trying hidden parts in other places")
    ends += [found] if found is not None else []
    if not ends:
        raise NotConvergedError("no minimum was found from this start; give a nearer one")
    best = min(ends, key=lambda end: (not end[0].converged, end[0].point.cost))
    yield Step(fitted(best), "weighing the noise")


def _in_order(problem: Problem, start: Floats, records: Sequence[Observation]) -> Floats:
    """Return the start with hidden parts in the places that the bounds tell."""
    if not len(outside(problem.bounds, start)):
        return start
    mirrors = Mirrors.of(problem, records, start)
    return next(iter(mirrors.inside(problem.bounds, start)), start)


def _in_other_places(
    problem: Problem, start: Floats, records: Sequence[Observation]
) -> Iterator[Minimum | None]:
    """Yield None after each way, and the answer from a start with hidden parts in other places.

    Fixed values and bounds that tell the places shut a start with the parts in the wrong ones off.
    """
    fixed = [i for i, unknown in enumerate(problem.layout.unknowns) if unknown.fixed]
    for exchange in Mirrors.of(problem, records, start, as_free=True).exchanges:
        moved, found = exchange.of(start), None
        moved[fixed] = start[fixed]
        for lowest in search(problem, moved):
            found = lowest
            yield None
        if found is not None and found[0].converged and explained(*found):
            yield found
            return


def _near(problem: Problem, rough: Rough) -> list[Minimum]:
    try:
        found = settle(problem, rough.unknowns)
        found = replace(found, trail=rough.trail)
        return [(found, infer(found.point))]
    except np.linalg.LinAlgError:
        return []


def _problem(prepared: Prepared, records: Sequence[Observation]) -> Problem:
    problem, fewer = prepared.problem(records), thinned(records)
    return problem if fewer is None else replace(problem, sketch=prepared.problem(fewer))


def _solve(
    prepared: Prepared, records: Sequence[Observation], before: Solution, start: Floats
) -> tuple[Solution, Inference]:
    """Minimize again from near the minimum, with other noise or further unknowns."""
    problem, old = _problem(prepared, records), before.point.problem
    same = len(old.layout.unknowns) == len(prepared.layout.unknowns)
    if old.lowest is not None and same:
        problem = replace(problem, sketch=old.sketch, lowest=old.lowest)
    solution = settle(problem, start)
    if same:
        solution = replace(solution, trail=before.trail)
    return solution, infer(solution.point)


def _correlated(record: Observation, neighbours: int | None) -> Observation:
    """Take the covariance from neighbouring lines of the whole record, where there are periods."""
    scatter = record.lines.scatter
    if scatter is None:
        return record
    covariance = correlated_covariance(scatter, neighbours)
    return record.with_lines(replace(record.lines, covariance=covariance))


def _chosen(
    solution: Solution, records: Sequence[Observation], neighbours: int | None
) -> list[Observation]:
    """Take the correlated covariance where the residual of one period resembles the next."""
    chosen = []
    for record, at in zip(records, solution.point.records, strict=True):
        scatter = record.lines.scatter
        correlated = False
        if scatter is not None:
            residual = at.period_residual(scatter[:, :, at.problem.order])
            # Whitened rows are independent of one another: each counts as a line of its own.
            correlated = is_correlated(residual.reshape(len(residual), -1, 1))
        chosen.append(_correlated(record, neighbours) if correlated else record)
    return chosen


def starting_values(
    model: Model, records: Sequence[Observation], knowledge: Knowledge, base: bool
) -> dict[str, float]:
    """Return starting values by name: from batch where it applies, else the nominal ones.

    What only loads hold, the unbalance, is left to start from zero.
    """
    told = {*knowledge.fixed, *knowledge.known, *knowledge.start}
    physical = model.nominal
    loads = {
        model.parameter_names[i]
        for i in Layout(model, (), physical_factors(model), False).load_only()
    }
    if base:
        held = {n: v for n, v in knowledge.fixed.items() if n in model.parameter_names}
        return _base_guess(model.substitute(held), records, knowledge, physical)
    if not set(model.parameter_names) - loads <= told:
        found = _batch(model, records)
        if found is not None:
            values = physical_start(*found)
            for parameter, value in zip(model.parameters, values, strict=True):
                if np.isfinite(value) and (value > 0 or not parameter.positive):
                    physical[parameter.name] = float(value)
    return {name: value for name, value in physical.items() if name not in loads}


def _base_guess(
    model: Model,
    records: Sequence[Observation],
    knowledge: Knowledge,
    physical: Mapping[str, float],
) -> dict[str, float]:
    if set(model.base.names) <= set(knowledge.start):
        return {}
    found = _batch(model, records)
    if found is not None:
        return dict(zip(model.base.names, found[1].tolist(), strict=True))
    known = {**physical, **{n: v for n, v in knowledge.start.items() if n in model.parameter_names}}
    values = [known.get(name, np.nan) for name in model.parameter_names]
    return dict(zip(model.base.names, model.base_values(values).tolist(), strict=True))


def _batch(model: Model, records: Sequence[Observation]) -> tuple[Model, Floats] | None:
    """Return the base parameters by batch, or None where it does not apply."""
    if any(channel.drive is not None for record in records for channel in record.channels):
        return None
    try:
        _, solution = Batch().solve(model, records)
    except InputError:
        return None
    return (model, solution.values) if np.isfinite(solution.values).all() else None
