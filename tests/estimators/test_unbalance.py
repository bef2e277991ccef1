"""Unbalance as amount and angle: against closed forms, and draws from the covariance."""

import numpy as np
import pytest
from bank import JEFFCOTT, THREE_MASS

import rotorid as rid
from rotorid.answer.unbalance import with_unbalance


def made(name: str, deviation: float) -> tuple[rid.Model, rid.Estimate]:
    """Return an estimate at the nominal values, all known equally well."""
    model = rid.load_model(name)
    values = tuple(rid.Value(p.name, p.unit, p.nominal, deviation) for p in model.parameters)
    sizes = deviation * np.array([v.value for v in values])
    return model, rid.Estimate(name, "ml", "ok", values, covariance=np.diag(sizes**2))


def test_planes_of_the_three_mass_rotor():
    model, estimate = made("three-mass", 1e-3)
    static, couple = with_unbalance(model, estimate).unbalance
    value = {v.name: v.value for v in estimate.parameters}
    assert (static.plane, static.unit) == ("x2, y2", "kg m")
    assert (couple.plane, couple.unit) == ("theta_x, theta_y", "kg m^2")
    wanted = value["m2"] * (value["xi"] + 1j * value["zeta"])
    assert static.amount * np.exp(1j * static.angle_rad) == pytest.approx(wanted, rel=1e-12)
    wanted = (value["I_t"] - value["I_p"]) * (value["mu"] + 1j * value["eta"])
    assert couple.amount * np.exp(1j * couple.angle_rad) == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize(
    "more",
    [
        "k*(bx*cos(phi) - by*sin(phi))",  # a bent shaft
        "(bx + by)*Omega*cos(phi)",
        "(bx + by)*Omega^3*cos(phi)",
        "(bx + by)*tanh(Omega)*cos(phi)",
    ],
)
def test_what_does_not_grow_as_the_square_of_the_speed_is_no_unbalance(more):
    jeffcott = rid.load_model("jeffcott").file_text
    known = '[parameters]\nbx = { unit = "m", nominal = 5e-3 }\nby = { unit = "m", nominal = 2e-3 }'
    text = jeffcott.replace("= F_x +", f"= F_x + {more} +").replace("[parameters]", known)
    assert text.count(more) == 1
    model = rid.models.parse_model(text)
    plain, estimate = made("jeffcott", 1e-3)
    added = (rid.Value("bx", "m", 5e-3), rid.Value("by", "m", 2e-3))
    wider = estimate.with_(parameters=(*estimate.parameters, *added), covariance=np.zeros((0, 0)))
    (found,), (wanted,) = (
        with_unbalance(model, wider).unbalance,
        with_unbalance(plain, estimate).unbalance,
    )
    assert found.amount == pytest.approx(wanted.amount, rel=1e-9)
    assert found.angle_rad == pytest.approx(wanted.angle_rad, rel=1e-9)


def test_what_grows_otherwise_leaves_no_rounding():
    text = rid.load_model("jeffcott").file_text
    model = rid.models.parse_model(text.replace("Omega^2", "Omega"))
    values = tuple(rid.Value(p.name, p.unit, p.nominal, 1e-3) for p in model.parameters)
    estimate = rid.Estimate("jeffcott", "ml", "ok", values, covariance=np.eye(len(values)))
    assert with_unbalance(model, estimate).unbalance == ()


def test_deviations_are_those_of_draws():
    model, estimate = made("rigid", 1e-3)
    value = np.array([v.value for v in estimate.parameters])
    rng = np.random.default_rng(3)
    draws = value * (1 + 1e-3 * rng.standard_normal((20000, len(value))))
    names = list(model.parameter_names)
    m, xi, zeta = (draws[:, names.index(n)] for n in ("m", "xi", "zeta"))
    static = with_unbalance(model, estimate).unbalance[0]
    amounts = m * (xi + 1j * zeta)
    assert static.std == pytest.approx(np.abs(amounts).std(), rel=0.03)
    assert static.angle_std_rad == pytest.approx(np.angle(amounts).std(), rel=0.03)


@pytest.mark.parametrize("problem", [THREE_MASS, JEFFCOTT], ids=lambda p: p.name)
@pytest.mark.parametrize("method", ["batch", "ml"])
def test_both_methods_state_the_same(problem, method):
    found = rid.identify(problem.model, problem.records, method).unbalance
    exact = with_unbalance(problem.model, truth_of(problem)).unbalance
    assert [u.plane for u in found] == [u.plane for u in exact]
    for one, other in zip(found, exact, strict=True):
        assert one.amount == pytest.approx(other.amount, rel=1e-6)
        assert one.angle_rad == pytest.approx(other.angle_rad, rel=1e-6)


def truth_of(problem) -> rid.Estimate:
    names = problem.model.parameter_names
    parameters = tuple(rid.Value(name, "", problem.truth[name], 0.0) for name in names)
    return rid.Estimate("truth", "ml", "ok", parameters)


def test_what_is_not_told_has_no_unbalance():
    model, estimate = made("three-mass", 1e-3)
    unknown = tuple(rid.Value(v.name, v.unit, np.nan) for v in estimate.parameters)
    assert (
        with_unbalance(model, estimate.with_(parameters=unknown, status="not_converged")).unbalance
        == ()
    )
    assert with_unbalance(model, estimate.with_(parameters=estimate.parameters[1:])).unbalance == ()
    bare = estimate.with_(covariance=np.full((13, 13), np.nan), status="not_identifiable")
    assert with_unbalance(model, bare).unbalance[0].std is None
    emps = rid.load_model("emps")
    values = tuple(rid.Value(p.name, p.unit, p.nominal, 1.0) for p in emps.parameters)
    assert with_unbalance(emps, rid.Estimate("emps", "ls", "ok", values)).unbalance == ()


def test_a_load_of_one_axis_stands_alone():
    model = rid.parse_model("""
title = "one axis"
equations = ["m*x'' + k*x = F + u*Omega^2*sin(phi)"]
coordinates = { x = "m" }
inputs = { F = "N" }
[parameters]
m = { unit = "kg" }
k = { unit = "N/m" }
u = { unit = "kg m" }""")
    values = [rid.Value("m", "kg", 2.0), rid.Value("k", "N/m", 1e4), rid.Value("u", "kg m", 3e-5)]
    (only,) = with_unbalance(model, rid.Estimate("m", "ml", "ok", tuple(values))).unbalance
    assert only.plane == "x"
    assert only.amount == pytest.approx(3e-5)
    assert only.angle_rad == pytest.approx(-np.pi / 2)
