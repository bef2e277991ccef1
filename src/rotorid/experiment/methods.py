"""From ``[estimator]`` to an estimator."""

from __future__ import annotations

from rotorid.answer.identify import Estimator
from rotorid.core.errors import InputError
from rotorid.experiment.names import bounds, modes, stated
from rotorid.experiment.schema import ChannelEntry, Effort, ExperimentFile, Method
from rotorid.models import Model
from rotorid.models.priors import Constraint


def build_estimator(
    entry: ExperimentFile,
    method: Method,
    fixed: dict[str, float],
    constraints: tuple[Constraint, ...],
    model: Model,
    effort: Effort | None = None,
) -> Estimator:
    if method == "ml":
        effort = effort or entry.estimator.effort
        return _maximum_likelihood(entry, fixed, constraints, model, effort)
    _refuse_deviations(entry)
    if method == "batch":
        from rotorid.linear.estimators import Batch

        return Batch(free_weight=entry.estimator.free_weight, fixed=fixed, constraints=constraints)
    from rotorid.linear.estimators import LeastSquares, Sequential

    family = LeastSquares if method == "ls" else Sequential
    return family(fixed=fixed, constraints=constraints)


def _maximum_likelihood(
    entry: ExperimentFile,
    fixed: dict[str, float],
    constraints: tuple[Constraint, ...],
    model: Model,
    effort: Effort,
) -> Estimator:
    from rotorid.likelihood.estimator import MaximumLikelihood

    values, deviations = (stated(entry.parameters, model, key) for key in ("value", "std"))
    return MaximumLikelihood(
        fixed=fixed,
        constraints=constraints,
        known={name: (value, deviations[name]) for name, value in values.items()},
        start=stated(entry.parameters, model, "start"),
        bounds=bounds(entry.parameters, entry.constraints, model),
        **entry.estimator.unknown,
        each=tuple(name for name, p in entry.parameters.items() if p.each),
        modes=modes(entry.modes, model),
        effort=effort,
    )


def default_method(model: Model, entry: ExperimentFile) -> Method:
    """Return ml where the model is linear in its coordinates and there are lines, else batch."""
    filtered = any(record.cutoff is not None for record in entry.records)
    return "batch" if filtered or model.linear is None else "ml"


def _uncertain(entry: ChannelEntry) -> bool:
    """Tell whether the dynamics of a channel, or of a law's column, are not known exactly."""
    entries = (entry.dynamics, *(column.dynamics for column in entry.columns))
    return any(d is not None and d.uncertain for d in entries)


def _refused(place: str) -> str:
    """Say what stands at a place that only a likelihood can weigh."""
    if place.endswith(".min, max"):
        return "a bound"
    differs = place.endswith(".each") or (place.startswith("records.") and "parameters" in place)
    return "parameters that differ between records" if differs else "a deviation"


def _refuse_deviations(entry: ExperimentFile) -> None:
    """Refuse what only a likelihood can weigh: knowledge with a deviation."""
    if entry.modes:
        raise InputError(
            "measured natural frequencies", "records alone for this method", "use ml", place="modes"
        )
    for key, value in entry.estimator.unknown.items():
        if value:
            raise InputError(
                f"{key} = {str(value).lower()}",
                "a measurement without unknown constants for this method",
                "use ml",
                place=f"estimator.{key}",
            )
    places = [f"parameters.{name}.std" for name, p in entry.parameters.items() if p.std is not None]
    places += [f"constraints.{i}.std" for i, c in enumerate(entry.constraints) if c.std is not None]
    channels = {f"channels.{name}": channel for name, channel in entry.channels.items()}
    for i, record in enumerate(entry.records):
        channels |= {f"records.{i}.channels.{name}": c for name, c in record.channels.items()}
    places += [f"{place}.gain_std" for place, c in channels.items() if c.gain_std]
    places += [f"{place}.delay.std" for place, c in channels.items() if c.delay.std]
    places += [f"{place}.dynamics" for place, c in channels.items() if _uncertain(c)]
    places += [f"{place}.{key}" for place, c in channels.items() for key in c.uncertain]
    columns = [(place, column) for place, c in channels.items() for column in c.columns]
    places += [f"{place}.{c.column}.gain_std" for place, c in columns if c.gain_std]
    places += [f"{place}.{c.column}.delay.std" for place, c in columns if c.delay.std]
    places += [f"parameters.{name}.each" for name, p in entry.parameters.items() if p.each]
    places += [f"records.{i}.parameters" for i, r in enumerate(entry.records) if r.parameters]
    places += [f"parameters.{name}.min, max" for name, p in entry.parameters.items() if p.bounded]
    places += [f"constraints.{i}.min, max" for i, c in enumerate(entry.constraints) if c.bounded]
    if places:
        raise InputError(
            _refused(places[0]),
            "exact values, the same in all records, for this method",
            "use ml",
            place=places[0],
        )
