"""Lines of signals: DFT, synthesis, derivatives, hold and delay, against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorid import Channel
from rotorid.force.channel_dynamics import Constant, FirstOrder, Measured, SecondOrder
from rotorid.signals.spectrum import (
    differentiate,
    line_spectra,
    quantity,
    shifted,
    synthesize,
    transfer_of_recording,
)

# -------------------------------------------------------------------------------------------------
# Lines of signals: DFT, synthesis, derivatives, hold and delay, against closed forms.


def all_lines(samples):
    return np.arange(samples // 2 + 1)


@pytest.mark.parametrize("samples", [2, 3, 4, 7, 8, 250, 251])
def test_lines_are_the_mean_of_the_definition(samples):
    x = np.random.default_rng(1).standard_normal((2, samples, 3))
    n = np.arange(samples)
    for k in all_lines(samples):
        expected = (x * np.exp(-2j * np.pi * k * n / samples)[:, None]).mean(axis=1)
        np.testing.assert_allclose(line_spectra(x, [k])[:, 0], expected, atol=1e-14)


@pytest.mark.parametrize("samples", [4, 7, 8, 250, 251])
def test_synthesis_of_all_lines_is_the_identity(samples):
    x = np.random.default_rng(2).standard_normal((3, samples, 2))
    every = all_lines(samples)
    np.testing.assert_allclose(synthesize(line_spectra(x, every), every, samples), x, atol=1e-14)


@settings(max_examples=40, deadline=None)
@given(st.integers(2, 60), st.data())
def test_synthesis_then_lines_is_the_identity(samples, data):
    chosen = data.draw(st.lists(st.sampled_from(list(all_lines(samples))), unique=True, min_size=1))
    harmonics = np.array(sorted(chosen))
    rng = np.random.default_rng(samples)
    lines = rng.standard_normal((len(harmonics), 2)) + 1j * rng.standard_normal((len(harmonics), 2))
    real = (harmonics == 0) | (2 * harmonics == samples)
    lines[real] = lines[real].real
    wave = synthesize(lines, harmonics, samples)
    np.testing.assert_allclose(line_spectra(wave, harmonics), lines, atol=1e-13)
    others = np.setdiff1d(all_lines(samples), harmonics)
    np.testing.assert_allclose(line_spectra(wave, others), 0, atol=1e-13)


def test_white_noise_has_the_variance_that_the_record_promises():
    """E|X_k|^2 = s^2 / N on every line, DC and Nyquist included."""
    samples, runs, s = 10, 20_000, 3.0
    x = s * np.random.default_rng(3).standard_normal((runs, samples, 1))
    power = (np.abs(line_spectra(x, all_lines(samples))) ** 2).mean(axis=0)[:, 0]
    np.testing.assert_allclose(power, s**2 / samples, rtol=0.05)


@pytest.mark.parametrize("samples", [24, 25])
@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_derivatives_of_band_limited_signals(samples, order):
    rate = 37.0
    t = np.arange(samples) / rate
    total, expected = np.full(samples, 2.5), np.full(samples, 2.5 if order == 0 else 0.0)
    rng = np.random.default_rng(4)
    for k in range(1, (samples - 1) // 2 + 1):
        a, shift, w = rng.standard_normal(), rng.uniform(0, 6), 2 * np.pi * k * rate / samples
        total = total + a * np.cos(w * t + shift)
        expected = expected + a * w**order * np.cos(w * t + shift + order * np.pi / 2)
    every = all_lines(samples)
    lines = differentiate(line_spectra(total[:, None], every), every, samples, rate, order)
    found = synthesize(lines, every, samples)[:, 0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_the_nyquist_line_of_an_even_count(order):
    """cos(pi n): its odd derivatives vanish at the samples, the even ones do not."""
    samples, rate = 8, 16.0
    wave, w = (-1.0) ** np.arange(samples), np.pi * rate
    every = all_lines(samples)
    lines = differentiate(line_spectra(wave[:, None], every), every, samples, rate, order)
    expected = {0: wave, 1: 0 * wave, 2: -(w**2) * wave, 3: 0 * wave}[order]
    np.testing.assert_allclose(
        synthesize(lines, every, samples)[:, 0], expected, rtol=1e-12, atol=1e-9
    )


def test_derivatives_follow_one_another():
    samples, rate = 31, 100.0
    every = all_lines(samples)
    lines = line_spectra(np.random.default_rng(5).standard_normal((samples, 2)), every)
    once = differentiate(lines, every, samples, rate, 1)
    np.testing.assert_allclose(
        differentiate(once, every, samples, rate, 1), differentiate(lines, every, samples, rate, 2)
    )


def test_leading_axes_are_kept():
    x = np.random.default_rng(6).standard_normal((2, 3, 8, 4))
    lines = line_spectra(x, [1, 3])
    assert lines.shape == (2, 3, 2, 4)
    assert differentiate(lines, np.array([1, 3]), 8, 1.0, 1).shape == (2, 3, 2, 4)
    assert synthesize(lines, [1, 3], 8).shape == (2, 3, 8, 4)


def test_a_zero_order_hold_by_exact_integration():
    """A command held over each sample period drives a damped mass: q from the exact recursion.

    ``m q'' + c q' + k q = held(u)``, sampled at the steps of the hold, is
    ``s_{n+1} = A s_n + b u_n`` with A = expm, exact. On a line the continuous force is
    ``H(f) U_k``, H what `transfer_of_recording` returns, plus the images of the hold, which the
    plant answers too. Sum the aliases and compare.
    """
    from scipy.linalg import expm

    m, c, k, samples, rate = 1.0, 40.0, 5e4, 50, 1000.0
    period = 1 / rate
    system = np.zeros((3, 3))
    system[:2, :2], system[:2, 2] = [[0, 1], [-k / m, -c / m]], [0, 1 / m]
    step = expm(system * period)
    A, b = step[:2, :2], step[:2, 2]
    u = np.random.default_rng(7).standard_normal(samples)
    state = np.zeros(2)
    for _ in range(40):  # damped out to 1e-17 of the start
        states = []
        for value in u:
            states.append(state)
            state = A @ state + b * value
    q = np.array(states)[:, 0]

    harmonics = np.arange(1, 10)
    frequency = harmonics * rate / samples
    lines_u, lines_q = (line_spectra(x[:, None], harmonics)[:, 0] for x in (u, q))
    expected = np.zeros(len(harmonics), dtype=complex)
    for image in range(-4000, 4001):
        f = frequency + image * rate
        w = 2 * np.pi * f
        hold = transfer_of_recording([Channel("u", hold=True)], f, rate)[:, 0]
        expected += hold * lines_u / (-m * w**2 + 1j * w * c + k)
    np.testing.assert_allclose(lines_q, expected, rtol=1e-9)


def test_hold_in_closed_form():
    """A held cosine, integrated over each step, has the line that the transfer says."""
    samples, rate, k = 20, 200.0, 3
    n, fine = np.arange(samples), 4000
    command = np.cos(2 * np.pi * k * n / samples + 0.4)
    held = np.repeat(command, fine)
    w = 2 * np.pi * k / (samples * fine)
    true_line = (held * np.exp(-1j * w * (np.arange(samples * fine) + 0.5))).mean()
    line = line_spectra(command[:, None], [k])[0, 0]
    hold = transfer_of_recording([Channel("u", hold=True)], np.array([k * rate / samples]), rate)
    assert line * hold[0, 0] == pytest.approx(true_line, rel=1e-6)
    f = k / samples
    assert hold[0, 0] == pytest.approx(np.sinc(f) * np.exp(-1j * np.pi * f))


def test_a_delay_is_undone():
    samples, rate, delay = 40, 400.0, 0.0137
    t = np.arange(samples) / rate

    def signal(time):
        return 3 + np.cos(2 * np.pi * 20 * time + 1) - 2 * np.sin(2 * np.pi * 70 * time)

    lagging = signal(t - delay)
    harmonics = np.array([0, 2, 7])
    correction = transfer_of_recording([Channel("x", delay=delay)], harmonics * 10.0, rate)
    found = line_spectra(lagging[:, None], harmonics) * correction
    np.testing.assert_allclose(found, line_spectra(signal(t)[:, None], harmonics), atol=1e-13)


def test_hold_and_delay_of_each_channel():
    channels = [
        Channel("a"),
        Channel("b", hold=True),
        Channel("c", delay=1e-3),
        Channel("d", hold=True, delay=1e-3),
    ]
    found = transfer_of_recording(channels, np.array([0.0, 50.0]), 1000.0)
    np.testing.assert_allclose(found[0], 1)
    assert found[1, 0] == 1
    assert found[1, 3] == pytest.approx(found[1, 1] * found[1, 2])


# -------------------------------------------------------------------------------------------------
# Shifted samples against the shifted function.


N = np.arange(400)


@pytest.mark.parametrize("steps", [0.5, -0.25, 3.7, -2.1, 2.0, -3.0, 0.0, 1e-12, -0.0001])
@pytest.mark.parametrize("frequency", [0.02, 0.1, 0.3, 0.4, 0.45])
def test_a_periodic_signal_is_shifted_to_its_ends(steps: float, frequency: float) -> None:
    wave = np.cos(2 * np.pi * frequency * N + 0.3)
    moved = np.cos(2 * np.pi * frequency * (N + steps) + 0.3)
    np.testing.assert_allclose(shifted(wave, steps, 100), moved, atol=3e-9)
    middle = slice(70, -70)
    if frequency < 0.4:  # what is not known beyond the ends is seen within 64 samples of them
        np.testing.assert_allclose(shifted(wave, steps)[middle], moved[middle], atol=3e-9)


@pytest.mark.parametrize("steps", [0.5, -3.2, 30.0])
@pytest.mark.parametrize("count", [2, 5, 17, 40])
def test_short_signals_keep_their_length(steps: float, count: int) -> None:
    assert len(shifted(np.arange(float(count)), steps)) == count
    np.testing.assert_allclose(shifted(np.ones(count), steps), 1.0)


def test_a_straight_line_stays_one_to_its_ends() -> None:
    line = 3.0 + 0.5 * N
    np.testing.assert_allclose(shifted(line, 0.4), line + 0.2)


# -------------------------------------------------------------------------------------------------
# What a column says of its quantity: hold, delay and dynamics undone, sample by sample.


RATE, SIZE = 5000.0, 500
LINES = np.array([1, 7, 23, 90])
FREQUENCY = LINES * RATE / SIZE
DYNAMICS = {
    "first order": FirstOrder(bandwidth=Constant("bandwidth", "Hz", 800.0)),
    "second order": SecondOrder(
        bandwidth=Constant("bandwidth", "Hz", 2000.0), damping=Constant("damping", "1", 0.7)
    ),
    "amplifier": FirstOrder(bandwidth=Constant("bandwidth", "Hz", 800.0), actuator=True),
    "table": Measured(
        frequency=np.array([5.0, 1000.0]), measured=np.array([1.0, 0.8 * np.exp(-0.5j)])
    ),
    "none": None,
}


def columns(dynamics, delay: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a quantity and what a channel with a delay records of it, one period."""
    lines = np.exp(2j * np.pi * np.random.default_rng(1).uniform(size=(len(LINES), 1)))
    passed = np.exp(-2j * np.pi * FREQUENCY * delay)
    if dynamics is not None:
        passed = passed / dynamics.correction(2 * np.pi * FREQUENCY)
    parts = (lines, lines * passed[:, None])
    return tuple(synthesize(part, LINES, SIZE)[:, 0] for part in parts)


