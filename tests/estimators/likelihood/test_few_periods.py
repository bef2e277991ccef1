"""How few periods widen deviations, beside scipy's t and the weights of each line."""

import numpy as np
import pytest
import scipy.stats
from result_cases import close_case, minimum_from_the_truth


@pytest.mark.parametrize(("periods", "widest"), [(10, 1.097), (100, 1.007)])
def test_deviations_are_widened_by_how_few_lines_tell_them(periods, widest):
    solution, inference = minimum_from_the_truth(close_case(3, periods=periods))
    point, lines, equations, n = solution.point, 15, 4, periods - 1
    left = np.linalg.svd(point.jacobian * inference.linear.scale, full_matrices=False)[0]
    t = equations - (left**2).reshape(lines, -1).sum(axis=1) / 2
    weighted = (
        np.repeat((n - t) / n, 2 * equations)[:, None] * point.jacobian * inference.linear.scale
    )
    influence = inference.linear.scale[:, None] * np.linalg.pinv(weighted)
    power = (influence**2).reshape(len(influence), lines, -1).sum(axis=2)
    share = power / power.sum(axis=1, keepdims=True)
    freedom = 1 / (share**2 / (2 * (n - t + 1))).sum(axis=1)
    factor = scipy.stats.t.ppf(0.975, freedom) / scipy.stats.norm.ppf(0.975)
    assert 1.0 < factor.min() < factor.max() < widest
    assert np.sqrt(np.diag(inference.covariance)) == pytest.approx(
        factor * np.sqrt(power.sum(axis=1)), rel=1e-7
    )
