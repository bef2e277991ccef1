"""The levitated rig in motion: plant, controller, amplifiers."""

import json
import re
import runpy
from dataclasses import replace
from fractions import Fraction
from functools import partial
from importlib.resources import files
from pathlib import Path

import control
import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from model_text import model_text
from rigs import recorded, reference_positions, with_actuators
from scipy import signal
from scipy.integrate import solve_ivp
from working_folder import simulated

from rotorid import Channel, InputError, Record, load_rig, parse_model
from rotorid.cli import run
from rotorid.force.channel_dynamics import Constant, FirstOrder
from rotorid.force.laws import Differential
from rotorid.force.reading import ForceReading, forces
from rotorid.rig.controller import Controller, pid, side_by_side
from rotorid.rig.kernel import coil_current
from rotorid.rig.logger import decimated
from rotorid.rig.machine import merge_clocks
from rotorid.rig.parts import Logger, Rotation
from rotorid.rig.plant import pairs, rotor_plant
from rotorid.rig.rig import Rig, growth

# Motion of the rig against closed forms and a reference integrator.


MAGNET = Differential(K=5e-6, bias=1.5, gap=5e-4, angle=np.radians(22.5))


def as_the_reference(rig: Rig, duration: float, within: float) -> None:
    found, expected = recorded(rig, duration).truth.position, reference_positions(rig, duration)
    assert np.abs(found - expected).max() < within * np.abs(expected).max()


CLOCKS = [
    {},
    {"delay": 0.0},
    {"delay": 130e-6},
    {"logger": Logger(15e3), "delay": 33e-6},
]


@pytest.mark.sampled(4)
@pytest.mark.parametrize("clocks", CLOCKS)
@pytest.mark.parametrize("bandwidth", [None, 1500.0])
def test_exact_steps_against_the_reference(quiet, clocks, bandwidth):
    rig = replace(with_actuators(quiet, bandwidth=bandwidth), settling=0.004, **clocks)
    assert rig.linear
    as_the_reference(rig, 0.012, 1e-9)


NONLINEAR = {
    "magnets": {"law": MAGNET, "limit": 1.4},
    "lag": {"law": MAGNET, "limit": 1.4, "bandwidth": 1500.0},
    "slew": {"law": MAGNET, "limit": 1.4, "bandwidth": 1500.0, "slew": 2000.0},
    "limit": {"law": MAGNET, "limit": 0.7},
    "linear law, slew": {"bandwidth": 1500.0, "slew": 2000.0},
}
CHANGING = Rotation(880.0, acceleration=300.0, drift=20.0, drift_period=0.02, phase=0.5)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", NONLINEAR)
def test_integration_against_the_reference(quiet, kind):
    """Done when: 1e-6 of the peak, from switching on, through saturation and changing speed."""
    changed = with_actuators(quiet, **NONLINEAR[kind])
    rig = replace(changed, rotation=CHANGING, settling=0.005, clearance=4.5e-4)
    assert not rig.linear
    as_the_reference(rig, 0.02, 1e-6)


def test_changing_speed_of_a_linear_law_against_the_reference(quiet):
    as_the_reference(replace(quiet, rotation=CHANGING, settling=0.002, delay=33e-6), 0.02, 1e-7)


def test_a_tighter_tolerance_converges(quiet):
    rig = replace(with_actuators(quiet, **NONLINEAR["slew"]), settling=0.0, clearance=4.5e-4)
    records = (recorded(replace(rig, tolerance=each), 0.05) for each in (1e-5, 1e-7, 1e-11))
    *found, exact = (record.truth.position for record in records)
    coarse, fine = (np.abs(q - exact).max() / np.abs(exact).max() for q in found)
    assert fine < coarse / 5
    assert fine < 1e-6


@pytest.mark.parametrize("command", [-3.0, -0.1, 0.0, 0.4, 2.5])
@pytest.mark.parametrize("slew", [np.inf, 4000.0])
def test_coil_current_in_closed_form(command, slew):
    lag, start = 1e-4, 0.4
    times = np.linspace(0.0, 1e-3, 7)
    fine = {"t_eval": times, "max_step": 2e-6, "rtol": 1e-10, "atol": 1e-12}

    def slope(_: float, i: np.ndarray) -> np.ndarray:
        return np.clip((command - i) / lag, -slew, slew)

    followed = solve_ivp(slope, (0.0, 1e-3), [start], **fine).y[0]
    found = [coil_current(start, command, lag, slew, t) for t in times]
    np.testing.assert_allclose(found, followed, atol=1e-6)
    assert coil_current(0.0, 2.0, 0.0, np.inf, 0.0) == 2.0  # without lag at once


