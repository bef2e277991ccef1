"""Line spectra, their covariance, and multisines."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorid import Channel, InputError
from rotorid.force.channel_dynamics import Constant, FirstOrder, Measured, SecondOrder
from rotorid.signals.covariance import (
    choose_covariance,
    correlated_covariance,
    is_correlated,
    lag_one_correlation,
    white_covariance,
)
from rotorid.signals.multisine import (
    Multisine,
    full_harmonics,
    leave_out,
    minimize_crest,
    multisine,
    odd_harmonics,
    orthogonal,
    schroeder_phases,
)
from rotorid.signals.spectrum import (
    differentiate,
    line_spectra,
    quantity,
    shifted,
    synthesize,
    transfer_of_recording,
)

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
    found = synthesize(lines, every, samples)[:, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-9)


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


# Shifted samples against the shifted function.


N = np.arange(400)


@pytest.mark.parametrize("steps", [0.5, -0.25, 3.7, -2.1, 2.0, -3.0, 0.0, 1e-12, -0.0001])
@pytest.mark.parametrize("frequency", [0.02, 0.1, 0.3, 0.4, 0.45])
def test_a_periodic_signal_is_shifted_to_its_ends(steps, frequency):
    wave = np.cos(2 * np.pi * frequency * N + 0.3)
    moved = np.cos(2 * np.pi * frequency * (N + steps) + 0.3)
    np.testing.assert_allclose(shifted(wave, steps, 100), moved, atol=3e-9)
    middle = slice(70, -70)
    if frequency < 0.4:  # what is not known beyond the ends is seen within 64 samples of them
        np.testing.assert_allclose(shifted(wave, steps)[middle], moved[middle], atol=3e-9)


@pytest.mark.parametrize("steps", [0.5, -3.2, 30.0])
@pytest.mark.parametrize("count", [2, 5, 17, 40, 400])
def test_a_straight_line_stays_one_to_its_ends(count, steps):
    np.testing.assert_allclose(shifted(np.ones(count), steps), 1.0)
    line = 3.0 + 0.5 * np.arange(count)
    assert len(shifted(line, steps)) == count
    if count == 400 and abs(steps) < 1:
        np.testing.assert_allclose(shifted(line, steps), line + 0.5 * steps)


# What a column says of its quantity: hold, delay and dynamics undone, sample by sample.


RATE, SIZE = 5000.0, 500
LINES = np.array([1, 7, 23, 90])
FREQUENCY = LINES * RATE / SIZE
HERTZ, DAMPING = partial(Constant, "bandwidth", "Hz"), Constant("damping", "1", 0.7)
DYNAMICS = {
    "first order": FirstOrder(bandwidth=HERTZ(800.0)),
    "second order": SecondOrder(bandwidth=HERTZ(2000.0), damping=DAMPING),
    "amplifier": FirstOrder(bandwidth=HERTZ(800.0), actuator=True),
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
def test_the_quantity_is_found_again(name, periods):
    """To rounding where the record is whole periods; a delay alone to 1e-9."""
    true, column = (np.tile(part, periods) for part in columns(DYNAMICS[name], 37e-6))
    channel = Channel("x", "m", delay=37e-6, dynamics=DYNAMICS[name])
    found = quantity(column, channel, RATE, SIZE)
    within = 1e-8 if name == "none" else 1e-12
    np.testing.assert_allclose(found, true, atol=within * np.abs(true).max())


@pytest.mark.parametrize("name", DYNAMICS)
def test_a_record_that_begins_and_ends_somewhere_is_right_inside(name):
    true, column = (np.tile(part, 5)[: 4 * SIZE + 77] for part in columns(DYNAMICS[name], 37e-6))
    found = quantity(column, Channel("x", "m", delay=37e-6, dynamics=DYNAMICS[name]), RATE)
    inside = slice(SIZE, 3 * SIZE)
    np.testing.assert_allclose(found[inside], true[inside], atol=2e-3 * np.abs(true).max())


def test_what_hardly_passes_is_not_made_any_larger():
    """Noise of a logger behind a sensor of 100 Hz: at most tenfold, where 1 / H is fifty."""
    slow = SecondOrder(bandwidth=HERTZ(100.0), damping=DAMPING)
    noise = np.random.default_rng(3).standard_normal(5 * SIZE)
    assert 8 < quantity(noise, Channel("x", "m", dynamics=slow), RATE).std() / noise.std() < 10


def test_a_table_goes_on_as_it_ends():
    """A gain of 0.8 from 1 kHz on, at 2 kHz too."""
    time = np.arange(5 * SIZE) / RATE
    column = 0.8 * np.cos(2 * np.pi * 2000 * time - 0.5)
    found = quantity(column, Channel("x", "m", dynamics=DYNAMICS["table"]), RATE)
    middle = slice(SIZE, 4 * SIZE)
    true = np.cos(2 * np.pi * 2000 * time)
    np.testing.assert_allclose(found[middle], true[middle], atol=0.02)


# Covariance of mean lines: both formulas against known noise, and the rule that chooses.


MIX = np.array([[1.0, 0.3 - 0.5j], [0.0, 0.8]])  # correlated channels


def circular(rng, *shape):
    """Return circular complex noise of variance 1."""
    return (rng.standard_normal((*shape, 2)) @ np.array([1, 1j])) / np.sqrt(2)


def white(rng, periods=260, lines=6, channels=2):
    return circular(rng, periods, lines, channels)


def telescoping(rng, periods, lines, channels=2, share=0.4):
    """Return white noise plus the difference of a random state between the ends of a period."""
    state = share * circular(rng, periods + 1, lines, channels)
    return white(rng, periods, lines, channels) + np.diff(state, axis=0)


def autoregressive(rng, periods, lines, channels, coefficient):
    noise = circular(rng, periods, lines, channels)
    noise[0] /= np.sqrt(1 - coefficient**2)
    for p in range(1, periods):
        noise[p] += coefficient * noise[p - 1]
    return noise


@pytest.mark.parametrize("periods", [2, 3, 20])
def test_white_formula_is_unbiased_and_keeps_cross_terms(periods):
    rng = np.random.default_rng(1)
    truth = MIX @ MIX.conj().T / periods
    draws = [white_covariance(white(rng, periods, 40) @ MIX.T) for _ in range(400)]
    assert {d.dof for d in draws} == {periods - 1}
    assert draws[0].kind == "white"
    found = np.mean([d.matrices for d in draws], axis=(0, 1))
    np.testing.assert_allclose(found, truth, atol=0.03 / periods)


def test_matrices_are_hermitian_and_positive():
    z = white(np.random.default_rng(3), 12, 4)
    for covariance in (white_covariance(z), correlated_covariance(z)):
        np.testing.assert_allclose(covariance.matrices, covariance.matrices.conj().swapaxes(1, 2))
        assert np.linalg.eigvalsh(covariance.matrices).min() > -1e-15


@pytest.mark.parametrize("periods", [2, 3, 24, 25])
def test_all_neighbours_are_the_white_formula_again(periods):
    z = white(np.random.default_rng(4), periods, 3)
    found = correlated_covariance(z, max(1, periods // 2))
    np.testing.assert_allclose(found.matrices, white_covariance(z).matrices, atol=1e-14)
    assert found.dof == periods - 1


@pytest.mark.parametrize(("periods", "m"), [(260, 22), (100, 8), (40, 3), (12, 1), (2, 1)])
def test_neighbours_that_are_taken(periods, m):
    found = correlated_covariance(white(np.random.default_rng(6), periods, 1))
    assert found.dof == min(2 * m, periods - 1)


def test_neither_formula_sees_what_every_period_repeats():
    rng = np.random.default_rng(7)
    z, signal = white(rng, 40, 3), 1e6 * circular(rng, 3, 2)
    for formula in (white_covariance, correlated_covariance):
        np.testing.assert_allclose(formula(z + signal).matrices, formula(z).matrices, atol=1e-9)


SHARE = 0.6
NOISY = 240
NOISES = [  # its share, the variance of the mean of so many periods, and that by their scatter
    (partial(telescoping, lines=30, share=SHARE), 1.0, 1 + 2 * SHARE**2),
    (partial(autoregressive, lines=20, coefficient=-0.6), 1 / 1.6**2, 1 / (1 - 0.6**2)),
    (partial(autoregressive, lines=20, coefficient=0.3), 1 / 0.7**2, 1 / (1 - 0.3**2)),
]


@pytest.mark.parametrize(("draw", "mean", "scatter"), NOISES)
def test_the_scatter_of_periods_is_not_that_of_their_mean(draw, mean, scatter):
    """States at the ends of periods cancel in the mean; the scatter between them does not know.

    The neighbours' own share of it grows with their distance: some per cent at a twelfth.
    """
    rng = np.random.default_rng(8)
    draws = [draw(rng, NOISY, channels=1) for _ in range(150)]
    true = np.mean([np.abs(z.mean(axis=0)) ** 2 for z in draws]) * NOISY
    assert true == pytest.approx(mean, rel=0.08)
    by_scatter, by_neighbours = (
        NOISY * np.mean([formula(z).matrices for z in draws]).real
        for formula in (white_covariance, correlated_covariance)
    )
    assert by_scatter == pytest.approx(scatter, rel=0.05)
    assert by_neighbours == pytest.approx(true, rel=0.12)
    assert abs(by_scatter / true - 1) > 4 * abs(by_neighbours / true - 1)


def test_lag_one_correlation():
    rng = np.random.default_rng(10)
    independent = np.mean([lag_one_correlation(white(rng, 20)) for _ in range(300)])
    assert independent == pytest.approx(-1 / 20, abs=0.004)
    z = autoregressive(rng, 4000, 6, 2, 0.5)
    assert lag_one_correlation(z) == pytest.approx(0.5, abs=0.02)
    np.testing.assert_allclose(lag_one_correlation(1e-9 * z), lag_one_correlation(z))


def test_no_noise_is_no_correlation():
    same = np.ones((50, 3, 2), dtype=complex) * (1 + 1j) / 3
    rounding = same * (1 + 1e-15 * np.arange(50)[:, None, None])
    for z in (same, rounding, np.zeros((50, 3, 2), dtype=complex)):
        assert lag_one_correlation(z) == 0
        assert choose_covariance(z, z).kind == "white"
    # Few periods are taken as independent.
    assert not is_correlated(autoregressive(np.random.default_rng(16), 7, 6, 2, 0.9))


def test_rows_without_noise_do_not_hide_those_with_it():
    z = autoregressive(np.random.default_rng(11), 260, 6, 2, 0.4)
    z[..., 1] = 3.0
    assert is_correlated(z)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("periods", "lines", "rows"), [(260, 6, 8), (40, 6, 1), (8, 1, 1), (260, 1, 4), (20, 41, 1)]
)
def test_false_alarms_are_rare(periods, lines, rows):
    rng = np.random.default_rng(12)
    alarms = [is_correlated(white(rng, periods, lines, rows)) for _ in range(1000)]
    assert np.mean(alarms) < 0.01


@pytest.mark.parametrize("harmonics", [[0], [0, 1]])
def test_false_alarms_are_rare_on_real_lines(harmonics):
    rng = np.random.default_rng(13)
    alarms = 0
    for _ in range(1000):
        z = white(rng, 100, len(harmonics), 1)
        z[:, 0] = np.sqrt(2) * z[:, 0].real
        alarms += is_correlated(z)
    assert alarms < 15


def test_a_weak_correlation_is_detected():
    """Lag-one correlation of -0.15 at 260 periods, 6 lines."""
    rng = np.random.default_rng(14)
    share = np.sqrt(0.15 / (1 - 2 * 0.15))  # -s^2 / (1 + 2 s^2) = -0.15
    found = [is_correlated(telescoping(rng, 260, 6, 2, share)) for _ in range(300)]
    lag = [lag_one_correlation(telescoping(rng, 260, 6, 2, share)) for _ in range(100)]
    assert np.mean(lag) == pytest.approx(-0.15, abs=0.01)
    assert np.mean(found) > 0.95


def test_the_rule_chooses():
    rng = np.random.default_rng(15)
    z, carried = white(rng), telescoping(rng, 260, 6)
    kinds = [choose_covariance(*each).kind for each in ((z, z), (carried, carried), (z, carried))]
    assert kinds == ["white", "correlated", "correlated"]
    assert choose_covariance(z, carried).matrices.shape == (6, 2, 2)


@pytest.mark.parametrize("formula", [white_covariance, correlated_covariance])
def test_one_period_and_impossible_neighbours_are_refused(formula):
    with pytest.raises(InputError, match="found 1 periods; expected 2 or more"):
        formula(np.ones((1, 2, 2), dtype=complex))
    for m in (0, 6):
        with pytest.raises(InputError, match=f"found {m} neighbouring lines; expected 1 to 5"):
            correlated_covariance(np.ones((10, 2, 2), dtype=complex), m)


# Multisines against their definition; phases, lines, tables.


def test_samples_are_the_sum_of_the_lines():
    rng = np.random.default_rng(0)
    lines = np.array([1, 4, 5])
    amplitudes = rng.normal(size=(3, 2)) + 1j * rng.normal(size=(3, 2))
    signals = Multisine(2.0, lines, amplitudes, ("a", "b"))
    t = np.arange(50) / 100.0
    wave = np.exp(2j * np.pi * 2.0 * np.multiply.outer(t, lines))
    np.testing.assert_allclose(signals.samples(100.0), (wave @ amplitudes).real, atol=1e-12)
    np.testing.assert_allclose(signals.rms, signals.samples(100.0).std(axis=0))


@given(st.integers(2, 40), st.integers(2, 6))
def test_sets_of_lines(highest, group):
    odd, full = odd_harmonics(2 * highest), full_harmonics(highest)
    assert (odd % 2 == 1).all()
    assert odd[-1] == 2 * highest - 1
    np.testing.assert_array_equal(full, np.arange(1, highest + 1))
    kept = leave_out(odd, group, np.random.default_rng(1))
    assert len(odd) - len(kept) == len(odd) // group
    assert set(kept) <= set(odd)


def test_schroeder_beats_random_phases():
    n = np.arange(8)
    np.testing.assert_allclose(schroeder_phases(np.ones(8)), -np.pi * n * (n + 1) / 8)
    lines = full_harmonics(60)
    one, by_chance = (1.0, lines, {"u": 1.0}), {"phases": "random", "rng": np.random.default_rng(3)}
    chance = [multisine(*one, **by_chance).crest_factor[0] for _ in range(20)]
    assert multisine(*one).crest_factor[0] < 1.8 < np.median(chance)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("lines", [odd_harmonics(11), odd_harmonics(79), full_harmonics(31)])
def test_crest_factor_is_minimized_and_amplitudes_are_kept(lines):
    start = multisine(20.0, lines, {"a": 2.0, "b": 3.0})
    better = minimize_crest(start)
    np.testing.assert_allclose(np.abs(better.amplitudes), np.abs(start.amplitudes))
    assert (better.crest_factor < 0.9 * start.crest_factor).all()
    assert (better.crest_factor < 1.48).all()
    again = minimize_crest(better, steps=1)
    assert (again.crest_factor <= better.crest_factor * (1 + 1e-12)).all()


def test_inputs_apart_by_lines():
    signals = multisine(1.0, full_harmonics(12), {"a": 1.0, "b": 2.0, "c": 1.0}, apart=True)
    assert (np.count_nonzero(signals.amplitudes, axis=1) == 1).all()
    assert (np.count_nonzero(signals.amplitudes, axis=0) == 4).all()


def test_orthogonal_runs_tell_inputs_apart_best():
    runs = orthogonal(multisine(1.0, [1, 2, 5], {n: 1.0 for n in "abcd"}))
    assert len(runs) == 4
    for line in range(3):
        matrix = np.stack([run.amplitudes[line] for run in runs], axis=1)
        assert np.linalg.cond(matrix) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Multisine(1.0, [0, 1], np.ones((2, 1)), ["u"]), "whole numbers from 1"),
        (lambda: Multisine(1.0, [2, 1], np.ones((2, 1)), ["u"]), "increasing numbers"),
        (lambda: Multisine(1.0, [1], np.ones((2, 1)), ["u"]), r"amplitudes of shape \(2, 1\)"),
        (lambda: Multisine(1.0, [1], [[np.nan]], ["u"]), "finite numbers"),
        (lambda: Multisine(0.0, [1], [[1.0]], ["u"]), "more than 0 Hz"),
        (lambda: multisine(3.0, [1], {"u": 1.0}).samples(100.0), "whole multiple"),
        (lambda: multisine(10.0, [7], {"u": 1.0}).samples(140.0), "more than 140 Hz"),
        (lambda: multisine(1.0, [1, 2], {"u": [1.0, 2.0, 3.0]}), "2, for each signal"),
        (lambda: multisine(1.0, [1], {"u": 1.0}, phases="random"), "pass rng"),
        (lambda: leave_out([1, 3], 1, np.random.default_rng(0)), "2 or more"),
    ],
)
def test_bad_multisines_are_refused(build, message):
    with pytest.raises(InputError, match=message):
        build()
