"""The estimator from records to `Estimate`: exact recovery, invariants, what it reports."""

from dataclasses import replace

import numpy as np
import pytest
from bank import recovered, steady, times
from hypothesis import given, settings
from hypothesis import strategies as st
from model_text import model_text

import rotorid as rid
from rotorid import (
    InputError,
    MaximumLikelihood,
    Model,
    ModelError,
    identify,
    load_estimate,
    parse_model,
)


@pytest.mark.parametrize(("by_bearings", "base"), [(False, False), (False, True), (True, False)])
def test_recovers_noise_free_data(demo, bearings, by_bearings, base):
    record = demo.record(bearings if by_bearings else None)
    start = demo.start(np.random.default_rng(1))
    fixed = {"L1": 0.3} if by_bearings else {}
    start = {name: value for name, value in start.items() if name not in fixed}
    estimate = demo.identified(record, fixed=fixed, start=start, base=base)
    assert estimate.status == "ok"
    assert estimate.method == "ml"
    recovered(estimate, demo.truth)
    names, values = demo.model.base.names, demo.model.base_values(demo.values)
    recovered(estimate, dict(zip(names, values, strict=True)))


def test_starts_from_batch_without_nominal_values(demo):
    untold = tuple(replace(p, nominal=None) for p in demo.model.parameters)
    bare = replace(demo.model, parameters=untold)
    estimate = identify(bare, demo.seen(2, None), MaximumLikelihood())
    assert estimate.status == "ok"
    assert estimate.value("m2") == pytest.approx(demo.truth["m2"], rel=5e-3)


BESIDE = model_text(
    "a rigid rotor in one plane, whose sensor a is not beside its magnet",
    ["m*x'' = F_a + F_b", "I*th'' = L_b*F_b - L_a*F_a"],
    "x m, th rad",
    "F_a N, F_b N",
    "m +9.0 kg, I +0.2 kg m^2, L_a 0.18 m, L_b 0.22 m, S_a 0.2 m",
)


def test_a_parameter_that_a_sensor_alone_reads_is_one_like_others():
    truth = {"m": 9.7, "I": 0.21, "L_a": 0.18, "L_b": 0.22, "S_a": 0.205}
    model, omega = parse_model(BESIDE), 2 * np.pi * 20.0 * np.array([1, 3, 5, 7])
    force = 4 * np.exp(2j * np.pi * np.random.default_rng(1).random((4, 2)))
    x = -force.sum(axis=1) / (truth["m"] * omega**2)
    tilt = -(0.22 * force[:, 1] - 0.18 * force[:, 0]) / (truth["I"] * omega**2)
    values = np.column_stack([force, x - 0.205 * tilt, x + 0.22 * tilt])

    def answer(lever: str) -> rid.Estimate:
        reads = {"s_a": {"x": 1.0, f"{lever}*th": -1.0}, "s_b": {"x": 1.0, "L_b*th": 1.0}}
        channels = [rid.Channel(name, "N") for name in model.inputs]
        channels += [rid.Channel(name, "m", reads=what) for name, what in reads.items()]
        noise = np.random.default_rng(2).standard_normal((6000, 4)) * [1e-6, 1e-6, 1e-12, 1e-12]
        turning = np.exp(1j * np.outer(np.arange(500) / 10e3, omega))
        samples = np.tile((turning @ values).real, (12, 1)) + noise
        record = rid.Record(channels, samples, sample_rate=10e3, speed=0.0)
        periods = rid.average(record, 20.0, harmonics=[1, 3, 5, 7])
        return identify(model, periods, MaximumLikelihood(fixed={"L_a": 0.18, "L_b": 0.22}))

    found = answer("S_a")
    assert found.status == "ok"
    assert {n: found.value(n) for n in truth} == pytest.approx(truth, rel=1e-6)
    assert 0 < found.std("S_a") < 1e-6
    with pytest.raises(InputError, match="S_a in no equation of the model, and in nothing that a"):
        answer("L_a")


