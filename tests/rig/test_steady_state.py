"""The periodic answer against time integration, direct formulas, and its own equations."""

from contextlib import nullcontext

import numpy as np
import pytest
from bank import BANK, Grid
from model_text import model_text

from rotorid import InputError, ModelError, load_model, parse_model, simulate, steady_state

JEFFCOTT = load_model("jeffcott")
VALUES = JEFFCOTT.values({"m": 2.0, "c": 150.0, "k": 2e5, "xi": 2e-4, "zeta": -1e-4})
GRID = Grid(200, 4000.0, turns=3, phase=0.6)
TURNING = {"sample_rate": GRID.sample_rate, "speed": GRID.speed, "phase": GRID.phase}


def multisine(grid, harmonics, inputs):
    t = grid.time
    waves = [np.cos(h * grid.omega * t + h**2) + np.sin(h * grid.omega * t) for h in harmonics]
    return np.outer(10 * np.sum(waves, axis=0), np.linspace(1, 2, inputs))


def test_one_degree_of_freedom_in_closed_form():
    m, c, k = VALUES[:3]
    w, t = GRID.omega * 4, GRID.time
    forces = np.column_stack([7 * np.cos(w * t + 0.3), 0 * t])
    values = [*VALUES[:3], 0.0, 0.0]
    found = steady_state(JEFFCOTT, values, forces, sample_rate=GRID.sample_rate)
    size, lag = 7 / abs(k - m * w**2 + 1j * c * w), np.angle(k - m * w**2 + 1j * c * w)
    np.testing.assert_allclose(found[:, 0], size * np.cos(w * t + 0.3 - lag), atol=1e-16)
    np.testing.assert_array_equal(found[:, 1], 0)


def test_unbalance_alone_in_closed_form():
    """A circle: z = m Omega^2 (xi + i zeta) exp(i phi) / (k - m Omega^2 + i c Omega)."""
    m, c, k, xi, zeta = VALUES
    W = GRID.speed
    found = steady_state(JEFFCOTT, VALUES, np.zeros((GRID.samples, 2)), **TURNING)
    answer = m * W**2 * (xi + 1j * zeta) / (k - m * W**2 + 1j * c * W) * np.exp(1j * GRID.angle)
    np.testing.assert_allclose(found[:, 0] + 1j * found[:, 1], answer, rtol=1e-12)


@pytest.mark.parametrize("samples", [40, 41])
@pytest.mark.parametrize("problem", [p for p in BANK if p.linear], ids=lambda p: p.name)
def test_the_answer_fulfils_the_equations(problem, samples):
    """Residual of M q'' + (D + Omega G) q' + K q - B u - g at the samples, by the DFT."""
    grid = Grid(samples, 3333.0, turns=3, phase=0.2)
    model = problem.model
    values = model.values(problem.truth)
    linear = model.require_linear()
    forces = multisine(grid, (1, 2, 7), len(model.inputs))
    free = np.linalg.matrix_rank(linear.matrices(values, grid.speed).K) < linear.rows
    if problem.name == "hoist":
        forces = forces + 9.81 * problem.truth["m"]  # it hangs still
        with pytest.raises(InputError, match="singular dynamic stiffness at 0 Hz"):
            steady_state(model, values, forces + 1.0, sample_rate=3333.0)
    q = steady_state(model, values, forces, sample_rate=3333.0, speed=grid.speed, phase=grid.phase)
    spectrum = np.fft.fft(q, axis=0)
    omega = 2 * np.pi * np.fft.fftfreq(samples, 1 / 3333.0)[:, None]
    first, second = (np.fft.ifft((1j * omega) ** n * spectrum, axis=0).real for n in (1, 2))
    m = linear.matrices(values, grid.speed)
    left = second @ m.M.T + first @ (m.D + grid.speed * m.G).T + q @ m.K.T
    columns = linear.load_columns(grid.time, grid.angle, grid.speed)
    right = forces @ m.B.T + columns @ model.monomial_values(values)
    scale = np.abs(second @ m.M.T).max() + np.abs(q @ m.K.T).max()
    np.testing.assert_allclose(left, right, atol=1e-10 * scale)
    assert free or problem.name not in ("rigid", "hoist")


def test_resonance_without_damping_is_refused():
    m, k = 2.0, 2.0 * (4 * GRID.omega) ** 2
    values = [m, 0.0, k, 0.0, 0.0]
    forces = multisine(GRID, (4,), 2)
    with pytest.raises(InputError, match=r"a singular dynamic stiffness at 80 Hz; .*damping"):
        steady_state(JEFFCOTT, values, forces, sample_rate=GRID.sample_rate)
    values[1] = 1.0
    found = steady_state(JEFFCOTT, values, forces, sample_rate=GRID.sample_rate)
    size = np.abs(forces[:, 0]).max() / (1.0 * 4 * GRID.omega)
    assert np.abs(found[:, 0]).max() == pytest.approx(size, rel=5e-3)