def test_growth_is_that_of_the_free_motion(quiet):
    """Weak damping: the slowest mode decays as its eigenvalue says."""
    rig = replace(quiet, settling=0.0, excitation=None)
    plant = rig.plant(1.0)
    rate, frequency, axis = growth(rig, plant, rig.rotation.speed)
    assert rate == pytest.approx(-10.39, abs=0.01)
    assert frequency == pytest.approx(0.0, abs=1e-6)
    assert axis in rig.model.inputs
    late = [growth(replace(rig, delay=d), plant, 880.0)[0] for d in (0.0, 2e-4, 4e-4, 8e-4)]
    assert late[-1] > 0 > late[0]


@pytest.fixture
def single(tmp_path):
    """Return a function that makes a rig of one coordinate."""

    def made(equation: str, parameters: str, more: str) -> Rig:
        model = model_text("one mass", [equation], "x m", "F_x N", parameters)
        (tmp_path / "model.toml").write_text(model)
        text = f'model = "model.toml"\nduration = "1 s"\nsensors = {{ x = {{}} }}\n{more}'
        (tmp_path / "rig.toml").write_text(text)
        return load_rig(tmp_path / "rig.toml").rig

    return made


def test_constant_loads_and_higher_orders_are_carried(single):
    """Gravity hangs the rotor where integral action is missing; a load of 2 phi shakes it."""
    rig = single(
        "m*x'' = F_x - m*g + a*Omega^2*sin(2*phi)",
        "m 2.0 kg, g 9.81 m/s^2, a 1e-4 kg m",
        """
settling = "3 s"
rotation = { speed = "20 Hz" }
controller = { rate = "10 kHz", stiffness = "1e5 N/m", damping = "200 N s/m", filter = "4 kHz" }
actuators = { all = { law = "force" } }
logger = { sample_rate = "10 kHz" }
""",
    )
    x = recorded(rig, 0.1).truth.position[:, 0]
    speed = rig.rotation.speed
    assert x.mean() == pytest.approx(-2.0 * 9.81 / 1e5, rel=1e-9)
    line = 2 * np.mean(x * np.exp(-2j * speed * np.arange(1000) / 10e3))
    expected = -1j * 1e-4 * speed**2 / (1e5 + 200 * 2j * speed - 2.0 * (2 * speed) ** 2)
    assert line == pytest.approx(expected, rel=0.05)  # the sampled derivative lags a little


def plant_of(equation: str, acceleration: float = 2000.0):
    model = parse_model(model_text("t", [equation], "x m", "F_x N", "m 2.0 kg, k 1e3 N/m"))
    return rotor_plant(model, model.values(model.nominal), Rotation(100.0, acceleration), 1.0)


def test_matrices_follow_the_speed_as_a_polynomial():
    plant = plant_of("m*x'' + k*(1 + Omega^2)*x = F_x")
    for speed in (100.0, 703.0, 2100.0):
        assert plant.at(speed).motion[0, 0, 0] == pytest.approx(-500.0 * (1 + speed**2))


@pytest.mark.parametrize(
    ("equation", "message"),
    [
        ("m*x'' + k*sqrt(Omega)*x = F_x", "no polynomial of Omega"),
        ("m*x'' + k*x = F_x + k*cos(5*t)", "no smooth function of"),
        ("m*x'' + k*x = F_x + k*cos(phi/2)", "no smooth function"),
        ("m*x' + k*x = F_x", "a coordinate without mass"),
        ("m*x'' + k*x^3 = F_x", "linear in the coordinates"),
    ],
)
def test_rotors_that_no_rig_can_carry(equation, message):
    with pytest.raises(InputError, match=message):
        plant_of(equation)


def test_axes_of_one_bearing_are_found_by_their_names():
    np.testing.assert_array_equal(pairs(("F_x1", "F_y1", "F_x3", "F_y3")), [1, 0, 3, 2])
    np.testing.assert_array_equal(pairs(("F_xa", "F_xb", "F_ya", "F")), [2, -1, 0, -1])


