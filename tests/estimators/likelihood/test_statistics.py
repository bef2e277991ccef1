"""Efficiency, cost and coverage over many seeds; figures of theory.md, sections 1 and 3."""

from dataclasses import replace
from functools import partial
from itertools import cycle

import numpy as np
import pytest
from bank import times
from scipy.stats import norm

from rotorid import Channel, MaximumLikelihood, predict_accuracy
from rotorid.testing import add_noise

pytestmark = pytest.mark.slow

SEEDS = 100

quick = partial(MaximumLikelihood, effort="quick")
"""The first minimum, in half the time: from near the truth it is the one that normal effort finds.

`test_bearing_sensors_from_far_away` and `test_headline` ask for it with normal effort.
"""


def check(found, least=None, *, joint=True, asked=slice(None)):
    """Hold scatter, coverage and cost of `SEEDS` records against what is stated.

    A scatter over what is stated has a standard error of 7.1 %: one deviation that is stated 25 %
    too small (a scatter of 1.33) is found with 92 %. All of them together show in the distance from
    the truth, whose mean is known to 4.1 % of a dozen: 10 % too small is found always. A 5 % test
    that rejects 10 % has normal quantiles of 1.28 times their deviation, which is known to 7.1 %.
    `least` is the Cramer-Rao bound of each.
    """
    assert found.statuses.count("ok") == SEEDS
    scatter = (found.rms / found.stated)[asked]
    assert (np.abs(scatter - 1) < 0.2).all()
    assert (np.abs(found.coverage[asked] - 0.95) < 0.07).all()
    assert abs(found.cost_deviation) < 3
    assert not joint or abs(found.distance_deviation) < 3
    quantiles = norm.ppf(found.p_values)
    assert abs(quantiles.mean()) < 3 / np.sqrt(SEEDS)
    assert quantiles.std() == pytest.approx(1, abs=0.2)
    if least is not None:
        assert (found.stated <= 1.06 * least).all()


def bounds_of(machine, found, sensors=None, **options):
    estimator = MaximumLikelihood(**options)
    bound = predict_accuracy(machine.model, machine.plan(sensors), estimator, machine.truth)
    return np.array([bound.std(name) for name in found.names])


def near(machine, rng, held, spread=0.1):
    """Return starts within so much of the truth of all but what is held."""
    start = machine.start(rng, spread)
    return {name: value for name, value in start.items() if name not in held}


def test_all_coordinates_base_parameters(demo, statistics):
    model = demo.model
    truth = dict(zip(model.base.names, model.base_values(demo.values), strict=True))
    clean = demo.record()
    load = {"m2*xi", "m2*zeta", "I_t*mu - I_p*mu", "I_t*eta - I_p*eta"}

    def draw(rng):
        start = {
            n: 0.0 if n in load else v * (1 + 0.1 * rng.uniform(-1, 1)) for n, v in truth.items()
        }
        return [demo.noisy(clean, rng)], quick(base=True, start=start)

    found = statistics.over_seeds(model, truth, draw, SEEDS, seed=101)
    check(found, bounds_of(demo, found, base=True))
    assert np.mean(found.expected) == pytest.approx(84.2, abs=0.2)


OTHER = {"L1": 0.25, "L2": 0.4, "k1": 5e5, "k2": 1.2e6}


def test_physical_parameters_by_the_bearing_sensors(demo, bearings, statistics):
    """All but L1 by four sensors, of an asymmetric rotor: nothing was made for the paper's.

    Its dynamic unbalance is known to 8 %, near a resonance: each interval holds, the joint one is
    bent. The distance from the truth in the metric of the covariance has mean 14.6 where 12 would
    be expected: second-order terms, products of large errors, along directions that are known much
    better.
    """
    machine = replace(demo, truth={**demo.truth, **OTHER})
    fixed = {"L1": machine.truth["L1"]}
    clean = machine.record(bearings)

    def draw(rng):
        start = near(machine, rng, fixed)
        return [machine.noisy(clean, rng)], quick(fixed=fixed, start=start)

    found = statistics.over_seeds(machine.model, machine.truth, draw, SEEDS, seed=104)
    check(found, bounds_of(machine, found, bearings, fixed=fixed), joint=False)


@pytest.mark.parametrize("amplitude", [1.0, 1000.0])
def test_bearing_sensors_from_far_away(demo, bearings, statistics, amplitude):
    """All from +-40 %, unbalance from zero.

    With 20 of `test_headline` there are 140: a search that loses 2.1 % passes with 5 %.
    """
    clean = demo.record(bearings, amplitude=amplitude)

    def draw(rng):
        start = near(demo, rng, {"L1"}, 0.4)
        return [demo.noisy(clean, rng)], MaximumLikelihood(fixed={"L1": 0.3}, start=start)

    found = statistics.over_seeds(demo.model, demo.truth, draw, 60, seed=102)
    # Not one lies at another minimum: the cost is what noise leaves, and no estimate is far off.
    assert found.statuses.count("ok") == 60
    assert np.abs(np.array(found.errors) / np.array(found.stds)).max() < 5.5
    assert min(found.p_values) > 1e-5


