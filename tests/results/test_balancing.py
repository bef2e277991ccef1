"""Balancing, trial masses, and where results of an estimate turn over."""

import json
import time
from pathlib import Path

import numpy as np
import pytest
from io_writers import write_table
from linear_machines import SUPPORTED, estimate_of, lost, model_of
from model_text import model_text
from result_cases import in_planes as ends_of
from scipy.optimize import brentq

import rotorid as rid
from rotorid import InputError, cli
from rotorid.answer.parts import Evidence, RecordEvidence
from rotorid.core.distributions import bound_of_length
from rotorid.results import machine
from rotorid.results.balancing import Balance, Masses, _nearest, _too_coarse, chosen, rotor_mass
from rotorid.results.export import _solved
from rotorid.results.machine import machine_of

# Correction masses and what they leave, held against closed forms and draws.


RIGID = rid.load_model("rigid")
ENDS = ["F_xa,F_ya", "F_xb,F_yb"]
UNBALANCE = ("xi", "zeta", "mu", "eta")


def vector(found: Balance) -> np.ndarray:
    return np.array([c.unbalance_kg_m * np.exp(1j * c.angle_rad) for c in found.corrections])


@pytest.mark.parametrize(
    ("planes", "speed"),
    [
        (ENDS, "6000 rpm"),
        (ENDS[::-1], "-3000 rpm"),
        (ENDS, ["1000 rpm", "9000 rpm"]),
        (["x - L_a*theta_y, y + L_a*theta_x", "x + 0.25*theta_y, y - 0.25*theta_x"], 500.0),
    ],
)
def test_a_rigid_rotor_in_two_planes_in_closed_form(planes, speed):
    """What cancels at one speed cancels at all; places by combination are those of the inputs."""
    found = rid.balance(estimate_of(RIGID), planes, speed)
    order = 1 if planes[0] != ENDS[1] else -1
    assert vector(found)[::order] == pytest.approx(-ends_of(RIGID.nominal), rel=1e-9)
    assert found.share < 1e-9
    assert found.rotor_mass == pytest.approx(10.0)
    if speed == "6000 rpm":
        for plane in found.residual:
            assert plane.grade_mm_s == pytest.approx(plane.unbalance_kg_m * 200 * np.pi / 10 * 1e3)
        assert found.grade_mm_s == pytest.approx(sum(p.grade_mm_s for p in found.residual))
        total = sum(c.unbalance_kg_m for c in found.corrections)
        before = total * 200 * np.pi / 10 * 1e3
        assert found.grade_before_mm_s == pytest.approx(before)
        off = np.hypot(0.01, np.radians(1.0))  # 1 % of a mass, 1 deg of its angle
        assert found.grade_mounted_mm_s == pytest.approx(off * before)


def test_the_covariance_is_that_of_the_unbalance():
    fixed = tuple(n for n in RIGID.parameter_names if n not in UNBALANCE)
    covariance = np.diag([1e-7, 2e-7, 1e-6, 3e-6]) ** 2
    covariance[0, 1] = covariance[1, 0] = 0.5 * 2e-14
    found = rid.balance(estimate_of(RIGID, fixed=fixed, covariance=covariance), ENDS, 500.0)
    # The planes are linear in them.
    only = [{n: float(n == name) for n in UNBALANCE} for name in UNBALANCE]
    columns = np.array([ends_of({**RIGID.nominal, **each}).view(float) for each in only])
    expected = columns.T @ covariance @ columns
    assert found.covariance == pytest.approx(expected, rel=1e-6, abs=1e-22)
    std = [np.sqrt(np.trace(expected[2 * k : 2 * k + 2, 2 * k : 2 * k + 2]) / 2) for k in (0, 1)]
    assert [plane.std_kg_m for plane in found.residual] == pytest.approx(std, rel=1e-6)


