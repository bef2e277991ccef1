"""How well an estimate predicts records: inputs, or outputs with hidden coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.errors import InputError
from rotorid.estimate import Estimate, Prediction
from rotorid.estimators.likelihood.assembly import assemble
from rotorid.estimators.likelihood.cost import Evaluation
from rotorid.estimators.likelihood.preparation import Knowledge, prepare
from rotorid.estimators.likelihood.problem import Problem
from rotorid.estimators.likelihood.unknowns import Nuisances, nuisance_unknowns, sensor_channels
from rotorid.models import Model
from rotorid.record import Complexes, PeriodicRecord
from rotorid.signals.covariance import white_covariance


def predict_with(
    model: Model, estimate: Estimate, records: Sequence[PeriodicRecord]
) -> dict[str, Prediction | None]:
    """Return how well an estimate predicts records that need not be its own."""
    values = {v.name: v.value for v in (*estimate.parameters, *estimate.nuisance)}
    nuisances = Nuisances(
        runout=any(name.startswith("runout[") for name in values),
        gains=tuple(
            kind
            for kind, sign in (("ki", "ki["), ("ks", "ks"), ("ks*", "ks["))
            if any(name == sign or ("[" in sign and name.startswith(sign)) for name in values)
        ),
        delays=tuple(kind for kind in ("force", "position") if f"delay[{kind}]" in values),
    )
    for record in records:
        if not record.phase_known:
            raise InputError(
                "a rotor angle of unknown phase", "a known phase", "give it", file=record.source
            )
    base = not {*model.parameter_names} <= values.keys()
    unknown = {u.name for u in nuisance_unknowns(model, records, nuisances)}
    held = {v.name: v.value for v in estimate.parameters if v.fixed}
    start = {
        name: value
        for name, value in values.items()
        if name not in held and (name in unknown or "[" not in name)
    }
    prepared = prepare(model, records, Knowledge(fixed=held, start=start), nuisances, base, {})
    likelihoods = tuple(
        assemble(prepared.layout, record, white_covariance(record.spectra), number)
        for number, record in enumerate(records)
    )
    problem = Problem(prepared.layout, likelihoods, prepared.exact, prepared.known, prepared.bounds)
    sensors = [[c.name for c in sensor_channels(prepared.layout.model, r)] for r in records]
    evaluations = problem.at(prepared.layout.start).records
    return predict_channels(evaluations, prepared.layout.model.inputs, sensors)


def predict_channels(
    evaluations: Sequence[Evaluation], inputs: Sequence[str], sensors: Sequence[Sequence[str]]
) -> dict[str, Prediction | None]:
    """Return the relative error of each channel, all records together."""
    hidden = any(e.problem.sensing.hidden.shape[1] for e in evaluations)
    wrong: dict[str, float] = {}
    size: dict[str, float] = {}
    for evaluation, names in zip(evaluations, sensors, strict=True):
        predicted, measured = (_outputs if hidden else _inputs)(evaluation)
        weight = evaluation.problem.multiplicity
        for j, name in enumerate(names if hidden else inputs):
            error = float(weight @ np.abs(predicted[:, j] - measured[:, j]) ** 2)
            wrong[name] = wrong.get(name, 0.0) + error
            power = float(weight @ np.abs(measured[:, j]) ** 2)
            size[name] = size.get(name, 0.0) + power
    return {
        name: Prediction(float(np.sqrt(wrong[name] / size[name]))) if size[name] > 0 else None
        for name in wrong
    }


def _inputs(at: Evaluation) -> tuple[Complexes, Complexes]:
    """Predict the inputs from the motion, the seed's (12); rows without input have no say."""
    p = at.problem
    true = at.state.factors * p.data
    motion = (true[:, p.inputs :] - at.state.runout) @ p.sensing.right.T
    force = (at.stiffness[:, : p.rows] @ motion[:, :, None])[:, :, 0] + at.load @ at.mu
    matrix = at.inputs[:, : p.rows]
    driven = np.abs(matrix).any(axis=(0, 2))
    if not driven.any():
        return true[:, : p.inputs], true[:, : p.inputs]
    predicted = -np.stack(
        [
            np.linalg.lstsq(b[driven], f[driven], rcond=None)[0]
            for b, f in zip(matrix, force, strict=True)
        ]
    )
    return predicted, true[:, : p.inputs]


def _outputs(at: Evaluation) -> tuple[Complexes, Complexes]:
    """Predict the readings from the inputs, y = C Z^-1 (B u + g) + r."""
    p = at.problem
    true = at.state.factors * p.data
    right = (at.inputs[:, : p.rows] @ true[:, : p.inputs, None])[:, :, 0] + at.load @ at.mu
    stiffness = -at.stiffness[:, : p.rows]
    motion = np.stack(
        [np.linalg.lstsq(z, f, rcond=None)[0] for z, f in zip(stiffness, right, strict=True)]
    )
    return motion @ p.sensing.reads.T + at.state.runout, true[:, p.inputs :]
