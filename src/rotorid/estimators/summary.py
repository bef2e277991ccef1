"""From a solution of the least-squares family to its `Estimate`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotorid.estimate import Estimate
from rotorid.estimate_parts import Prediction, Value
from rotorid.estimators.derived import physical_from_base
from rotorid.estimators.prediction import by_regression, relative_errors
from rotorid.estimators.regression import Regression
from rotorid.frozen import frozen
from rotorid.models import Model
from rotorid.record import Booleans, Complexes, Floats


def summarize(
    method: str,
    full: Model,
    fixed: Mapping[str, float],
    regressions: Sequence[Regression],
    base: Floats,
    covariance: Floats,
    spreads: Sequence[Complexes],
    condition_number: float,
    warnings: Sequence[str],
) -> Estimate:
    """Return the `Estimate` of base parameters and their covariance, from regressions on lines."""
    model = regressions[0].model
    records = [r.record for r in regressions]
    known = np.where(np.isfinite(base), base, 0.0)
    findings = Findings(
        base=base,
        covariance=covariance,
        inflation=_inflation(regressions, base, spreads),
        prediction=relative_errors([by_regression(r, known) for r in regressions]),
        condition_number=condition_number,
        warnings=(*(w for r in records for w in r.warnings), *warnings),
        lines_hz=tuple(sorted({float(f) for r in records for f in r.frequency})),
        periods=min(r.periods for r in records),
    )
    return result(method, full, fixed, model, findings)


@frozen
class Findings:
    """What a regression found, as an `Estimate` states it.

    Parameters
    ----------
    base : array, shape (base,)
    covariance : array, shape (base, base)
    inflation : float
        Of the deviations, where all of the misfit is taken for noise.
    prediction : mapping of input to Prediction or None
    condition_number : float
    warnings : sequence of str
    lines_hz : sequence of float
    periods : int
    unknown_spread : bool array, shape (base,), optional
        Parameters of which no deviation can be stated.
    """

    base: Floats
    covariance: Floats
    inflation: float
    prediction: dict[str, Prediction | None]
    condition_number: float
    warnings: tuple[str, ...]
    lines_hz: tuple[float, ...] = ()
    periods: int = 1
    unknown_spread: Booleans | None = None


def result(
    method: str, full: Model, fixed: Mapping[str, float], model: Model, findings: Findings
) -> Estimate:
    """Return the `Estimate` of base parameters, with the physical ones that follow."""
    base, covariance = findings.base, findings.covariance
    determined = np.isfinite(base)
    std = np.where(determined, np.sqrt(np.diag(covariance).clip(0)), np.nan)
    found = zip(
        model.base.names, model.base.units, base, std, std * findings.inflation, strict=True
    )
    parameters = [
        Value(name, unit, float(value), float(s), float(i)) for name, unit, value, s, i in found
    ]
    if findings.unknown_spread is not None:
        parameters = [
            replace(p, std=None, std_inflated=None) if unknown else p
            for p, unknown in zip(parameters, findings.unknown_spread, strict=True)
        ]
    units = {p.name: p.unit for p in full.parameters}
    held = [Value(name, units[name], value, 0.0, 0.0, True) for name, value in fixed.items()]
    number = findings.condition_number
    return Estimate(
        model=full.name,
        method=method,
        status="ok" if determined.all() else "not_identifiable",
        parameters=(*parameters, *held),
        derived=physical_from_base(model, base, covariance),
        covariance=covariance,
        prediction=findings.prediction,
        lines_hz=findings.lines_hz,
        periods=findings.periods,
        warnings=findings.warnings,
        condition_number=number if np.isfinite(number) else None,
    )


def _inflation(
    regressions: Sequence[Regression], base: Floats, spreads: Sequence[Complexes]
) -> float:
    """Return by how much the residual exceeds its scatter over periods, at least 1.

    Each row counts alike. What the periods repeat, a misfit of the model or a bias, is in the
    residual and not in the scatter.
    """
    if not np.isfinite(base).all():
        return 1.0
    misfit, noise, equations = 0.0, 0.0, 0.0
    for regression, spread in zip(regressions, spreads, strict=True):
        weight = regression.record.multiplicity
        residual = weight @ np.abs(regression.residual(base)) ** 2
        expected = weight @ np.diagonal(spread.real, axis1=1, axis2=2)
        noisy = expected > 1e-20 * (weight @ np.abs(regression.target) ** 2).max()
        misfit += float((residual[noisy] / expected[noisy]).sum())
        noise += float(noisy.sum())
        equations += float(weight.sum() * noisy.sum())
    if equations <= len(base):
        return 1.0
    return float(np.sqrt(max(1.0, misfit / noise / (1 - len(base) / equations))))


def describe_open_directions(names: Sequence[str], directions: Floats) -> list[str]:
    """Say in words which combinations are left open."""
    texts = []
    for direction in directions.T:
        large = np.flatnonzero(np.abs(direction) > 1e-3 * np.abs(direction).max())
        members = ", ".join(names[int(i)] for i in large)
        what = "are determined only together" if len(large) > 1 else "is not determined"
        texts.append(f"{members} {what}")
    return texts
