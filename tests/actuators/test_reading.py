"""Force laws, their entries in files, and what goes through them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotorid import Channel, Drive, InputError, Record, average
from rotorid.force.channel_dynamics import Constant
from rotorid.force.entry import LawEntry
from rotorid.force.laws import MU0, Differential, Flux, Linear
from rotorid.force.reading import ForceReading, as_channels, forces, through_laws

# Force laws against closed forms, differences and Monte Carlo.


MAGNET = Differential(K=1.2e-5, bias=2.5, gap=4e-4, angle=np.radians(22.5))
SINGLE = replace(MAGNET, bias=0.0, iron=2e-5)
BIASED = Differential(K=4e-6, bias=2.0, gap=4e-4, angle=0.3)
WITH_IRON = replace(BIASED, bias_difference=0.05, iron=1e-5, saturation=7000.0)


def test_linear_is_what_it_says():
    law = Linear(ki=120.0, ks=2e5)
    np.testing.assert_allclose(law.force([0.0, 1.0], [1e-4, 0.0]), [20.0, 120.0])
    assert law.linearize(1.0, 1e-5) is law


def test_slopes_at_the_origin_are_the_closed_forms():
    slope, c = MAGNET.linearize(), np.cos(MAGNET.angle)
    assert slope.ki == pytest.approx(4 * 1.2e-5 * 2.5 / 4e-4**2 * c, rel=1e-14)
    assert slope.ks == pytest.approx(4 * 1.2e-5 * 2.5**2 / 4e-4**3 * c**2, rel=1e-14)


@given(st.sampled_from([MAGNET, WITH_IRON]), st.floats(-1.7, 1.7), st.floats(-3e-4, 3e-4))
def test_slopes_are_the_derivatives_of_the_force(law, current, position):
    slope = law.linearize(current, position)
    di, dx = 1e-5, 1e-9
    by_current = law.force(current + di, position) - law.force(current - di, position)
    by_position = law.force(current, position + dx) - law.force(current, position - dx)
    assert by_current / (2 * di) == pytest.approx(slope.ki, rel=1e-6)
    assert by_position / (2 * dx) == pytest.approx(slope.ks, rel=1e-5)


@given(st.floats(-20.0, 20.0), st.floats(-5e-3, 3e-4) | st.just(-4.2e-4 / np.cos(SINGLE.angle)))
def test_without_bias_one_magnet_works_at_a_time(current, nearer):
    """It pulls with the square of its current, to its own side, over its own gap alone."""
    c, side = np.cos(SINGLE.angle), np.sign(current)
    position, gap = side * nearer, 4.2e-4 - nearer * c
    force = SINGLE.force(current, position)
    assert force == pytest.approx(side * 1.2e-5 * c * current**2 / gap**2, rel=1e-12)
    assert SINGLE.guess(force, np.float64(position)) == pytest.approx(current, rel=1e-9)
    if abs(current) > 0.01:
        slope = SINGLE.linearize(current, position)
        assert slope.ki == pytest.approx(2 * force / current, rel=1e-12)
        assert slope.ks == pytest.approx(2 * force * side * c / gap, rel=1e-12)


def test_geometry_gives_the_constant_of_a_horseshoe():
    entry = LawEntry(law="differential", area="2 cm^2", turns=100, bias="2 A", gap="0.5 mm")
    law = entry.build()
    assert isinstance(law, Differential)
    flux = MU0 * 100 * 2.0 / (2 * 5e-4)
    assert law.force(0.0, 0.0) == 0.0
    single = law.K * (2.0 / 5e-4) ** 2
    assert single == pytest.approx(2 * 2e-4 * flux**2 / (2 * MU0), rel=1e-12)


KNOWN = {"K": 1e-7, "bias": 0.01, "gap": 4e-6, "angle": 0.01}


@pytest.mark.parametrize(
    ("law", "at"),
    [
        (Linear(120.0, 2e5, std={"ki": 2.4, "ks": 1e4}), (0.7, 1e-4)),
        (replace(MAGNET, std=KNOWN), (0.7, 1e-4)),
        (replace(SINGLE, std={"K": 1e-7, "gap": 4e-6, "iron": 1e-6}), (-0.7, 1e-4)),
        (Flux(2e-4, 2, 0.3, std={"area": 2e-6, "angle": 0.01}), (0.9, 0.4)),
    ],
)
def test_deviation_of_the_force_is_that_of_drawn_constants(law, at):
    rng = np.random.default_rng(2)
    forces = []
    for _ in range(4000):
        drawn = {n: getattr(law, n) + std * rng.normal() for n, std in law.std.items()}
        forces.append(replace(law, **drawn).force(*at))
    assert law.force_std(*at) == pytest.approx(np.std(forces), rel=0.05)


def test_deviation_of_the_slopes():
    slope = replace(MAGNET, std={"gap": 4e-6}).linearize()
    assert slope.std["ki"] == pytest.approx(2 * 0.01 * slope.ki, rel=1e-12)
    assert slope.std["ks"] == pytest.approx(3 * 0.01 * slope.ks, rel=1e-12)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Differential(1e-5, 2.0, 0.0), r"gap: found gap = 0.0; expected more than 0 m"),
        (lambda: Differential(1e-5, -2.0, 4e-4), r"bias = -2.0; expected 0 or more"),
        (lambda: Differential(1e-5, 2.0, np.nan), r"gap = nan"),
        (
            lambda: replace(SINGLE, std={"bias": 0.1}),
            r"bias = 0 A, with a deviation of 0.1 A; expected ex",
        ),
        (lambda: Differential(1e-5, 0.0, 4e-4, bias_difference=0.1), r"bias_difference = 0.1"),
        (lambda: SINGLE.linearize(), r"the force has no slope; expected a current other than 0"),
        (lambda: Differential(1e-5, 2.0, 4e-4, angle=2.0), r"less than 90 degrees"),
        (lambda: Linear(0.0), r"ki = 0.0; expected not zero"),
        (lambda: Linear(1.0, std={"ks": -1.0}), r"ks_std = -1.0"),
        (lambda: Flux(0.0), r"area = 0.0"),
        (lambda: Flux(1e-4, poles=0), r"poles = 0"),
        (lambda: MAGNET.force([0.0, 2.6], 0.0), r"current 2.6 A at sample 1, 1 such in all; "),
        (lambda: MAGNET.force(0.0, 5e-4), r"position 0.0005 m, .* less than the gap"),
        (lambda: SINGLE.force(-1.0, -5e-4), r"position -0.0005 m, .* less than the gap"),
        (lambda: MAGNET.force(0.0, -5e-4), r"position -0.0005 m, .* less than the gap"),
        (lambda: MAGNET.force(np.nan, 0.0), r"current nan A"),
    ],
)
def test_bad_constants_and_states_are_refused(build, message):
    with pytest.raises(InputError, match=message):
        build()


@given(st.floats(-2.4, 2.4), st.floats(-3.9e-4, 3.9e-4))
def test_opposed_magnets_are_odd(current, position):
    """Turned around, the pair pulls the other way."""
    ahead, behind = MAGNET.force(current, position), MAGNET.force(-current, -position)
    assert ahead == pytest.approx(-behind, rel=1e-12)


def test_iron_is_wider_gaps_and_saturation_bounds_the_force():
    law = Differential(K=1e-5, bias=2.0, gap=4e-4)
    i, x = np.array([0.3, -1.2]), np.array([2e-5, -9e-5])
    iron, wider = replace(law, iron=3e-5), replace(law, gap=4.3e-4)
    np.testing.assert_allclose(iron.force(i, x), wider.force(i, x), rtol=1e-14)
    saturated = replace(law, saturation=6000.0)
    assert saturated.force(1.99, 0.0) < 1e-5 * 6000.0**2
    ahead, behind = saturated.fluxes(0.5, 0.0)
    b = 2.5 / 4e-4
    assert ahead == pytest.approx(b / (1 + (b / 6000.0) ** 4) ** 0.25)
    assert saturated.force(0.5, 0.0) == pytest.approx(1e-5 * (ahead**2 - behind**2))


def test_flux_and_current_laws_agree():
    rng = np.random.default_rng(1)
    current, position = rng.uniform(-2, 2, 50), rng.uniform(-3e-4, 3e-4, 50)
    law = Flux(area=2e-4, poles=2, angle=MAGNET.angle)
    found = law.force(*law.densities(MAGNET, current, position))
    np.testing.assert_allclose(found, MAGNET.force(current, position), rtol=1e-12, atol=1e-10)


# Constants of force laws as they stand in files.


ENTRY = {"law": "differential", "K": "5e-6 N m^2/A^2", "bias": "2 A", "gap": "0.4 mm"}


def test_exact_known_and_unknown_constants():
    bias = {"value": "2 A", "std": "50 mA", "shared": "supply"}
    entry = LawEntry(**ENTRY | {"bias": bias, "gap": {"start": "0.4 mm"}})
    law = entry.build()
    assert (law.bias, law.gap) == (2.0, 4e-4)
    assert law.std == {"bias": 0.05, "gap": np.inf}
    assert set(entry.uncertain) == {"bias", "gap"}
    assert law.shared == {"bias": "supply"}


def test_an_area_is_a_constant_of_either_law():
    area = {"value": "4 cm^2", "std": "0.1 cm^2", "shared": "poles"}
    horseshoe = LawEntry(law="differential", area=area, turns=200, bias="2 A", gap="0.4 mm")
    law = horseshoe.build()
    assert law.shared == {"K": "poles"}
    assert law.std["K"] == pytest.approx(0.025 * law.K)
    assert LawEntry(law="flux", area=area).build().shared == {"area": "poles"}


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({**ENTRY, "gap": {"value": "1 mm"}}, r"the keys value; expected value and std, or start"),
        ({**ENTRY, "gap": {"start": "1 mm", "shared": 3}}, r"the keys shared, start"),
        ({"law": "linear", "ki": {"start": "1 N/A"}}, r'ki: found .*gains = \["ki"\]'),
        (
            {"law": "linear", "ki": {"value": "1 N/A", "std": "0.1 N/A", "shared": "a"}},
            r"an unknown or shared ki",
        ),
    ],
)
def test_refuses(entry, message):
    with pytest.raises(ValueError, match=message):
        LawEntry(**entry).build()


# Forces read from currents: held or not, delayed, through any law, on the lines that count.


RATE, F0, PERIODS = 10_000.0, 20.0, 3
SIZE = int(RATE / F0)
LINES = np.array([1, 3, 5, 7, 9, 11, 30])
LINEAR = Linear(ki=120.0, ks=2e5)
STEPS = 200  # of a fine grid within a sample


def through(law, current: str = "i", place: str = "x") -> dict[str, ForceReading]:
    return {"F": ForceReading(law, (current,), {place: 1.0})}


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


@pytest.mark.parametrize("law", [LINEAR, BIASED])
@pytest.mark.parametrize("delay", [0.0, -50e-6, -130e-6, 30e-6])
def test_lines_of_a_held_current(law, delay):
    """A command leads: it flows -delay after its sample, for one sample period."""
    record = recorded(True, delay, 20e-6)
    read = average(forces(record, through(law), period=SIZE), F0, harmonics=LINES)
    truth, found = lines_of_truth(law, held_from=-delay), read.spectra[..., read.index("F")]
    np.testing.assert_allclose(found, [truth] * PERIODS, atol=2e-6 * np.abs(truth).max())


@pytest.mark.parametrize("law", [LINEAR, BIASED])
@pytest.mark.parametrize("delays", [(0.0, 0.0), (37e-6, 0.0), (0.0, -20e-6), (50e-6, 50e-6)])
def test_samples_of_a_measured_current(law, delays):
    record = forces(recorded(False, *delays), through(law), period=SIZE)
    time = np.arange(PERIODS * SIZE) / RATE
    truth = law.force(current(time), position(time))
    np.testing.assert_allclose(record.column("F"), truth, atol=1e-8 * np.abs(truth).max())


def test_channels_used_up_are_replaced_and_others_kept():
    record = forces(recorded(True, 0.0, 0.0), through(LINEAR))
    assert record.names == ("F", "x", "other")
    force = record.channels[0]
    assert (force.unit, force.hold, force.delay) == ("N", False, 0.0)
    assert record.speed == 3.0


def test_drives_are_laws_of_their_own():
    record = recorded(True, -50e-6, 0.0)
    drive = Drive(LINEAR.ki, LINEAR.ks, {"x": 1.0})
    channels = (Channel("F", "A", hold=True, delay=-50e-6, drive=drive), *record.channels[1:])
    driven = Record(channels, record.samples, RATE)
    by_law = forces(record, through(LINEAR))
    np.testing.assert_array_equal(forces(driven).samples, by_law.samples)
    np.testing.assert_array_equal(forces(driven, drives=False).samples, driven.samples)


def test_flux_densities():
    time = np.arange(PERIODS * SIZE) / RATE
    law = Flux(area=2e-4, poles=2, angle=BIASED.angle)
    pair = law.densities(BIASED, current(time), position(time))
    record = Record([Channel("b1", "T"), Channel("b2", "T")], np.stack(pair, axis=1), RATE)
    found = forces(record, {"F": ForceReading(law, ("b1", "b2"))})
    assert found.names == ("F",)
    truth = BIASED.force(current(time), position(time))
    np.testing.assert_allclose(found.column("F"), truth, rtol=1e-9, atol=1e-9)


def test_constants_of_the_law_give_the_gain_its_deviation():
    law = Linear(ki=120.0, std={"ki": 1.2})
    record = forces(recorded(False, 0.0, 0.0), {"F": ForceReading(law, ("i",))})
    assert record.channels[0].gain_std == pytest.approx(0.01)
    through = {"i": ForceReading(law, ("i",))}
    for currents in (True, False):
        record = through_laws(recorded(False, 0.0, 0.0), through, currents=currents)
        assert record.channels[0].gain_std == pytest.approx(0.01)


def test_displacement_as_a_combination_of_sensors():
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
    ("law", "current", "place", "message"),
    [
        (Differential(1e-6, 2.0, 3e-5), "i", "x", "run.h5: F: .* less than the gap of 3e-05 m"),
        (LINEAR, "j", "x", "no channel 'j'"),
        (LINEAR, "i", "z", "no channel 'z'"),
    ],
)
def test_bad_readings_are_refused(law, current, place, message):
    with pytest.raises(InputError, match=message):
        forces(recorded(False, 0.0, 0.0), through(law, current, place))


# Laws kept with the forces that they read: inverted, and followed with other constants.


TURN = np.linspace(0, 6 * np.pi, 200)
CURRENT, POSITION = 1.2 * np.cos(TURN), 8e-5 * np.sin(TURN / 3 + 0.4)


def test_the_current_is_found_again():
    found = WITH_IRON.flowing(WITH_IRON.force(CURRENT, POSITION), POSITION)
    np.testing.assert_allclose(found, CURRENT, atol=1e-12)


@pytest.mark.parametrize("saturation", [7000.0, np.inf])
def test_the_current_of_magnets_without_bias(saturation):
    """Their bias is no constant that could be another: it is known to be none."""
    law = replace(WITH_IRON, bias=0.0, bias_difference=0.0, saturation=saturation)
    found = law.flowing(law.force(CURRENT, POSITION), POSITION)
    np.testing.assert_allclose(found, CURRENT, atol=1e-9)
    assert set(law.constants) == {"K", "gap", "angle", "iron", "saturation"}


def test_what_no_current_gives_is_given_by_the_most():
    most = WITH_IRON.force(WITH_IRON.most, 0.0)
    found = WITH_IRON.flowing(np.array([2.0, -2.0]) * most, np.zeros(2))
    np.testing.assert_allclose(found, [WITH_IRON.most, -WITH_IRON.most])


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("K", 1e-7), ("bias", -0.1), ("gap", 2e-5), ("angle", 0.05),
        ("bias_difference", -0.08), ("iron", 5e-6), ("saturation", -500.0),
    ],
)  # fmt: skip
def test_another_constant_is_another_law(name, change):
    other = replace(WITH_IRON, **{name: getattr(WITH_IRON, name) + change})
    found = WITH_IRON.changed(CURRENT, POSITION, {name: change})
    np.testing.assert_allclose(found, other.force(CURRENT, POSITION), rtol=1e-13)


def test_a_knee_is_a_saturation_counted_from_none():
    """b_s = 1.5 b_0 is (1 / 1.5)^4 of a knee, and the derivative at none is finite."""
    plain = replace(WITH_IRON, saturation=np.inf)
    saturated = replace(plain, saturation=1.5 * plain.bias / plain.gap)
    found = plain.changed(CURRENT, POSITION, {"knee": 1.5**-4})
    np.testing.assert_allclose(found, saturated.force(CURRENT, POSITION), rtol=1e-13)
    slope = plain.changed(CURRENT, POSITION, {"knee": 1e-30j}).imag / 1e-30
    step = plain.changed(CURRENT, POSITION, {"knee": 1e-6}) - plain.force(CURRENT, POSITION)
    np.testing.assert_allclose(slope, step / 1e-6, atol=1e-4 * np.abs(slope).max())


def test_flux_laws_scale():
    law = Flux(2e-4, 2, 0.3, std={"area": 2e-6}, shared={"area": "poles"})
    force = law.force(0.6, 0.5)
    assert law.flowing(force, np.zeros(1)) == force
    other = law.changed(force, np.zeros(1), {"area": 1e-5, "angle": -0.1})
    assert other == pytest.approx(Flux(2.1e-4, 2, 0.2).force(0.6, 0.5), rel=1e-14)
    assert law.constants["area"] == Constant("area", "m^2", 2e-4, 2e-6, True, "poles")
    assert not law.constants["angle"].std


def test_a_force_keeps_its_law():
    channels = [Channel("i", "A", gain_std=0.02), Channel("x", "m")]
    record = Record(channels, np.stack([CURRENT, POSITION], axis=1), 1e3)
    law = replace(WITH_IRON, shared={"gap": "bearings"})
    channel = forces(record, through(law)).channels[0]
    assert channel.law == replace(law, position={"x": 1.0})
    assert channel.gain_std == 0.02