WITH_FORCES = ("m1", "m2", "m3", "I_t", "I_p", "k1", "k2")


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(factor=st.floats(1e-3, 1e3))
def test_scaling_forces_scales_masses(demo, factor):
    record = demo.seen(4, periods=40)
    scaled = times(record, demo.model.inputs, factor)
    start = {name: factor * demo.truth[name] for name in WITH_FORCES}
    one = demo.identified(record, effort="quick")
    other = demo.identified(scaled, effort="quick", start=start)
    assert other.misfit.cost == pytest.approx(one.misfit.cost, rel=1e-7)
    for value in one.parameters:
        scale = factor if value.name in WITH_FORCES else 1.0
        near = pytest.approx(scale * value.value, rel=1e-9, abs=1e-4 * scale * (value.std or 0))
        assert other.value(value.name) == near


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_a_start_a_thousand_times_off(demo, factor):
    """All masses and stiffnesses alike: the finer homotopy finds the way back."""
    start = {name: factor * demo.truth[name] for name in WITH_FORCES}
    estimate = demo.identified(demo.seen(4, periods=40), start=start)
    assert estimate.status == "ok"
    assert estimate.value("m2") == pytest.approx(demo.truth["m2"], rel=0.01)


@pytest.mark.slow
@settings(max_examples=6, deadline=None)
@given(order=st.permutations(range(8)))
def test_permuting_equations_changes_nothing(demo, order):
    record = demo.seen(5, periods=40)
    other = replace(demo, model=permuted(demo.model, order))
    one, other = (machine.identified(record, effort="quick") for machine in (demo, other))
    assert other.misfit.cost == pytest.approx(one.misfit.cost, rel=1e-7)
    for value in one.free:
        assert other.value(value.name) == pytest.approx(value.value, abs=1e-4 * (value.std or 0))


def permuted(model: Model, order) -> Model:
    place = {row: i for i, row in enumerate(order)}
    equations = tuple(replace(p, row=place[p.row]) for p in model.equations)
    return replace(model, texts=tuple(model.texts[i] for i in order), equations=equations)


def test_line_misfits_add_up(demo):
    estimate = demo.identified(demo.seen(6, None), fixed={})
    assert sum(m.cost for m in estimate.line_misfit) == pytest.approx(estimate.misfit.cost)
    assert sum(m.expected for m in estimate.line_misfit) == pytest.approx(estimate.misfit.expected)
    assert [m.frequency_hz for m in estimate.line_misfit] == [20, 60, 100, 140, 180, 220]


def test_fixed_parameters_keep_their_place_and_have_no_deviation(demo):
    estimate = demo.identified(demo.seen(8))
    assert [v.name for v in estimate.parameters] == list(demo.model.parameter_names)
    assert estimate["L1"].fixed
    assert (estimate.value("L1"), estimate.std("L1")) == (0.3, 0.0)
    assert estimate.covariance.shape == (12, 12)
    full = demo.identified(demo.seen(9, None), base=True)
    assert full["L1"].fixed
    assert full.value("k2*L2") == pytest.approx(8.8357e5 * 0.3, rel=0.01)


def test_dc_line_holds_constants():
    """A weight on springs: real equations at DC, complex ones above."""
    parameters = "m +2.0 kg, c 5.0 N s/m, k +900.0 N/m, w 3.0 N"
    equations = ["m*x'' + c*x' + k*x + w = F"]
    model = rid.parse_model(model_text("a weight", equations, "x m", "F N", parameters))
    forces, noise = np.array([[0.0], [1.0], [2.0]]), {"F": 0.01, "x": 1e-4}
    clean, noisy = (
        steady(model, {}, forces, (0, 1, 4), 1.0, 100.0, 50, noise=noise, rng=rng)
        for rng in (None, np.random.default_rng(0))
    )
    estimate = identify(model, clean, MaximumLikelihood())
    recovered(estimate, model.nominal)
    estimate = identify(model, noisy, MaximumLikelihood())
    assert estimate.misfit.dof == 1 + 2 + 2 - 4
    assert estimate.status == "ok"


