"""Motion of the rig against closed forms and a reference integrator."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import linalg
from scipy.integrate import solve_ivp

from rotorid import InputError, load_rig, parse_model
from rotorid.force.laws import Differential
from rotorid.rig.kernel import coil_current
from rotorid.rig.machine import merge_clocks
from rotorid.rig.parts import Actuator, Logger, Rotation
from rotorid.rig.plant import rotor_plant
from rotorid.rig.rig import excitation_table, growth, pairs

# -------------------------------------------------------------------------------------------------
# Motion of the rig against closed forms and a reference integrator.


MAGNET = Differential(constant=5e-6, bias=1.5, gap=5e-4, angle=np.radians(22.5))


def closed_loop_steady_state(rig) -> np.ndarray:
    """Positions of one period: the sampled loop solved at z = exp(i omega T), line by line."""
    linear, speed = rig.model.require_linear(), rig.rotation.speed
    m = linear.matrices(rig.parameters, speed)
    inverse, n = np.linalg.inv(m.M), len(m.M)
    ki, ks = rig.parts[0].slopes
    A = np.zeros((2 * n, 2 * n))
    A[:n, n:] = np.eye(n)
    A[n:, :n] = -inverse @ (m.K - ks * m.B @ m.B.T)
    A[n:, n:] = -inverse @ (m.D + speed * m.G)
    B = np.vstack([np.zeros_like(m.B), inverse @ m.B * ki])
    T, late = rig.controller.period, rig.delay

    def driven(t):
        return np.linalg.solve(A, (linalg.expm(A * t) - np.eye(2 * n)) @ B)

    new = driven(T - late)  # of the command of this step, and of the one before it
    old = driven(T) - new
    at = [linear.load_columns(np.zeros(1), np.array([phi]), speed)[0] for phi in (0, np.pi / 2)]
    mu = linear.monomial_values(rig.parameters)
    g = np.concatenate([np.zeros(n), inverse @ (at[0] @ mu - 1j * (at[1] @ mu))])
    E, c = linalg.expm(A * T), rig.controller
    turn = np.exp(1j * speed * T)
    load = np.linalg.solve(1j * speed * np.eye(2 * n) - A, (turn * np.eye(2 * n) - E) @ g) / 2
    names = [sensor.name for sensor in rig.sensors]
    S = np.eye(2 * n)[[names.index(f) for f in rig.feedback]]
    table = excitation_table(rig)
    N = len(table)
    U, rotation = np.fft.fft(table, axis=0) / N, round(speed * T * N / (2 * np.pi))
    X = np.zeros((N, n), dtype=complex)
    for k in range(N):
        z = np.exp(2j * np.pi * k / N)
        held = new + old / z
        system = np.block(
            [
                [z * np.eye(2 * n) - E - held @ c.D @ S, -held @ c.C],
                [-c.B @ S, z * np.eye(c.states) - c.A],
            ]
        )
        right = np.concatenate([held @ U[k], np.zeros(c.states)])
        right[: 2 * n] += load * (k == rotation) + load.conj() * (k == N - rotation)
        X[k] = np.linalg.solve(system, right)[:n]
    return (np.fft.ifft(X, axis=0) * N).real


@pytest.mark.parametrize("delay", [0.0, 50e-6, 100e-6])
def test_steady_state_is_the_discrete_closed_loop(quiet, run, delay: float) -> None:
    rig = replace(quiet, delay=delay, settling=4.0)
    record = run(rig, 0.1)
    expected = np.tile(closed_loop_steady_state(rig), (2, 1))
    scale = np.abs(expected).max(axis=0)
    np.testing.assert_allclose(record.truth.position / scale, expected / scale, atol=1e-8)


def test_the_continuous_solution_is_met_to_the_images_of_the_hold(quiet, run) -> None:
    """Z q = B F + g with the lines of the held forces: the images fold back by 1e-6, not 1e-8."""
    rig = replace(quiet, settling=4.0, delay=0.0)
    truth = run(rig, 0.05).truth
    k = np.array([1, 3, 5, 7, 9, 11])
    omega, T = 2 * np.pi * 20.0 * k, rig.controller.period
    hold = np.sinc(20.0 * k * T) * np.exp(-0.5j * omega * T)
    position = np.fft.rfft(truth.position, axis=0, norm="forward")[k]
    current = np.fft.rfft(truth.current, axis=0, norm="forward")[k] * hold[:, None]
    linear = rig.model.require_linear()
    m = linear.matrices(rig.parameters, rig.rotation.speed)
    ki, ks = rig.parts[0].slopes
    Z = linear.dynamic_stiffness(omega, rig.parameters, rig.rotation.speed) - ks * m.B @ m.B.T
    mu, phi = linear.monomial_values(rig.parameters), truth.angle[:500]
    g = np.fft.rfft(
        linear.load_columns(truth.time[:500], phi, rig.rotation.speed) @ mu, axis=0, norm="forward"
    )[k]
    solved = np.linalg.solve(Z, (ki * current @ m.B.T + g)[..., None])[..., 0]
    error = np.abs(position - solved).max() / np.abs(solved).max()
    assert 1e-8 < error < 1e-5


CLOCKS = [
    {},
    {"delay": 0.0},
    {"delay": 130e-6},
    {"logger": Logger(8e3)},
    {"logger": Logger(15e3), "delay": 33e-6},
    {"logger": Logger(5e3), "delay": 100e-6},
]


@pytest.mark.sampled(4)
@pytest.mark.parametrize("clocks", CLOCKS)
@pytest.mark.parametrize("bandwidth", [None, 1500.0])
def test_exact_steps_against_the_reference(quiet, change, run, reference, clocks, bandwidth):
    rig = replace(change(quiet, bandwidth=bandwidth), settling=0.004, **clocks)
    assert rig.linear
    found, expected = run(rig, 0.012).truth.position, reference(rig, 0.012)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


NONLINEAR = {
    "magnets": {"law": MAGNET, "limit": 1.4},
    "lag": {"law": MAGNET, "limit": 1.4, "bandwidth": 1500.0},
    "slew": {"law": MAGNET, "limit": 1.4, "bandwidth": 1500.0, "slew": 2000.0},
    "limit": {"law": MAGNET, "limit": 0.7},
    "linear law, slew": {"bandwidth": 1500.0, "slew": 2000.0},
}
TURNING = {
    "constant": Rotation(speed=880.0),
    "changing": Rotation(880.0, acceleration=300.0, drift=20.0, drift_period=0.02, phase=0.5),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("turning", TURNING)
@pytest.mark.parametrize("kind", NONLINEAR)
def test_integration_against_the_reference(quiet, change, run, reference, kind, turning) -> None:
    """Done when: 1e-6 of the peak, from switching on, through saturation and changing speed."""
    rig = replace(
        change(quiet, **NONLINEAR[kind]),
        rotation=TURNING[turning],
        settling=0.005,
        clearance=4.5e-4,
    )
    assert not rig.linear
    found, expected = run(rig, 0.02).truth.position, reference(rig, 0.02)
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


def test_changing_speed_of_a_linear_law_against_the_reference(quiet, run, reference) -> None:
    rig = replace(quiet, rotation=TURNING["changing"], settling=0.002, delay=33e-6)
    found, expected = run(rig, 0.02).truth.position, reference(rig, 0.02)
    assert np.abs(found - expected).max() < 1e-7 * np.abs(expected).max()


def test_a_tighter_tolerance_converges(quiet, change, run) -> None:
    rig = replace(change(quiet, **NONLINEAR["slew"]), settling=0.0, clearance=4.5e-4)
    runs = [run(replace(rig, tolerance=tol), 0.05).truth.position for tol in (1e-5, 1e-7, 1e-11)]
    coarse, fine = (np.abs(q - runs[2]).max() / np.abs(runs[2]).max() for q in runs[:2])
    assert fine < coarse / 5
    assert fine < 1e-6


def test_integrator_and_exact_steps_agree(quiet, change, run) -> None:
    """A slew limit that is never reached changes the method and not the motion."""
    rig = replace(change(quiet, bandwidth=1500.0), settling=0.1)
    slow = change(rig, slew=1e7)
    assert rig.linear
    assert not slow.linear
    exact, stepped = (run(r, 0.2).truth.position for r in (rig, slow))
    assert np.abs(exact - stepped).max() < 2e-7 * np.abs(exact).max()


def test_small_motion_in_magnets_is_linear(quiet, change, run) -> None:
    little = replace(
        quiet,
        excitation=quiet.excitation.scaled(1e-4 * np.ones(4)),
        values={**quiet.values, "xi": 0.0, "zeta": 0.0, "mu": 0.0, "eta": 0.0},
        settling=0.5,
    )
    magnets = change(little, law=MAGNET, limit=1.4)
    slopes = change(little, law=MAGNET.linearize(), limit=1.4)
    one, other = (run(rig, 0.2).truth.position for rig in (magnets, slopes))
    assert np.abs(one - other).max() < 1e-6 * np.abs(other).max()


@pytest.mark.parametrize("command", [-3.0, -0.1, 0.0, 0.4, 2.5])
@pytest.mark.parametrize("slew", [np.inf, 4000.0])
def test_coil_current_in_closed_form(command: float, slew: float) -> None:
    lag, start = 1e-4, 0.4
    times = np.linspace(0.0, 1e-3, 7)
    followed = solve_ivp(
        lambda t, i: np.clip((command - i) / lag, -slew, slew),
        (0.0, 1e-3),
        [start],
        t_eval=times,
        max_step=2e-6,
        rtol=1e-10,
        atol=1e-12,
    ).y[0]
    found = [coil_current(start, command, lag, slew, t) for t in times]
    np.testing.assert_allclose(found, followed, atol=1e-6)


def test_an_amplifier_without_lag_follows_at_once() -> None:
    assert coil_current(0.0, 2.0, 0.0, np.inf, 0.0) == 2.0


def test_a_slower_logger_sees_the_same_motion(quiet, run) -> None:
    slow = replace(quiet, logger=Logger(5e3), settling=0.1)
    fast = replace(quiet, logger=Logger(20e3), settling=0.1)
    one, other = run(slow, 0.1).truth.position, run(fast, 0.1).truth.position
    np.testing.assert_allclose(one, other[::4], atol=1e-12 * np.abs(one).max())


def test_growth_is_that_of_the_free_motion(quiet, change) -> None:
    """Weak damping: the slowest mode decays as its eigenvalue says."""
    rig = replace(quiet, settling=0.0, excitation=None)
    plant = rig.plant(1.0)
    rate, frequency, axis = growth(rig, plant, rig.rotation.speed)
    assert rate == pytest.approx(-10.39, abs=0.01)
    assert frequency == pytest.approx(0.0, abs=1e-6)
    assert axis in rig.model.inputs
    late = [growth(replace(rig, delay=d), plant, 880.0)[0] for d in (0.0, 2e-4, 4e-4, 8e-4)]
    assert late[-1] > 0 > late[0]


def test_constant_loads_and_higher_orders_are_carried(run, tmp_path) -> None:
    """Gravity hangs the rotor where integral action is missing; a load of 2 phi shakes it."""
    (tmp_path / "model.toml").write_text(
        """
