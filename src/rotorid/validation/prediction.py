"""How well an estimate predicts a record: its forces, or its outputs where some are hidden."""

from __future__ import annotations

import numpy as np

from rotorid.errors import InputError
from rotorid.estimate import Estimate, Prediction
from rotorid.estimators.likelihood.prediction import predict_with
from rotorid.estimators.regression import (
    Regression,
    hidden_coordinates,
    input_spectra,
    load_spectra,
    predict_inputs,
    sensors,
)
from rotorid.models import Model
from rotorid.record import Floats, PeriodicRecord


def predict(
    model: Model, estimate: Estimate, record: PeriodicRecord
) -> dict[str, Prediction | None]:
    """Return how well an estimate predicts a record, channel by channel.

    Where every coordinate is measured, forces are predicted, the seed's (12): ``b = F theta``.
    Where some are hidden, outputs are: ``y = C Z^-1 (B u + g)``.

    Parameters
    ----------
    model : Model
        The one that was identified.
    estimate : Estimate
    record : PeriodicRecord
        The same record, or better another one.

    Returns
    -------
    dict of channel name to Prediction
        |lines(measured - predicted)| / |lines(measured)|; ``None`` for a channel that is zero.

    Raises
    ------
    InputError
        For an estimate that is not of this model, or that lacks values.
    ModelError
        For hidden coordinates of a model that is not linear.
    """
    _check_determined(estimate)
    if estimate.method == "ml":
        return predict_with(model, estimate, [record])
    reduced, base = base_of(model, estimate)
    if not hidden_coordinates(model, record):
        return predict_inputs([Regression(reduced, record)], base)
    return _predict_outputs(model, _physical(model, estimate), record)


def base_of(model: Model, estimate: Estimate) -> tuple[Model, Floats]:
    """Return the model with what was fixed substituted, and the base parameters of an estimate."""
    found = {value.name: value.value for value in estimate.parameters}
    fixed = {value.name: value.value for value in estimate.parameters if value.fixed}
    reduced = model.substitute(fixed)
    missing = [name for name in reduced.base.names if name not in found]
    if missing:
        raise InputError(
            f"a result of {estimate.model!r} without {missing[0]!r}",
            f"the base parameters of {model.name!r}: {', '.join(reduced.base.names)}",
            "use the result and the experiment of one model",
        )
    return reduced, np.array([found[name] for name in reduced.base.names], dtype=float)


def _physical(model: Model, estimate: Estimate) -> Floats:
    found = {value.name: value.value for value in (*estimate.derived, *estimate.parameters)}
    return model.values({n: found[n] for n in model.parameter_names if n in found})


def _check_determined(estimate: Estimate) -> None:
    unknown = [value.name for value in estimate.parameters if not np.isfinite(value.value)]
    if unknown:
        raise InputError(
            f"a result that leaves {', '.join(unknown)} undetermined",
            "a value of every parameter",
            "fix one or measure more, then identify again",
        )


def _predict_outputs(
    model: Model, values: Floats, record: PeriodicRecord
) -> dict[str, Prediction | None]:
    linear, mu = model.require_linear(), model.monomial_values(values)
    force = input_spectra(model, record).mean(axis=0)
    right = force @ linear.input_matrix(mu).T + load_spectra(model, record) @ mu
    position = linear.response(record.omega, values, record.speed, right)
    errors: dict[str, Prediction | None] = {}
    for index, reads in zip(*sensors(model, record), strict=True):
        measured = record.mean_spectrum[:, index]
        wrong, size = (
            float(np.sqrt(record.multiplicity @ np.abs(x) ** 2))
            for x in (measured - position @ reads, measured)
        )
        errors[record.names[index]] = Prediction(wrong / size) if size > 0 else None
    return errors
