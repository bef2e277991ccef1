"""Machines with known modes, and estimates of them with a covariance."""

from collections.abc import Mapping

import numpy as np

import rotorid as rid

SUPPORTED = """
title = "A rigid rotor with a heavy disc on springs and dampers, softer across"
equations = [
  "m*x'' + c*x' + 2*k_x*x = m*Omega^2*(xi*cos(phi) - zeta*sin(phi))",
  "m*y'' + c*y' + 2*k_y*y = m*Omega^2*(xi*sin(phi) + zeta*cos(phi))",
  "I_t*theta_x'' + d*theta_x' + I_p*Omega*theta_y' + 2*L^2*k_y*theta_x = T",
  "I_t*theta_y'' + d*theta_y' - I_p*Omega*theta_x' + 2*L^2*k_x*theta_y = 0",
]
[coordinates]
x = "m"
y = "m"
theta_x = "rad"
theta_y = "rad"
[inputs]
T = "N m"
[parameters]
m = { unit = "kg", nominal = 8.0 }
I_t = { unit = "kg m^2", nominal = 0.2 }
I_p = { unit = "kg m^2", nominal = 0.15 }
k_x = { unit = "N/m", nominal = 4e5 }
k_y = { unit = "N/m", nominal = 5e5 }
c = { unit = "N s/m", nominal = 60.0 }
d = { unit = "N m s", nominal = 1.5 }
L = { unit = "m", nominal = 0.25 }
xi = { unit = "m", nominal = 2e-5 }
zeta = { unit = "m", nominal = -1e-5 }
"""


def model_of(text: str, name: str = "machine") -> rid.Model:
    """Return the model of a text."""
    return rid.parse_model(text, name=name)


def estimate_of(
    model: rid.Model,
    values: Mapping[str, float] | None = None,
    percent: float = 1.0,
    fixed: tuple[str, ...] = (),
    covariance: np.ndarray | None = None,
    **changes: object,
) -> rid.Estimate:
    """Return an estimate of a model; deviations in percent, correlated a little, or as given."""
    at = {**model.nominal, **(values or {})}
    free = [name for name in model.parameter_names if name not in fixed]
    if covariance is None:
        std = np.array([0.01 * percent * abs(at[name]) for name in free])
        correlation = np.eye(len(free)) + 0.3 * (1 - np.eye(len(free)))
        covariance = correlation * np.outer(std, std)
    spread = dict(zip(free, np.sqrt(np.diag(covariance)), strict=True))
    parameters = tuple(
        rid.Value(p.name, p.unit, at[p.name], std=spread.get(p.name, 0.0), fixed=p.name in fixed)
        for p in model.parameters
    )
    made = rid.Estimate(
        model.name,
        "ml",
        "ok",
        parameters,
        covariance=covariance,
        provenance=rid.Provenance(model=model.file_text),
    )
    return made.with_(**changes)
