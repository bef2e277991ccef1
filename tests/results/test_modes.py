"""Modes, critical speeds and Campbell diagrams; the command that prints them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from differences import deviations
from linear_machines import SUPPORTED, estimate_of, lost, model_of
from model_text import model_text

import rotorid as rid
from rotorid.results import modes
from rotorid.results.machine import machine_of
from rotorid.results.modes import Campbell, critical_speeds, partners, whirl_of

# Natural frequencies, damping, whirl and critical speeds, held against closed forms.


MACHINE = model_of(SUPPORTED)
SYMMETRIC = SUPPORTED.replace("nominal = 5e5", "nominal = 4e5")


def test_a_jeffcott_rotor_in_closed_form():
    found = rid.modes(rid.load_model("jeffcott"), speed="3000 rpm")
    (mode,) = found.modes
    omega, ratio = np.sqrt(1e6 / 5), 60 / (2 * np.sqrt(5e6))
    assert mode.count == 2
    assert mode.frequency_hz == pytest.approx(omega * np.sqrt(1 - ratio**2) / (2 * np.pi))
    assert mode.damping_ratio == pytest.approx(ratio)
    assert (mode.std_hz, mode.damping_std, mode.interval_hz) == (None, None, None)
    assert found.rigid == 0


def test_the_rotor_of_the_paper_at_its_speed():
    found = rid.modes(rid.load_model("three-mass"), speed="140 Hz")
    hertz = [mode.frequency_hz for mode in found.modes]
    assert hertz == pytest.approx([36.85, 175.53, 175.53, 340.32, 569.29], abs=0.006)
    whirls = [mode.whirl for mode in found.modes]
    assert whirls == ["forward", "backward", "forward", "backward", "forward"]
    assert found.rigid == 6


@pytest.mark.parametrize("speed", [100.0, -100.0])
def test_a_free_rigid_rotor_nods_with_the_ratio_of_its_inertias(speed):
    (mode,) = rid.modes(rid.load_model("rigid"), speed=speed).modes
    assert mode.frequency_hz == pytest.approx(100.0 * 0.03 / 0.2 / (2 * np.pi))
    assert mode.whirl == "forward"
    still = rid.modes(rid.load_model("rigid"))
    assert (still.modes, still.rigid) == ((), 8)


def test_whirl_follows_the_direction_of_rotation():
    ahead, back = (rid.modes(MACHINE, speed=s * 2000.0).modes for s in (1, -1))
    assert [m.whirl for m in ahead] == [m.whirl for m in back]
    assert "backward" in {m.whirl for m in ahead}
    assert [m.frequency_hz for m in ahead] == pytest.approx([m.frequency_hz for m in back])


@pytest.mark.sampled(1)
@pytest.mark.parametrize("speed", [0.0, 700.0, -700.0])
@pytest.mark.parametrize("fixed", [(), ("m", "L")])
def test_deviations_are_those_of_differences(speed, fixed):
    estimate = estimate_of(MACHINE, fixed=fixed, percent=0.1)
    machine = machine_of(estimate)

    def moved(values: np.ndarray) -> list[tuple[float, float]]:
        at = dict(zip(machine.names, values, strict=True))
        there = rid.modes(estimate_of(MACHINE, at), speed=speed)
        return [(m.frequency_hz, m.damping_ratio) for m in there.modes]

    found = rid.modes(estimate, speed=speed)
    stated = [(m.std_hz, m.damping_std) for m in found.modes]
    expected = deviations(moved, machine.values, machine.covariance)
    assert np.array(stated) == pytest.approx(expected, rel=1e-4)
    assert not any(m.close for m in found.modes)


def base_estimate(model: rid.Model, off: float = 0.0) -> rid.Estimate:
    """Return an estimate of base parameters, each off by a share of its deviation of 1 percent."""
    base = model.base_values(machine_of(model).values)
    away = 1 + 0.01 * off * np.cos(np.arange(len(base)))
    values = tuple(
        rid.Value(name, unit, value, std=0.01 * abs(value))
        for name, unit, value in zip(model.base.names, model.base.units, base * away, strict=True)
    )
    covariance = np.diag([(v.std or 0) ** 2 for v in values])
    return rid.Estimate(model.name, "ls", "ok", values, covariance=covariance)


def test_base_parameters_tell_the_same():
    model = rid.load_model("three-mass")
    found, direct = rid.modes(base_estimate(model), speed=800.0), rid.modes(model, speed=800.0)
    hertz = [m.frequency_hz for m in direct.modes]
    assert [m.frequency_hz for m in found.modes] == pytest.approx(hertz)
    away = rid.modes(base_estimate(model, 0.5), speed=800.0)
    assert away.rigid == 6  # the best fit moves freely, as the machine does
    off = [(m.frequency_hz - f) / m.std_hz for m, f in zip(away.modes, hertz, strict=True)]
    assert 0 < np.abs(off).max() < 1


def test_base_parameters_that_no_physical_ones_follow_from():
    text = TWO.replace("c*x'", "(c + g)*x'").replace("c*y'", "(c + g)*y'")
    model = model_of(text.replace("c = {", 'g = { unit = "1/s", nominal = 1.0 }\nc = {'))
    found = rid.modes(base_estimate(model).with_(provenance=rid.Provenance(model=model.file_text)))
    (one, two) = found.modes
    assert (one.damping_ratio, two.damping_ratio) == pytest.approx((3e-3 / 2, 3e-3 / 2), rel=1e-3)
    assert one.damping_std == pytest.approx(0.01 * one.damping_ratio, rel=0.2)


TWO = model_text(
    "two planes that hardly touch",
    ["x'' + c*x' + a*x + e*y = F", "y'' + c*y' + b*y + e*x = 0"],
    "x 1, y 1",
    "F 1/s^2",
    "a 1e6 1/s^2, b 1.0001e6 1/s^2, c 2.0 1/s, e 0.0 1/s^2",
)


@pytest.mark.parametrize(
    ("std", "close"),
    [
        ((10.0, 10.0, 0.01, 0.0), False),
        ((200.0, 200.0, 0.01, 0.0), True),
        ((1e-3, 1e-3, 0.01, 100.0), True),
        ((24.9 / np.sqrt(2), 24.9 / np.sqrt(2), 1e-9, 0.0), False),  # a quarter of the distance
        ((25.1 / np.sqrt(2), 25.1 / np.sqrt(2), 1e-9, 0.0), True),
    ],
)
def test_modes_are_close_by_their_deviations(std, close):
    """Their distance is 100: certain, uncertain in order, and uncertain in shape."""
    estimate = estimate_of(model_of(TWO), covariance=np.diag(np.square(std)))
    assert [m.close for m in rid.modes(estimate).modes] == [close, close]


def test_close_modes_have_the_deviations_of_whole_draws():
    estimate = estimate_of(model_of(TWO), covariance=np.diag([150.0, 150.0, 0.1, 80.0]) ** 2)
    found = rid.modes(estimate)
    rng = np.random.default_rng(5)
    drawn = rng.multivariate_normal([1e6, 1.0001e6, 2.0, 0.0], estimate.covariance, 20000)
    a, b, c, e = drawn.T
    root = np.sqrt(((a - b) / 2) ** 2 + e**2)
    squares = np.column_stack([(a + b) / 2 - root, (a + b) / 2 + root])
    hertz = np.sqrt(squares - (c[:, None] / 2) ** 2) / (2 * np.pi)
    here = np.array([m.frequency_hz for m in found.modes])
    std = np.sqrt(((hertz - here) ** 2).mean(axis=0))
    assert [m.std_hz for m in found.modes] == pytest.approx(std, rel=0.05)
    low, high = np.quantile(hertz, [0.025, 0.975], axis=0)
    stated = np.array([m.interval_hz for m in found.modes])
    expected = np.column_stack([low, high]) - here[:, None]
    assert stated - here[:, None] == pytest.approx(expected, rel=0.06, abs=1e-4)


def test_isotropic_pairs_that_move_together_are_not_close():
    found = rid.modes(estimate_of(rid.load_model("three-mass")), speed=5.0)
    assert not any(m.close for m in found.modes if m.frequency_hz > 1)


def test_modes_that_coincide_by_chance_count_twice():
    found = rid.modes(model_of(SYMMETRIC.replace("I_p*Omega", "0.001*I_p*Omega")))
    assert [m.count for m in found.modes] == [1, 1, 1, 1]


def test_unstable_and_overdamped_machines_are_told():
    grows = rid.modes(model_of(SUPPORTED.replace("nominal = 60.0", "nominal = -60.0")))
    assert min(m.damping_ratio for m in grows.modes) < 0
    slow = rid.modes(model_of(SUPPORTED.replace("nominal = 60.0", "nominal = 6e4")))
    assert len(slow.modes) == 2
    assert len(slow.real_poles) == 4
    assert max(slow.real_poles) < 0


def test_pairs_by_name_and_orbits():
    assert partners(["x1", "y1", "theta_x", "theta_y", "q"]) == [(0, 1), (2, 3)]
    assert partners(["ux_a", "uy_a"]) == [(0, 1)]
    circle = np.array([1.0, -1j, 1.0, 1j])
    ones = np.ones(4)
    pairs = [(0, 1), (2, 3)]
    assert whirl_of(circle, pairs[:1], ones, 1.0) == "forward"
    assert whirl_of(circle, pairs[:1], ones, -1.0) == "backward"
    assert whirl_of(circle, pairs[1:], ones, 0.0) == "backward"
    assert whirl_of(circle, pairs, ones, 1.0) == "mixed"
    for share, whirl in ((0.019, "forward"), (0.021, "mixed")):  # of what hardly moves
        inertia = np.array([1 - share, 1 - share, share, share])
        assert whirl_of(circle, pairs, inertia, 1.0) == whirl
    assert whirl_of(np.array([1.0, 0.5, 0, 0]), pairs, ones, 1.0) == "planar"
    for tilt, whirl in ((0.019, "planar"), (0.022, "forward")):  # of the axes of the orbit
        assert whirl_of(np.array([1.0, -1j * tilt]), pairs[:1], ones, 1.0) == whirl


def test_values_that_are_not_determined_matter_only_where_they_are_needed():
    base = estimate_of(MACHINE)
    found = rid.modes(lost(base, "xi"))
    assert found.status == "not_identifiable"
    assert any("xi" in remark for remark in found.remarks)
    assert found.modes[0].std_hz == pytest.approx(rid.modes(base).modes[0].std_hz)
    with pytest.raises(rid.InputError, match="leaves k_x undetermined"):
        rid.modes(lost(base, "k_x"))


def test_a_rejected_result_says_so_and_inflates():
    base = estimate_of(MACHINE)
    parameters = tuple(replace(v, std_inflated=3 * v.std) for v in base.parameters)
    found = rid.modes(base.with_(status="rejected", parameters=parameters))
    assert found.modes[0].std_hz == pytest.approx(3 * rid.modes(base).modes[0].std_hz)
    assert "reject" in found.remarks[0]
    with pytest.raises(rid.InputError, match="not converged"):
        rid.modes(base.with_(status="not_converged"))


def test_what_every_record_has_to_itself():
    base = estimate_of(MACHINE, fixed=("k_x",))
    own = (*base.parameters, rid.Value("k_x[1]", "N/m", 8e5, 0.0, fixed=True))
    estimate = base.with_(parameters=own)
    first, second = rid.modes(estimate), rid.modes(estimate, record=1)
    ratio = second.modes[1].frequency_hz / first.modes[0].frequency_hz
    assert first.modes[0].frequency_hz < second.modes[0].frequency_hz
    assert ratio == pytest.approx(np.sqrt(2), rel=1e-3)


def test_models_that_have_no_modes_are_refused():
    with pytest.raises(rid.ModelError, match=r"sign\(q'\).*leave that term out"):
        rid.modes(rid.load_model("emps"))
    bare = model_of(SUPPORTED.replace(", nominal = 8.0", ""))
    with pytest.raises(rid.InputError, match="no nominal value of m"):
        rid.modes(bare)
    with pytest.raises(rid.InputError, match=r"a speed of 1e\+200 rad/s; expected at most 1e\+09"):
        rid.modes(rid.load_model("flexible"), speed=1e200)
    with pytest.raises(rid.InputError, match="a finite speed"):
        rid.modes(MACHINE, speed=np.inf)
    fewer = model_text("one", ["m*x'' + k*(x - y) = F"], "x m, y m", "F N", "m 1 kg, k 1 N/m")
    with pytest.raises(rid.InputError, match="1 equations for 2 coordinates"):
        rid.modes(model_of(fewer))


# Campbell diagrams and critical speeds, held against closed forms and differences.


def speeds_of(found: Campbell) -> list[float]:
    return [each.speed_rad_s for each in found.critical]


def test_a_rotor_on_springs_in_closed_form():
    """Symmetric: sqrt(k / m), and k = Omega^2 (I_t - I_p) forward, (I_t + I_p) backward."""
    text = SYMMETRIC.replace("nominal = 60.0", "nominal = 0.0")
    found = rid.campbell(model_of(text.replace("nominal = 1.5", "nominal = 0.0")), 2000.0)
    k, turning = 2 * 4e5, 2 * 4e5 * 0.25**2
    bounce = np.sqrt(k / 8)  # of two planes, that are the same by chance
    expected = [bounce, bounce, np.sqrt(turning / 0.35), np.sqrt(turning / 0.05)]
    assert sorted(speeds_of(found)) == pytest.approx(sorted(expected), rel=1e-9)
    whirls = [each.whirl for each in sorted(found.critical, key=lambda c: c.speed_rad_s)]
    assert whirls == ["planar", "planar", "backward", "forward"]


@pytest.mark.parametrize("last", [2000.0, -1e9])
def test_with_damping_and_two_planes_the_frequency_is_that_of_the_rotation(last):
    sign = np.sign(last)
    assert rid.campbell(MACHINE, sign * 1e-9).critical == ()
    found = rid.campbell(MACHINE, last)
    assert len(found.critical) == 4
    for each in found.critical:
        assert np.sign(each.speed_rad_s) == sign
        there = rid.modes(MACHINE, speed=each.speed_rad_s)
        away = [abs(m.eigenvalue.imag - abs(each.speed_rad_s)) for m in there.modes]
        assert min(away) < 1e-7 * abs(each.speed_rad_s)
    ratios = [each.damping_ratio for each in found.critical]
    assert all(0 < ratio < 0.1 for ratio in ratios)


FREE = model_text(
    "a free body",
    ["J*theta_x'' + I_p*Omega*theta_y' = T", "J*theta_y'' - I_p*Omega*theta_x' = 0"],
    "theta_x rad, theta_y rad",
    "T N m",
    "J 1.0 kg m^2, I_p 0.5 kg m^2",
)
APART = model_text(
    "two planes that hardly differ",
    ["m*x'' + k*x = F", "m*y'' + k_y*y = 0"],
    *("x m, y m", "F N", "m 1.0 kg, k 1e4 N/m, k_y 1.5e4 N/m"),
)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("ratio", [1.0, 1.0000001, 0.9])
def test_what_turns_with_the_rotor_at_every_speed_is_not_critical(ratio):
    """The nutation of a free body is I_p / I_t times the speed: it crosses 1x nowhere."""
    assert speeds_of(rid.campbell(model_of(FREE.replace("0.5", repr(ratio))), 500.0)) == []


@pytest.mark.parametrize("apart", [1e-8, 1e-6, 4e-6, 1e-3])
def test_two_planes_have_two_critical_speeds_however_close(apart):
    model = model_of(APART.replace("1.5e4", repr(1e4 * (1 + apart))))
    found = speeds_of(rid.campbell(model, 500.0))
    assert sorted(found) == pytest.approx([100.0, 100.0 * np.sqrt(1 + apart)], rel=1.1e-6)


@pytest.mark.slow
def test_deviations_of_critical_speeds_are_those_of_differences():
    fixed = ("m", "c", "d", "L", "xi", "zeta")
    machine = machine_of(estimate_of(MACHINE, percent=0.05, fixed=fixed))

    def moved(values: np.ndarray) -> list[float]:
        there = critical_speeds(replace(machine, values=values), 1200.0)
        return [each.speed_rad_s for each in there]

    found = critical_speeds(machine, 1200.0)
    assert len(found) == 4
    expected = deviations(moved, machine.values, machine.covariance, 1e-5)
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
    found = rid.campbell(model_of(SYMMETRIC.replace("nominal = 0.25", "nominal = 0.15")), 3000.0)
    straight = [c for c in found.frequency_hz.T if np.ptp(c) < 1e-6 * c[0]]
    assert len(straight) == 2
    others = [c for c in found.frequency_hz.T if np.ptp(c) > 1]
    assert len(others) == 2
    for curve in others:
        assert np.abs(np.diff(curve, 2)).max() < 0.05 * np.ptp(curve)
    rising = max(others, key=lambda c: c[-1])
    assert rising[0] < straight[0][0] < rising[-1]
    assert {w for w in found.whirl} == {"planar", "forward", "backward"}


def test_a_mode_that_is_overdamped_for_a_while_leaves_a_gap():
    text = SUPPORTED.replace("d*theta_", "d*(Omega/500)^2*theta_")
    found = rid.campbell(model_of(text.replace("nominal = 1.5", "nominal = 200.0")), 3000.0)
    assert np.isnan(found.frequency_hz).any()
    assert len(found.critical) >= 2
    massless = SUPPORTED.replace("I_t*theta_x''", "1e-9*I_t*theta_x''*0")
    assert len(rid.campbell(model_of(massless), 600.0).critical) >= 2


def test_close_criticals_have_the_deviations_of_whole_draws():
    model = model_of(SUPPORTED.replace("nominal = 5e5", "nominal = 4.004e5"))
    fixed = tuple(n for n in model.parameter_names if n not in ("k_x", "k_y"))
    found = rid.campbell(estimate_of(model, fixed=fixed, std=600.0), 340.0)
    drawn = np.random.default_rng(3).normal([4e5, 4.004e5], 600.0, (20000, 2))
    omega = np.sort(np.sqrt(2 * drawn / 8 - (60.0 / 16) ** 2), axis=1)
    near = found.critical[:2]
    off = omega - [each.speed_rad_s for each in near]
    assert [each.std for each in near] == pytest.approx(np.sqrt((off**2).mean(axis=0)), rel=0.05)


def test_the_response_to_unbalance_is_that_of_the_equations():
    estimate = estimate_of(MACHINE, percent=0.1)
    found = rid.unbalance_response(estimate, "3000 rpm")
    omega = 100 * np.pi
    eccentricity = 2e-5 - 1e-5j
    x = 8 * omega**2 * eccentricity / (8e5 - 8 * omega**2 + 60j * omega)
    assert found.motion[0, 0] == pytest.approx(x)
    y = -1j * 8 * omega**2 * eccentricity / (1e6 - 8 * omega**2 + 60j * omega)
    assert found.motion[0, 1] == pytest.approx(y)
    machine = machine_of(estimate)

    def moved(values: np.ndarray) -> np.ndarray:
        at = dict(zip(machine.names, values, strict=True))
        return np.abs(rid.unbalance_response(estimate_of(MACHINE, at), omega).motion)[0]

    expected = deviations(moved, machine.values, machine.covariance)
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


# ``rotorid modes`` as its users meet it.


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "machine.toml").write_text(SUPPORTED)
    estimate_of(rid.load_model(tmp_path / "machine.toml")).save(tmp_path / "result.json")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_result_alone_gives_modes_and_critical_speeds(folder, output):
    (folder / "machine.toml").unlink()
    speeds = ("--speed", "3000 rpm", "--to", "12000 rpm")
    shown = output("modes", "result.json", *speeds, "--json", "modes.json")
    for word in ("without forces at its inputs (T)", "critical speed", "forward", "unbalance"):
        assert word in shown
    found = json.loads((folder / "modes.json").read_text())
    assert found["speed_rad_s"] == pytest.approx(314.159, rel=1e-5)
    assert len(found["modes"]) == len(found["critical_speeds"]) == 4
    first = found["modes"][0]
    for key in ("frequency_hz", "std_hz", "damping_ratio", "damping_std"):
        assert first[key] > 0
    assert first["whirl"] in ("forward", "backward", "planar", "mixed")
    for each in found["critical_speeds"]:
        assert each["std"] > 0
        assert {"speed_rad_s", "std", "whirl"} <= each.keys()
    assert len(found["campbell"]["frequency_hz"]) == 4
    assert set(first["shape"]) == {"x", "y", "theta_x", "theta_y"}


def test_a_model_file_and_a_shipped_model_have_no_deviations(folder, output):
    output("modes", "machine.toml", "--json", "modes.json")
    found = json.loads((folder / "modes.json").read_text())
    assert {mode["std_hz"] for mode in found["modes"]} == {None}
    assert found["critical_speeds"] == []
    assert "6 poles at zero" in output("modes", "three-mass", "--speed", "-140 Hz")


def test_a_result_that_is_not_identifiable_shows_and_ends_with_1(folder, output):
    output("modes", "result.json", "--record", "3")  # nothing is a record's own
    estimate_of(MACHINE, status="not_identifiable").save("open.json")
    assert "others fit as well" in output("modes", "open.json", code=1)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nothing"], "no model 'nothing'"),
        (["none.json"], "none.json"),
        (["emps"], "leave that term out"),
        (["machine.toml", "--speed", "3000"], "without a unit"),
        (["machine.toml", "--speed", "3000 kg"], "unit 'kg'"),
        (["machine.toml", "--to", "0 rpm"], "a speed to go to"),
        (["machine.toml", "--json", "machine.toml"], "machine.toml"),
    ],
)
def test_what_cannot_be_is_one_line(folder, refusal, arguments, said):
    assert said in refusal("modes", *arguments)


@pytest.mark.parametrize("fixed", [False, True])
def test_a_record_with_values_of_its_own_is_its_own_machine(fixed):
    """The spring that all share, free or fixed, is not that of record 1."""
    text = model_text("one", ["m*x'' + k*x = F"], "x m", "F N", "m kg, k N/m")
    shared = rid.Value("k", "N/m", 800.0, 0.0 if fixed else 80.0, fixed=fixed)
    own = rid.Value("k[1]", "N/m", 1800.0, 9.0)
    found = rid.Estimate(
        "one",
        "ml",
        "ok",
        (rid.Value("m", "kg", 2.0, 0.0, fixed=True), shared, own),
        covariance=np.diag([81.0] if fixed else [6400.0, 81.0]),
        provenance=rid.Provenance(model=text),
    )
    (mode,) = rid.modes(found, record=1).modes
    assert mode.frequency_hz == pytest.approx(30 / (2 * np.pi))
    assert mode.std_hz == pytest.approx(mode.frequency_hz * 9.0 / (2 * 1800.0))
