"""The levitated rig: sensor noise comes back through the controller as motion and as current.

The true random motion carries over from one period to the next, so that the scatter between
periods overstates the noise of the mean, and the noise of currents and positions is correlated.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from result_cases import fit
from scipy.stats import norm

import rotorid as rid
from rotorid import Lines, MaximumLikelihood, Misfit, average, identify
from rotorid.likelihood.inference import infer
from rotorid.likelihood.solver import solve
from rotorid.likelihood.unknowns import Nuisances
from rotorid.models.knowledge import Knowledge
from rotorid.rig.rig import Rig
from rotorid.signals.covariance import LineCovariance, correlated_covariance
from rotorid.testing import bind, parse_rig

HARMONICS = (1, 3, 5, 7, 9, 11)


RUNOUT = {"x1": (5, -3), "y1": (2, 4), "x3": (-6, 1), "y3": (3, 3)}  # um


@cache
def rig(rpm: int = 8400, *, bearings: bool = False) -> Rig:
    """The shipped rig at a lower rate, so that hundreds of runs take minutes."""
    text = rid.load_rig("three-mass").text.replace("10 kHz", "4 kHz")
    text = text.replace('settling = "2 s"', 'settling = "0.5 s"')
    text = text.replace("8400 rpm", f"{rpm} rpm")
    if bearings:
        head, rest = text.split("[sensors]")
        sensors = [
            f'{name} = {{ noise = "2 um", runout = [{{ order = 1, cos = "{cos} um", '
            f'sin = "{sin} um" }}] }}'
            for name, (cos, sin) in RUNOUT.items()
        ]
        tail = rest[rest.index("[excitation]") :]
        text = head + "[sensors]\n" + "\n".join(sensors) + "\n\n" + tail
    return parse_rig(text).rig


def run(*seed: int, periods: int = 130, on: Rig | None = None) -> rid.PeriodicRecord:
    record = (on or rig()).run(periods / 20.0, np.random.default_rng(seed))
    return average(record, 20.0, harmonics=HARMONICS)


def test_choice_of_covariance(demo):
    """By the residual's correlation between periods: in closed loop yes, open loop no."""
    closed = run(77, 0)
    chosen = identify(demo.model, closed, MaximumLikelihood())
    quick = MaximumLikelihood(effort="quick")
    correlated = identify(demo.model, closed, replace(quick, covariance="correlated"))
    assert chosen.misfit.expected == pytest.approx(correlated.misfit.expected, rel=1e-6)
    assert chosen.status == "ok"
    assert chosen.misfit.cost == pytest.approx(correlated.misfit.cost, rel=1e-6)
    open_loop = demo.seen(61, None)
    chosen = identify(demo.model, open_loop, quick)
    white = identify(demo.model, open_loop, replace(quick, covariance="white"))
    assert chosen.misfit == white.misfit


def test_neighbours_may_be_chosen(demo):
    record = run(77, 1)
    narrow, wide = (
        identify(demo.model, record, MaximumLikelihood(covariance="correlated", neighbours=m))
        for m in (15, 25)
    )
    # About dof n / (n - t), of which theory.md has 106.2 and 95.0 for 82 degrees of freedom; the
    # sum over lines, each with its own t, is a little more.
    assert narrow.misfit.expected == pytest.approx(83 * 30 / (30 - 83 / 12), rel=5e-3)
    assert wide.misfit.expected == pytest.approx(83 * 50 / (50 - 83 / 12), rel=5e-3)


@pytest.mark.slow
def test_statistics_of_the_three_covariances(demo, statistics):
    """140 records. What holds: cross terms, from neighbouring lines; what does not: the rest.

    A deviation that is stated 25 % too small is found with 97 %, 10 % of all of them together
    always. That the rest does not hold shows in forty records.
    """
    found = {name: statistics() for name in ("correlated", "white", "diagonal")}

    def add(name, solution, inference):
        point = solution.point
        misfit = Misfit(point.cost, inference.expectation.mean, 0, inference.p_value)
        found[name].append(point.unknowns - demo.values, inference.covariance, misfit)

    model, knowledge = demo.model, Knowledge(start=demo.truth)
    for seed in range(140):
        record = run(77, seed)
        for choice in ("auto", "white") if seed < 40 else ("correlated",):
            fitted = fit(model, [bind(model, record)], knowledge, Nuisances(), covariance=choice)
            name = "white" if choice == "white" else "correlated"
            assert fitted.records[0].lines.covariance.kind == name
            add(name, fitted.solution, fitted.inference)
        if seed >= 40:
            continue
        whole = correlated_covariance(record.spectra)
        alone = LineCovariance(whole.matrices * np.eye(12), whole.dof, whole.kind)
        prepared = fitted.problem
        problem = prepared.of([bind(model, Lines.of_periods(record, alone))])
        solution = solve(problem, prepared.layout.start)
        add("diagonal", solution, infer(solution.point))
    right = found["correlated"]
    assert abs(right.cost_deviation) < 3
    assert norm.ppf(right.p_values).std() == pytest.approx(1, abs=0.18)
    assert abs(right.distance_deviation) < 3
    # Over 140 runs one standard error of a coverage is 1.8 %, of a scatter 6 %.
    assert (np.abs(right.coverage - 0.95) < 0.06).all()
    assert (np.abs(right.rms / right.stated - 1) < 0.19).all()
    white, diagonal = found["white"], found["diagonal"]
    assert white.cost_deviation < -5
    assert white.rejected < 0.02
    assert diagonal.cost_deviation < -40
    assert diagonal.rejected < 0.01
    assert (diagonal.rms / diagonal.stated).min() < 0.6  # two and a half times too wide


@pytest.mark.slow
def test_headline_in_closed_loop(demo):
    """Levitated, its bearing sensors with unknown runout, coil currents with unknown constants."""
    truth = {**demo.truth, "ks": 2e5, **{f"ki[{name}]": 120.0 for name in demo.model.inputs}}
    for name, vector in RUNOUT.items():
        for part, size in zip(("cos", "sin"), vector, strict=True):
            truth[f"runout[{name}].{part}"] = 1e-6 * size
    mass = rid.Constraint("m1 + m2 + m3", 12.98878)
    known = {"fixed": {"L1": 0.3}, "gains": ("ki", "ks"), "constraints": (mass,)}
    estimator = MaximumLikelihood(runout=True, **known)
    scaled = []
    for seed in range(20):
        speeds = {rpm: rig(rpm, bearings=True) for rpm in (8400, 6000)}
        records = [run(78, seed, rpm, periods=260, on=each) for rpm, each in speeds.items()]
        estimate = identify(demo.model, records, estimator)
        assert estimate.status == "ok"
        scaled.append([(v.value - truth[v.name]) / v.std for v in estimate.free])
    rms = np.sqrt(np.mean(np.square(scaled), axis=0))
    assert rms.max() < 1.5  # three standard errors of an rms over 20
    assert np.sqrt(np.mean(rms**2)) == pytest.approx(1.0, abs=0.12)