def test_what_is_left_is_less_than_stated_19_times_of_20():
    rng = np.random.default_rng(2)
    for mean, spread in (
        (np.zeros(2), np.eye(2)),
        (np.array([3.0, -1.0]), np.array([[4.0, 1.0], [1.0, 0.3]])),
        (np.array([0.5, 0.0]), np.array([[0.0, 0.0], [0.0, 1.0]])),
        (np.array([2.0, 0.0]), np.array([[1.0, 1.0], [1.0, 1.0]])),
    ):
        bound = bound_of_length(mean, spread, 0.95)
        drawn = rng.multivariate_normal(mean, spread, 200_000)
        assert (np.hypot(*drawn.T) < bound).mean() == pytest.approx(0.95, abs=0.002)
    assert bound_of_length(np.zeros(2), np.eye(2), 0.95) == pytest.approx(2.447746831, rel=1e-6)
    assert bound_of_length(np.array([3.0, 4.0]), np.zeros((2, 2)), 0.95) == 5.0


def test_one_plane_does_what_it_can():
    """A supported rotor, its tilt left aside: the plane of the centre of mass takes all of it."""
    estimate = estimate_of(model_of(SUPPORTED))
    found = rid.balance(estimate, ["x,y"], "3000 rpm", at={"x": 1.0, "y": 1.0})
    assert vector(found) == pytest.approx([-8.0 * (2e-5 - 1e-5j)])
    assert found.share < 1e-12
    far = rid.balance(estimate, ["x - 0.2*theta_y, y + 0.2*theta_x"], "3000 rpm")
    assert far.share > 0.02


def test_the_mass_of_a_rotor():
    assert rotor_mass(machine_of(rid.load_model("three-mass"))) == pytest.approx(12.98878)
    assert rotor_mass(machine_of(rid.load_model("emps").substitute({"Fc": 0.0}))) is None


def test_masses_in_holes():
    given = {"radius": "30 mm", "masses": ["0.1 g", "0.2 g", "0.5 g", "1 g"], "holes": 24}
    found = rid.balance(estimate_of(RIGID), ENDS, 500.0, **given)
    wanted = -ends_of(RIGID.nominal)
    for k, (each, plane) in enumerate(zip(found.corrections, found.residual, strict=True)):
        assert 1 <= len(each.masses) <= 2
        for mass, angle in each.masses:
            assert mass in (1e-4, 2e-4, 5e-4, 1e-3)
            assert np.exp(24j * angle) == pytest.approx(1, abs=1e-9)
        total = sum(m * 0.03 * np.exp(1j * a) for m, a in each.masses)
        assert vector(found)[k] == pytest.approx(total)
        assert plane.off_kg_m == pytest.approx(abs(total - wanted[k]))
        assert plane.unbalance_kg_m > plane.off_kg_m
        assert plane.off_kg_m < 0.06 * abs(wanted[k])


def test_masses_of_any_size_go_between_two_holes():
    wanted = -ends_of(RIGID.nominal)
    found = rid.balance(estimate_of(RIGID), ENDS, 500.0, radius=0.03, holes=12)
    assert vector(found) == pytest.approx(wanted)
    assert all(len(each.masses) == 2 for each in found.corrections)
    bare = rid.balance(estimate_of(RIGID), ENDS, 500.0, radius=0.03)
    ((mass, angle),) = bare.corrections[0].masses
    assert 0.03 * mass * np.exp(1j * angle) == pytest.approx(wanted[0])


def test_no_mass_is_better_than_one_that_is_too_large():
    kit = Masses.of(0.1, ["1 kg"], 4)
    applied, mounted = chosen(kit, np.array([0.01 + 0j]), (np.eye(1), np.array([-0.01 + 0j])))
    assert applied[0] == 0
    assert mounted == [()]


