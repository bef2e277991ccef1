"""From a model, records and what is known beforehand to the `Layout` and its relations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rotorid.core.errors import InputError, require_names
from rotorid.likelihood.layout import Layout
from rotorid.likelihood.mode_rows import ModalRows, configuration
from rotorid.likelihood.problem import Known, Problem, retract
from rotorid.likelihood.relations import Limit, Polynomial, Relation, Relations
from rotorid.likelihood.unknowns import Scalar, Unknown
from rotorid.models import Model
from rotorid.models.knowledge import (
    Constraint,
    Knowledge,
    Mode,
    base_row,
    configurations,
    constraint_polynomial,
)

GENERIC = 0.2  # relative change of unknowns after which frequencies that coincide do so always
GENERATOR = 4711  # the fixed number from which that change is drawn
EXACT = 1e-12  # share of a value below which its deviation is lost in rounding of what it weighs
CONTRADICTED = 5.0
"""Deviations beyond which a fixed value contradicts a constraint in which nothing is free: chance
in a million; it would add its square to any misfit."""


def prepare(
    model: Model,
    knowledge: Knowledge[float],
    nuisances: Sequence[Unknown],
    base: bool,
    guess: Mapping[str, float],
) -> Problem:
    """Lay out the unknowns and write what is known as relations; no records are in it yet."""
    held = knowledge.held(model) if base else {}
    layout = Layout(model, (), base, tuple(nuisances))
    _check(layout, knowledge)
    layout = replace(layout, model=model.substitute(held))
    layout = replace(layout, unknowns=_unknowns(layout, knowledge, guess))
    count = len(layout.unknowns)
    stated, bounds = (Relations(tuple(k(layout, knowledge)), count) for k in (_known, _bounds))
    exact = stated.where(lambda row: not row.std)
    weighed = stated.where(lambda row: row.std > 0)
    _check_relations(layout, exact)
    _refuse_contradicted(layout, weighed, bounds)
    modes = rows_of_modes(layout, knowledge.modes, exact)
    return Problem(layout, exact, Known(weighed, modes), bounds, substituted=held)


def _unknowns(
    layout: Layout, knowledge: Knowledge[float], guess: Mapping[str, float]
) -> tuple[Scalar, ...]:
    """Return all unknowns with their starts: zero for an unbalance of which nothing is said."""
    model = layout.model
    if layout.base:
        named = [(*each, False) for each in zip(model.base.names, model.base.units, strict=True)]
    else:
        named = [(p.name, p.unit, p.positive) for p in model.parameters]
    scalars = [
        Scalar(name, unit, guess.get(name, np.nan), nuisance=False, positive=positive)
        for name, unit, positive in named
    ]
    scalars += [scalar for nuisance in layout.nuisances for scalar in nuisance.scalars]
    loads, own = layout.load_only(), {at: effect.parameter for _, effect, at in layout.replaced}
    found: list[Scalar] = []
    for i, scalar in enumerate(scalars):
        if i in own and scalar.std is None:
            scalar = replace(found[own[i]], name=scalar.name)
        scalar = _informed(scalar, knowledge)
        unsaid = i in loads and np.isnan(scalar.start)
        found.append(replace(scalar, start=0.0) if unsaid else scalar)
    for i in layout.idle:  # no record uses it, and nothing may depend on it
        found[i] = replace(found[i], start=1.0, std=0.0)
    if missing := [u.name for u in found if np.isnan(u.start)]:
        told = f"no start of {', '.join(missing)}"
        expected = "a starting value of every parameter, where some coordinates are not measured"
        cure = "give start (in the experiment file) or nominal (in the model file)"
        raise InputError(told, expected, cure, place=f"parameters.{missing[0]}")
    if wrong := [u.name for u in found if u.positive and not u.fixed and u.start <= 0]:
        told = f"a start of {wrong[0]} that is not positive"
        expected = "a positive number, as the model declares"
        cure = "start above 0, or take positive out of the model"
        raise InputError(told, expected, cure, place=f"parameters.{wrong[0]}")
    return tuple(found)


def _informed(unknown: Scalar, knowledge: Knowledge[float]) -> Scalar:
    name = unknown.name
    if name in knowledge.fixed:
        return replace(unknown, start=float(knowledge.fixed[name]), std=0.0)
    if name in knowledge.known:
        value, std = (float(x) for x in knowledge.known[name])
        unknown = replace(unknown, prior=value, std=std, start=value)
    if name in knowledge.start:
        unknown = replace(unknown, start=float(knowledge.start[name]))
    return unknown


def _check(layout: Layout, knowledge: Knowledge[float]) -> None:
    """Refuse names that are none, values that say nothing, and what base parameters cannot use."""
    parameters = layout.model.parameter_names
    extra = (scalar.name for nuisance in layout.nuisances for scalar in nuisance.scalars)
    names = sorted({*parameters, *extra})
    for key in ("fixed", "known", "start"):
        given: Mapping[str, Any] = getattr(knowledge, key)
        if not (layout.base and key == "start"):  # names of base parameters
            require_names(given, names, f"{{}} in {key}", place=key)
        for name, value in given.items():
            numbers = np.atleast_1d(np.asarray(value, dtype=float))
            known, std = key == "known", float(numbers[-1])
            said = None
            if not np.isfinite(numbers).all():
                said = f"{value} for {name}", "finite numbers", "give numbers, or leave it out"
            elif known and (len(numbers) != 2 or std <= 0):
                expected = "a value and a deviation of more than 0"
                said = f"{value} for {name}", expected, "give both, or fix the value"
            elif known and std < EXACT * abs(numbers[0]):
                said = (
                    f"a deviation of {std:g} of {name} = {numbers[0]:g}",
                    f"more than {EXACT:g} of the value: less is lost in rounding",
                    f"write fixed in place of value and std of {name}, if it is exact",
                )
            if said:
                raise InputError(*said, place=key)
    if twice := sorted(knowledge.fixed.keys() & knowledge.known.keys()):
        raise InputError(f"{twice[0]} both fixed and with a deviation", "one of them", "drop one")
    if layout.base:
        _refuse_physical(layout, knowledge)


def _refuse_physical(layout: Layout, knowledge: Knowledge[float]) -> None:
    asked = "where base parameters are asked for"
    if layout.replaced:
        told = f"{layout.nuisances[0].term}, a parameter that differs between records"
        cure = "estimate the physical parameters, or each record by itself"
        raise InputError(told, f"the same parameters in every record, {asked}", cure)
    if known := sorted(knowledge.known.keys() & {*layout.model.parameter_names}):
        cure = "estimate the physical parameters"
        raise InputError(f"a deviation of {known[0]}", f"fixed values, {asked}", cure)
    if knowledge.bounds:
        raise InputError("bounds", f"none, {asked}", "drop them")


def _known(layout: Layout, knowledge: Knowledge[float]) -> Iterator[Relation]:
    for i, unknown in enumerate(layout.unknowns):
        if unknown.std:
            yield Relation({(i,): 1.0, (): -unknown.prior}, unknown.name, unknown.std)
    for constraint in knowledge.constraints:
        value, std = constraint.in_si
        for polynomial in _polynomials(layout, constraint):
            yield Relation(polynomial, f"{constraint.expression} = {value:g}", std)


def _polynomials(layout: Layout, constraint: Constraint) -> list[Polynomial]:
    """Return a constraint, or that of each record where every one has a value to itself."""
    if layout.base:
        row, value = base_row(layout.model, constraint)
        return [{(): -value} | {(i,): x for i, x in enumerate(row.tolist()) if x}]
    terms = constraint_polynomial(layout.model, constraint.expression)
    polynomial = {
        tuple(i for i, power in enumerate(powers) for _ in range(power)): coefficient
        for powers, coefficient in terms.items()
    }
    polynomial[()] = polynomial.get((), 0.0) - constraint.in_si[0]
    if not any(i in layout.idle for product in polynomial for i in product):
        return [polynomial]
    found: list[Polynomial] = []
    for number in sorted({record for record, _, _ in layout.replaced}):
        own = {i: at for i, at in layout.of_record(number).own.items() if i in layout.idle}
        moved = {tuple(sorted(own.get(i, i) for i in m)): c for m, c in polynomial.items()}
        found.append(moved)
    return found


def _bounds(layout: Layout, knowledge: Knowledge[float]) -> Iterator[Relation]:
    for i, unknown in enumerate(layout.unknowns):
        if unknown.positive and not unknown.fixed:
            yield Relation({(i,): 1.0, (): 0.0}, Limit(unknown.name, 1.0, 0.0))
    for expression, (lower, upper) in knowledge.bounds.items():
        positive = any(u.name == expression and u.positive for u in layout.unknowns)
        least = max(-np.inf if lower is None else lower, 0.0 if positive else -np.inf)
        if upper is not None and least >= upper:
            said = ", which the model calls positive" if positive and least == 0 else ""
            told = f"{expression} from {least:g} to {upper:g}{said}"
            expected = "a lower bound below the upper one"
            cure = "exchange them, or correct one; for an exact value write fixed, or value alone"
            raise InputError(told, expected, cure, place=f"bounds of {expression[:60]!r}")
        for limit, way in ((lower, 1.0), (upper, -1.0)):
            constraint = Constraint(expression, limit or 0.0)
            for polynomial in [] if limit is None else _polynomials(layout, constraint):
                signed = {powers: way * c for powers, c in polynomial.items()}
                yield Relation(signed, Limit(expression, way, constraint.in_si[0]))


def _check_relations(layout: Layout, exact: Relations) -> None:
    if not len(exact):
        return
    anywhere = np.where(layout.start != 0, layout.start, 1.0)
    normal = (exact.jacobian(anywhere) * np.abs(anywhere))[:, layout.free]
    length = np.sqrt((normal**2).sum(axis=1))
    idle = np.flatnonzero(length == 0)
    if idle.size:
        told = f"the constraint {exact.texts[idle[0]]!r}, which holds no free parameter"
        cure = "drop it, or free one of its parameters"
        raise InputError(told, "a relation between free parameters", cure, place="constraints")
    values = np.linalg.svd(normal / length[:, None], compute_uv=False)
    if len(exact) > normal.shape[1] or values[-1] < 1e-9 * values[0]:
        told, cure = "constraints that repeat or contradict one another", "drop one"
        raise InputError(told, "independent constraints", cure, place="constraints")


def _refuse_contradicted(layout: Layout, known: Relations, bounds: Relations) -> None:
    unknowns = layout.unknowns
    told = np.array([u.start if u.std is None or u.fixed else u.prior for u in unknowns])
    anywhere = np.where(told != 0, told, 1.0)  # where no derivative is zero by chance
    fixed = np.array([u.fixed for u in unknowns])
    stated = np.array([u.std is not None for u in unknowns])  # with a deviation or without
    for relations, off, most in (
        (known, np.abs(known.values(told)), CONTRADICTED),
        (bounds, -bounds.values(told), 0.0),
    ):
        held_by = relations.jacobian(anywhere) != 0
        for row in np.flatnonzero(off > most):
            at = np.flatnonzero(held_by[row])
            outside = relations is bounds and stated[at].all() and len(at) == 1
            if outside or fixed[at].all():
                listed = ", ".join(f"{unknowns[i].name} = {told[i]:g}" for i in at)
                way = "fixed" if fixed[at].all() else "known with a deviation"
                raise InputError(
                    f"{listed}, {way}, which {relations.texts[row]} contradicts",
                    "values within their bounds, and constraints that fixed values keep",
                    "change one of the two, or drop it",
                    place=f"parameters.{unknowns[at[0]].name}" if at.size else "constraints",
                )


def rows_of_modes(layout: Layout, modes: Sequence[Mode], exact: Relations) -> ModalRows:
    """Return rows of modes, told apart about the start, where relations hold and no symmetry."""
    if not modes:
        return ModalRows()
    rng, start, free = np.random.default_rng(GENERATOR), layout.start, layout.free
    x = start.copy()
    x[free] *= 1 + GENERIC * rng.uniform(-1, 1, len(free))
    if len(exact):
        scale = np.where(start[free] != 0, np.abs(start[free]), 1.0)
        kept = retract(x, free, exact, scale)
        x = x if kept is None else kept
    return ModalRows(tuple(configuration(layout, group, x) for group in configurations(modes)))
