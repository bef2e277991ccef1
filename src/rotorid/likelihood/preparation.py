"""From a model, records and what is known beforehand to the `Layout` and its relations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from itertools import zip_longest

import numpy as np

from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.values import Floats
from rotorid.data.measured_modes import Mode
from rotorid.data.observation import Observation
from rotorid.likelihood.assembly import assemble
from rotorid.likelihood.cost import Likelihood
from rotorid.likelihood.effects import Replaces, of_kind
from rotorid.likelihood.layout import Layout, base_factors, physical_factors
from rotorid.likelihood.mode_rows import modal_rows
from rotorid.likelihood.problem import Known, Problem, retract
from rotorid.likelihood.relations import Polynomial, Relations
from rotorid.likelihood.unknowns import Scalar, Unknown
from rotorid.models import Model
from rotorid.models.constraints import Constraint, constraint_polynomial, eliminate

GENERIC = 0.2
"""Relative change of the unknowns after which natural frequencies that coincide do so always."""
GENERATOR = 4711
"""The fixed number from which that change is drawn."""
EXACT = 1e-12
"""Share of a known value below which its deviation is lost in the rounding of what it weighs."""

CONTRADICTED = 5.0
"""Deviations beyond which a fixed value contradicts a constraint in which nothing is free: chance
in a million; it would add its square to any misfit."""


@frozen
class Knowledge:
    """What is known before the records are looked at; all in SI."""

    # exact values, of parameters or nuisances
    fixed: Mapping[str, float] = field(default_factory=dict)
    # mapping of name to (value, std): values with a deviation
    known: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    # where to start; never biases the estimate
    start: Mapping[str, float] = field(default_factory=dict)
    # polynomials in the parameters, exact or with a deviation
    constraints: tuple[Constraint, ...] = ()
    # mapping of expression to (lower, upper): polynomials in the parameters that are kept within
    # bounds; ``None`` for no bound
    bounds: Mapping[str, tuple[float | None, float | None]] = field(default_factory=dict)
    modes: tuple[Mode, ...] = ()  # measured natural frequencies


@frozen
class Limit:
    expression: str
    way: float  # 1 of a lower bound, -1 of an upper one
    value: float  # SI

    def __str__(self) -> str:
        return f"{self.expression} {'>=' if self.way > 0 else '<='} {self.value:g}"


@frozen
class Prepared:
    """Unknowns and the relations among them; what was put into the model is in `substituted`."""

    layout: Layout
    exact: Relations
    known: Known
    bounds: Relations
    limits: tuple[Limit, ...]  # what each of the bounds was stated as
    substituted: Mapping[str, float] = field(default_factory=dict)

    def problem(self, records: Sequence[Observation], alike: Sequence[Likelihood] = ()) -> Problem:
        """Return the likelihoods of records with what is known; `alike`: of the same records."""
        likelihoods = tuple(
            assemble(self.layout, record, number, like)
            for number, (record, like) in enumerate(zip_longest(records, alike))
        )
        return Problem(self.layout, likelihoods, self.exact, self.known, self.bounds)


def prepare(
    model: Model,
    knowledge: Knowledge,
    nuisances: Sequence[Unknown],
    base: bool,
    guess: Mapping[str, float],
) -> Prepared:
    """Lay out the unknowns and write what is known as relations."""
    extra = [unknown for nuisance in nuisances for unknown in nuisance.scalars]
    _check_names(model, extra, knowledge, base)
    held: dict[str, float] = {}
    own = {
        unknown.scalars[0].name: effect.parameter
        for unknown in nuisances
        for effect in of_kind(Replaces, unknown.effects)
    }
    if base:
        if own:
            raise InputError(
                f"{next(iter(own))}, a parameter that differs between records",
                "the same parameters in every record, where base parameters are asked for",
                "estimate the physical parameters, or each record by itself",
            )
        held = {n: v for n, v in knowledge.fixed.items() if n in model.parameter_names}
        model = model.substitute(held)
        names = zip(model.base.names, model.base.units, strict=True)
        parameters = [Scalar(n, unit, guess.get(n, np.nan), nuisance=False) for n, unit in names]
        factors: Sequence[tuple[int, ...] | None] = base_factors(model)
    else:
        parameters = [
            Scalar(p.name, p.unit, guess.get(p.name, np.nan), nuisance=False, positive=p.positive)
            for p in model.parameters
        ]
        factors = physical_factors(model)
    informed = [_informed(unknown, knowledge) for unknown in parameters]
    for unknown in extra:
        here = own.get(unknown.name)
        if here is not None and unknown.std is None:
            unknown = replace(informed[here], name=unknown.name)
        informed.append(_informed(unknown, knowledge))
    layout = Layout(model, tuple(informed), tuple(factors), base, tuple(nuisances))
    layout = _started(replace(layout, unknowns=_without_idle(layout)))
    exact, known = _relations(layout, knowledge)
    bounds, limits = _bounds(layout, knowledge)
    _check_relations(layout, exact)
    _refuse_contradicted(layout, known, bounds)
    modes = modal_rows(layout, knowledge.modes, generic(layout, exact))
    return Prepared(layout, exact, Known(known, modes), bounds, limits, held)


def _without_idle(layout: Layout) -> tuple[Scalar, ...]:
    """Hold the common unknowns that no record uses, so that nothing depends on them."""
    return tuple(
        replace(u, start=1.0, std=0.0) if i in layout.idle else u
        for i, u in enumerate(layout.unknowns)
    )


def _informed(unknown: Scalar, knowledge: Knowledge) -> Scalar:
    name = unknown.name
    if name in knowledge.fixed:
        return replace(unknown, start=float(knowledge.fixed[name]), std=0.0)
    if name in knowledge.known:
        value, std = (float(x) for x in knowledge.known[name])
        unknown = replace(unknown, prior=value, std=std, start=value)
    if name in knowledge.start:
        unknown = replace(unknown, start=float(knowledge.start[name]))
    return unknown


def _started(layout: Layout) -> Layout:
    """Put the unbalance to zero where nothing else is said, and ask for the starts that lack."""
    loads = layout.load_only()
    unknowns = tuple(
        replace(u, start=0.0) if i in loads and np.isnan(u.start) else u
        for i, u in enumerate(layout.unknowns)
    )
    missing = [u.name for u in unknowns if np.isnan(u.start)]
    if missing:
        raise InputError(
            f"no start of {', '.join(missing)}",
            "a starting value of every parameter, where some coordinates are not measured",
            "give start (in the experiment file) or nominal (in the model file)",
            place=f"parameters.{missing[0]}",
        )
    wrong = [u.name for u in unknowns if u.positive and not u.fixed and u.start <= 0]
    if wrong:
        raise InputError(
            f"a start of {wrong[0]} that is not positive",
            "a positive number, as the model declares",
            "start above 0, or take positive out of the model",
            place=f"parameters.{wrong[0]}",
        )
    return replace(layout, unknowns=unknowns)


def _check_names(model: Model, extra: Sequence[Scalar], knowledge: Knowledge, base: bool) -> None:
    parameters = model.parameter_names
    names = {*parameters, *(unknown.name for unknown in extra)}
    for key in ("fixed", "known", "start"):
        for name, value in getattr(knowledge, key).items():
            if name not in names and not (base and key == "start"):  # names of base parameters
                raise InputError(
                    f"{name!r} in {key}",
                    f"one of {', '.join(sorted(names))}",
                    "take a name from there",
                    place=key,
                )
            numbers = np.atleast_1d(np.asarray(value, dtype=float))
            if not np.isfinite(numbers).all():
                raise InputError(
                    f"{value} for {name}",
                    "finite numbers",
                    "give numbers, or leave the name out",
                    place=key,
                )
            if key == "known" and (len(numbers) != 2 or numbers[1] <= 0):
                raise InputError(
                    f"{value} for {name}",
                    "a value and a deviation of more than 0",
                    "give both, or fix the value",
                    place=key,
                )
            if key == "known" and numbers[1] < EXACT * abs(numbers[0]):
                raise InputError(
                    f"a deviation of {numbers[1]:g} of {name} = {numbers[0]:g}",
                    f"more than {EXACT:g} of the value: less is lost in rounding",
                    f"write fixed in place of value and std of {name}, if it is exact",
                    place=key,
                )
    twice = set(knowledge.fixed) & set(knowledge.known)
    if twice:
        raise InputError(
            f"{sorted(twice)[0]} both fixed and with a deviation", "one of them", "drop one"
        )
    if base and knowledge.known.keys() & set(parameters):
        raise InputError(
            f"a deviation of {sorted(knowledge.known.keys() & set(parameters))[0]}",
            "fixed values, where base parameters are asked for",
            "estimate the physical parameters",
        )


def _relations(layout: Layout, knowledge: Knowledge) -> tuple[Relations, Relations]:
    count = len(layout.unknowns)
    exact: list[tuple[Polynomial, float, str]] = []
    known: list[tuple[Polynomial, float, str]] = []
    for i, unknown in enumerate(layout.unknowns):
        if unknown.std is not None and unknown.std > 0:
            known.append(({(i,): 1.0, (): -unknown.prior}, unknown.std, unknown.name))
    if layout.base:
        return _base_relations(layout, knowledge), Relations.build(known, count)
    for constraint in knowledge.constraints:
        value, std = constraint.in_si
        text = f"{constraint.expression} = {value:g}"
        for polynomial in _polynomials(layout, constraint):
            if std > 0:
                known.append((polynomial, std, text))
            else:
                exact.append((polynomial, 1.0, text))
    return Relations.build(exact, count), Relations.build(known, count)


def _polynomials(layout: Layout, constraint: Constraint) -> list[Polynomial]:
    """Return a constraint, or that of each record where every one has a value to itself."""
    polynomial = {
        tuple(i for i, power in enumerate(powers) for _ in range(power)): coefficient
        for powers, coefficient in constraint_polynomial(layout.model, constraint).items()
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


def _base_relations(layout: Layout, knowledge: Knowledge) -> Relations:
    """Return the constraints, linear in the base parameters, that `eliminate` solves."""
    count, size = len(layout.unknowns), layout.parameters
    elimination = eliminate(layout.model, knowledge.constraints, knowledge.fixed)
    unit = np.eye(elimination.basis.shape[1])
    kept = [int((elimination.basis == row).all(axis=1).argmax()) for row in unit]
    gone = [i for i in range(size) if i not in kept]
    rows: list[tuple[Polynomial, float, str]] = []
    for i in gone:
        polynomial = {(i,): 1.0, (): -float(elimination.origin[i])}
        for j, coefficient in zip(kept, elimination.basis[i], strict=True):
            if coefficient:
                polynomial[j,] = -float(coefficient)
        rows.append((polynomial, 1.0, layout.unknowns[i].name))
    return Relations.build(rows, count)


def _bounds(layout: Layout, knowledge: Knowledge) -> tuple[Relations, tuple[Limit, ...]]:
    count = len(layout.unknowns)
    rows: list[tuple[Polynomial, Limit]] = []
    for i, unknown in enumerate(layout.unknowns):
        if unknown.positive and not unknown.fixed:
            rows.append(({(i,): 1.0, (): 0.0}, Limit(unknown.name, 1.0, 0.0)))
    if layout.base and knowledge.bounds:
        raise InputError("bounds", "none, where base parameters are asked for", "drop them")
    for expression, (lower, upper) in knowledge.bounds.items():
        _refuse_empty(expression, lower, upper, layout)
        for limit, way in ((lower, 1.0), (upper, -1.0)):
            if limit is None:
                continue
            for polynomial in _polynomials(layout, Constraint(expression, limit)):
                signed = {powers: way * c for powers, c in polynomial.items()}
                rows.append((signed, Limit(expression, way, limit)))
    relations = Relations.build([(row, 1.0, str(limit)) for row, limit in rows], count)
    return relations, tuple(limit for _, limit in rows)


def _refuse_empty(
    expression: str, lower: float | None, upper: float | None, layout: Layout
) -> None:
    positive = any(u.name == expression and u.positive for u in layout.unknowns)
    least = max(-np.inf if lower is None else lower, 0.0 if positive else -np.inf)
    if upper is not None and least >= upper:
        told = ", which the model calls positive" if positive and least == 0 else ""
        raise InputError(
            f"{expression} from {least:g} to {upper:g}{told}",
            "a lower bound below the upper one",
            "exchange them, or correct one; for an exact value write fixed, or value alone",
            place=f"bounds of {expression[:60]!r}",
        )


def _check_relations(layout: Layout, exact: Relations) -> None:
    if not len(exact):
        return
    anywhere = np.where(layout.start != 0, layout.start, 1.0)
    normal = (exact.jacobian(anywhere) * np.abs(anywhere))[:, layout.free]
    length = np.sqrt((normal**2).sum(axis=1))
    idle = np.flatnonzero(length == 0)
    if idle.size:
        raise InputError(
            f"the constraint {exact.texts[idle[0]]!r}, which holds no free parameter",
            "a relation between free parameters",
            "drop it, or free one of its parameters",
            place="constraints",
        )
    values = np.linalg.svd(normal / length[:, None], compute_uv=False)
    if len(exact) > normal.shape[1] or values[-1] < 1e-9 * values[0]:
        raise InputError(
            "constraints that repeat or contradict one another",
            "independent constraints",
            "drop one",
            place="constraints",
        )


def _refuse_contradicted(layout: Layout, known: Relations, bounds: Relations) -> None:
    unknowns = layout.unknowns
    told = np.array([u.start if u.std is None or u.fixed else u.prior for u in unknowns])
    anywhere = np.where(told != 0, told, 1.0)  # where no derivative is zero by chance
    fixed = np.array([u.fixed for u in unknowns])
    stated = np.array([u.std is not None for u in unknowns])  # with a deviation or without
    for relations, most in ((known, CONTRADICTED), (bounds, 0.0)):
        held_by = relations.jacobian(anywhere) != 0
        values = relations.values(told)
        for row, members in enumerate(held_by):
            outside = relations is bounds and stated[members].all() and members.sum() == 1
            off = abs(values[row]) if relations is known else -values[row]
            if off > most and (outside or fixed[members].all()):
                at = np.flatnonzero(members)
                listed = ", ".join(f"{unknowns[i].name} = {told[i]:g}" for i in at)
                way = "fixed" if fixed[members].all() else "known with a deviation"
                raise InputError(
                    f"{listed}, {way}, which {relations.texts[row]} contradicts",
                    "values within their bounds, and constraints that fixed values keep",
                    "change one of the two, or drop it",
                    place=f"parameters.{unknowns[at[0]].name}" if at.size else "constraints",
                )


def generic(layout: Layout, exact: Relations) -> Floats:
    """Return unknowns about the start that keep the exact relations and no symmetry but theirs."""
    rng, start, free = np.random.default_rng(GENERATOR), layout.start, layout.free
    x = start.copy()
    x[free] *= 1 + GENERIC * rng.uniform(-1, 1, len(free))
    if not len(exact):
        return x
    scale = np.where(start[free] != 0, np.abs(start[free]), 1.0)
    kept = retract(x, free, exact, scale)
    return x if kept is None else kept