def test_noise_is_drawn_from_the_generator_alone(shipped):
    rig = replace(shipped, settling=0.01)
    one, again, other = (recorded(rig, 0.02, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.samples, again.samples)
    assert np.abs(one.samples - other.samples).min() > 0


def test_noise_has_its_size(quiet):
    """Sensor noise is in the reading; process noise moves a free mass as its impulses do."""
    sensors = tuple(replace(s, noise=3e-6) for s in quiet.sensors)
    record = recorded(replace(quiet, sensors=sensors, settling=0.5), 1.0)
    noise = record.samples[:, 4:] - record.truth.position
    np.testing.assert_allclose(noise.std(axis=0), 3e-6, rtol=0.03)
    np.testing.assert_allclose(noise.mean(axis=0), 0.0, atol=4 * 3e-8)


def test_process_noise_has_its_size(single):
    rig = single(
        "m*x'' = F_x",
        "m 2.0 kg",
        """
settling = "2 s"
controller = { rate = "1 kHz", stiffness = "200 N/m", damping = "20 N s/m", filter = "400 Hz" }
actuators = { all = {} }
process_noise = { F_x = "3 N" }
logger = { sample_rate = "1 kHz" }
""",
    )
    x = recorded(rig, 100.0).truth.position[:, 0]
    # White force of intensity s^2 T on m, c, k: var x = s^2 T / (2 c k); the loop delays a little.
    assert x.var() == pytest.approx(3.0**2 * 1e-3 / (2 * 20.0 * 200.0), rel=0.1)


# Clocks merged into one pattern.


@given(st.integers(1, 12), st.integers(1, 12), st.integers(0, 40))
def test_every_clock_ticks_as_often_as_it_should(p, q, tenths):
    control_rate, sample_rate = 1000.0 * p, 1000.0 * q
    delay = tenths / 10 / control_rate
    found = merge_clocks(control_rate, sample_rate, delay)
    assert found.duration == pytest.approx(1e-3 / np.gcd(p, q))
    assert found.length.sum() == pytest.approx(found.duration)
    assert (found.length > 0).all()
    np.testing.assert_allclose(np.diff(found.offset), found.length[:-1], atol=1e-15)
    for ticks, rate in ((found.control, control_rate), (found.log, sample_rate)):
        at = found.offset[ticks >= 0]
        np.testing.assert_allclose(at, np.arange(len(at)) / rate, atol=1e-15)
        np.testing.assert_array_equal(ticks[ticks >= 0], np.arange(len(at)))
    effect = found.offset[found.apply >= 0] + found.lag / control_rate
    begun = found.apply[found.apply >= 0] / control_rate
    np.testing.assert_allclose(effect, begun + delay, atol=1e-12)
    assert found.lag == Fraction(tenths, 10) // 1


@pytest.mark.parametrize(
    ("rates", "message"),
    [
        ((0.0, 1.0, 0.0), "rate: found 0.0 Hz"),
        ((1.0, -1.0, 0.0), "sample_rate: found -1.0 Hz"),
        ((1e4, 1e4 * (1 + 1e-6), 0.0), "samples at 10000.01 Hz; expected a ratio of whole num"),
        ((1e4, np.pi * 1e4, 0.0), "choose rates of a simpler ratio"),
    ],
)
def test_clocks_that_never_meet_are_refused(rates, message):
    with pytest.raises(InputError, match=message):
        merge_clocks(*rates)


# Controllers: PID, and what python-control and scipy bring.


T = 1e-4


def test_pid_is_its_transfer_function():
    """-(P + I T / (z - 1) + D (1 - a) / T (z - 1) / (z - a)), a = exp(-2 pi f T)."""
    gain, reset, rate, f = 3e3, 2e5, 7.0, 1500.0
    omega = 2 * np.pi * np.array([1.0, 10.0, 200.0, 4000.0])
    z, a = np.exp(1j * omega * T), np.exp(-2 * np.pi * f * T)
    expected = -(gain + reset * T / (z - 1) + rate * (1 - a) / T * (z - 1) / (z - a))
    found = pid(gain, reset, rate, f, T).response(omega)[:, 0, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_axes_side_by_side_do_not_know_of_one_another():
    axes = [pid(p, 10.0, 1.0, 500.0, T) for p in (1.0, 2.0, 3.0)]
    both = side_by_side(axes).response([100.0])[0]
    single = [axis.response([100.0])[0, 0, 0] for axis in axes]
    np.testing.assert_allclose(both, np.diag(single))
    assert axes[0].on_each(4).commands == 4


GAIN = partial(Controller, [], [], [])
NUMERATOR, DENOMINATOR = [-2e4, 1.9e4], [1.0, -0.6, 0.05]
SPACE = ([[0.5, 0.1], [0.0, 0.2]], [[1.0], [0.5]], [[-1e4, 2.0]], [[-3e3]])
SYSTEMS = {
    "scipy transfer function": signal.dlti(NUMERATOR, DENOMINATOR, dt=T).to_ss(),
    "control transfer function": control.ss(control.tf(NUMERATOR, DENOMINATOR, T)),
    "scipy state space": signal.dlti(*SPACE, dt=T),
    "control state space": control.StateSpace(*SPACE, T),
}


@pytest.mark.parametrize("kind", SYSTEMS)
def test_systems_of_other_packages(kind):
    z = np.exp(1j * np.array([50.0, 3000.0]) * T)
    if "transfer" in kind:
        expected = np.polyval(NUMERATOR, z) / np.polyval(DENOMINATOR, z)
    else:
        a, b, c, d = map(np.array, SPACE)
        expected = [(c @ np.linalg.solve(x * np.eye(2) - a, b) + d)[0, 0] for x in z]
    system = SYSTEMS[kind]
    found = Controller(system.A, system.B, system.C, system.D, T)
    np.testing.assert_allclose(found.response([50.0, 3000.0])[:, 0, 0], expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Controller([[1.0]], [[1.0, 2.0]], [[1.0]], [[1.0]], T), r"B of shape \(1, 2\)"),
        (lambda: GAIN([[np.nan]], T), "not finite"),
        (lambda: GAIN([[1.0]], 0.0), "a period of 0.0 s"),
        (lambda: pid(1.0, 0.0, 1.0, 0.0, T), "filter_frequency: found 0.0 Hz"),
        (lambda: side_by_side([GAIN([[1.0]], t) for t in (T, 2 * T)]), "expected one period"),
    ],
)
def test_bad_controllers_are_refused(build, message):
    with pytest.raises(InputError, match=message):
        build()


