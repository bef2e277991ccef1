"""Forces read from currents: held or not, delayed, through any law, on the lines that count."""

import numpy as np
import pytest

from rotorid import Channel, Drive, InputError, Record, average
from rotorid.force.laws import Differential, Flux, Linear
from rotorid.force.reading import ForceReading, as_channels, forces

RATE, F0, PERIODS = 10_000.0, 20.0, 3
SIZE = int(RATE / F0)
LINES = np.array([1, 3, 5, 7, 9, 11, 30])
MAGNET = Differential(constant=4e-6, bias=2.0, gap=4e-4, angle=0.3)
LINEAR = Linear(ki=120.0, ks=2e5)
STEPS = 200  # of a fine grid within a sample


def wave(size: float, seed: int, time: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0, 2 * np.pi, len(LINES))
    return size * np.cos(2 * np.pi * F0 * np.multiply.outer(time, LINES) + phase).sum(axis=-1)


def current(time: np.ndarray) -> np.ndarray:
    return wave(0.15, 1, time)


def position(time: np.ndarray) -> np.ndarray:
    return wave(15e-6, 2, time)


def lines_of_truth(law, held_from: float | None) -> np.ndarray:
    """Lines of the force, by quadrature; the current held from `held_from` after each sample."""
    middle = (np.arange(SIZE * STEPS) + 0.5) / (RATE * STEPS)
    if held_from is None:
        flowing = current(middle)
    else:
        flowing = current(np.floor((middle - held_from) * RATE + 1e-9) / RATE)
    force = law.force(flowing, position(middle))
    turns = np.exp(-2j * np.pi * F0 * np.multiply.outer(LINES, middle))
    # The rule of the middle is exact on each step to the sinc of the step.
    return turns @ force / len(middle) * np.sinc(F0 * LINES / (RATE * STEPS))


def recorded(hold: bool, late_current: float, late_position: float, unit: str = "A") -> Record:
    """Columns that lag their quantities; a held one lags the hold of its samples."""
    time = np.arange(PERIODS * SIZE) / RATE
    shift = 0.0 if hold else late_current
    channels = [
        Channel("i", unit, hold=hold, delay=late_current),
        Channel("x", "m", delay=late_position),
        Channel("other", "m"),
    ]
    columns = [current(time - shift), position(time - late_position), time]
    return Record(channels, np.stack(columns, axis=1), RATE, speed=3.0, source="run.h5")


@pytest.mark.parametrize("law", [LINEAR, MAGNET])
@pytest.mark.parametrize("delay", [0.0, -50e-6, -130e-6, 30e-6])
def test_lines_of_a_held_current(law, delay: float) -> None:
    """A command leads: it flows -delay after its sample, for one sample period."""
    record = recorded(True, delay, 20e-6)
    reading = {"F": ForceReading(law, ("i",), {"x": 1.0})}
    found = average(forces(record, reading, period=SIZE), F0, harmonics=LINES)
    truth = lines_of_truth(law, held_from=-delay)
    np.testing.assert_allclose(
        found.spectra[..., found.index("F")], [truth] * PERIODS, atol=2e-6 * np.abs(truth).max()
    )


@pytest.mark.parametrize("law", [LINEAR, MAGNET])
@pytest.mark.parametrize("delays", [(0.0, 0.0), (37e-6, 0.0), (0.0, -20e-6), (50e-6, 50e-6)])
def test_samples_of_a_measured_current(law, delays: tuple[float, float]) -> None:
    record = forces(
        recorded(False, *delays), {"F": ForceReading(law, ("i",), {"x": 1.0})}, period=SIZE
    )
    time = np.arange(PERIODS * SIZE) / RATE
    truth = law.force(current(time), position(time))
    np.testing.assert_allclose(record.column("F"), truth, atol=1e-8 * np.abs(truth).max())


def test_channels_used_up_are_replaced_and_others_kept() -> None:
    record = forces(recorded(True, 0.0, 0.0), {"F": ForceReading(LINEAR, ("i",), {"x": 1.0})})
    assert record.names == ("F", "x", "other")
    force = record.channels[0]
    assert (force.unit, force.hold, force.delay) == ("N", False, 0.0)
    assert record.speed == 3.0


def test_drives_are_laws_of_their_own() -> None:
    record = recorded(True, -50e-6, 0.0)
    drive = Drive(LINEAR.ki, LINEAR.ks, {"x": 1.0})
    channels = (Channel("F", "A", hold=True, delay=-50e-6, drive=drive), *record.channels[1:])
    driven = Record(channels, record.samples, RATE)
    by_law = forces(record, {"F": ForceReading(LINEAR, ("i",), {"x": 1.0})})
    np.testing.assert_array_equal(forces(driven).samples, by_law.samples)
    np.testing.assert_array_equal(forces(driven, drives=False).samples, driven.samples)


def test_flux_densities() -> None:
    time = np.arange(PERIODS * SIZE) / RATE
    law = Flux(area=2e-4, poles=2, angle=MAGNET.angle)
    pair = law.densities(MAGNET, current(time), position(time))
    record = Record([Channel("b1", "T"), Channel("b2", "T")], np.stack(pair, axis=1), RATE)
    found = forces(record, {"F": ForceReading(law, ("b1", "b2"))})
    assert found.names == ("F",)
    truth = MAGNET.force(current(time), position(time))
    np.testing.assert_allclose(found.column("F"), truth, rtol=1e-9, atol=1e-9)


def test_constants_of_the_law_give_the_gain_its_deviation() -> None:
    law = Linear(ki=120.0, std={"ki": 1.2})
    record = forces(recorded(False, 0.0, 0.0), {"F": ForceReading(law, ("i",))})
    assert record.channels[0].gain_std == pytest.approx(0.01)


def test_displacement_as_a_combination_of_sensors() -> None:
    planes = [
        Channel("a", "m", reads={"x": 1.0, "theta_y": -0.2}),
        Channel("b", "m", reads={"x": 1.0, "theta_y": 0.25}),
    ]
    assert as_channels(planes, {"x": 1.0, "theta_y": -0.2}) == {"a": 1.0}
    weights = as_channels(planes, {"x": 1.0})
    assert weights["a"] * -0.2 + weights["b"] * 0.25 == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(InputError, match=r"no sensors that give the displacement 1\*y"):
        as_channels(planes, {"y": 1.0})
    with pytest.raises(InputError, match="no sensors"):
        as_channels([], {"y": 1.0})


@pytest.mark.parametrize(
    ("record", "reading", "message"),
    [
        (
            recorded(False, 0.0, 0.0),
            ForceReading(Differential(1e-6, 0.5, 4e-4), ("i",)),
            r"run.h5: F: found current .* A at sample \d+, \d+ such in all; expected less than "
            "the bias of 0.5 A",
        ),
        (
            recorded(False, 0.0, 0.0),
            ForceReading(Differential(1e-6, 2.0, 3e-5), ("i",), {"x": 1.0}),
            "less than the gap of 3e-05 m",
        ),
        (recorded(False, 0.0, 0.0), ForceReading(LINEAR, ("j",)), "no channel 'j'"),
        (recorded(False, 0.0, 0.0), ForceReading(LINEAR, ("i",), {"z": 1.0}), "no channel 'z'"),
    ],
)
def test_bad_readings_are_refused(record: Record, reading: ForceReading, message: str) -> None:
    with pytest.raises(InputError, match=message):
        forces(record, {"F": reading})
