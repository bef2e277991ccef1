"""Dynamics of channels: known, known with a deviation, unknown; first and second order, eddy."""

from dataclasses import replace

import numpy as np
import pytest

from rotorid import Channel, InputError, MaximumLikelihood, identify
from rotorid.force.channel_dynamics import (
    UNKNOWN,
    Constant,
    EddyCurrents,
    FirstOrder,
    Measured,
    SecondOrder,
)

BANDWIDTH = Constant("bandwidth", "Hz", 1500.0)
KINDS = {
    "first order": FirstOrder(bandwidth=BANDWIDTH),
    "second order": SecondOrder(bandwidth=BANDWIDTH, damping=Constant("damping", "1", 0.7)),
    "eddy currents": EddyCurrents(eddy=Constant("eddy", "s", 3e-5)),
}


@pytest.mark.parametrize("name", KINDS)
def test_slopes_are_those_of_the_logarithm(name):
    dynamics, omega = KINDS[name], 2 * np.pi * np.array([1.0, 50.0, 900.0])
    values, step = dynamics.values, 1e-5
    for j in range(len(values)):
        moved = np.ones(len(values))
        moved[j] += step
        up, down = (
            np.log(dynamics.response(omega, values * factor)) for factor in (moved, 2 - moved)
        )
        found = dynamics.slopes(omega, values)[:, j]
        np.testing.assert_allclose(found, (up - down) / (2 * step * values[j]), rtol=1e-7)


@pytest.mark.parametrize("name", KINDS)
def test_half_power_and_limits(name):
    dynamics = KINDS[name]
    assert abs(dynamics.response(np.array([1e-12]), dynamics.values)[0] - 1) < 1e-6
    at = 2 * np.pi * np.array([1500.0])
    wanted = {"first order": 1 / (1 + 1j), "second order": 1 / 1.4j}
    if name in wanted:
        assert dynamics.response(at, dynamics.values)[0] == pytest.approx(wanted[name])


def passed_through(record, dynamics, names):
    """Return a record whose channels went through dynamics that nobody corrected."""
    gain = dynamics.response(record.omega, dynamics.values)
    factor = np.ones((len(gain), len(record.channels)), dtype=complex)
    for name in names:
        factor[:, record.index(name)] = 1 / gain if dynamics.actuator else gain
    return replace(record, spectra=record.spectra * factor)


def with_dynamics(record, dynamics, names):
    channels = [replace(c, dynamics=dynamics) if c.name in names else c for c in record.channels]
    corrected = dynamics.correction(record.omega)
    factor = np.ones((len(corrected), len(record.channels)), dtype=complex)
    for name in names:
        factor[:, record.index(name)] = corrected
    return replace(record, channels=tuple(channels), spectra=record.spectra * factor)


@pytest.mark.parametrize("actuator", [True, False])
@pytest.mark.parametrize("name", KINDS)
def test_an_unknown_constant_that_channels_share_is_found(demo, bearings, name, actuator):
    """The amplifiers of all inputs, or the filters of all sensors, start 20 % off."""
    truth = replace(KINDS[name], actuator=actuator, shared="loop")
    names = demo.model.inputs if actuator else bearings
    record = passed_through(demo.record(bearings), truth, names)
    guessed = replace(
        truth,
        **{c.name: replace(c, value=1.2 * c.value, std=UNKNOWN) for c in truth.constants},
    )
    estimator = MaximumLikelihood(
        fixed={"L1": 0.3}, start=demo.start(np.random.default_rng(3), 0.1)
    )
    estimate = identify(demo.model, with_dynamics(record, guessed, names), estimator)
    found = {v.name: v.value for v in estimate.nuisance}
    assert list(found) == [f"{c.name}[loop]" for c in truth.constants]
    for constant in truth.constants:
        assert found[f"{constant.name}[loop]"] == pytest.approx(constant.value, rel=1e-6)
    assert estimate.value("m2") == pytest.approx(demo.truth["m2"], rel=1e-7)


def test_a_bandwidth_known_with_a_deviation_is_drawn_to_its_prior(demo, bearings):
    rng = np.random.default_rng(5)
    given = FirstOrder(bandwidth=replace(BANDWIDTH, std=1e-3), actuator=True)
    record = demo.noisy(demo.record(bearings), rng)
    record = passed_through(record, KINDS["first order"], ["F_x1"])
    record = with_dynamics(record, given, ["F_x1"])
    estimate = identify(demo.model, record, MaximumLikelihood(fixed={"L1": 0.3}))
    (value,) = estimate.nuisance
    assert value.name == "bandwidth[F_x1]"
    assert value.value == pytest.approx(1500.0, abs=4e-3)
    assert value.std == pytest.approx(1e-3, rel=1e-3)


def test_a_measured_response_is_linear_in_amplitude_and_phase():
    table = Measured(frequency=[0.0, 100.0], measured=[1.0, 0.5j])
    middle = table.response(np.array([2 * np.pi * 50.0]), table.values)[0]
    assert middle == pytest.approx(0.75 * np.exp(0.25j * np.pi))
    with pytest.raises(InputError, match=r"a line at 101 Hz.*0 to 100 Hz"):
        table.response(np.array([2 * np.pi * 101.0]), table.values)
    with pytest.raises(InputError, match="sort the table"):
        Measured(frequency=[1.0, 1.0], measured=[1.0, 1.0])
    with pytest.raises(InputError, match="leave such points out"):
        Measured(frequency=[1.0, 2.0], measured=[1.0, 0.0])
    assert table == Measured(frequency=[0.0, 100.0], measured=[1.0, 0.5j])


def test_constants_are_positive():
    with pytest.raises(InputError, match="more than 0"):
        Constant("bandwidth", "Hz", 0.0)


def test_channels_carry_their_dynamics():
    assert Channel("x").dynamics is None
