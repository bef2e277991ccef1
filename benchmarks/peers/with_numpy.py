"""The procedure of Levy and Arogeti with numpy alone, its misprints corrected.

All rows at once: those with a force weighted by its variance at each sample, (8), the others by
`FREE_WEIGHT` times the largest of these, (9); std by the inverse of (13).
"""

import numpy as np
from common import FORCES, Case, enter, of_base, regression

FREE_WEIGHT = 100.0


def solve(case: Case) -> dict:
    F, b = regression(case)
    count, samples = case.periods.shape[:2]
    variance = np.zeros((samples, 4, 2))
    for coordinate, pair in FORCES.items():
        for part, name in enumerate(pair):
            variance[:, coordinate, part] = case.column(name).var(axis=0, ddof=1) / count
    largest = variance.max(axis=(1, 2))[:, None, None]
    weight = 1 / np.sqrt(np.where(variance > 0, variance, FREE_WEIGHT * largest))
    rows = (weight[..., None] * np.stack([F.real, F.imag], axis=2)).reshape(-1, F.shape[-1])
    right = (weight * np.stack([b.real, b.imag], axis=2)).ravel()
    scale = np.linalg.norm(rows, axis=0)
    q, r = np.linalg.qr(rows / scale)
    inverse = np.linalg.inv(r) / scale[:, None]
    return of_base(inverse @ (q.T @ right), inverse @ inverse.T)


def start_of(case: Case) -> dict[str, float]:
    """Return a start for nonlinear least squares: this answer, where all coordinates are read."""
    return solve(case)["parameters"] if len(case.coordinates) == 4 else case.told["start"]


if __name__ == "__main__":
    enter(solve)