def test_the_example_of_a_centralised_controller_holds_the_rotor_by_all_axes():
    example = runpy.run_path(Path(__file__).parents[2] / "examples" / "centralised_control.py")
    rig = load_rig("three-mass").rig
    controller = example["centralised"](rig)
    assert (controller.positions, controller.commands) == (4, 4)
    held = replace(rig, controller=controller)
    assert growth(held, held.plant(1.0), rig.rotation.speed)[0] < 0
    # From one axis and end to the others: no four controllers side by side.
    across = np.abs(controller.response([2 * np.pi * 140.0])[0])
    assert across[0, 1:].min() > 1e-3 * across[0, 0]
    assert across[0, 3] > 0.05 * across[0, 0]


# Lagging amplifiers: the rig's own files are right for its own reader, images and all.


LIBRARY = files("rotorid.rig") / "library"
RIGID = (LIBRARY / "rigid.toml").read_text("utf-8").replace('"10 s"', '"5 s"')
LINEAR = (LIBRARY / "three-mass.toml").read_text("utf-8").replace('"13 s"', '"5 s"')
LAG = 'bandwidth = "1.5 kHz"'
FILES = {
    "magnets, measured": RIGID,
    "magnets, commanded": RIGID.replace('current = "measured"', 'current = "command"'),
    "flux": RIGID.replace(LAG, f'{LAG}\nflux = {{ area = "4 cm^2", noise = "1 mT" }}'),
}


def identified(folder: Path, text: str) -> dict:
    """Simulate a rig file, identify by the file that it leaves, and return the result."""
    result = folder / "run.json"
    assert run(["identify", str(simulated(folder, text)), "--json", str(result)]) == 0
    found = json.loads(result.read_text())
    assert found["status"] == "ok"
    truth = load_rig("rigid" if "F_xa" in text else "three-mass").rig.values
    for parameter in found["parameters"]:
        if not parameter["fixed"]:
            off = abs(parameter["value"] - truth[parameter["name"]])
            assert off < 5 * parameter["std"], parameter["name"]
    return found


