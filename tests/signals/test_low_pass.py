"""The zero-phase low-pass: against scipy's, closed forms, and the noise that it lets pass."""

import numpy as np
import pytest
from scipy import signal

from rotorid import Channel, InputError
from rotorid.data.filtered import END, LowPass, read_condition

RATE = 1000.0
TIME = np.arange(6000) / RATE


def test_it_is_butterworth_forward_and_backward() -> None:
    """As scipy has it, but for the warped frequencies of its digital filter."""
    rng = np.random.default_rng(0)
    walk = np.cumsum(rng.standard_normal((6000, 2)), axis=0)
    found = LowPass(RATE, (8.0,)).apply(walk)
    sections = signal.butter(4, 8.0, fs=RATE, output="sos")
    other = signal.sosfiltfilt(sections, walk, axis=0)
    inner = slice(1500, -1500)
    assert np.abs(found - other)[inner].max() < 2e-3 * walk.std()
    assert LowPass(RATE, (8.0,)).gain(np.array([0.0, 8.0, 16.0])) == pytest.approx(
        [1.0, 0.5, 1 / (1 + 2.0 ** (2 * 4))]
    )


def test_derivatives_are_exact_and_a_ramp_stays_one() -> None:
    low = LowPass(RATE, (40.0,))
    omega = 2 * np.pi * 1.37
    wave = 0.3 + 2.0 * TIME[:, None] + np.sin(omega * TIME)[:, None]
    truth = (
        wave[:, 0],
        2.0 + omega * np.cos(omega * TIME),
        -(omega**2) * np.sin(omega * TIME),
    )
    inner = slice(400, -400)
    for order in range(3):
        error = low.apply(wave, order)[:, 0] - truth[order]
        assert np.abs(error)[inner].max() < 1e-6 * np.abs(truth[order]).max()


def test_beyond_its_memory_the_ends_do_not_count() -> None:
    """What the record goes on to beyond an end changes a sample by a thousandth at most."""
    low = LowPass(RATE, (20.0,))
    count = low.memory()
    wave = np.zeros((6000, 1))
    wave[3000:] = 1.0
    weights = np.abs(np.diff(low.apply(wave)[:, 0]))

    def beyond(away: int) -> float:
        return float((weights[: 3000 - away].sum() + weights[2999 + away :].sum()) / weights.sum())

    assert beyond(count + 1) <= END == 1e-3 < beyond(count - 2)
    assert LowPass(RATE, (40.0,)).memory() == pytest.approx(count / 2, abs=1.0)


def test_delay_and_hold_are_undone() -> None:
    low = LowPass(RATE, (100.0,))
    wave = np.sin(2 * np.pi * 1.37 * TIME)
    channels = (Channel("F", delay=0.003, hold=True), Channel("q", delay=0.0025))
    found = low.apply(np.column_stack([TIME, wave]), 0, channels)
    inner = slice(300, -300)
    # Held over a millisecond, a command acts half of that later than its samples say.
    assert np.abs(found[:, 0] - (TIME + 0.003 - 0.0005))[inner].max() < 1e-9
    later = np.sin(2 * np.pi * 1.37 * (TIME + 0.0025))
    assert np.abs(found[:, 1] - later)[inner].max() < 1e-6


def test_noise_that_it_lets_pass() -> None:
    low = LowPass(RATE, (30.0,))
    noise = 3.0 * np.random.default_rng(1).standard_normal((60000, 2))
    for order in range(3):
        found = low.apply(noise, order)[300:-300].std(axis=0)
        assert low.noise_of(noise, order) == pytest.approx(found, rel=0.05)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("abs(q') < 2 mm/s", ("q", 1, True, True, 0.002)),
        ("q'' > 3 m/s^2", ("q", 2, False, False, 3.0)),
        ("abs(F)>0.12 kN", ("F", 0, True, False, 120.0)),
        ("F < -5 N", ("F", 0, False, True, -5.0)),
    ],
)
def test_conditions(text: str, told: tuple[str, int, bool, bool, float]) -> None:
    found = read_condition(text, {"F": "N", "q": "m"})
    assert (found.channel, found.order, found.absolute, found.below) == told[:4]
    assert found.limit == pytest.approx(told[4])


def test_what_a_condition_tells() -> None:
    values = np.array([-3.0, -1.0, 0.0, 1.0, 3.0])
    told = {
        "abs(q) < 2 m": [False, True, True, True, False],
        "abs(q) > 2 m": [True, False, False, False, True],
        "q > 2 m": [False, False, False, False, True],
        "q < 2 m": [True, True, True, True, False],
    }
    for text, met in told.items():
        assert read_condition(text, {"q": "m"}).met(values).tolist() == met


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("q' = 2 mm/s", "the condition .*expected a channel, < or >"),
        ("abs(q' < 2 mm/s", "the condition .*expected a channel, < or >"),
        ("q''' < 2 m/s^3", "the condition .*expected a channel, < or >"),
        ("z < 2 mm", "'z' in the condition .*expected a channel of the record: F, q"),
        ("q' < 2 mm", "leave_out: .*mm.*m/s"),
        ("q' < 2", "leave_out: "),
    ],
)
def test_conditions_that_are_none(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_condition(text, {"F": "N", "q": "m"})