@pytest.mark.parametrize(
    ("estimate", "planes", "more", "message"),
    [
        (None, [], {}, "no plane"),
        (None, ["x,y", "x, y"], {}, "one plane twice"),
        (None, ["nowhere"], {}, "the plane 'nowhere'.*such as x,y"),
        (None, ["x,theta"], {}, "the plane 'x,theta'"),
        (None, ["x"], {}, "the plane 'x'.*such as x,y"),
        (None, ["x,x"], {}, "one direction twice.*x before y"),
        (None, ["theta_x,theta_y"], {}, "a couple, where a mass makes a force"),
        (None, ["x,theta_x"], {}, "a couple, where a mass makes a force"),
        (None, ["y,x"], {}, "a pair in which y comes before x"),
        (None, ["x + 0.1*theta_y,y - 0.5*y - 0.3*theta_x"], {}, "not x and y of one place"),
        (None, ["x - 0.1*theta_y,y - 0.1*theta_x"], {}, "two places along the axis, as a sign"),
        (None, ["x + 0.1*theta_y,y - 0.2*theta_x"], {}, "two places along the axis"),
        (None, ["x + 0.1*theta_y,y"], {}, "two places along the axis"),
        (None, ["2*x,2*y"], {}, "2 times the motion of a place"),
        (None, ["0.5*x,0.5*y"], {}, "0.5 times the motion of a place"),
        (None, ["F_xa,2*F_xa"], {}, "the plane"),
        (None, ["x,y", *ENDS], {}, "planes of which one does what others do"),
        (None, ["x,y"], {"speed": 0.0}, "a speed of 0"),
        (None, ["x,y"], {"speed": []}, "no speed"),
        (None, ["x,y"], {"at": {"z": 1.0}}, "'z' with the weight 1"),
        (None, ["x,y"], {"at": {"x": -1.0}}, "'x' with the weight -1"),
        (None, ["x,y"], {"masses": ["1 g"]}, "without the radius"),
        (None, ["x,y"], {"radius": "30"}, "without a unit"),
        (None, ["x,y"], {"radius": "3 cm", "holes": 0}, "0 holes"),
        (None, ["x,y"], {"radius": "3 cm", "holes": 2.5}, r"2.5 holes.*whole number"),
        (None, ["x,y"], {"radius": "3 cm", "holes": 2}, "reach every direction"),
        (None, ["x,y"], {"radius": "3 cm", "masses": ["0 g"]}, "more than 0 kg"),
        ("mu", ENDS, {}, "leaves mu undetermined.*second speed"),
        ("I_t", ENDS, {}, "leaves I_t undetermined"),
        (dict.fromkeys(UNBALANCE, 0.0), ENDS, {}, "without unbalance"),
    ],
)
def test_what_cannot_be_is_refused(estimate, planes, more, message):
    if isinstance(estimate, str):
        estimate = lost(estimate_of(RIGID), estimate)
    else:
        estimate = estimate_of(RIGID, estimate, fixed=UNBALANCE)
    speed = more.pop("speed", 500.0)
    with pytest.raises(rid.InputError, match=message):
        rid.balance(estimate, planes, speed, **more)


ONE_AXIS = model_text(
    "two masses that move along one axis",
    [
        "m*x1'' + c*x1' + k*x1 + k*(x1 - x2) = F + Omega^2*(ux*cos(phi) - uy*sin(phi))",
        "m*x2'' + c*x2' + k*(x2 - x1) = 0",
    ],
    "x1 m, x2 m",
    "F N",
    "m 2.0 kg, c 30.0 N s/m, k 2e5 N/m, ux 3e-5 kg m, uy 2e-5 kg m",
)


def test_a_model_of_one_axis_has_planes_of_one_direction():
    """Its unbalance turns all the same: cos and sin of one direction tell amount and angle."""
    estimate = estimate_of(model_of(ONE_AXIS))
    for plane in ("x1", "F"):
        found = rid.balance(estimate, [plane], "1800 rpm")
        assert vector(found) == pytest.approx([-(3e-5 + 2e-5j)], rel=1e-9)
        assert found.share < 1e-9
    with pytest.raises(rid.InputError, match=r"one direction twice.*x1.*name the one alone"):
        rid.balance(estimate, ["x1,x1"], "1800 rpm")
    with pytest.raises(rid.InputError, match="the plane 'F,'"):
        rid.balance(estimate, ["F,"], "1800 rpm")


def test_runout_is_said_to_stay():
    estimate = estimate_of(RIGID)
    runout = tuple(rid.Value(f"runout[x].{part}", "m", 1e-6, 1e-8) for part in ("cos", "sin"))
    wider = np.pad(estimate.covariance, ((0, 2), (0, 2)))
    wider[-2:, -2:] = 1e-16 * np.eye(2)
    found = rid.balance(estimate.with_(nuisance=runout, covariance=wider), ENDS, 500.0)
    assert any("left as it is: runout[x]" in remark for remark in found.remarks)
    same = rid.balance(estimate, ENDS, 500.0)
    assert found.covariance == pytest.approx(same.covariance, rel=1e-9)


