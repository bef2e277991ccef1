"""Three masses in a row on springs, the first on the ground: as text and as matrices."""

import numpy as np
from model_text import model_text

import rotorid as rid

TEXT = model_text(
    "three masses in a row",
    [
        "m1*x1'' + c*(x1' - x2') + k1*(x1 - x2) + k0*x1 = F",
        "m2*x2'' + c*(x2' - x1') + k1*(x2 - x1) + k2*(x2 - x3) = G",
        "m3*x3'' + k2*(x3 - x2) = 0",
    ],
    "x1 m, x2 m, x3 m",
    "F N, G N",
    "m1 +2.2 kg, m2 +2.7 kg, m3 +1.3 kg, k0 +4e5 N/m, k1 +1.2e6 N/m, k2 +1.8e6 N/m, c 30.0 N s/m",
)
MODEL = rid.parse_model(TEXT)
TRUTH = {"m1": 2.0, "m2": 3.0, "m3": 1.5, "k0": 5e5, "k1": 1e6, "k2": 2e6, "c": 20.0}


def matrices(**changed: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return masses, damping and stiffness."""
    p = {**TRUTH, **changed}
    k0, k1, k2 = p["k0"], p["k1"], p["k2"]
    stiffness = np.array([[k0 + k1, -k1, 0], [-k1, k1 + k2, -k2], [0, -k2, k2]])
    damping = p["c"] * np.array([[1, -1, 0], [-1, 1, 0], [0, 0, 0]])
    return np.diag([p["m1"], p["m2"], p["m3"]]), damping, stiffness


def wrong(estimate: rid.Estimate) -> float:
    """Return how many of its deviations the worst value is off."""
    free = [value for value in estimate.parameters if not value.fixed]
    return max(abs(v.value - TRUTH[v.name]) / v.std for v in free)
