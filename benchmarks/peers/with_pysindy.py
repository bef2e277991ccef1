"""pysindy: an equation at a time, with the columns that the rotor's equation has.

Both planes are two trajectories of one equation, derivatives those of the mean period in the
frequency domain. The structure is told, so there is nothing left to threshold.
"""

import numpy as np
import pysindy as ps
from common import Case, answer, enter, regression


def fitted(target: np.ndarray, *columns: np.ndarray) -> np.ndarray:
    """Return c of target = sum c column; real and imaginary parts are two trajectories."""
    scale = np.array([np.linalg.norm(column) for column in columns])
    series = np.stack(columns, axis=1) / scale
    size = np.linalg.norm(target)
    parts = np.stack([target.real, target.imag])[..., None] / size
    rates = list(np.repeat(parts, len(scale), axis=2))  # as many targets as columns, all the same
    model = ps.SINDy(ps.STLSQ(threshold=0.0, alpha=0.0), ps.IdentityLibrary())
    model.fit([series.real.copy(), series.imag.copy()], 1.0, x_dot=rates)
    return model.coefficients()[0] * size / scale


def solve(case: Case) -> dict:
    """Each equation is solved for its acceleration, as SINDy wants it."""
    F, b = regression(case)
    first, second, tilt, third = np.moveaxis(F, 1, 0)
    k1_m1, kL1_m1, one_m1 = fitted(first[:, 0], -first[:, 5], -first[:, 7], b[:, 0])
    k2_m3, kL2_m3, one_m3 = fitted(third[:, 2], -third[:, 6], -third[:, 8], b[:, 3])
    m1, m3 = 1 / one_m1, 1 / one_m3
    k1, k2, L1, L2 = k1_m1 * m1, k2_m3 * m3, kL1_m1 / k1_m1, kL2_m3 / k2_m3
    force = -(
        k1 * second[:, 5] + L1 * k1 * second[:, 7] + k2 * second[:, 6] + L2 * k2 * second[:, 8]
    )
    moment = -(k1 * L1 * tilt[:, 7] + k2 * L2 * tilt[:, 8] + (k1 * L1**2 + k2 * L2**2) * tilt[:, 9])
    one_m2, xi, zeta = fitted(second[:, 1], force, -second[:, 10], -second[:, 11])
    one_It, ratio, mu, eta = fitted(tilt[:, 3], moment, -tilt[:, 4], -tilt[:, 12], -tilt[:, 13])
    I_t, I_p = 1 / one_It, ratio / one_It
    mu, eta = mu / (1 - ratio), eta / (1 - ratio)
    return answer([m1, 1 / one_m2, m3, I_t, I_p, k1, k2, L1, L2, xi, zeta, mu, eta])


if __name__ == "__main__":
    enter(solve)
