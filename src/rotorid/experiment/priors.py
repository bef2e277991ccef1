"""What an experiment file says of parameters, and the estimator that it asks for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from rotorid.answer.identify import Estimator
from rotorid.core.errors import InputError, naming, require_names
from rotorid.core.units import to_si
from rotorid.experiment.schema import Effort, ExperimentFile, Method, OwnEntry, PriorKeys
from rotorid.models import Model
from rotorid.models.equations import polynomial
from rotorid.models.knowledge import Constraint, Knowledge, Mode, in_units_of, unit_of_expression
from rotorid.models.model import Parameter


def knowledge_of(entry: ExperimentFile, model: Model) -> Knowledge[float]:
    expressions = []
    for number, one in enumerate(entry.constraints):
        place = f"constraints.{number}"
        unit = unit_of_expression(one.expression, model, place)
        expressions.append((one.expression, _in_si(one, unit, place)))
    _check_once(entry, model)
    parameters = {}
    for name, knowledge in entry.parameters.items():
        place = f"parameters.{name}"
        parameter = _parameter(name, model, place)
        parameters[name] = _in_si(knowledge, parameter.unit, place)
        if parameter.positive:
            _check_signs(parameters[name], place)
    every = (*parameters.items(), *expressions)
    fixed, values, stds, start = (
        {name: told[key] for name, told in parameters.items() if key in told}
        for key in ("fixed", "value", "std", "start")
    )
    return Knowledge(
        fixed=fixed,
        constraints=tuple(
            Constraint(expression, told["value"], told.get("std", 0.0))
            for expression, told in expressions
            if "value" in told
        ),
        known={name: (value, stds[name]) for name, value in values.items()},
        start=start,
        bounds={n: (t.get("min"), t.get("max")) for n, t in every if t.keys() & {"min", "max"}},
    )


def own_values(
    entries: Mapping[str, OwnEntry], model: Model, place: str
) -> dict[str, tuple[float, float]]:
    """Return the parameters that a record has to itself, value and deviation in SI."""
    found = {}
    for name, entry in entries.items():
        where = f"{place}.{name}"
        parameter = _parameter(name, model, where)
        told = _in_si(entry, parameter.unit, where)
        value = told.get("fixed", told.get("value", 0.0))
        # A trial mass of none is 0, whatever the model says of those that are there.
        if parameter.positive and value < 0:
            _check_signs(told, where)
        found[name] = (value, told.get("std", 0.0))
    return found


def _parameter(name: str, model: Model, place: str) -> Parameter:
    known = {parameter.name: parameter for parameter in model.parameters}
    require_names([name], known, "{}, which is no parameter of the model", place=place)
    return known[name]


def _in_si(entry: PriorKeys | OwnEntry, unit: str, place: str) -> dict[str, float]:
    found = {}
    for key in ("fixed", "value", "std", "start", "min", "max"):
        quantity = getattr(entry, key, None)
        if quantity is not None:
            found[key] = to_si(quantity, unit, place=f"{place}.{key}")
    if found.get("std", 1.0) <= 0:
        raise InputError(
            f"{found['std']:g}",
            "a deviation of more than 0",
            "leave it out for an exact value",
            place=f"{place}.std",
        )
    return found


def _check_signs(told: Mapping[str, float], place: str) -> None:
    for key in ("fixed", "value", "start"):
        if told.get(key, 1.0) <= 0:
            raise InputError(
                f"{told[key]:g}",
                "more than 0, since the model says positive = true",
                "correct one of them",
                place=f"{place}.{key}",
            )


def _check_once(entry: ExperimentFile, model: Model) -> None:
    """Refuse a measurement stated twice: a multiple of what has value and deviation already."""
    names = model.parameter_names
    known = {
        frozenset([(tuple(int(n == name) for n in names), 1.0)]): f"parameters.{name}"
        for name, one in entry.parameters.items()
        if one.value is not None and one.std is not None
    }
    for number, one in enumerate(entry.constraints):
        if one.value is None or one.std is None:
            continue
        terms = {p: float(c) for p, c in polynomial(one.expression, names).items() if c}
        largest = max(terms.items(), key=lambda term: (abs(term[1]), term[0]), default=((), 1.0))[1]
        what = frozenset((tuple(p), round(c / largest, 12)) for p, c in terms.items())
        place = f"constraints.{number}"
        if (other := known.setdefault(what, place)) != place:
            raise InputError(
                f"{one.expression[:60]!r}, which is what {other} states, or a multiple of it",
                "each measurement once: twice it counts as two",
                "remove one; of two weighings state the mean, and its own std",
                place=place,
            )


def default_method(model: Model, entry: ExperimentFile) -> Method:
    filtered = any(record.cutoff is not None for record in entry.records)
    return "batch" if filtered or model.linear is None else "ml"


def build_estimator(
    entry: ExperimentFile,
    method: Method,
    priors: Knowledge[float],
    model: Model,
    effort: Effort | None,
) -> Estimator:
    if method == "ml":
        from rotorid.likelihood.estimator import MaximumLikelihood

        return MaximumLikelihood(
            **vars(replace(priors, modes=_modes(entry, model))),
            **entry.estimator.unknown,
            each=tuple(name for name, p in entry.parameters.items() if p.each),
            effort=effort or entry.estimator.effort,
        )
    for place, found, expected in _of_ml_alone(entry):
        raise InputError(found, f"{expected} for this method", "use ml", place=place)
    from rotorid.linear.estimators import Batch, LeastSquares, Sequential

    told: dict[str, Any] = {"fixed": priors.fixed, "constraints": priors.constraints}
    if method == "batch":
        return Batch(free_weight=entry.estimator.free_weight, **told)
    return (LeastSquares if method == "ls" else Sequential)(**told)


def _modes(entry: ExperimentFile, model: Model) -> tuple[Mode, ...]:
    found = []
    for number, one in enumerate(entry.modes):
        place = f"modes.{number}"
        for name in one.parameters:
            _parameter(name, model, f"{place}.parameters.{name}")
        damping = None if one.damping is None else (one.damping.value, one.damping.std)
        said = {name: str(value) for name, value in one.parameters.items()}
        with naming(place=place):
            mode = Mode(one.frequency, one.std, damping, one.speed, said, one.mode)
            found.append(in_units_of(model, mode))
    return tuple(found)


def _of_ml_alone(entry: ExperimentFile) -> Iterator[tuple[str, str, str]]:
    """Yield the place of what ml alone can weigh, what stands there, and what others expect."""
    exact = "exact values, the same in all records,"
    if entry.modes:
        yield "modes", "measured natural frequencies", "records alone"
    for key, value in entry.estimator.unknown.items():
        if value:
            told = f"{key} = {str(value).lower()}"
            yield f"estimator.{key}", told, "a measurement without unknown constants"
    knowledge: dict[str, PriorKeys] = {f"parameters.{n}": p for n, p in entry.parameters.items()}
    each = [f"parameters.{name}.each" for name, p in entry.parameters.items() if p.each]
    knowledge |= {f"constraints.{number}": c for number, c in enumerate(entry.constraints)}
    channels = {f"channels.{name}": channel for name, channel in entry.channels.items()}
    for number, record in enumerate(entry.records):
        channels |= {f"records.{number}.channels.{n}": c for n, c in record.channels.items()}
        each += [f"records.{number}.parameters"] if record.parameters else []
    stds = [f"{place}.std" for place, one in knowledge.items() if one.std is not None]
    bounds = [f"{place}.min, max" for place, one in knowledge.items() if one.bounded]
    stds += [f"{place}.{key}" for place, one in channels.items() for key in one.deviations]
    yield from ((place, "parameters that differ between records", exact) for place in each)
    yield from ((place, "a deviation", exact) for place in stds)
    yield from ((place, "a bound", exact) for place in bounds)
