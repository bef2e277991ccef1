"""Efficiency, cost and coverage over many seeds; figures of theory.md, sections 1 and 3."""

import numpy as np
import pytest

from rotorid.estimators import MaximumLikelihood

pytestmark = pytest.mark.slow


def covers(statistics) -> bool:
    """Each 95 % interval covers 93.5 to 96.5 %; over 2000 seeds one error is 0.5 %."""
    return bool((np.abs(statistics.coverage - 0.95) <= 0.015).all())


def agrees(statistics) -> bool:
    """J and the distance from the truth have the mean that they should."""
    return abs(statistics.cost_deviation) < 3 and abs(statistics.distance_deviation) < 3


def test_all_coordinates_base_parameters(demo, monte_carlo):
    model = demo.model
    truth = dict(zip(model.base.names, model.base_values(demo.values), strict=True))
    clean = demo.record()
    load = {"m2*xi", "m2*zeta", "I_t*mu - I_p*mu", "I_t*eta - I_p*eta"}

    def draw(rng):
        start = {
            n: 0.0 if n in load else v * (1 + 0.4 * rng.uniform(-1, 1)) for n, v in truth.items()
        }
        return [demo.noisy(clean, rng)], MaximumLikelihood(base=True, start=start)

    found = monte_carlo(model, truth, draw, 2000, seed=101)
    assert found.statuses.count("ok") == 2000
    assert agrees(found)
    assert covers(found)
    assert np.mean(found.expected) == pytest.approx(84.2, abs=0.1)


@pytest.mark.parametrize("amplitude", [1.0, 1000.0])
def test_bearing_sensors_from_far_away(demo, bearings, monte_carlo, amplitude):
    """1000 of 1000 from +-40 %, unbalance from zero."""
    clean = demo.record(bearings, amplitude=amplitude)

    def draw(rng):
        start = demo.start(rng, 0.4)
        del start["L1"]
        return [demo.noisy(clean, rng)], MaximumLikelihood(fixed={"L1": 0.3}, start=start)

    found = monte_carlo(demo.model, demo.truth, draw, 1000, seed=102)
    # Not one lies at another minimum: the cost is what noise leaves, and no estimate is far off.
    assert found.statuses.count("ok") == 1000
    assert np.abs(np.array(found.errors) / np.array(found.stds)).max() < 5.5
    assert min(found.p_values) > 1e-5