def test_refuses_what_is_not_linear_in_the_coordinates(demo):
    with pytest.raises(ModelError, match="equation 1: found the term sign"):
        identify(rid.load_model("emps"), demo.record(), MaximumLikelihood())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fixed": {"L9": 0.3}}, "'L9' in fixed"),
        ({"known": {"L1": (0.3, 0.0)}}, "a value and a deviation of more than 0"),
        ({"known": {"L1": (0.3, 2.9e-13)}}, "a deviation of 2.9e-13 of L1 .* write fixed"),
        ({"bounds": {"L1": (0.4, 0.4)}}, "L1 from 0.4 to 0.4; expected a lower bound below"),
        ({"bounds": {"2*I_t - I_p": (1.0, 0.5)}}, "I_p from 1 to 0.5"),
        ({"bounds": {"m1": (None, -1.0)}}, "m1 from 0 to -1, which the model calls positive"),
        ({"start": {"m1": -1.0}}, "a start of m1 that is not positive"),
        ({"start": {"m1": float("nan")}}, "finite numbers"),
        ({"gains": ("kx",)}, "gains: found 'kx'"),
        ({"gains": ("ks", "ks*")}, "both ks and ks"),
        ({"gains": ("ks",)}, "an unknown ks, but forces instead of currents"),
        ({"delays": ("current",)}, "delays: found 'current'"),
        ({"covariance": "diagonal"}, "covariance 'diagonal'"),
        ({"fixed": {"L1": 0.3}, "known": {"L1": (0.3, 0.1)}}, "L1 both fixed and"),
    ],
)
def test_refuses_contradictory_options(demo, bearings, options, message):
    with pytest.raises(InputError, match=message):
        identify(demo.model, demo.record(bearings), MaximumLikelihood(**options))


def test_refuses_to_estimate_nothing_and_names_nothing_twice(demo):
    record = demo.seen(3)
    with pytest.raises(InputError, match="every parameter fixed"):
        demo.identified(record, fixed=demo.truth)
    twice = {"delays": ("position", "position"), "effort": "quick"}
    (free,) = demo.identified(record, fixed=demo.truth, **twice).free
    assert free.name == "delay[position]"


@pytest.mark.sampled(1)
@pytest.mark.parametrize("periods", [12, 5, 2])
def test_too_few_periods_say_so(demo, periods):
    """V is mixed with the diagonal of C; deviations are rough, rather too wide than too narrow."""
    start = demo.start(np.random.default_rng(0), 0.0)
    scaled = []
    for seed in range(5):
        estimate = demo.identified(demo.seen(seed, None, periods=periods), fixed={}, start=start)
        assert estimate.status == "ok"
        assert "too few periods" in estimate.warnings[0]
        assert "record more periods" in estimate.warnings[0]
        scaled.append([(v.value - demo.truth[v.name]) / v.std for v in estimate.free])
    assert 0.3 < np.sqrt(np.mean(np.square(scaled))) < 1.3


def test_no_way_to_a_minimum_is_a_result_too(demo, bearings, tmp_path, monkeypatch):
    def lost(*_, **__):
        raise np.linalg.LinAlgError("singular")

    monkeypatch.setattr("rotorid.likelihood.starts.solve", lost)
    estimate = demo.identified(demo.record(bearings))
    assert estimate.status == "not_converged"
    assert estimate.value("L1") == 0.3
    assert np.isnan(estimate.value("m1"))
    assert "give a nearer one" in estimate.warnings[-1]
    estimate.save(tmp_path / "result.json")
    assert load_estimate(tmp_path / "result.json").status == "not_converged"