title = "a mass in a bearing"
equations = ["m*x'' = F_x - m*g + a*Omega^2*sin(2*phi)"]
coordinates = { x = "m" }
inputs = { F_x = "N" }
[parameters]
m = { unit = "kg", nominal = 2.0 }
g = { unit = "m/s^2", nominal = 9.81 }
a = { unit = "kg m", nominal = 1e-4 }
"""
    )
    (tmp_path / "rig.toml").write_text(
        """
model = "model.toml"
duration = "0.1 s"
settling = "3 s"
rotation = { speed = "20 Hz" }
controller = { rate = "10 kHz", stiffness = "1e5 N/m", damping = "200 N s/m", filter = "4 kHz" }
actuators = { all = { law = "force" } }
sensors = { x = {} }
logger = { sample_rate = "10 kHz" }
"""
    )
    rig = load_rig(tmp_path / "rig.toml").rig
    x = run(rig, 0.1).truth.position[:, 0]
    speed = rig.rotation.speed
    assert x.mean() == pytest.approx(-2.0 * 9.81 / 1e5, rel=1e-9)
    line = 2 * np.mean(x * np.exp(-2j * speed * np.arange(1000) / 10e3))
    expected = -1j * 1e-4 * speed**2 / (1e5 + 200 * 2j * speed - 2.0 * (2 * speed) ** 2)
    assert line == pytest.approx(expected, rel=0.05)  # the sampled derivative lags a little


MODEL = """
title = "a mass on a spring that depends on the speed"
equations = ["m*x'' + k*{factor}*x = F_x"]
coordinates = {{ x = "m" }}
inputs = {{ F_x = "N" }}
parameters = {{ m = {{ unit = "kg", nominal = 2.0 }}, k = {{ unit = "N/m", nominal = 1e3 }} }}
"""


def plant_of(equation: str, acceleration: float = 2000.0):
    model = parse_model(equation)
    return rotor_plant(model, model.values(model.nominal), Rotation(100.0, acceleration), 1.0)


def test_matrices_follow_the_speed_as_a_polynomial() -> None:
    plant = plant_of(MODEL.format(factor="(1 + Omega^2)"))
    for speed in (100.0, 703.0, 2100.0):
        assert plant.at(speed).motion[0, 0, 0] == pytest.approx(-500.0 * (1 + speed**2))


@pytest.mark.parametrize(
    ("equation", "message"),
    [
        (MODEL.format(factor="sqrt(Omega)"), "no polynomial of Omega"),
        (MODEL.format(factor="1").replace("= F_x", "= F_x + k*cos(5*t)"), "no smooth function of"),
        (MODEL.format(factor="1").replace("= F_x", "= F_x + k*cos(phi/2)"), "no smooth function"),
        (MODEL.format(factor="1").replace("m*x'' +", "m*x' +"), "a coordinate without mass"),
        (MODEL.format(factor="x^2"), "linear in the coordinates"),
    ],
)
def test_rotors_that_no_rig_can_carry(equation: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        plant_of(equation)


def test_axes_of_one_bearing_are_found_by_their_names() -> None:
    np.testing.assert_array_equal(pairs(("F_x1", "F_y1", "F_x3", "F_y3")), [1, 0, 3, 2])
    np.testing.assert_array_equal(pairs(("F_xa", "F_xb", "F_ya", "F")), [2, -1, 0, -1])


def test_noise_is_drawn_from_the_generator_alone(shipped, run) -> None:
    rig = replace(shipped, settling=0.01)
    one, again, other = (run(rig, 0.02, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.samples, again.samples)
    assert np.abs(one.samples - other.samples).min() > 0


def test_noise_has_its_size(quiet, run) -> None:
    """Sensor noise is in the reading; process noise moves a free mass as its impulses do."""
    sensors = tuple(replace(s, noise=3e-6) for s in quiet.sensors)
    record = run(replace(quiet, sensors=sensors, settling=0.5), 1.0)
    noise = record.samples[:, 4:] - record.truth.position
    np.testing.assert_allclose(noise.std(axis=0), 3e-6, rtol=0.03)
    np.testing.assert_allclose(noise.mean(axis=0), 0.0, atol=4 * 3e-8)


def test_process_noise_has_its_size(run, tmp_path) -> None:
    (tmp_path / "model.toml").write_text(
        """
