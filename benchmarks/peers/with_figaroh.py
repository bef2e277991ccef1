"""figaroh: its weighted least squares, each equation by the variance of its own residual.

Twice, as its `BaseIdentification` does for the joints of a robot (Gautier 1997). Its regressors are
those of rigid bodies and joints from a URDF; the rotor's are given.
"""

import numpy as np
from common import Case, enter, of_base, regression
from figaroh.tools.solver import LinearSolver


def solve(case: Case) -> dict:
    F, b = regression(case)
    parts = np.stack([F.real, F.imag], axis=1), np.stack([b.real, b.imag], axis=1)
    rows, right = (np.moveaxis(part, 0, 2) for part in parts)  # (part, coordinate, sample)
    equations, flat = rows.reshape(-1, F.shape[-1]), right.ravel()
    scale = np.linalg.norm(equations, axis=0)
    theta = LinearSolver("lstsq").solve(equations / scale, flat)
    residual = (flat - equations / scale @ theta).reshape(8, -1)
    variance = np.repeat((residual**2).mean(axis=1), residual.shape[1])
    theta = LinearSolver("weighted", weights=1 / variance).solve(equations / scale, flat)
    whitened = equations / scale / np.sqrt(variance)[:, None]
    covariance = np.linalg.inv(whitened.T @ whitened) / np.outer(scale, scale)
    return of_base(theta / scale, covariance)


if __name__ == "__main__":
    enter(solve)
