"""A fit as something to change, and the rival hypotheses that change it.

A case is a fit with what it was made of. Every change of it - a further unknown, a known value set
free, lines as they would be without a mistake - gives another case, which is minimized again from
near the estimate or from its starts. A rival hypothesis is such a change with a name.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.core.values import Floats
from rotorid.data.observation import Observation
from rotorid.likelihood.effects import Reads, of_kind
from rotorid.likelihood.inference import infer
from rotorid.likelihood.layout import physical_factors
from rotorid.likelihood.linear import Linearized
from rotorid.likelihood.preparation import Prepared, generic
from rotorid.likelihood.problem import Known, Point, Problem, inside, outside
from rotorid.likelihood.relations import Monomials, Relations
from rotorid.likelihood.solver import STAGES, evaluated, few_steps, solve
from rotorid.likelihood.starts import moved, thinned
from rotorid.likelihood.symmetric_answers import CLOSE
from rotorid.likelihood.unknowns import Unknown
from rotorid.models import Model
from rotorid.models.rotor.rotor_model import structure_of
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

Records = Sequence[Observation]


@frozen
class Case:
    """What was estimated: unknowns and relations, records, and where that led."""

    prepared: Prepared
    records: tuple[Observation, ...]
    unknowns: Floats  # where `near` starts; of a case with other records the minimum of nothing
    expected: float = 0.0  # cost that noise alone leaves of these records
    # physical parameters at the estimate, not finite where open; None before there is an estimate
    values: Floats | None = None
    found: Point | None = None  # the point at `unknowns`, where it was evaluated before
    like: Point | None = None  # a point of the same records, whose noise was factored

    @cached_property
    def problem(self) -> Problem:
        before = self.found or self.like
        alike = () if before is None else before.problem.likelihoods
        return self.prepared.problem(self.records, alike)

    @cached_property
    def point(self) -> Point:
        return self.found or self.problem.at(self.unknowns, like=self.like)

    @property
    def gross(self) -> bool:
        """Whether the misfit is so large that a mistake may be no small change."""
        return self.costs(GROSS)

    def costs(self, times: float) -> bool:
        """Tell whether the cost is more than so many times what noise leaves."""
        return self.point.cost > times * max(self.expected, 1.0)

    @property
    def model(self) -> Model:
        return self.prepared.layout.model

    @cached_property
    def structure(self) -> Structure | None:
        """Springs, masses and axes of the model at the estimate, where it has any."""
        if self.values is None:
            return None
        speeds = (float(v) for record in self.records for v in record.lines.speed)
        return structure_of(self.model, self.values, max(speeds, key=abs, default=0.0))

    def plus(self, *added: Unknown) -> Case:
        starts = [scalar.start for unknown in added for scalar in unknown.scalars]
        unknowns = np.concatenate([self.unknowns, starts])
        return self._prepared(_extended(self.prepared, added), unknowns)

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
        return self._prepared(replace(self.prepared, layout=layout, known=known))

    def knowing(self, known: Known) -> Case:
        return self._prepared(replace(self.prepared, known=known))

    def without_bounds(self, rows: Collection[int]) -> Case:
        every = self.prepared
        kept = [i for i in range(len(every.bounds)) if i not in rows]
        bounds = every.bounds.subset(np.array(kept, dtype=np.int64))
        limits = tuple(every.limits[i] for i in kept)
        return self._prepared(replace(every, bounds=bounds, limits=limits))

    def _prepared(self, prepared: Prepared, unknowns: Floats | None = None) -> Case:
        at = self.unknowns if unknowns is None else unknowns
        return replace(self, prepared=prepared, unknowns=at, found=None, like=self.point)

    def reading(self, change: Callable[[Records], Records]) -> Case:
        return replace(self, records=tuple(change(self.records)), found=None, like=None)

    def on_lines(self, few: int) -> Case | None:
        """Return the case on some of the lines of its records; None where they have few."""
        fewer = thinned(self.records, few)
        return None if fewer is None else self.reading(lambda _: fewer)

    def on_model(self, whole: Model) -> Case:
        """Return the case with a model of the same parameters and other coordinates."""
        factors = physical_factors(whole)
        layout = replace(self.prepared.layout, model=whole, monomial_factors=factors)
        prepared = replace(self.prepared, layout=layout)
        other = self.reading(lambda records: [moved(record, whole) for record in records])
        return replace(other, prepared=prepared)

    def at(self, point: Point | None) -> Case | None:
        """Return the case at a minimum of its own; None where that is none."""
        if point is None:
            return None
        try:
            expected = infer(point).expectation.mean
        except np.linalg.LinAlgError:
            return None
        return replace(self, unknowns=point.unknowns, found=point, expected=expected)

    def near(self) -> Point | None:
        return self._minimized(self.unknowns, (0.0,))

    def far(self) -> Point | None:
        """Minimize from the starts, by the homotopy."""
        return _lowest([self._minimized(start, STAGES) for start in self._starts()])

    def from_start(self) -> Point | None:
        """Minimize from the start alone, by the homotopy."""
        return self._minimized(self.prepared.layout.start, STAGES)

    def both(self) -> Point | None:
        """Minimize from where it is and from the starts; return the lower end."""
        return _lowest([self.near(), self.far()])

    def _minimized(self, start: Floats, stages: Sequence[float]) -> Point | None:
        """Return the minimum, or None where the way leads nowhere.

        What leaves a misfit beyond all hope explains nothing: how much exactly is not found out.
        """
        try:
            with np.errstate(all="ignore"):
                point = solve(self.problem, start, stages, brief=True).point
        except np.linalg.LinAlgError:
            return None
        return point if np.isfinite(point.cost) else None

    def screened(self) -> float:
        """Return the cost after a few steps from the starts, errors granted to the equations."""
        try:
            with np.errstate(all="ignore"):
                return min(_screened(self.problem, x) for x in self._starts())
        except np.linalg.LinAlgError:
            return np.inf

    def _starts(self) -> list[Floats]:
        """Return the start, and the nominal values where it is not made of them.

        A start that comes from the records is as wrong as they are.
        """
        layout, found = self.prepared.layout, [self.prepared.layout.start]
        nominal = layout.start.copy()
        for name, value in ({} if layout.base else layout.model.nominal).items():
            unknown = layout.unknowns[layout.index[name]]
            if not unknown.fixed and unknown.start != 0:
                nominal[layout.index[name]] = value
        if not np.allclose(nominal, layout.start, rtol=1e-3, atol=0.0):
            found.append(nominal)
        return found


def _lowest(ends: Sequence[Point | None]) -> Point | None:
    return min((p for p in ends if p is not None), key=lambda p: p.cost, default=None)


def _extended(prepared: Prepared, added: Sequence[Unknown]) -> Prepared:
    """Return what is prepared with further unknowns behind the others."""
    layout = prepared.layout
    scalars = tuple(scalar for unknown in added for scalar in unknown.scalars)
    wider = replace(
        layout,
        unknowns=(*layout.unknowns, *scalars),
        nuisances=(*layout.nuisances, *added),
    )
    exact, relations, bounds = (
        _widened(r, len(scalars))
        for r in (prepared.exact, prepared.known.relations, prepared.bounds)
    )
    known = prepared.known.within(wider, relations, generic(wider, exact))
    return replace(prepared, layout=wider, exact=exact, known=known, bounds=bounds)


def _widened(relations: Relations, added: int) -> Relations:
    old = relations.monomials
    count = old.unknowns + added
    factors = np.where(old.factors == old.unknowns, count, old.factors)
    return replace(relations, monomials=Monomials(factors, count))


def _screened(problem: Problem, start: Floats) -> float:
    """Return the cost after a few steps at each stage of a screening, at the bounds if beyond.

    All forces upside down are a rotor of negative mass: only its bounds tell it from the right one.
    """
    point = few_steps(problem, start, COARSE, STEPS)
    if point is None or not len(outside(problem.bounds, point.unknowns)):
        return np.inf if point is None else point.cost
    size = np.abs(point.unknowns[problem.layout.free])
    within = inside(problem, point.unknowns, np.where(size > 0, size, 1.0))
    held = None if within is None else evaluated(problem, within, COARSE[-1])
    return np.inf if held is None else held.cost


Kind = Literal["bound", "known", "term", "gain", "lag", "mistake", "unit", "speed", "omission"]
"""What a rival says is otherwise: a limit; a value known beforehand; a term or an effect that
nobody thought of; a factor; a lag; what was read, in one way or another; a line that counts."""


@frozen
class Small:
    """The derivative by which a small change is scored before it is tried."""

    columns: Callable[[Slopes], Floats]  # of the whitened residual, by what is set free
    value: Callable[[Floats], float | None]  # from the first step of what is set free
    unknown: Unknown | None = None  # what is added


@frozen
class Rival:
    """Another hypothesis about what was measured: a change of the case, and what to say of it."""

    term: str  # for people: ``swap[x1, y1]``; no code takes it apart
    on: tuple[str, ...]  # channels, groups of them, records, or the term itself
    kind: Kind
    change: Callable[[Case], Case | None]
    # what is the matter, and what to do about it; at its value
    told: tuple[str, str] | Callable[[float | None], tuple[str, str]]
    value: float | Callable[[Point], float | None] | None = None  # what is right, in `unit`
    unit: str = ""
    way: Literal["near", "far", "both"] = "near"  # from where it is minimized
    small: Small | None = None  # it is scored first
    likely: Callable[[Point], bool] | None = None  # of a bound: whether it is a mistake by itself
    # from the case and the minimum that it leads to, to what says the same more exactly
    sharper: Callable[[Case, Point], Iterator[Rival]] | None = None

    @property
    def added(self) -> Unknown | None:
        """The unknown that it frees, where that is a further one."""
        return None if self.small is None else self.small.unknown

    def value_at(self, point: Point) -> float | None:
        return self.value(point) if callable(self.value) else self.value


@frozen
class Slopes:
    """The whitened residual at an estimate by all unknowns, fixed ones and rivals included."""

    point: Point  # the estimate, with the rivals fixed
    columns: Floats
    index: Mapping[str, int]
    known: Known

    @property
    def linear(self) -> Linearized:
        return self.point.linear

    @classmethod
    def turns(cls, case: Case, rivals: Sequence[Rival]) -> Iterator[tuple[Slopes, list[Rival]]]:
        """Yield the derivative by all unknowns that rivals add, evaluated once, and the rivals.

        Unknowns that exclude others of them have a turn of their own, and those that change what
        sensors read: with them the same residual is whitened in other rows.
        """
        turns: dict[tuple[bool, bool], list[Rival]] = {}
        for rival in rivals:
            added = rival.added
            turn = added and (bool(added.alternative_to), any(of_kind(Reads, added.effects)))
            turns.setdefault(turn or (False, False), []).append(rival)
        for among in turns.values():
            yield cls.of(case, [rival.added for rival in among if rival.added]), among

    @classmethod
    def of(cls, case: Case, added: Sequence[Unknown]) -> Slopes:
        """Evaluate the derivative by all unknowns of a case, and by further ones."""
        fixed = [replace(u, scalars=tuple(replace(s, std=0.0) for s in u.scalars)) for u in added]
        wide = case.plus(*fixed) if fixed else case
        known = wide.point.problem.known
        rows = [record.jacobian() for record in wide.point.records]
        columns = np.concatenate([*rows, known.jacobian(wide.unknowns)])
        index = {u.name: k for k, u in enumerate(wide.prepared.layout.unknowns)}
        return cls(wide.point, columns, index, known)

    def by(self, *names: str) -> Floats:
        return self.columns[:, [self.index[name] for name in names]]

    def slack(self, text: str) -> Floats:
        """Return the columns that take what is known of something out of the residual."""
        known, count = self.known, len(self.columns)
        rows = [i for i, each in enumerate(known.texts) if each == text]
        columns = np.zeros((count, len(rows)))
        columns[[count - len(known) + i for i in rows], range(len(rows))] = 1.0
        return columns


Entry = Callable[[Case], Iterator[Rival]]
CATALOGUE: dict[str, list[Entry]] = {}


def rivals(stage: str) -> Callable[[Entry], Entry]:
    """Enter a function that yields the rivals of a case, to be tried at a stage of the search."""

    def enter(entry: Entry) -> Entry:
        CATALOGUE.setdefault(stage, []).append(entry)
        return entry

    return enter


def freed(
    unknown: Unknown,
    kind: Kind = "term",
    *,
    on: tuple[str, ...] | None = None,
) -> Rival:
    """Return the rival that an unknown is not what it is taken for."""
    names = [scalar.name for scalar in unknown.scalars]
    start = np.array([scalar.start for scalar in unknown.scalars])

    def value(point: Point) -> float:
        index = point.problem.layout.index
        return unknown.size(point.unknowns[[index[name] for name in names]])

    def instead(case: Case, point: Point) -> Iterator[Rival]:
        misfit = point.cost >= case.expected + CLOSE
        other = unknown.instead(value(point), case.model.inputs) if misfit else None
        if other is not None:
            yield freed(other, "lag")

    alone = tuple(unknown.on) if len(unknown.on) == 1 else (unknown.term,)
    return Rival(
        unknown.term,
        on or alone,
        kind,
        lambda case: case.plus(unknown),
        unknown.told,
        value,
        unknown.unit,
        small=Small(
            lambda slopes: slopes.by(*names),
            lambda step: unknown.size(start + step),
            unknown,
        ),
        sharper=instead,
    )


def mistake(
    term: str,
    on: tuple[str, ...],
    said: str,
    cure: str,
    change: Callable[[Records], Records],
    value: float | None = None,
    unit: str = "",
    kind: Kind = "mistake",
) -> Rival:
    """Return the rival that records were made with a mistake; `change` undoes it."""
    return Rival(
        term, on, kind, lambda case: case.reading(change), (said, cure), value, unit, way="far"
    )


def each_record(
    change: Callable[[Observation], Observation],
    of: Callable[[Observation], bool] = lambda record: True,
) -> Callable[[Records], list[Observation]]:
    """Return what changes each record by itself; `of`: those of one kind."""
    return lambda records: [change(record) if of(record) else record for record in records]
