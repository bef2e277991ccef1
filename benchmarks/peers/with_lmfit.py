"""lmfit: output error in the frequency domain, the noise of the forces in the weights.

From linear least squares, or by logarithms from the start that is given. The first pass weights the
readings by their own noise, the second by theirs and that of the forces through the compliance.
"""

import lmfit
import numpy as np
from common import Case, answer, enter, real
from with_numpy import start_of


def solve(case: Case) -> dict:
    lines = case.lines()
    own = np.diag(lines.reading_variance) / 2  # of the real part, and of the imaginary one
    whitener = np.broadcast_to(np.diag(1 / np.sqrt(np.diag(own))), (len(lines.omega), *own.shape))
    parameters = lmfit.create_params(**start_of(case))
    for name in case.told["known"]:
        parameters[name].vary = False

    def motion(parameters: lmfit.Parameters) -> np.ndarray:
        return case.predicted(parameters.valuesdict(), lines, lines.force)[0]

    def logarithms(parameters: lmfit.Parameters) -> np.ndarray:
        return real(np.log(lines.reading / motion(parameters)))

    def residual(parameters: lmfit.Parameters) -> np.ndarray:
        return real(np.einsum("kij,kj->ki", whitener, lines.reading - motion(parameters)))

    if len(case.coordinates) < 4:
        parameters = lmfit.minimize(logarithms, parameters, max_nfev=1000).params
    for _ in range(2):
        fit = lmfit.minimize(residual, parameters, scale_covar=False, max_nfev=1000)
        parameters = fit.params
        _, compliance = case.predicted(parameters.valuesdict(), lines, lines.force)
        through = compliance * lines.force_variance / 2 @ compliance.conj().swapaxes(1, 2)
        whitener = np.linalg.inv(np.linalg.cholesky(own + through))
    if not (fit.success and fit.errorbars):
        raise RuntimeError(fit.message)
    return answer(*zip(*((each.value, each.stderr) for each in fit.params.values()), strict=True))


if __name__ == "__main__":
    enter(solve)