@pytest.mark.slow
def test_a_rigs_own_file_is_accepted(tmp_path):
    text = LINEAR.replace('limit = "3 A"', 'limit = "3 A"\nbandwidth = "1 kHz"')
    assert identified(tmp_path, text)["misfit"]["p_value"] > 0.001


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_a_rigs_own_file_is_accepted_at_a_hundredth_of_its_noise(name, tmp_path):
    """No image, and no kink of the currents, is left: a lag of .1 us would be rejected."""

    def less(match: re.Match[str]) -> str:
        return f'{match[1]}"{float(match[2]) / 100:g} {match[3]}"'

    text = re.sub(r'((?:noise|jitter) = )"([\d.]+) (\w+)"', less, FILES[name])
    text = re.sub(r'(\nF_\w+ = )"([\d.]+) (N)"', less, text).replace('"5 s"', '"2 s"')
    misfit = identified(tmp_path, text)["misfit"]
    assert misfit["cost"] < 2 * misfit["expected"]


@pytest.mark.slow
def test_a_rig_without_bias(tmp_path):
    """One magnet at a time; currents logged as fast as they bend give the rotor."""
    text = RIGID.replace('"5 s"', '"2 s"').replace('bias = "2.5 A"', 'bias = "0 A"')
    text = text.replace('limit = "2.4 A"', 'limit = "4 A"')
    text = text.replace('sample_rate = "10 kHz"', 'sample_rate = "40 kHz"')
    identified(tmp_path, text.replace("oversampling = 8", "oversampling = 2"))
    assert 'bias = "0 A"' in (tmp_path / "run.toml").read_text()
    with h5py.File(tmp_path / "run.h5") as data:
        force, current = data["truth/force"][:, 0], data["truth/current"][:, 0]
    assert np.all(force * current >= 0)
    assert np.min(np.abs(current)) < 0.01 < 1 < np.max(np.abs(current))


def test_an_amplifier_in_a_law_that_bends():
    """A held command, a first-order lag, opposed magnets: the force against fine integration."""
    rate, period, lag, fine = 10e3, 1000, 1 / (2 * np.pi * 1500.0), 40
    law = Differential(K=1e-5, bias=2.0, gap=4e-4)
    t = np.arange(period) / rate
    command = 0.6 * np.cos(2 * np.pi * 110.0 * t) + 0.4 * np.sin(2 * np.pi * 290.0 * t)

    def place(time: np.ndarray) -> np.ndarray:
        return 5e-5 * np.cos(2 * np.pi * 70.0 * time + 1.0)

    step = 1 / rate / fine
    steps = np.exp(-step * np.arange(fine) / lag)
    current, flowing = 0.0, np.zeros(period * fine)
    for _ in range(3):  # until it repeats
        for k, held in enumerate(command):
            flowing[k * fine : (k + 1) * fine] = held + (current - held) * steps
            current = held + (current - held) * np.exp(-fine * step / lag)
    # The rotor turns smoothly between the fine steps, on which the current is exact.
    when = np.arange(period * fine) * step
    truth = np.fft.rfft(law.force(flowing, place(when)))[:40] / fine
    behind = FirstOrder(bandwidth=Constant("bandwidth", "Hz", 1500.0), actuator=True)
    channels = [Channel("i", "A", hold=True, dynamics=behind), Channel("x", "m")]
    record = Record(channels, np.tile(np.stack([command, place(t)], axis=1), (4, 1)), rate)
    plain = replace(record, channels=(replace(channels[0], dynamics=None), channels[1]))
    errors = []
    for each in (record, plain):
        read = forces(each, {"F": ForceReading(law, ("i",), {"x": 1.0})}, period=period)
        found = np.fft.rfft(read.column("F")[period : 2 * period])[:40]
        errors.append(np.abs(found - truth).max() / np.abs(truth).max())
    assert errors[0] < 3e-4
    assert errors[1] > 0.05


def test_converters_let_lines_through_and_images_not():
    every, count = 8, 4000
    t = np.arange(count * every) / every
    inside = np.cos(2 * np.pi * 0.09 * t + 0.3)
    image = np.cos(2 * np.pi * 0.95 * t)
    kept = decimated(np.stack([inside, image], axis=1), every)
    assert kept.shape == (count, 2)
    middle = slice(50, -50)
    np.testing.assert_allclose(kept[middle, 0], inside[::every][middle], atol=3e-6)
    assert np.abs(kept[middle, 1]).max() < 3e-6
    np.testing.assert_array_equal(decimated(inside, 1), inside)