def test_centring_follows_the_axis_of_inertia():
    laws = {"F_xa": (120.0, 3e5), "F_yb": (100.0, 2e5)}
    first, second, _, fourth = rid.centring(rigid(), "6000 rpm", laws=laws)
    n = RIGID.nominal
    # A free rotor turns about its axis of inertia: its centre by -e, its tilt by -(mu + i eta).
    x = -(n["xi"] + 1j * n["zeta"])
    tilt = -(n["mu"] + 1j * n["eta"])  # theta_x; theta_y is - i times it
    at_a = x - n["L_a"] * (-1j * tilt)
    assert first.motion_m == pytest.approx(abs(at_a), rel=1e-6)
    current = -3e5 / 120.0 * at_a
    assert first.amplitude_ampere == pytest.approx(abs(current), rel=1e-6)
    assert first.angle_rad == pytest.approx(np.angle(current), rel=1e-6)
    assert second.amplitude_ampere is None
    assert fourth.amplitude_ampere is not None
    assert 0 < first.std_ampere < 0.01 * first.amplitude_ampere


def test_constants_of_the_result_and_of_the_experiment():
    """An estimated ki with its deviation comes first; ks stands in the experiment."""
    text = """
[channels.F_xa]
law = "linear"
current = { column = "i", unit = "A" }
position = "x"
ki = "90 N/A"
ks = "3e5 N/m"
[channels.F_ya]
law = "differential"
K = "1e-5 N m^2/A^2"
bias = "2 A"
gap = "0.4 mm"
"""
    base = estimate_of(RIGID, percent=1e-6)
    wider = np.pad(base.covariance, (0, 1))
    wider[-1, -1] = 1.2**2
    ki = rid.Value("ki[F_xa]", "N/A", 120.0, 1.2)
    source = rid.Provenance(experiment=text, model=base.provenance.model)
    estimate = base.with_(nuisance=(ki,), covariance=wider, provenance=source)
    first, second, *_ = rid.centring(estimate, 600.0)
    assert first.amplitude_ampere == pytest.approx(3e5 / 120 * first.motion_m)
    assert first.std_ampere == pytest.approx(0.01 * first.amplitude_ampere, rel=1e-3)
    ki, ks = 4 * 1e-5 * 2 / 4e-4**2, 4 * 1e-5 * 4 / 4e-4**3
    assert second.amplitude_ampere == pytest.approx(ks / ki * second.motion_m)


def test_the_command(tmp_path, monkeypatch, output, refusal):
    monkeypatch.chdir(tmp_path)
    estimate_of(RIGID).save("run.json")
    arguments = ("balance", "run.json", "--plane", *ENDS, "--speed", "6000 rpm")
    kit = ("--radius", "30 mm", "--masses", "0.1 g, 0.5 g")
    at = [part for place in ("x=2", "y", "theta_x", "theta_y") for part in ("--at", place)]
    shown = output(*arguments, *kit, *at, "--json", "b.json")
    for word in ("correction", "mount in plane", "left, with 95 %", "centring", "ISO 21940-11"):
        assert word in shown
    found = json.loads((tmp_path / "b.json").read_text())
    assert {"plane", "unbalance_kg_m", "angle_rad", "std_kg_m"} <= found["corrections"][0].keys()
    assert {"plane", "unbalance_kg_m", "std_kg_m", "grade_mm_s"} <= found["residual"][1].keys()
    before, after, mounted = (found[f"grade_{n}mm_s"] for n in ("before_", "", "mounted_"))
    of, to = (next(g for g in (0.4, 1, 2.5, 6.3, 16) if size <= g) for size in (before, after))
    assert f"before {before:.2g} mm/s (G {of}), after below {after:.2g} mm/s (G {to})" in shown
    assert f"masses to 1 % and angles to 1 deg leave up to {mounted:.2g} mm/s more" in shown
    assert 0 < after < before > 20 * mounted > 0
    assert "no speed, and none" in refusal("balance", "run.json", "--plane", "x,y")
    assert "x=much" in refusal(*arguments, "--at", "x=much")


