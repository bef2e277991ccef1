"""Machines with known modes, and estimates of them with a covariance."""

from collections.abc import Mapping, Sequence

import numpy as np
from model_text import model_text

import rotorid as rid

SUPPORTED = model_text(
    "A rigid rotor with a heavy disc on springs and dampers, softer across",
    [
        "m*x'' + c*x' + 2*k_x*x = m*Omega^2*(xi*cos(phi) - zeta*sin(phi))",
        "m*y'' + c*y' + 2*k_y*y = m*Omega^2*(xi*sin(phi) + zeta*cos(phi))",
        "I_t*theta_x'' + d*theta_x' + I_p*Omega*theta_y' + 2*L^2*k_y*theta_x = T",
        "I_t*theta_y'' + d*theta_y' - I_p*Omega*theta_x' + 2*L^2*k_x*theta_y = 0",
    ],
    "x m, y m, theta_x rad, theta_y rad",
    "T N m",
    "m 8.0 kg, I_t 0.2 kg m^2, I_p 0.15 kg m^2, k_x 4e5 N/m, k_y 5e5 N/m, c 60.0 N s/m, "
    "d 1.5 N m s, L 0.25 m, xi 2e-5 m, zeta -1e-5 m",
)


def written(title: str, equations: Sequence[str], *units: str) -> rid.Model:
    """Return a model of what stands in its file."""
    return rid.parse_model(model_text(title, equations, *units))


def model_of(text: str, name: str = "machine") -> rid.Model:
    return rid.parse_model(text, name=name)


def estimate_of(
    model: rid.Model,
    values: Mapping[str, float] | None = None,
    percent: float = 1.0,
    fixed: tuple[str, ...] = (),
    covariance: np.ndarray | None = None,
    std: float | None = None,
    **changes: object,
) -> rid.Estimate:
    """Return an estimate of a model; deviations in percent, correlated a little, or as given."""
    at = {**model.nominal, **(values or {})}
    free = [name for name in model.parameter_names if name not in fixed]
    if std is not None:
        covariance = std**2 * np.eye(len(free))
    if covariance is None:
        spread = np.array([0.01 * percent * abs(at[name]) for name in free])
        correlation = np.eye(len(free)) + 0.3 * (1 - np.eye(len(free)))
        covariance = correlation * np.outer(spread, spread)
    deviations = dict(zip(free, np.sqrt(np.diag(covariance)), strict=True))
    parameters = tuple(
        rid.Value(p.name, p.unit, at[p.name], deviations.get(p.name, 0.0), fixed=p.name in fixed)
        for p in model.parameters
    )
    told = {"covariance": covariance, "provenance": rid.Provenance(model=model.file_text)}
    return rid.Estimate(model.name, "ml", "ok", parameters, **told).with_(**changes)


def lost(estimate: rid.Estimate, name: str) -> rid.Estimate:
    """Return an estimate that leaves a parameter undetermined."""
    values = tuple(
        v if v.name != name else rid.Value(name, v.unit, np.nan, np.nan)
        for v in estimate.parameters
    )
    bad = np.array([v.name == name for v in estimate.parameters])
    covariance = np.where(bad[:, None] | bad, np.nan, estimate.covariance)
    return estimate.with_(parameters=values, covariance=covariance, status="not_identifiable")
