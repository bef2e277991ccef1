"""Campbell diagrams and critical speeds, held against closed forms and differences."""

from dataclasses import replace

import numpy as np
import pytest
from linear_machines import SUPPORTED, estimate_of, model_of

import rotorid as rid
from rotorid.results import modes
from rotorid.results.machine import machine_of
from rotorid.results.modes import Campbell, critical_speeds


def speeds_of(found: Campbell) -> list[float]:
    return [each.speed_rad_s for each in found.critical]


def test_a_rotor_on_springs_in_closed_form():
    """Symmetric: sqrt(k / m), and k = Omega^2 (I_t - I_p) forward, (I_t + I_p) backward."""
    text = SUPPORTED.replace("nominal = 5e5", "nominal = 4e5")
    text = text.replace("nominal = 60.0", "nominal = 0.0").replace("nominal = 1.5", "nominal = 0.0")
    found = rid.campbell(model_of(text), 2000.0)
    k, turning = 2 * 4e5, 2 * 4e5 * 0.25**2
    bounce = np.sqrt(k / 8)  # of two planes, that are the same by chance
    expected = [bounce, bounce, np.sqrt(turning / 0.35), np.sqrt(turning / 0.05)]
    assert sorted(speeds_of(found)) == pytest.approx(sorted(expected), rel=1e-9)
    whirls = [each.whirl for each in sorted(found.critical, key=lambda c: c.speed_rad_s)]
    assert whirls == ["planar", "planar", "backward", "forward"]


@pytest.mark.parametrize("sign", [1, -1])
def test_with_damping_and_two_planes_the_frequency_is_that_of_the_rotation(sign):
    found = rid.campbell(model_of(SUPPORTED), sign * 2000.0)
    assert len(found.critical) == 4
    for each in found.critical:
        assert np.sign(each.speed_rad_s) == sign
        there = rid.modes(model_of(SUPPORTED), speed=each.speed_rad_s)
        away = [abs(m.eigenvalue.imag - abs(each.speed_rad_s)) for m in there.modes]
        assert min(away) < 1e-7 * abs(each.speed_rad_s)
    ratios = [each.damping_ratio for each in found.critical]
    assert all(0 < ratio < 0.1 for ratio in ratios)


FREE = """
title = "a free body"
equations = ["J*theta_x'' + I_p*Omega*theta_y' = T", "J*theta_y'' - I_p*Omega*theta_x' = 0"]
coordinates = { theta_x = "rad", theta_y = "rad" }
inputs = { T = "N m" }
parameters = { J = { unit = "kg m^2", nominal = 1.0 }, I_p = { unit = "kg m^2", nominal = %r } }
"""
APART = """
title = "two planes that hardly differ"
equations = ["m*x'' + k*x = F", "m*y'' + k_y*y = 0"]
coordinates = { x = "m", y = "m" }
inputs = { F = "N" }
parameters = { m = { unit = "kg", nominal = 1.0 }, k = { unit = "N/m", nominal = 1e4 }, \
k_y = { unit = "N/m", nominal = %r } }
"""


@pytest.mark.parametrize("ratio", [1.0, 1.0000001, 0.9, 1.5])
def test_what_turns_with_the_rotor_at_every_speed_is_not_critical(ratio):
    """The nutation of a free body is I_p / I_t times the speed: it crosses 1x nowhere."""
    assert speeds_of(rid.campbell(model_of(FREE % ratio), 500.0)) == []


@pytest.mark.parametrize("apart", [1e-8, 1e-7, 1e-6, 4e-6, 1e-3])
def test_two_planes_have_two_critical_speeds_however_close(apart):
    found = speeds_of(rid.campbell(model_of(APART % (1e4 * (1 + apart))), 500.0))
    assert sorted(found) == pytest.approx([100.0, 100.0 * np.sqrt(1 + apart)], rel=1.1e-6)


@pytest.mark.slow
def test_deviations_are_those_of_differences():
    fixed = ("m", "c", "d", "L", "xi", "zeta")
    machine = machine_of(estimate_of(model_of(SUPPORTED), percent=0.05, fixed=fixed))
    found = critical_speeds(machine, 1200.0)
    assert len(found) == 4
    slopes = []
    for i, value in enumerate(machine.values):
        step = 1e-5 * abs(value)
        at = step * np.eye(len(machine.values))[i]
        sides = [
            [
                each.speed_rad_s
                for each in critical_speeds(
                    replace(machine, values=machine.values + s * at), 1200.0
                )
            ]
            for s in (1, -1)
        ]
        slopes.append((np.array(sides[0]) - np.array(sides[1])) / (2 * step))
    expected = np.sqrt(np.einsum("im,ij,jm->m", slopes, machine.covariance, slopes))
    assert [each.std for each in found] == pytest.approx(expected, rel=1e-4)


def test_supports_that_follow_the_speed():
    text = SUPPORTED.replace("+ 2*k_x*x", "+ 2*k_x*x*(1 + (Omega/1000)^2)")
    found = rid.campbell(model_of(text), 1500.0)
    exact = np.sqrt(1 / (8 / 8e5 - 1e-6))  # k (1 + s^2 / 1e6) = m s^2
    undamped = rid.campbell(model_of(text.replace("nominal = 60.0", "nominal = 0.0")), 1500.0)
    assert min(abs(s - exact) for s in speeds_of(undamped)) < 1e-6 * exact
    assert len(found.critical) == len(undamped.critical)