@pytest.mark.parametrize(
    ("experiment", "measured", "kind", "shown"),
    [
        ('[[records]]\nspeed = "6000 rpm"\n[[records]]\nspeed = "100 Hz"\n', (), "", "6000, 6000"),
        ("", (628.0, 628.6), "periods", "5999.82"),  # as with an angle, whose encoder told one
        ("", (628.0, 629.0), "periods", None),
        ("", (-400.0, -200.0), "phasors", "-1800, -3000"),
        ("", (200.0, 800.0), "whole table", "9 speeds from 1800 to 6600"),
    ],
)
def test_the_speeds_of_the_experiment_are_those_of_the_records(
    experiment, measured, kind, shown, tmp_path, output, refusal
):
    base = estimate_of(RIGID)
    source = rid.Provenance(experiment=experiment, model=base.provenance.model)
    if measured:
        lines = (30, 50) if kind == "phasors" else tuple(range(30, 120, 10))
        kind = "periods" if kind == "periods" else "phasors"
        record = RecordEvidence("run.h5", kind, speed_rad_s=measured, frequency_hz=lines)
        base = base.with_(evidence=Evidence((record,)))
    base.with_(provenance=source).save(tmp_path / "run.json")
    run, said = (output, f"rigid at {shown} rpm") if shown else (refusal, "no speed, and none")
    assert said in run("balance", tmp_path / "run.json", "--plane", *ENDS)


@pytest.mark.parametrize(
    "text",
    [
        "records = 5",
        "channels = 5",
        "a = " + "[" * 5000,
        ".".join("a" * 15_000) + " = 1",
        "a = 1\n" * 1_000_000,
        "a = 0x" + "f" * 20_000,
        "\ud800 = 1",
    ],
)
def test_the_experiment_in_a_result_may_be_anything(text, tmp_path, refusal):
    base = estimate_of(RIGID)
    source = rid.Provenance(experiment=text, model=base.provenance.model)
    result = tmp_path / "run.json"
    base.save(result)
    found = json.loads(result.read_text())
    found["provenance"]["experiment"] = text
    result.write_text(json.dumps(found))
    started = time.process_time()
    told = refusal("balance", result, "--plane", *ENDS)
    assert "found no speed" in told or "found no JSON" in told
    assert time.process_time() - started < 2
    if "\ud800" not in text:
        assert len(rid.centring(base.with_(provenance=source), 600.0)) == 4


def test_what_was_fixed_is_told_and_never_exact():
    every = rid.balance(estimate_of(RIGID, fixed=RIGID.parameter_names), ENDS, 500.0)
    assert every.residual[0].unbalance_kg_m is None
    assert any("all parameters are fixed" in remark for remark in every.remarks)
    some = rid.balance(estimate_of(RIGID, fixed=("mu", "eta")), ENDS, 500.0)
    assert any("taken as exact" in r and r.endswith(": mu, eta") for r in some.remarks)


def test_a_current_is_no_plane():
    """The mass would be too small by k_i, and with a negative one on the other side."""
    text = model_text(
        "a mass in two magnets",
        [
            "m*x'' + k*x = ki*i_x + m*xi*Omega^2*cos(phi)",
            "m*y'' + k*y = ki*i_y + m*xi*Omega^2*sin(phi)",
        ],
        "x m, y m",
        "i_x A, i_y A",
        "m 2.0 kg, k 2e5 N/m, ki 50.0 N/A, xi 2e-5 m",
    )
    estimate = estimate_of(model_of(text))
    assert rid.balance(estimate, ["x,y"], 900.0).corrections
    with pytest.raises(rid.InputError, match=r"the input i_x in A for a plane; .*such as x,y;"):
        rid.balance(estimate, ["i_x,i_y"], 900.0)


# From two runs, one with a trial mass, to the correction: by the command line alone.