TABLE = ("m1", "m2", "I_t", "I_p", "k1", "L2", "xi", "zeta", "mu", "eta")
HEADLINE = np.array([0.42, 0.05, 3.0, 0.79, 0.45, 0.25, 0.44, 0.30, 28, 12])
"""Standard deviations in percent of TABLE, from theory.md."""


def test_headline(levitated, statistics):
    """Bearing sensors with unknown runout, coil currents, one scale, one ruler: everything.

    Over 60 records a scatter is known to 9 %, and all of them to 2.5 %; the deviations are those of
    theory.md, which `test_bound` has for runout and k_i alone as well. Every third takes the effort
    of all further starts.
    """
    machine, truth = levitated.machine, levitated.truth
    clean = [levitated.record(hertz) for hertz in (140.0, 100.0)]
    options = {"runout": True, "gains": ("ki", "ks"), "constraints": (levitated.weighed,)}
    efforts = cycle(["normal", "quick", "quick"])

    def draw(rng):
        start = near(machine, rng, {"L1"}, 0.4)
        for name in ("ks", *(n for n in truth if n.startswith("ki["))):
            start[name] = truth[name] * (1 + (0.5 if name == "ks" else 0.2) * rng.uniform(-1, 1))
        records = [levitated.noisy(record, rng) for record in clean]
        estimator = MaximumLikelihood(fixed={"L1": 0.3}, start=start, **options)
        return records, replace(estimator, effort=next(efforts))

    found = statistics.over_seeds(machine.model, truth, draw, 60, seed=103)
    assert found.statuses.count("ok") == 60
    assert np.abs(np.array(found.errors) / np.array(found.stds)).max() < 5
    assert abs(found.cost_deviation) < 3
    assert abs(found.distance_deviation) < 3
    assert (np.abs(found.rms / found.stated - 1) < 0.28).all()
    at = [found.names.index(name) for name in TABLE]
    stated = 100 * found.stated[at] / np.abs(np.array(found.truth)[at])
    rounding = 0.5 * 10.0 ** np.array([-2] * 8 + [0] * 2) / HEADLINE
    assert (np.abs(stated / HEADLINE - 1) < 0.15 + rounding).all()


def test_few_periods(demo, statistics):
    """theory.md: intervals cover 95 to 97 % at 20 periods, and the test of the misfit holds."""
    clean = demo.record(periods=20)

    def draw(rng):
        estimator = quick(start=demo.start(rng, 0.1), covariance="white")
        return [demo.noisy(clean, rng)], estimator

    check(statistics.over_seeds(demo.model, demo.truth, draw, SEEDS, seed=105), joint=False)


@pytest.mark.sampled(0, parts=3)
@pytest.mark.parametrize(("periods", "every"), [(3, True), (4, False), (6, False)])
def test_very_few_periods(demo, bearings, statistics, periods, every):
    """C is mixed with its diagonal: four and eight sensors, of 3 to 6 periods.

    Parameters of a record err together: the mean cover of 100 records is known to 1 %.
    """
    clean = demo.record(None if every else bearings, periods=periods)
    noise = {name: 0.15 * std for name, std in demo.noise(clean.names).items()}
    fixed = {} if every else {"L1": 0.3}

    def draw(rng):
        return [add_noise(clean, noise, rng)], quick(fixed=fixed, start=near(demo, rng, fixed))

    found = statistics.over_seeds(demo.model, demo.truth, draw, SEEDS, seed=115)
    assert found.statuses.count("ok") == SEEDS
    assert 0.93 <= found.coverage.mean() <= 0.98
    assert 0.7 < np.median(found.p_values) / 0.5 < 1.4


def test_gains_with_priors_cover(demo, bearings, statistics):
    """1 % on each of four sensors, drawn anew for every record."""
    sensors = [Channel(name, "m", gain_std=0.01) for name in bearings]
    clean = demo.record(sensors)
    estimator = quick(fixed={"L1": 0.3}, start=near(demo, np.random.default_rng(0), {"L1"}, 0))

    def draw(rng):
        spectra = clean.spectra.copy()
        spectra[:, :, 4:] *= 1 + 0.01 * rng.standard_normal(4)
        return [demo.noisy(replace(clean, spectra=spectra), rng)], estimator

    # The errors of the gains themselves are left out: they differ from record to record.
    truth = {**demo.truth, **{f"gain[{name}]": np.nan for name in bearings}}
    found = statistics.over_seeds(demo.model, truth, draw, SEEDS, seed=106)
    check(found, joint=False, asked=slice(12))


def test_declared_delay_covers(demo, bearings, statistics):
    """The paper's rotor, with 5 us between forces and positions."""
    clean = demo.record(bearings)
    late = times(clean, bearings, np.exp(-5e-6j * clean.omega))
    start = near(demo, np.random.default_rng(0), {"L1"}, 0)
    told = {"fixed": {"L1": 0.3}, "delays": ("position",)}

    def draw(rng):
        return [demo.noisy(late, rng)], quick(start=start, **told)

    truth = {**demo.truth, "delay[position]": 5e-6}
    found = statistics.over_seeds(demo.model, truth, draw, SEEDS, seed=107)
    check(found, bounds_of(demo, found, bearings, **told))
