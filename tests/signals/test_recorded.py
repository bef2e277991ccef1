"""What a column says of its quantity: hold, delay and dynamics undone, sample by sample."""

import numpy as np
import pytest

from rotorid import Channel
from rotorid.force.channel_dynamics import Constant, FirstOrder, Measured, SecondOrder
from rotorid.signals.spectrum import quantity, synthesize

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