MODEL = model_text(
    "Jeffcott rotor with a trial plane",
    [
        "m*x'' + c*x' + k*x = ki*i_x + Omega^2*((u_x + t_x)*cos(phi) - (u_y + t_y)*sin(phi))",
        "m*y'' + c*y' + k*y = ki*i_y + Omega^2*((u_x + t_x)*sin(phi) + (u_y + t_y)*cos(phi))",
    ],
    "x m, y m",
    "i_x A, i_y A",
    "ki +100.0 N/A, m +4.0 kg, c +80.0 N s/m, k +8e5 N/m, u_x 0 kg m, u_y 0 kg m, "
    "t_x 0 kg m, t_y 0 kg m",
)
RECORD = """
[[records]]
file = "bare.csv"
sample_rate = "1 kHz"
fundamental = "10 Hz"
harmonics = [1, 3, 5, 7, 8, 9]
speed = "3000 rpm"
phase = "0 deg"
"""
EXPERIMENT = 'model = "rotor.toml"' + RECORD
TRIAL = f"""{RECORD.replace("bare", "trial")}
[records.parameters]
t_x = {{ fixed = "0 g mm" }}
t_y = {{ fixed = "150 g mm" }}
"""
REST = """
[channels]
i_x = { column = "ix", unit = "mA" }
i_y = { column = "iy", unit = "mA" }
x = { column = "x", unit = "um" }
y = { column = "y", unit = "um" }
[parameters]
t_x = { fixed = "0 g mm" }
t_y = { fixed = "0 g mm" }
"""
RUNOUT_UNKNOWN = "[estimator]\nrunout = true\n"
TRUTH = {"m": 5.0, "c": 60.0, "k": 1e6, "ki": 120.0}
RESIDUAL, MOUNTED = 9e-5 - 6e-5j, 150e-6j
PERIODS, SPEED = 30, 2 * np.pi * 50.0


def run_of(unbalance: complex, rng: np.random.Generator) -> np.ndarray:
    """Return currents (mA) and readings (um) of a settled run with noise."""
    omega = 2 * np.pi * 10.0 * np.array([1, 3, 5, 7, 8, 9])
    current = 0.2 * np.exp(2j * np.pi * rng.random((6, 2)))
    current[2] = 0  # the rotation has its line for itself
    load = TRUTH["ki"] * current
    load[2] = SPEED**2 * unbalance * np.array([1, -1j])
    stiffness = TRUTH["k"] + 1j * omega * TRUTH["c"] - omega**2 * TRUTH["m"]
    waves = np.exp(1j * np.outer(np.arange(100 * PERIODS) / 1000.0, omega))
    motion = load / stiffness[:, None]
    table = np.column_stack([1e3 * (waves @ current).real, 1e6 * (waves @ motion).real])
    return table + 0.5 * rng.standard_normal(table.shape)


@pytest.fixture
def runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(8)
    (tmp_path / "rotor.toml").write_text(MODEL)
    for name, unbalance in (("bare", RESIDUAL), ("trial", RESIDUAL + MOUNTED)):
        write_table(f"{name}.csv", "ix,iy,x,y", run_of(unbalance, rng))
    return tmp_path


def balanced(*options: str) -> tuple[complex, float]:
    """Return the correction and the stated residual of what `rotorid balance` writes, kg m."""
    arguments = ["balance", "run.json", "--plane", "x,y", "--json", "b.json", "--force", *options]
    assert cli.run(arguments) == 0
    found = json.loads(Path("b.json").read_text())
    (one,), (left,) = found["corrections"], found["residual"]
    return one["unbalance_kg_m"] * np.exp(1j * one["angle_rad"]), left["unbalance_kg_m"]


@pytest.mark.slow
def test_a_trial_mass_is_the_scale_where_no_force_is_known(runs):
    (runs / "run.toml").write_text(EXPERIMENT + TRIAL + REST)
    assert cli.run(["identify", "run.toml", "--json", "run.json"]) == 0
    found = rid.load_estimate("run.json")
    for name, value in TRUTH.items():
        assert abs(found.value(name) - value) < 4 * found.std(name) < 0.05 * value
    added, stated = balanced("--report", "b.html", "--radius", "40 mm")
    assert abs(added + RESIDUAL) < stated < 0.05 * abs(RESIDUAL)
    assert "rotorid balance run.json" in (runs / "b.html").read_text()
    # With the trial mass left where it is, so much less is to be added.
    after, _ = balanced("--record", "1")
    assert after == pytest.approx(added - MOUNTED, abs=1e-9)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (REST, ["a result that leaves m, c, k undetermined"]),
        # It moves the reading as much whatever the runout is: only the speed parts them.
        pytest.param(
            TRIAL + REST + RUNOUT_UNKNOWN,
            ["at a second speed where runout is unknown", "with a trial mass where no force is kn"],
            marks=pytest.mark.slow,
        ),
    ],
)
def test_without_it_there_is_no_scale_and_it_does_not_part_runout(runs, refusal, more, said):
    (runs / "run.toml").write_text(EXPERIMENT + more)
    cli.run(["identify", "run.toml", "--json", "run.json"])
    told = refusal("balance", "run.json", "--plane", "x,y")
    assert all(part in told for part in said)