def test_curves_follow_their_shapes_through_a_crossing():
    """The nodding of a disc rises through the bouncing, and neither takes the other's course."""
    text = SUPPORTED.replace("nominal = 5e5", "nominal = 4e5").replace("I_t*theta", "I_t*theta")
    text = text.replace("nominal = 0.25", "nominal = 0.15")
    found = rid.campbell(model_of(text), 3000.0)
    straight = [c for c in found.frequency_hz.T if np.ptp(c) < 1e-6 * c[0]]
    assert len(straight) == 2
    others = [c for c in found.frequency_hz.T if np.ptp(c) > 1]
    assert len(others) == 2
    for curve in others:
        bends = np.abs(np.diff(curve, 2)).max()
        assert bends < 0.05 * np.ptp(curve)
    rising = max(others, key=lambda c: c[-1])
    assert rising[0] < straight[0][0] < rising[-1]
    assert {w for w in found.whirl} == {"planar", "forward", "backward"}


def test_a_mode_that_is_overdamped_for_a_while_leaves_a_gap():
    text = SUPPORTED.replace("d*theta_x'", "d*(Omega/500)^2*theta_x'").replace(
        "d*theta_y'", "d*(Omega/500)^2*theta_y'"
    )
    found = rid.campbell(model_of(text.replace("nominal = 1.5", "nominal = 200.0")), 3000.0)
    assert np.isnan(found.frequency_hz).any()
    assert len(found.critical) >= 2


def test_nearly_equal_criticals_are_both_found():
    text = SUPPORTED.replace("nominal = 5e5", "nominal = 4.0001e5")
    text = text.replace("nominal = 60.0", "nominal = 0.01").replace("I_p*Omega", "1e-9*I_p*Omega")
    found = rid.campbell(model_of(text.replace("nominal = 0.25", "nominal = 0.1")), 400.0)
    assert len(found.critical) == 4


def test_close_criticals_have_the_deviations_of_whole_draws():
    text = SUPPORTED.replace("nominal = 5e5", "nominal = 4.004e5")
    model = model_of(text)
    fixed = tuple(n for n in model.parameter_names if n not in ("k_x", "k_y"))
    covariance = np.diag([600.0, 600.0]) ** 2
    found = rid.campbell(estimate_of(model, fixed=fixed, covariance=covariance), 340.0)
    drawn = np.random.default_rng(3).normal([4e5, 4.004e5], 600.0, (20000, 2))
    omega = np.sort(np.sqrt(2 * drawn / 8 - (60.0 / 16) ** 2), axis=1)
    near = found.critical[:2]
    off = omega - [each.speed_rad_s for each in near]
    assert [each.std for each in near] == pytest.approx(np.sqrt((off**2).mean(axis=0)), rel=0.05)


def test_massless_coordinates_and_any_last_speed():
    text = SUPPORTED.replace("I_t*theta_x''", "1e-9*I_t*theta_x''*0")
    assert len(rid.campbell(model_of(text), 600.0).critical) >= 2
    assert len(rid.campbell(model_of(SUPPORTED), 1e9).critical) == 4
    assert rid.campbell(model_of(SUPPORTED), 1e-9).critical == ()


def test_the_page_says_where_it_goes():
    with pytest.raises(rid.InputError, match="a speed to go to"):
        rid.campbell(model_of(SUPPORTED), "0 rpm")


def test_the_response_to_unbalance_is_that_of_the_equations():
    model = model_of(SUPPORTED)
    found = rid.unbalance_response(estimate_of(model, percent=0.1), "3000 rpm")
    omega = 100 * np.pi
    eccentricity = 2e-5 - 1e-5j
    x = 8 * omega**2 * eccentricity / (8e5 - 8 * omega**2 + 60j * omega)
    assert found.motion[0, 0] == pytest.approx(x)
    y = -1j * 8 * omega**2 * eccentricity / (1e6 - 8 * omega**2 + 60j * omega)
    assert found.motion[0, 1] == pytest.approx(y)
    machine = machine_of(estimate_of(model, percent=0.1))
    slopes = []
    for name, value in zip(machine.names, machine.values, strict=True):
        step = 1e-6 * abs(value)
        sides = [
            np.abs(
                rid.unbalance_response(estimate_of(model, {name: value + s * step}), omega).motion
            )[0]
            for s in (1, -1)
        ]
        slopes.append((sides[0] - sides[1]) / (2 * step))
    expected = np.sqrt(np.einsum("im,ij,jm->m", slopes, machine.covariance, slopes))
    assert found.std[0, :2] == pytest.approx(expected[:2], rel=1e-5)


def test_an_undamped_critical_speed_has_no_bound():
    model = model_of(SUPPORTED.replace("nominal = 60.0", "nominal = 0.0"))
    found = rid.unbalance_response(model, np.array([100.0, np.sqrt(1e5)]))
    assert np.isfinite(found.motion[0]).all()
    assert np.isnan(found.motion[1]).all()
    bare = SUPPORTED.split("xi = {")[0]
    for part in ("(xi*cos(phi) - zeta*sin(phi))", "(xi*sin(phi) + zeta*cos(phi))"):
        bare = bare.replace(f"m*Omega^2*{part}", "0")
    with pytest.raises(rid.InputError, match="without unbalance"):
        rid.unbalance_response(model_of(bare), 100.0)


def test_what_does_not_follow_the_speed_is_solved_once(monkeypatch):
    solved = []
    eigenmodes = modes.eigenmodes

    def counted(*matrices):
        solved.append(matrices)
        return eigenmodes(*matrices)

    monkeypatch.setattr(modes, "eigenmodes", counted)
    rid.campbell(rid.load_model("jeffcott"), "6000 rpm")
    assert len(solved) == 3  # and twice for how modes part
    rid.campbell(rid.load_model("three-mass"), "6000 rpm")
    assert len(solved) > 60
