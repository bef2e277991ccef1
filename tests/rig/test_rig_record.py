"""What the logger writes says of itself what the reader needs: hold, delay, law, angle."""

from dataclasses import replace

import numpy as np
import pytest

from rotorid import average
from rotorid.force.laws import Flux
from rotorid.force.reading import forces
from rotorid.rig.logger import how_recorded
from rotorid.rig.parts import Encoder, FluxSensors, Keyphasor, Logger, Rotation, SensorRunout

LINES = [1, 3, 5, 7, 9, 11]
FINE = 40


def lines_of_truth(rig, run) -> np.ndarray:
    """Lines of the true forces of a linear rig, from a logger many times as fast, shape (line, j).

    The current of an amplifier without lag jumps when a command takes effect, which is when the
    fast logger samples; it is held in between. A lagging one is continuous.
    """
    rate = FINE / rig.controller.period
    fine = run(replace(rig, logger=Logger(rate, "measured")), 0.05).truth
    ki, ks = rig.parts[0].slopes
    frequency = 20.0 * np.array(LINES)
    current = np.fft.rfft(fine.current, axis=0, norm="forward")[LINES]
    if rig.parts[0].time_constant == 0:
        step = frequency / rate
        current *= (np.sinc(step) * np.exp(-1j * np.pi * step))[:, None]
    B = rig.model.require_linear().matrices(rig.parameters, rig.rotation.speed).B
    position = np.fft.rfft(fine.position @ B, axis=0, norm="forward")[LINES]
    return ki * current + ks * position


def lines_read(rig, run) -> np.ndarray:
    size = round(rig.logger.sample_rate / 20.0)
    record = forces(run(rig, 0.15), period=size)
    return average(record, 20.0, harmonics=LINES).mean_spectrum[:, :4]


EXACT = [
    {"logger": Logger(10e3, "command"), "delay": 50e-6},
    {"logger": Logger(10e3, "command"), "delay": 0.0},
    {"logger": Logger(10e3, "command"), "delay": 150e-6},
    {"logger": Logger(20e3, "command"), "delay": 50e-6},
    {"logger": Logger(10e3, "measured"), "delay": 50e-6},
    {"logger": Logger(10e3, "measured"), "delay": 0.0},
    {"logger": Logger(10e3, "measured"), "delay": 125e-6},
    {"logger": Logger(20e3, "measured"), "delay": 50e-6},
    {"logger": Logger(20e3, "measured"), "delay": 75e-6},
]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("clocks", EXACT)
def test_a_held_column_gives_the_lines_of_the_force(quiet, run, clocks) -> None:
    rig = replace(quiet, settling=3.0, **clocks)
    assert how_recorded(rig, rig.parts[0])[0]
    truth = lines_of_truth(rig, run)
    np.testing.assert_allclose(lines_read(rig, run), truth, atol=4e-6 * np.abs(truth).max())


NEAR = [
    # A lagging current is no hold: its samples see its images, 0.2 % at 220 Hz.
    ({"logger": Logger(10e3, "measured"), "delay": 50e-6}, 2000.0, 2.5e-3),
    ({"logger": Logger(10e3, "measured"), "delay": 0.0}, 2000.0, 2.5e-3),
    ({"logger": Logger(30e3, "measured"), "delay": 50e-6}, 2000.0, 1e-3),
    # A command for a current that lags: the lag is taken for a delay.
    ({"logger": Logger(10e3, "command"), "delay": 50e-6}, 5000.0, 2e-3),
    # Clocks that do not fit: the hold is taken for half a period of delay.
    ({"logger": Logger(5e3, "command"), "delay": 50e-6}, None, 2e-3),
    ({"logger": Logger(15e3, "command"), "delay": 50e-6}, None, 2e-3),
    ({"logger": Logger(15e3, "measured"), "delay": 50e-6}, None, 2e-3),
]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("clocks", "bandwidth", "accuracy"), NEAR)
def test_other_columns_give_it_nearly(quiet, change, run, clocks, bandwidth, accuracy) -> None:
    rig = replace(change(quiet, bandwidth=bandwidth), settling=3.0, **clocks)
    truth = lines_of_truth(rig, run)
    error = np.abs(lines_read(rig, run) - truth).max(axis=0) / np.abs(truth).max(axis=0)
    assert error.max() < accuracy
    if how_recorded(rig, rig.parts[0]) == (False, 0.0):
        return
    bare = run(rig, 0.15)
    bare = replace(bare, channels=tuple(replace(c, hold=False, delay=0.0) for c in bare.channels))
    size = round(rig.logger.sample_rate / 20.0)
    raw = average(forces(bare, period=size), 20.0, harmonics=LINES).mean_spectrum[:, :4]
    assert np.abs(raw - truth).max() > 2 * np.abs(lines_read(rig, run) - truth).max()


def test_channels_of_a_force_rig(quiet, change, run) -> None:
    gains = quiet.parts[0].slopes[0]
    controller = replace(
        quiet.controller, C=gains * quiet.controller.C, D=gains * quiet.controller.D
    )
    direct = replace(change(quiet, law=None, limit=np.inf), controller=controller)
    record = run(direct, 0.01)
    first = record.channels[0]
    assert (first.name, first.unit, first.hold, first.delay) == ("F_x1", "N", True, -50e-6)
    assert record.names == (*quiet.model.inputs, *quiet.model.coordinates)
    np.testing.assert_array_equal(record.truth.force, record.truth.current)