# Where answers about a machine turn over: what is too coarse, what counts, what is a line.


def rigid(**values: float) -> rid.Estimate:
    return estimate_of(RIGID, values, percent=0.1)


@pytest.mark.parametrize(("left", "told"), [(0.099, 0), (0.101, 1)])
def test_masses_that_leave_a_tenth_are_too_coarse(left, told):
    ideal = np.array([2e-4 * np.exp(0.3j)])
    kit = Masses.of(0.1, ["1 g"], None)
    remarks = _too_coarse(["x,y"], (1 - left) * ideal, ideal, kit)
    assert len(remarks) == told
    assert all("the masses given leave 1" in remark for remark in remarks)


@pytest.mark.slow
@pytest.mark.parametrize(("share", "graded"), [(0.19, True), (0.21, False)])
def test_a_plane_that_leaves_a_fifth_gives_no_grade(share, graded):
    def one_plane(couple: float) -> Balance:
        less = {name: couple * RIGID.nominal[name] for name in ("mu", "eta")}
        return rid.balance(rigid(**less), ["x + 0.001*theta_y, y - 0.001*theta_x"], "6000 rpm")

    couple = brentq(lambda c: one_plane(c).share - share, 0.0, 3.0, xtol=1e-6)
    assert (one_plane(couple).grade_mm_s is not None) == graded


def test_planes_that_nearly_coincide_are_one():
    def beside(apart: float) -> list[str]:
        return [f"x + {a}*theta_y, y - {a}*theta_x" for a in (0.2, 0.2 + apart)]

    assert len(rid.balance(rigid(), beside(8e-7), "6000 rpm").corrections) == 2
    with pytest.raises(InputError, match="planes of which one does what others do"):
        rid.balance(rigid(), beside(5e-7), "6000 rpm")


def test_masses_go_where_hands_can_put_them():
    """Two masses for three quarters of both stand 41.41 degrees beside it: on whole degrees, 41."""
    kit = Masses.of(0.1, ["1 g"], None)
    ideal = 1.5e-4 * np.exp(0.2j)
    _, (mounted,) = chosen(kit, np.array([ideal]), (np.eye(1), np.array([-ideal])))
    beside = sorted(np.degrees(angle - 0.2) for _, angle in mounted)
    assert beside == pytest.approx([-41, 42]) or beside == pytest.approx([-41, 41])
    assert len(_nearest(kit, ideal)) == 24  # are tried with those of the other planes


def test_more_masses_than_are_tried_in_a_second_are_refused():
    sizes = [f"{k} g" for k in range(1, 11)]
    assert Masses.of(0.1, sizes, 400).holes == 400
    with pytest.raises(InputError, match=r"10 masses in 401 places; expected 4000 choices"):
        Masses.of(0.1, sizes, 401)


def test_a_matrix_is_singular_to_rounding():
    """Two equations that differ by this share have a reciprocal condition of a quarter of it."""
    of = machine.machine_of(rigid())
    nearly, singular = (np.array([[1.0, 1.0], [1.0, 1.0 - away]]) for away in (8e-12, 2e-12))
    assert np.isfinite(_solved(of, nearly, np.eye(2))).all()
    with pytest.raises(InputError, match="that is singular"):
        _solved(of, singular, np.eye(2))


def test_a_record_that_is_not_there_has_no_values(tmp_path, refusal):
    """Of an index beyond the last the common values were taken: the rotor without trial masses."""
    seen = Evidence(tuple(RecordEvidence(f"{k}.csv", "phasors") for k in range(2)))
    estimate = estimate_of(RIGID).with_(evidence=seen)
    assert rid.balance(estimate, ENDS, "600 rpm", record=1).share < 1e-9
    with pytest.raises(InputError, match=r"record 2, of a result of 2; expected .* 0 to 1"):
        rid.balance(estimate, ENDS, "600 rpm", record=2)
    estimate.save(tmp_path / "run.json")
    assert "from 0 to 1" in refusal("modes", tmp_path / "run.json", "--record", 2)
