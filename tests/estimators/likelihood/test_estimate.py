"""The estimator from records to `Estimate`: exact recovery, invariants, what it reports."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from bank import recovered, steady, times
from hypothesis import given, settings
from hypothesis import strategies as st
from model_text import model_text

import rotorid as rid
from rotorid import (
    Constraint,
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


# What is known beforehand: values, deviations, bounds, constraints.


@pytest.fixture(scope="module")
def noisy(demo):
    return demo.seen(11)


@pytest.fixture(scope="module")
def found(demo, noisy):
    """Return the estimate from one record with what is known besides a length."""
    return partial(demo.identified, noisy)


@pytest.fixture(scope="module")
def free(found):
    return found()


def test_linear_constraint_is_exact(found):
    estimate = found(constraints=(Constraint("m1 + m2 + m3", 12.98878),))
    total = sum(estimate.value(name) for name in ("m1", "m2", "m3"))
    assert total == pytest.approx(12.98878, rel=1e-14)
    assert estimate.misfit.dof == 48 - 12 + 1
    # The covariance has no spread along the constraint.
    along = np.array([float(value.name in ("m1", "m2", "m3")) for value in estimate.free])
    assert along @ estimate.covariance @ along < 1e-20
    assert estimate.status == "ok"


def test_product_constraint_is_exact(demo, found, free):
    """The static unbalance was weighed: m2 xi, and the stiffness of a bearing times its length."""
    static = demo.truth["m2"] * demo.truth["xi"]
    known = (Constraint("m2*xi", static), Constraint("k1*L1^2 - k2*L2^2", 0.0))
    estimate = found(constraints=known)
    assert estimate.value("m2*xi") == pytest.approx(static, rel=1e-13)
    assert estimate.std("m2*xi") < 1e-9 * abs(estimate.value("m2*xi"))
    one, other = (estimate.value(f"k{i}") * estimate.value(f"L{i}") ** 2 for i in (1, 2))
    assert one == pytest.approx(other, rel=1e-13)
    assert estimate.misfit.dof == free.misfit.dof + 2
    assert estimate.misfit.cost > free.misfit.cost
    assert estimate.std("k2") < free.std("k2")


def test_constraint_with_deviation_is_a_measurement(demo, found, free):
    """Between no constraint and the exact one, and equal to each in the limits."""
    known = [Constraint("m1 + m2 + m3", 12.98878, std) for std in (1e3, 1e-3, 0.0)]
    loose, firm, exact = (found(constraints=(each,)) for each in known)
    for value in free.free:
        scale = free.std(value.name)
        assert loose.value(value.name) == pytest.approx(value.value, abs=1e-3 * scale)
        assert loose.std(value.name) == pytest.approx(scale, rel=1e-4)
        assert exact.std(value.name) <= firm.std(value.name) * (1 + 1e-4)
        assert firm.std(value.name) <= scale * 1.01
    assert loose.misfit.dof == free.misfit.dof + 1
    assert loose.misfit.expected == pytest.approx(free.misfit.expected + 1, abs=1e-3)
    assert demo.truth["m2"] == pytest.approx(firm.value("m2"), abs=4 * firm.std("m2"))


def test_value_with_deviation_equals_constraint_with_deviation(found):
    one = found(fixed={}, known={"L1": (0.3, 0.5e-3)})
    other = found(fixed={}, constraints=(Constraint("L1", 0.3, 0.5e-3),))
    assert one.misfit.cost == pytest.approx(other.misfit.cost, rel=1e-9)
    for value in one.free:
        assert other.value(value.name) == pytest.approx(value.value, abs=1e-4 * value.std)
        assert other.std(value.name) == pytest.approx(value.std, rel=1e-4)
    # theory.md, section 3: a length measured to 0.5 mm moves I_p from .05 to .34 %.
    assert 100 * one.std("I_p") / one.value("I_p") == pytest.approx(0.34, abs=0.02)


def test_bound_that_does_not_bind_changes_nothing(found, free):
    bounded = found(bounds={"2*I_t - I_p": (0.0, None), "m1": (0.5, 1.5)})
    assert [v.value for v in bounded.parameters] == [v.value for v in free.parameters]
    assert bounded.warnings == ()


@pytest.mark.slow
def test_bound_that_binds_is_an_equality(found, free):
    """I_p <= 2 I_t of a rotor whose estimate lies beyond it; J rises as little as it must."""
    limit = 2 * free.value("I_t") - free.value("I_p") + 2 * free.std("I_t")
    bounded = found(bounds={"2*I_t - I_p": (limit, None)})
    held = 2 * bounded.value("I_t") - bounded.value("I_p")
    assert held == pytest.approx(limit, rel=1e-12)
    equality = found(constraints=(Constraint("2*I_t - I_p", limit),))
    assert bounded.misfit.cost == pytest.approx(equality.misfit.cost, rel=1e-9)
    assert any("2*I_t - I_p >= " in warning for warning in bounded.warnings)
    assert bounded.std("I_t") == pytest.approx(free.std("I_t"), rel=0.05)


@pytest.mark.slow
def test_several_bounds_release_what_need_not_hold(found, free):
    """Two bounds, of which only one binds once the other holds."""
    # k1 and m1 are strongly correlated: pushing k1 up lifts m1 far beyond its own bound.
    names = [value.name for value in free.free]
    assert free.correlation[names.index("m1"), names.index("k1")] > 0.8
    bounds = {
        "k1": (free.value("k1") + 3 * free.std("k1"), None),
        "m1": (free.value("m1") + 0.5 * free.std("m1"), None),
    }
    estimate = found(bounds=bounds)
    assert estimate.value("k1") == pytest.approx(bounds["k1"][0], rel=1e-12)
    assert estimate.value("m1") > bounds["m1"][0] * (1 + 1e-6)
    assert sum("is active" in warning for warning in estimate.warnings) == 1


@pytest.mark.parametrize(
    ("constraints", "message"),
    [
        ((Constraint("m1", 1.0), Constraint("2*m1", 3.0)), "repeat or contradict"),
        ((Constraint("L1", 0.3),), "holds no free parameter"),
        ((Constraint("m1 + m9", 1.0),), "unknown name 'm9'"),
        ((Constraint("m1/m2", 1.0),), "a polynomial in the parameters"),
    ],
)
def test_refuses_constraints_without_sense(found, constraints, message):
    with pytest.raises(InputError, match=message):
        found(constraints=constraints)


def test_exact_constraints_on_base_parameters(demo):
    known = {"base": True, "constraints": (Constraint("m1 - m3", 0.0),)}
    estimate = demo.identified(demo.seen(12, None), fixed={}, **known)
    assert estimate.value("m1") == pytest.approx(estimate.value("m3"), rel=1e-13)
    assert estimate.misfit.dof == 83


def test_start_may_be_given_in_part(demo, noisy):
    told = [replace(p, nominal=None) if p.name == "m2" else p for p in demo.model.parameters]
    bare = replace(demo, model=replace(demo.model, parameters=tuple(told)))
    with pytest.raises(InputError, match="no start of m2"):
        bare.identified(noisy)
    estimate = bare.identified(noisy, start={"m2": 9.0})
    assert estimate.value("m2") == pytest.approx(demo.truth["m2"], rel=5e-3)
