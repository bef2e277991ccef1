"""odrpack: orthogonal distance regression, forces and readings both with noise, line by line."""

import numpy as np
from common import NAMES, Case, answer, enter
from odrpack import odr_fit
from with_numpy import start_of


def parts(z: np.ndarray) -> np.ndarray:
    """Return real over imaginary parts, one column a line."""
    return np.concatenate([z.real.T, z.imag.T])


def solve(case: Case) -> dict:
    lines = case.lines()

    def motion(x: np.ndarray, beta: np.ndarray) -> np.ndarray:
        force = (x[:2] + 1j * x[2:]).T
        return parts(case.predicted(dict(zip(NAMES, beta, strict=True)), lines, force)[0])

    start = start_of(case)
    fit = odr_fit(
        motion,
        parts(lines.force),
        parts(lines.reading),
        np.array([start[name] for name in NAMES]),
        weight_x=np.tile(2 / lines.force_variance, 2),
        weight_y=np.tile(2 / lines.reading_variance, 2),
        fix_beta=np.array([name in case.told["known"] for name in NAMES]),
        diff_scheme="central",
        maxit=200,
    )
    if not fit.success:
        raise RuntimeError(fit.stopreason)
    return answer(fit.beta, fit.sd_beta)


if __name__ == "__main__":
    enter(solve)