@pytest.mark.parametrize("name", DYNAMICS)
@pytest.mark.parametrize("periods", [1, 4])
def test_the_quantity_is_found_again(name: str, periods: int) -> None:
    """To rounding where the record is whole periods; a delay alone to 1e-9."""
    true, column = (np.tile(part, periods) for part in columns(DYNAMICS[name], 37e-6))
    channel = Channel("x", "m", delay=37e-6, dynamics=DYNAMICS[name])
    found = quantity(column, channel, RATE, SIZE)
    within = 1e-8 if name == "none" else 1e-12
    np.testing.assert_allclose(found, true, atol=within * np.abs(true).max())


@pytest.mark.parametrize("name", DYNAMICS)
def test_a_record_that_begins_and_ends_somewhere_is_right_inside(name: str) -> None:
    true, column = (np.tile(part, 5)[: 4 * SIZE + 77] for part in columns(DYNAMICS[name], 37e-6))
    channel = Channel("x", "m", delay=37e-6, dynamics=DYNAMICS[name])
    found = quantity(column, channel, RATE)
    inside = slice(SIZE, 3 * SIZE)
    np.testing.assert_allclose(found[inside], true[inside], atol=2e-3 * np.abs(true).max())


def test_what_hardly_passes_is_not_made_any_larger() -> None:
    """Noise of a logger behind a sensor of 100 Hz: at most tenfold, where 1 / H is fifty."""
    slow = SecondOrder(
        bandwidth=Constant("bandwidth", "Hz", 100.0), damping=Constant("damping", "1", 0.7)
    )
    noise = np.random.default_rng(3).standard_normal(5 * SIZE)
    found = quantity(noise, Channel("x", "m", dynamics=slow), RATE)
    assert 8 < found.std() / noise.std() < 10


def test_a_table_goes_on_as_it_ends() -> None:
    """A gain of 0.8 from 1 kHz on, at 2 kHz too."""
    time = np.arange(5 * SIZE) / RATE
    column = 0.8 * np.cos(2 * np.pi * 2000 * time - 0.5)
    found = quantity(column, Channel("x", "m", dynamics=DYNAMICS["table"]), RATE)
    middle = slice(SIZE, 4 * SIZE)
    true = np.cos(2 * np.pi * 2000 * time)
    np.testing.assert_allclose(found[middle], true[middle], atol=0.02)
