"""Derivatives by differences, for tests of analytic ones."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np


def extrapolated(function: Callable[[float], float], step: float, levels: int = 6) -> float:
    """Return the derivative at zero: central differences, extrapolated to step zero."""
    table = [[(function(h) - function(-h)) / (2 * h)] for h in step / 2.0 ** np.arange(levels)]
    for i in range(1, levels):
        for m in range(1, i + 1):
            table[i].append((4**m * table[i][m - 1] - table[i - 1][m - 1]) / (4**m - 1))
    steps = [abs(table[i][i] - table[i - 1][i - 1]) for i in range(1, levels)]
    return table[int(np.argmin(steps)) + 1][int(np.argmin(steps)) + 1]


def gradient_holds(
    evaluate: Callable[[np.ndarray], Any],
    x: np.ndarray,
    scale: np.ndarray,
    rtol: float = 1e-9,
    atol: float = 1e-9,
) -> None:
    """Hold the gradient of an evaluated cost against differences along each unknown."""
    at = evaluate(x)
    gradient = 2 * at.jacobian().T @ at.residual

    def along(h: float, step: np.ndarray) -> float:
        return evaluate(x + h * step).cost

    found = [extrapolated(partial(along, step=step), 4e-3) for step in np.diag(scale)]
    np.testing.assert_allclose(gradient * scale, found, rtol=rtol, atol=atol * np.abs(found).max())


def deviations(
    function: Callable[[np.ndarray], np.ndarray],
    values: np.ndarray,
    covariance: np.ndarray,
    step: float = 1e-6,
) -> np.ndarray:
    """Return the deviations that a covariance of values gives a function of them."""
    slopes = []
    for at in np.diag(step * np.abs(values)):
        ahead, behind = (np.asarray(function(values + side * at)) for side in (1, -1))
        slopes.append((ahead - behind) / (2 * at.sum()))
    return np.sqrt(np.einsum("i...,ij,j...->...", slopes, covariance, slopes))
