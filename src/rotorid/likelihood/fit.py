"""From records to the minimum of their likelihood."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from rotorid.answer.derived import physical_start
from rotorid.core.errors import InputError, NotConvergedError
from rotorid.core.notes import Note
from rotorid.core.values import Floats, frozen
from rotorid.core.watch import watch
from rotorid.data.observation import Observation, Records, bind
from rotorid.likelihood.case import Case
from rotorid.likelihood.doubts_angle import Creep, creeps
from rotorid.likelihood.inference import (
    Inference,
    SharedNoise,
    by_equation_errors,
    in_common,
    infer,
    shared_noise,
)
from rotorid.likelihood.layout import Layout
from rotorid.likelihood.other_answers import questioned
from rotorid.likelihood.preparation import prepare
from rotorid.likelihood.problem import Point, Problem, outside
from rotorid.likelihood.rivals import Plain, plainly
from rotorid.likelihood.solver import Interrupted, Solution, settle, solve
from rotorid.likelihood.starts import (
    FINER,
    NEGLIGIBLE,
    ROUGH,
    SHARE,
    STARTS,
    WAYS,
    reduced,
    search,
    shift_by_reduction,
    thinned,
)
from rotorid.likelihood.symmetric_answers import Mirrors
from rotorid.likelihood.unknowns import Nuisances, unknowns_of
from rotorid.linear.estimators import Batch
from rotorid.models import Model
from rotorid.models.knowledge import Knowledge
from rotorid.signals.covariance import correlated_covariance, is_correlated

CovarianceChoice = Literal["auto", "white", "correlated"]


@frozen
class Fit:
    solution: Solution
    inference: Inference  # that of the solution, or what was made of it
    records: tuple[Observation, ...]  # with the covariance that was chosen
    notes: tuple[Note, ...] = ()  # why it may not be the answer, and which signs no record tells
    alternatives: tuple[Point, ...] = ()  # other minima that fit as well
    creeps: tuple[Creep | None, ...] = ()  # how the rotation of each record moves against its angle
    plain: Plain | None = None  # what the search itself came upon that is plainly wrong
    shared: SharedNoise | None = None  # noise that sensors share, by which deviations were widened

    @property
    def problem(self) -> Problem:
        return self.solution.point.problem

    @property
    def layout(self) -> Layout:
        return self.problem.layout

    @property
    def covariance(self) -> Floats:
        layout, free = self.layout, self.layout.free
        covariance = np.zeros((len(layout.unknowns), len(layout.unknowns)))
        covariance[np.ix_(free, free)] = self.inference.covariance
        return covariance

    @property
    def std(self) -> Floats:
        """Deviation of every unknown: 0 where fixed, NaN where the records do not determine it."""
        layout, inference = self.layout, self.inference
        std = np.zeros(len(layout.unknowns))
        std[layout.free] = np.where(inference.linear.undetermined, np.nan, inference.std)
        return std

    @cached_property
    def case(self) -> Case:
        """What was estimated; values of the model fitted, NaN where base parameters do not tell."""
        layout, point = self.layout, self.solution.point
        if layout.base:
            values = physical_start(layout.model, point.unknowns[: layout.parameters])
        else:
            values = point.unknowns[layout.of_record(0).held]
        expected = self.inference.expectation.mean
        return Case(self.problem, self.records, point.unknowns, expected, values, point)


FIRST = "looking for the first minimum"  # done at first; what is behind it was interrupted there
SEARCHING = "trying further starts"  # what comes next while the minimum is looked for
DOUBTING = "asking what may be wrong"  # what comes last
FEW = 120  # lines on which a rotor of few shapes is found: usually six times as many as unknowns
NEAR = 500  # lines from which shapes are taken again: all lines move no unknown much further then
REDRAWN = 3  # times that a rotor is divided anew; its sensors then sit where they are
ROUGHLY = 1e-4  # share of its cost left to gain there: the shapes that it lacks move it further


@frozen
class Rough:
    """The minimum of a simpler problem in the same unknowns, near which that of the whole is."""

    problem: Problem  # the simpler one: ways from other starts are led by it too
    found: Solution
    unknowns: Floats  # (unknown,): its minimum, or what is nearer to that of the whole

    @classmethod
    def of(cls, fit: Fit, before: Rough | None) -> Rough:
        unknowns, index = fit.solution.point.unknowns, fit.layout.index
        if before is None:
            return cls(fit.problem.sketch or fit.problem, fit.solution, unknowns)
        return replace(before, unknowns=unknowns[[index[n] for n in before.problem.layout.index]])

    @property
    def values(self) -> dict[str, float]:
        return dict(zip(self.problem.layout.index, self.unknowns.tolist(), strict=True))


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
    def found(self) -> str:
        cost, expected = self.fit.solution.point.cost, self.fit.inference.expectation.mean
        return f"misfit {cost:.4g}, {expected:.4g} expected from noise"

    @property
    def best(self) -> Fit:
        return self.fit if self.refine is None else answered(self.refine(self.fit), ask=False)


@frozen
class Fitting:
    model: Model
    knowledge: Knowledge[float]
    nuisances: Nuisances
    base: bool = False
    covariance: CovarianceChoice = "auto"
    neighbours: int | None = None
    effort: int = 1

    def steps(self, bound: Records) -> Iterator[Step]:
        """Yield the best so far, the last with the answer.

        Where the model is reduced, until the whole one would not move the estimate.
        """
        records, rough, share = bound, None, SHARE
        if bound and not self.base:
            known = {name: pair[0] for name, pair in self.knowledge.known.items()}
            values = {**known, **self.knowledge.start, **self.knowledge.fixed}
            records = reduced(bound, values, self.knowledge.modes, ROUGH)
        if records and records[0].model is not self.model:
            try:
                rough = self.approached(records, bound)
            except Interrupted as stop:
                yield from _reached(self.prepared(records), records, stop)
                raise
            records = reduced(bound, values if rough is None else rough.values, share=share)
        drawings = REDRAWN
        while True:
            at = yield from self.located(records, rough)
            whole = not records or records[0].model is bound[0].model
            if whole or _stands(at):
                answer = answered(at)
                if whole or answer.solution is at.solution or _stands(answer):
                    drawn = _redrawn(bound, answer) if drawings else bound
                    if drawn is bound:
                        yield Step(answer, DOUBTING)
                        return
                    bound, drawings = drawn, drawings - 1
                at = answer
            rough = Rough.of(at, rough)
            share *= FINER
            records = reduced(bound, rough.values, share=share)

    def prepared(self, records: Records) -> Problem:
        _refuse_silence(records)
        model = records[0].model if records else self.model
        guess = starting_values(model, records, self.knowledge, self.base)
        unknowns = unknowns_of(records, self.nuisances)
        problem = prepare(model, self.knowledge, unknowns, self.base, guess)
        problem = replace(problem, effort=self.effort)
        if records and not len(problem.layout.free):
            raise InputError("every parameter fixed", "something to estimate", "free one")
        return problem

    def approached(self, records: Records, bound: Records) -> Rough | None:
        """Follow the homotopy once with few shapes on few lines; None where it leads nowhere."""
        watch("finding a rotor of fewer shapes")

        def posed(chosen: Records, few: int) -> Problem:
            chosen = thinned(chosen, few, periodic=True) or chosen
            return replace(self.prepared(chosen).of(chosen), tolerance=ROUGHLY)

        try:
            problem = posed(records, FEW)
            found = solve(problem, problem.layout.start)
            if not found.converged:
                return None
            rough = Rough(problem, found, found.point.unknowns)
            nearer = settle(posed(reduced(bound, rough.values), NEAR), rough.unknowns)
        except np.linalg.LinAlgError:
            return None
        return replace(rough, unknowns=nearer.point.unknowns) if nearer.converged else rough

    def located(self, records: Records, rough: Rough | None = None) -> Generator[Step, None, Fit]:
        if self.covariance == "correlated":
            records = _correlated(records, self.neighbours)
        prepared, step = self.prepared(records), None
        try:
            for step in _globally(prepared, records, rough):
                yield replace(step, refine=self.refined)
        except Interrupted as stop:
            if step is None:
                yield from _reached(prepared, records, stop)
            raise
        assert step is not None  # or there is no minimum, which is said
        found = self.refined(step.fit)
        yield Step(found, refine=lambda found: found)
        return found

    def refined(self, found: Fit) -> Fit:
        """Choose the covariance by what is left at a minimum, and let rotor angles creep."""
        if self.covariance == "auto" and found.plain is None:
            chosen = _correlated(found.records, self.neighbours, found.solution)
            if any(new is not old for new, old in zip(chosen, found.records, strict=True)):
                again = _again(found.problem, chosen, found.solution)
                found = Fit(again, again.inference, tuple(chosen))
        crept = creeps(found.solution.point, found.records)
        if not any(c is not None and c.creeps for c in crept):
            return replace(found, creeps=crept)
        loose = list(found.records)
        for number, creep in enumerate(crept):
            if creep is not None and creep.creeps:  # the angle is known no better than by that
                lines = loose[number].lines
                std = float(np.hypot(lines.phase_std, creep.angle))
                loose[number] = loose[number].with_lines(replace(lines, phase_std=std))
        again = _again(self.prepared(loose), loose, found.solution)
        return Fit(again, again.inference, tuple(loose), creeps=crept, plain=found.plain)


def _reached(prepared: Problem, records: Records, stop: Interrupted) -> Iterator[Step]:
    """Yield where an interrupted way has led, before there is a minimum."""
    if len(stop.unknowns) == len(prepared.layout.unknowns):
        with suppress(np.linalg.LinAlgError):
            at = prepared.of(records).best_at(stop.unknowns)
            still = (None,) * len(records)
            yield Step(Fit(Solution(at, False, 0), infer(at), tuple(records), creeps=still), FIRST)


def _redrawn(bound: Records, found: Fit) -> Records:
    """Return the records of a rotor that is divided where its sensors turn out to sit."""
    if not bound or found.layout.base:
        return bound
    model = bound[0].model
    values = found.solution.point.unknowns[found.layout.of_record(0).held]
    other = model.redrawn(dict(zip(model.parameter_names, values.tolist(), strict=True)))
    return bound if other is model else tuple(bind(other, record) for record in bound)


def _stands(found: Fit) -> bool:
    """Tell whether the whole rotor would not move what was found with a reduced one."""
    covariance = found.inference.covariance
    return shift_by_reduction(found.solution.point, covariance, found.records) <= NEGLIGIBLE


def answered(found: Fit, *, ask: bool = True) -> Fit:
    """Return a minimum with its deviations, after asking whether it is the answer."""
    solution, inference, answers = found.solution, found.inference, found.alternatives
    notes: list[Note] = []
    mirrors = Mirrors.of(found.problem, found.records, solution.point.unknowns)
    turned = mirrors.best(solution) if found.plain is None else solution
    if turned is not solution:
        solution, inference = turned, turned.inference
    # Where noise does not explain the cost, the model is wrong, and its leads come first.
    if ask and solution.converged and inference.explained:
        solution, inference, answers, notes = questioned(solution, mirrors)
    inference = by_equation_errors(inference, solution.point, found.records)
    unsure = any(at.problem.noise.shrunk > 0 for at in solution.point.records)
    if unsure and 0 < (mean := inference.expectation.mean) < inference.cost:
        # The misfit tells the size of the noise as well as two or three periods' scatter does.
        wider = inference.covariance * (inference.cost / mean)
        inference = replace(inference, covariance=wider)
    common = None
    if solution.converged and inference.explained:
        common = shared_noise(solution.point, inference, found.records)
        inference = in_common(solution.point, inference, found.records)
    if common is not None:
        inference = replace(inference, covariance=common.covariance)
    notes += mirrors.notes(solution, inference) if solution.converged else []
    answer = replace(found, solution=solution, inference=inference, notes=tuple(notes))
    return replace(answer, alternatives=answers, shared=common)


def _refuse_silence(records: Records) -> None:
    """Refuse records whose sensors read nothing: any machine at rest fits them."""
    for record in records:
        columns = [sensor.column for sensor in record.sensors]
        if not np.abs(record.lines.mean[:, columns]).any():
            names = ", ".join(sensor.channel.name for sensor in record.sensors)
            told, cure = f"zero on every line of {names}", "check their columns and cables"
            raise InputError(told, "sensors that read the motion", cure, file=record.lines.source)


def _globally(prepared: Problem, records: Records, rough: Rough | None) -> Iterator[Step]:
    """Look for plain mistakes, then for the minimum, from the start and with reason from others."""

    def step(found: Solution, *said: Any, plain: Plain | None = None) -> Step:
        return Step(Fit(found, found.inference, tuple(records), plain=plain), *said)

    problem, ends = _problem(prepared, records), list[Solution]()
    if rough is not None and rough.problem.layout.index == prepared.layout.index:
        problem = replace(problem, sketch=rough.problem, lowest=rough.found.point)
        with suppress(np.linalg.LinAlgError):
            near = replace(settle(problem, rough.unknowns), trail=rough.found.trail)
            explained = near.inference.explained
            ends.append(near)
            yield step(near, SEARCHING)
            if explained:
                return
    if problem.sketch is not None:
        watch("looking for gross mistakes on few lines")
    found: Solution | None = None
    if (plain := plainly(prepared, records, problem)) is not None:
        yield step(plain.solution, plain=plain)
        return
    start = prepared.layout.start
    if len(outside(problem.bounds, start)):  # of hidden parts in other places than they tell
        moved = (exchange.of(start) for exchange in Mirrors.of(problem, records, start).exchanges)
        start = next((x for x in moved if not len(outside(problem.bounds, x))), start)
    ways = WAYS + STARTS * problem.effort
    for number, found in enumerate(search(problem, start), 1):
        yield step(found, SEARCHING, min(number, ways), ways)
    if found is None or not (found.converged and found.inference.explained):
        for other in _in_new_places(problem, start, records):
            found = other or found
            if found is not None:
                yield step(found, "trying hidden parts in other places")
    ends += [found] if found is not None else []
    if not ends:
        raise NotConvergedError("no minimum was found from this start; give a nearer one")
    best = min(ends, key=lambda end: (not end.converged, end.point.cost))
    yield step(best, "weighing the noise")


def _in_new_places(problem: Problem, start: Floats, records: Records) -> Iterator[Solution | None]:
    """Yield None after each way, and the answer from a start with hidden parts in other places.

    Fixed values and bounds that tell the places shut a start with the parts in the wrong ones off.
    """
    fixed = [i for i, unknown in enumerate(problem.layout.unknowns) if unknown.fixed]
    alike = {exchange.places for exchange in Mirrors.of(problem, records, start).exchanges}
    for exchange in Mirrors.of(problem, records, start, as_free=True).exchanges:
        moved, found = exchange.of(start), None
        if exchange.places in alike and not len(outside(problem.bounds, moved)):
            continue  # the same problem, with the same ways
        moved[fixed] = start[fixed]
        for lowest in search(problem, moved):
            found = lowest
            yield None
        if found is not None and found.converged and found.inference.explained:
            yield found
            return


def _problem(prepared: Problem, records: Records) -> Problem:
    problem, fewer = prepared.of(records), thinned(records)
    return problem if fewer is None else replace(problem, sketch=prepared.of(fewer))


def _again(prepared: Problem, records: Records, before: Solution) -> Solution:
    """Minimize again from near a minimum, with other noise or further unknowns."""
    problem, old, layout = _problem(prepared, records), before.point.problem, prepared.layout
    start = layout.start.copy()
    start[[layout.index[u.name] for u in old.layout.unknowns]] = before.point.unknowns
    same = len(old.layout.unknowns) == len(layout.unknowns)
    if old.lowest is not None and same:
        problem = replace(problem, sketch=old.sketch, lowest=old.lowest)
    solution = settle(problem, start)
    return replace(solution, trail=before.trail) if same else solution


def _correlated(records: Records, neighbours: int | None, at: Solution | None = None) -> Records:
    """Take the covariance from neighbouring lines of the whole record, where there are periods.

    With a solution, only where the residual of one period resembles the next.
    """
    found = list(records)
    for number, record in enumerate(records):
        if (scatter := record.lines.scatter) is None:
            continue
        if at is not None:
            there = at.point.records[number]
            residual = there.period_residual(scatter[:, :, there.problem.order])
            # Whitened rows are independent of one another: each counts as a line of its own.
            if not is_correlated(residual.reshape(len(residual), -1, 1)):
                continue
        covariance = correlated_covariance(scatter, neighbours)
        found[number] = record.with_lines(replace(record.lines, covariance=covariance))
    return found


def starting_values(
    model: Model, records: Records, knowledge: Knowledge[float], base: bool
) -> dict[str, float]:
    """Return starts by name, of batch or nominal; what loads alone hold is left out, to be zero."""
    nominal = model.nominal
    if base:
        model = model.substitute(knowledge.held(model))
        names = model.base.names
        if {*names} <= knowledge.start.keys():
            return {}
        if (found := _batch(model, records)) is None:
            known = {**nominal, **knowledge.start}
            found = model.base_values([known.get(name, np.nan) for name in model.parameter_names])
        return dict(zip(names, found.tolist(), strict=True))
    loads = {model.parameter_names[i] for i in Layout(model, ()).load_only()}
    told = {*loads, *knowledge.fixed, *knowledge.known, *knowledge.start}
    found = None if {*model.parameter_names} <= told else _batch(model, records)
    if found is not None:
        values = physical_start(model, found)
        for parameter, value in zip(model.parameters, values.tolist(), strict=True):
            if np.isfinite(value) and (value > 0 or not parameter.positive):
                nominal[parameter.name] = value
    return {name: value for name, value in nominal.items() if name not in loads}


def _batch(model: Model, records: Records) -> Floats | None:
    if any(channel.drive is not None for record in records for channel in record.channels):
        return None
    try:
        _, solution = Batch().solve(model, records)
    except InputError:
        return None
    return solution.values if np.isfinite(solution.values).all() else None