@pytest.mark.parametrize(
    ("load", "speed", "message"),
    [
        ("h*cos(25*phi)", 2 * np.pi * 20, None),
        ("h*cos(99*phi)", 2 * np.pi * 20, None),
        ("h*cos(100*phi)", 2 * np.pi * 20, "a force at 2000 Hz, half the sample rate"),
        ("h*cos(150*phi)", 2 * np.pi * 20, "a load of the model at 3000 Hz"),
        ("h*cos(phi)", 2 * np.pi * 2200, "a load of the model at 2200 Hz"),
        ("h*cos(phi/2)", 2 * np.pi * 20, "a load of the model at 10 Hz; .*a period that holds it"),
        ("h*cos(2*pi*40*t)", 0.0, None),
        ("h*cos(250*t)", 0.0, "a load of the model at"),
        ("h*t", 0.0, "a load of the model at"),
        ("h*sign(sin(phi))", 2 * np.pi * 20, "a load of the model at"),
    ],
)
def test_loads_that_the_lines_of_a_period_do_not_hold(load, speed, message):
    equation = f"m*x'' + k*x = F + {load}"
    model = parse_model(model_text("small", [equation], "x m", "F N", "m kg, k N/m, h N"))
    when = {"sample_rate": 4000.0, "speed": speed}
    with nullcontext() if message is None else pytest.raises(InputError, match=message):
        assert np.abs(steady_state(model, [1.0, 5e3, 2.0], np.zeros((200, 1)), **when)).max() > 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"speed": 100.0}, "0.795775 revolutions in a period; expected a whole number"),
        ({"forces": np.zeros(200)}, r"forces of shape \(200,\); expected \(sample, 2\)"),
        ({"forces": np.zeros((200, 3))}, r"forces of shape \(200, 3\)"),
        ({"forces": np.zeros((0, 2))}, r"forces of shape \(0, 2\)"),
        ({"forces": np.full((200, 2), np.nan)}, "not finite"),
        ({"forces": np.outer((-1.0) ** np.arange(200), [1, 0])}, "a force at 2000 Hz, half the s"),
        ({"values": [1.0, 2.0]}, r"values of shape \(2,\); expected \(5,\)"),
        ({"values": [np.inf, 1, 1, 1, 1]}, "not finite"),
        ({"sample_rate": 0.0}, "not finite"),
    ],
)
def test_refusals(change, message):
    options = {"values": VALUES, "forces": np.zeros((200, 2)), "sample_rate": 4000.0, **change}
    with pytest.raises(InputError, match=message):
        steady_state(JEFFCOTT, options.pop("values"), options.pop("forces"), **options)


def test_models_that_are_not_linear_or_not_complete():
    emps = load_model("emps")
    with pytest.raises(ModelError, match=r"equation 1: found the term .*sign\(q'\)"):
        steady_state(emps, emps.values(emps.nominal), np.zeros((8, 1)), sample_rate=8.0)
    text = model_text("t", ["m*x'' + k*(x - y) = F"], "x m, y m", "F N", "m kg, k N/m")
    with pytest.raises(InputError, match="1 equations for 2 coordinates"):
        steady_state(parse_model(text), [1.0, 2.0], np.ones((8, 1)), sample_rate=8.0)


def test_record_of_a_simulation():
    forces = multisine(GRID, (1, 2), 2)
    record = simulate(JEFFCOTT, VALUES, forces, periods=3, **TURNING)
    assert record.names == ("F_x", "F_y", "x", "y")
    assert [c.unit for c in record.channels] == ["N", "N", "m", "m"]
    assert record.samples.shape == (600, 4)
    np.testing.assert_array_equal(record.samples[:200], record.samples[400:])
    np.testing.assert_array_equal(record.samples[:200, :2], forces)
    np.testing.assert_allclose(record.rotor_angle()[:200], GRID.angle)
    np.testing.assert_allclose(np.diff(record.rotor_angle()), GRID.speed / GRID.sample_rate)


def test_noise_of_a_simulation():
    options = {"sample_rate": GRID.sample_rate, "periods": 100}
    forces = multisine(GRID, (1, 2), 2)
    clean = simulate(JEFFCOTT, VALUES, forces, **options)
    noise = {"F_x": 0.5, "y": 1e-3}
    first, second = (
        simulate(JEFFCOTT, VALUES, forces, **options, noise=noise, rng=np.random.default_rng(1))
        for _ in range(2)
    )
    np.testing.assert_array_equal(first.samples, second.samples)
    difference = first.samples - clean.samples
    np.testing.assert_allclose(difference.std(axis=0), [0.5, 0, 0, 1e-3], rtol=0.02)
    assert abs(np.corrcoef(difference[:, 0], difference[:, 3])[0, 1]) < 0.03
    for change, message in (
        ({"noise": noise}, "noise without rng"),
        ({"noise": {"z": 1.0}}, "noise of 'z'; expected one of F_x, F_y, x, y"),
        ({"periods": 0}, "0 periods"),
        ({"noise": {"x": -1.0}}, "noise of -1"),
    ):
        with pytest.raises(InputError, match=message):
            simulate(JEFFCOTT, VALUES, forces, **options | change)
