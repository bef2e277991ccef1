"""A fit as something to change, and the rival hypotheses that change it.

A case is a fit with what it was made of. Every change of it - a further unknown, a known value set
free, lines as they would be without a mistake - gives another case, which is minimized again from
near the estimate or from its starts. A rival hypothesis is such a change with a name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from typing import Any, Literal, TypeVar

import numpy as np

from rotorid.core.values import Floats, frozen
from rotorid.data.observation import Observation, Records, bind
from rotorid.likelihood.inference import infer
from rotorid.likelihood.preparation import rows_of_modes
from rotorid.likelihood.problem import Known, Point, Problem, inside, outside
from rotorid.likelihood.solver import STAGES, evaluated, few_steps, solve
from rotorid.likelihood.starts import thinned
from rotorid.likelihood.symmetric_answers import CLOSE
from rotorid.likelihood.unknowns import Unknown
from rotorid.models import Model
from rotorid.models.rotor.rotor_model import places_of, structure_of
from rotorid.models.structure import Structure

GROSS = 3.0
"""Cost over its expectation from which on mistakes that are no small changes are tried: no swap,
sign or unit of a channel that says anything costs less."""
COARSE = (10.0, 1.0)
"""Stages of a screening: errors as large as the mean force are granted to the end, with which a
few steps suffice. What is right still stands out: noise is a thousandth of the forces, a mistake is
as large as they are."""
STEPS = 6
"""Steps of a screening at each stage. What is right needs three or four, and the few per cent that
would be left to gain after six decide nothing."""
Way = Literal["near", "far", "both", "start"]
"""From where a case is minimized: where it is, its starts, both, or the first start alone."""


@frozen
class Case:
    """What was estimated: unknowns and relations, records, and where that led."""

    prepared: Problem
    records: tuple[Observation, ...]
    unknowns: Floats  # where it is; of a case with other records the minimum of nothing
    expected: float = 0.0  # cost that noise alone leaves of these records
    # physical parameters at the estimate, not finite where open; None before there is an estimate
    values: Floats | None = None
    found: Point | None = None  # the point at `unknowns`, where it was evaluated before
    like: Point | None = None  # a point of the same records, whose noise was factored

    @cached_property
    def problem(self) -> Problem:
        before = self.found or self.like
        alike = () if before is None else before.problem.likelihoods
        return self.prepared.of(self.records, alike)

    @cached_property
    def point(self) -> Point:
        return self.found or self.problem.at(self.unknowns, like=self.like)

    @property
    def gross(self) -> bool:
        """Whether the misfit is so large that a mistake may be no small change."""
        return self.costs(GROSS)

    def costs(self, times: float) -> bool:
        return self.point.cost > times * max(self.expected, 1.0)

    @property
    def model(self) -> Model:
        return self.prepared.layout.model

    @property
    def speed(self) -> float:
        """The largest of the records."""
        speeds = (float(v) for record in self.records for v in record.lines.speed)
        return max(speeds, key=abs, default=0.0)

    @cached_property
    def structure(self) -> Structure | None:
        return None if self.values is None else structure_of(self.model, self.values, self.speed)

    @cached_property
    def places(self) -> Structure | None:
        return None if self.values is None else places_of(self.model, self.values, self.speed)

    def plus(self, *added: Unknown, fixed: bool = False) -> Case:
        every, layout = self.prepared, self.prepared.layout
        scalars = tuple(scalar for unknown in added for scalar in unknown.scalars)
        if fixed:
            scalars = tuple(replace(scalar, std=0.0) for scalar in scalars)
        wider = replace(
            layout,
            unknowns=(*layout.unknowns, *scalars),
            nuisances=(*layout.nuisances, *added),
        )
        held, count = (every.exact, every.known.relations, every.bounds), len(wider.unknowns)
        exact, relations, bounds = (replace(each, unknowns=count) for each in held)
        known = Known(relations, rows_of_modes(wider, every.known.modes.modes, exact))
        prepared = replace(every, layout=wider, exact=exact, known=known, bounds=bounds)
        unknowns = np.concatenate([self.unknowns, [scalar.start for scalar in scalars]])
        return replace(self.prepared_as(prepared), unknowns=unknowns)

    def beside(self, added: Iterable[Unknown]) -> Point:
        """Return the point where it is with further unknowns, for their derivatives."""
        more = tuple(added)
        return self.plus(*more, fixed=True).point if more else self.point

    def freed(self, *names: str) -> Case:
        return self._anew({name: {"std": None} for name in names})

    def held(self, values: Mapping[str, float]) -> Case:
        return self._anew({name: {"start": at, "std": 0.0} for name, at in values.items()})

    def _anew(self, changes: Mapping[str, Mapping[str, Any]]) -> Case:
        layout, known = self.prepared.layout, self.prepared.known
        scalars = tuple(replace(u, **changes.get(u.name, {})) for u in layout.unknowns)
        for name in changes:
            known = known.without(name)
        layout = replace(layout, unknowns=scalars)
        return self.prepared_as(replace(self.prepared, layout=layout, known=known))

    def prepared_as(self, prepared: Problem) -> Case:
        return replace(self, prepared=prepared, found=None, like=self.point)

    def reading(self, records: Records) -> Case:
        return replace(self, records=tuple(records), found=None, like=None)

    def on_lines(self, few: int) -> Case:
        fewer = thinned(self.records, few)
        return self if fewer is None else self.reading(fewer)

    def on_model(self, whole: Model) -> Case:
        """Return the case with a model of the same parameters and other coordinates."""
        layout = replace(self.prepared.layout, model=whole)
        other = self.reading([bind(whole, record) for record in self.records])
        return replace(other, prepared=replace(self.prepared, layout=layout))

    def at(self, point: Point | None) -> Case | None:
        """Return the case at a minimum of its own; None where that is none."""
        with suppress(np.linalg.LinAlgError):
            if point is not None:
                expected = infer(point).expectation.mean
                return replace(self, unknowns=point.unknowns, found=point, expected=expected)
        return None

    def settled(self, way: Way = "near") -> Case | None:
        return self.at(self.minimized(way))

    def minimized(self, way: Way = "near") -> Point | None:
        here: list[tuple[Floats, Sequence[float]]] = [(self.unknowns, (0.0,))]
        afar: list[tuple[Floats, Sequence[float]]] = [(x, STAGES) for x in self._starts()]
        tried = {"near": here, "far": afar, "both": here + afar, "start": afar[:1]}[way]
        ends = [self._descended(start, stages) for start, stages in tried]
        return min((p for p in ends if p is not None), key=lambda p: p.cost, default=None)

    def _descended(self, start: Floats, stages: Sequence[float]) -> Point | None:
        """Return the minimum, found no better than a rival needs, or None where there is none."""
        with suppress(np.linalg.LinAlgError):
            point = solve(self.problem, start, stages, brief=True).point
            return point if np.isfinite(point.cost) else None
        return None

    def screened(self, most: float = np.inf) -> float:
        """Return the cost after a few steps from the starts, errors granted to the equations.

        What will cost more than `most` is not followed to the end.
        """
        with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
            return min(_screened(self.problem, x, most) for x in self._starts())
        return np.inf

    def _starts(self) -> list[Floats]:
        """Return the start, and the nominal values: what comes from records is as wrong as they."""
        layout, found = self.prepared.layout, [self.prepared.layout.start]
        nominal = layout.start.copy()
        for name, value in ({} if layout.base else layout.model.nominal).items():
            unknown = layout.unknowns[layout.index[name]]
            if not unknown.fixed and unknown.start != 0:
                nominal[layout.index[name]] = value
        if not np.allclose(nominal, layout.start, rtol=1e-3, atol=0.0):
            found.append(nominal)
        return found


def _screened(problem: Problem, start: Floats, most: float) -> float:
    """Return the cost after a few steps at each stage of a screening, at the bounds if beyond.

    All forces upside down are a rotor of negative mass: only its bounds tell it from the right one.
    """
    point = few_steps(problem, start, COARSE, STEPS, most)
    if not len(outside(problem.bounds, point.unknowns)):
        return point.cost
    size = np.abs(point.unknowns[problem.layout.free])
    within = inside(problem, point.unknowns, np.where(size > 0, size, 1.0))
    held = None if within is None else evaluated(problem, within, COARSE[-1])
    return np.inf if held is None else held.cost


Kind = Literal[
    "bound", "known", "term", "gain", "lag", "mistake", "unit", "speed", "omission", "errors"
]
"""What a rival says is otherwise: a limit; a value known beforehand; a term or an effect that
nobody thought of; a factor; a lag; what was read, in one way or another; a line that counts; much,
a little."""


@frozen
class Rival:
    """Another hypothesis about what was measured: a change of the case, and what to say of it."""

    term: str  # for people: ``swap[x1, y1]``; no code takes it apart
    says: str | Callable[[float | None], str]  # what is the matter, at its value
    cure: str
    change: Callable[[Case], Case]  # of a mistake, what undoes it
    value: float | Callable[[Point], float | None] | None = None  # what is right, in `unit`
    unit: str = ""
    on: tuple[str, ...] = ()  # channels, groups of them or records that it acts on, if on such
    kind: Kind = "mistake"
    way: Way = "far"  # from where it is minimized
    added: Unknown | None = None  # the unknown that it frees, where that is a further one
    # A small change is scored first, by the derivative: the unknowns that it frees, the value that
    # theirs come to, and what is no longer known.
    frees: tuple[str, ...] = ()
    size: Callable[[Floats], float] | None = None
    forgets: str = ""
    likely: Callable[[Point], bool] | None = None  # of a bound: whether it is a mistake by itself
    # from the case and the minimum that it leads to, to what says the same more exactly
    sharper: Callable[[Case, Point], Iterator[Rival]] = lambda case, point: iter(())

    @property
    def place(self) -> tuple[str, ...]:
        return self.on or (self.term,)

    def value_at(self, point: Point) -> float | None:
        if self.size is not None:
            return self.size(point.unknowns[point.problem.layout.where(*self.frees)])
        return self.value(point) if callable(self.value) else self.value

    def score(self, point: Point) -> tuple[float, float | None]:
        """Return the drop of the cost to first order, and the value after a step; see `beside`."""
        columns = np.column_stack([point.by(*self.frees), point.slack(self.forgets)])
        drop, step = point.linear.score(columns)
        if self.size is None:
            return drop, None
        at = point.problem.layout.where(*self.frees)
        return drop, self.size(point.unknowns[at] + step[: len(at)])


Entry = Callable[[Case], Iterator[Rival]]
E = TypeVar("E", bound=Entry)
CATALOGUE: dict[str, list[Entry]] = {}


def rivals(stage: str) -> Callable[[E], E]:
    """Enter a function that yields the rivals of a case, to be tried at a stage of the search."""

    def enter(entry: E) -> E:
        CATALOGUE.setdefault(stage, []).append(entry)
        return entry

    return enter


def freed(unknown: Unknown, kind: Kind = "term", on: tuple[str, ...] = ()) -> Rival:
    def instead(case: Case, point: Point) -> Iterator[Rival]:
        value = rival.value_at(point)
        if value is not None and point.cost >= case.expected + CLOSE:
            other = unknown.instead(value, case.model.inputs)
            yield from [] if other is None else [freed(other, "lag")]

    rival = Rival(
        unknown.term,
        unknown.said,
        unknown.cure,
        lambda case: case.plus(unknown),
        unit=unknown.unit,
        on=on or (tuple(unknown.on) if len(unknown.on) == 1 else ()),
        kind=kind,
        way="near",
        added=unknown,
        frees=tuple(scalar.name for scalar in unknown.scalars),
        size=unknown.size,
        sharper=instead,
    )
    return rival


def each_record(
    change: Callable[[Observation], Observation],
    of: Callable[[Observation], bool] = lambda record: True,
) -> Callable[[Case], Case]:
    """Return what changes each record of a case by itself; `of`: those of one kind."""
    return lambda case: case.reading([change(r) if of(r) else r for r in case.records])


def not_asked(case: Case, unknowns: Iterable[Unknown]) -> list[Unknown]:
    index = case.prepared.layout.index
    return [u for u in unknowns if not any(s.name in index for s in u.scalars)]
