"""From ``[estimator]`` to an estimator."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from rotorid.errors import InputError
from rotorid.estimators import Batch, Constraint, Estimator, LeastSquares, Sequential
from rotorid.experiment.schema import ExperimentFile, Method

Builder = Callable[[ExperimentFile, dict[str, float], tuple[Constraint, ...]], Estimator]


def _least_squares(
    entry: ExperimentFile, fixed: dict[str, float], constraints: tuple[Constraint, ...]
) -> Estimator:
    _refuse_deviations(entry)
    return LeastSquares(fixed=fixed, constraints=constraints)


def _batch(
    entry: ExperimentFile, fixed: dict[str, float], constraints: tuple[Constraint, ...]
) -> Estimator:
    _refuse_deviations(entry)
    return Batch(free_weight=entry.estimator.free_weight, fixed=fixed, constraints=constraints)


def _sequential(
    entry: ExperimentFile, fixed: dict[str, float], constraints: tuple[Constraint, ...]
) -> Estimator:
    _refuse_deviations(entry)
    return Sequential(fixed=fixed, constraints=constraints)


BUILDERS: Mapping[Method, Builder] = {
    "ls": _least_squares,
    "batch": _batch,
    "sequential": _sequential,
}
DEFAULT: Method = "batch"


def build_estimator(
    entry: ExperimentFile,
    method: Method | None,
    fixed: dict[str, float],
    constraints: tuple[Constraint, ...],
) -> Estimator:
    """Return the estimator of an experiment.

    Parameters
    ----------
    entry : ExperimentFile
    method : {"ls", "batch", "sequential", "ml"}, optional
        In place of the file's.
    fixed : mapping of str to float
        SI.
    constraints : sequence of Constraint

    Raises
    ------
    InputError
        For a method that is not there, or that cannot honour what the file says.
    """
    chosen = method or entry.estimator.method or DEFAULT
    if chosen not in BUILDERS:
        raise InputError(
            f"{chosen!r}, which this version does not have yet",
            f"one of {', '.join(BUILDERS)}",
            "choose one of these",
            place="--method" if method else "estimator.method",
        )
    return BUILDERS[chosen](entry, fixed, constraints)


def _refuse_deviations(entry: ExperimentFile) -> None:
    """Refuse what only a likelihood can weigh: knowledge with a deviation."""
    places = [f"parameters.{name}.std" for name, p in entry.parameters.items() if p.std is not None]
    places += [f"constraints.{i}.std" for i, c in enumerate(entry.constraints) if c.std is not None]
    places += [f"channels.{name}.gain_std" for name, c in entry.channels.items() if c.gain_std]
    places += [
        f"records.{i}.channels.{name}.gain_std"
        for i, record in enumerate(entry.records)
        for name, c in record.channels.items()
        if c.gain_std
    ]
    if places:
        raise InputError("a deviation", "exact values for this method", "use ml", place=places[0])