title = "a mass"
equations = ["m*x'' = F_x"]
coordinates = { x = "m" }
inputs = { F_x = "N" }
parameters = { m = { unit = "kg", nominal = 2.0 } }
"""
    )
    (tmp_path / "rig.toml").write_text(
        """
model = "model.toml"
duration = "100 s"
settling = "2 s"
controller = { rate = "1 kHz", stiffness = "200 N/m", damping = "20 N s/m", filter = "400 Hz" }
actuators = { all = {} }
sensors = { x = {} }
process_noise = { F_x = "3 N" }
logger = { sample_rate = "1 kHz" }
"""
    )
    x = run(load_rig(tmp_path / "rig.toml").rig, 100.0).truth.position[:, 0]
    # White force of intensity s^2 T on m, c, k: var x = s^2 T / (2 c k); the loop delays a little.
    assert x.var() == pytest.approx(3.0**2 * 1e-3 / (2 * 20.0 * 200.0), rel=0.1)


@pytest.mark.parametrize("law", [None, MAGNET])
def test_a_rig_of_one_actuator_kind_needs_no_other(quiet, run, law) -> None:
    part = Actuator(law, limit=1.4 if law else np.inf)
    slopes = quiet.controller.D * quiet.parts[0].slopes[0] / part.slopes[0]
    assert slopes.shape == (4, 4)
    names = quiet.model.inputs
    mixed = {**quiet.actuators, names[0]: replace(quiet.parts[0], limit=2.0)}
    assert run(replace(quiet, actuators=mixed, settling=0.01), 0.01).truth.force.shape == (100, 4)


# -------------------------------------------------------------------------------------------------
# Clocks merged into one pattern.


@given(st.integers(1, 12), st.integers(1, 12), st.integers(0, 40))
def test_every_clock_ticks_as_often_as_it_should(p: int, q: int, tenths: int) -> None:
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
        ((1.0, 1.0, -1e-3), "delay: found -0.001 s"),
        ((1e4, 1e4 * (1 + 1e-6), 0.0), "samples at 10000.01 Hz; expected a ratio of whole num"),
        ((1e4, np.pi * 1e4, 0.0), "choose rates of a simpler ratio"),
    ],
)
def test_clocks_that_never_meet_are_refused(rates, message: str) -> None:
    with pytest.raises(InputError, match=message):
        merge_clocks(*rates)