def test_channels_of_a_linear_rig_hold_currents(quiet, run) -> None:
    record = run(quiet, 0.01)
    first = record.channels[0]
    assert (first.unit, first.drive.ki, first.drive.ks) == ("A", 120.0, 2e5)
    assert dict(first.drive.position) == {"x1": 1.0}
    assert record.columns[0].name == "i_x1"
    assert record.truth.parameters["L1"] == 0.3


def test_noise_of_the_recording_is_not_in_the_rotor(quiet, change, run) -> None:
    noisy, clean = run(change(quiet, noise=0.01), 0.2), run(quiet, 0.2)
    np.testing.assert_array_equal(noisy.truth.position, clean.truth.position)
    error = noisy.samples[:, :4] - clean.samples[:, :4]
    np.testing.assert_allclose(error.std(axis=0), 0.01, rtol=0.05)


@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_flux_gives_the_force_at_the_sample(magnetic, change, run, angle: float) -> None:
    law = replace(magnetic.parts[0].law, angle=angle)
    sensors = FluxSensors(Flux(area=2e-4, poles=2, angle=angle), noise=0.0)
    rig = change(magnetic, law=law, flux=sensors, bandwidth=3000.0)
    record = run(replace(rig, logger=Logger(10e3, "measured"), settling=0.1), 0.1)
    force = np.stack([record.column(name) for name in rig.model.inputs], axis=1)
    scale = np.abs(record.truth.force).max()
    np.testing.assert_allclose(force, record.truth.force, atol=1e-9 * scale)
    assert {"b1_x1", "b2_x1", "i_x1"} <= {column.name for column in record.columns}


def test_noise_of_flux_sensors_is_in_the_force(magnetic, change, run) -> None:
    sensors = FluxSensors(Flux(area=2e-4), noise=1e-3)
    rig = replace(change(magnetic, flux=sensors), settling=0.1)
    record = run(rig, 0.2)
    column = next(c for c in record.columns if c.name == "b1_x1").samples
    clean = next(
        c
        for c in run(change(rig, flux=replace(sensors, noise=0.0)), 0.2).columns
        if c.name == "b1_x1"
    ).samples
    assert (column - clean).std() == pytest.approx(1e-3, rel=0.05)


def test_sensors_off_plane_with_runout_bias_and_steps(quiet, run) -> None:
    x2 = replace(
        quiet.sensors[2],
        name="s",
        reads={"x2": 1.0, "theta_y": -0.02},
        bias=3e-6,
        runout=(SensorRunout(1, 5e-6, 2e-6), SensorRunout(2, 0.0, 1e-6)),
    )
    rough = replace(quiet.sensors[3], quantum=1e-6)
    sensors = (*quiet.sensors[:2], x2, rough, *quiet.sensors[4:])
    record = run(replace(quiet, sensors=sensors, settling=0.1), 0.05)
    truth = record.truth
    phi = truth.angle
    expected = truth.position[:, 2] - 0.02 * truth.position[:, 5] + 3e-6
    expected += 5e-6 * np.cos(phi) + 2e-6 * np.sin(phi) + 1e-6 * np.sin(2 * phi)
    np.testing.assert_allclose(record.column("s"), expected, atol=1e-15)
    assert dict(record.channels[6].reads) == {"x2": 1.0, "theta_y": -0.02}
    steps = record.column("y2") / 1e-6
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    assert np.abs(record.column("y2") - truth.position[:, 3]).max() <= 0.5e-6 + 1e-12


def test_the_controller_sees_what_the_sensors_read(quiet, run) -> None:
    """A bias moves the rotor by as much, once the integral has worked it out."""
    biased = (replace(quiet.sensors[0], bias=10e-6), *quiet.sensors[1:])
    moved = run(replace(quiet, sensors=biased, settling=3.0), 0.1).truth.position
    assert moved[:, 0].mean() == pytest.approx(-10e-6, rel=1e-6)


TURNING = [
    Rotation(speed=880.0, phase=0.5),
    Rotation(speed=880.0, acceleration=5.0, phase=-2.0),
    Rotation(speed=880.0, drift=2.0, drift_period=0.5),
]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("turning", TURNING)
@pytest.mark.parametrize("mark", [Encoder(1024), Keyphasor(), None])
def test_the_angle_is_measured(quiet, run, turning: Rotation, mark) -> None:
    rig = replace(quiet, rotation=turning, logger=Logger(10e3, angle=mark), settling=0.05)
    record = run(rig, 0.5)
    off = np.angle(np.exp(1j * (record.rotor_angle() - record.truth.angle)))
    assert np.abs(off).max() < (2 * np.pi / 1024 if isinstance(mark, Encoder) else 2e-3)
    assert abs(off.mean()) < 2e-4
    assert record.speed == pytest.approx(record.truth.speed.mean(), rel=2e-4)


def test_marks_that_cannot_be_seen_are_refused(quiet, run) -> None:
    thin = replace(quiet, logger=Logger(10e3, angle=Keyphasor(width=0.01)))
    with pytest.raises(ValueError, match=r"pulses of 0.714 samples; expected four or more"):
        run(thin, 0.05)
    still = replace(quiet, rotation=Rotation(), logger=Logger(10e3, angle=Keyphasor()))
    with pytest.raises(ValueError, match="a keyphasor at 0 rad/s"):
        run(still, 0.05)
