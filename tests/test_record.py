"""Records, and what their channels are to a model."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from working_folder import shaken

import rotorid as rid
from rotorid import Channel, InputError, PeriodicRecord, Record, average
from rotorid.answer.identify import by_name
from rotorid.core.linalg import SENSORS, sensor_rank
from rotorid.data.lines import SampledClock
from rotorid.data.record import Steady, changed, unread
from rotorid.signals.checks.rotation import synchronism
from rotorid.testing import bind

# Records: what they accept, and what they derive.


TWO = (Channel("a", "N"), Channel("b", "m"))


@settings(max_examples=50, deadline=None)
@given(arrays(float, (7, 2), elements=st.floats(-1e99, 1e99)), st.floats(1e-6, 1e9))
def test_samples_are_kept_as_they_are(samples, rate):
    record = Record(list(TWO), samples.tolist(), rate)
    assert record.channels == TWO
    np.testing.assert_array_equal(record.column("a"), samples[:, 0])
    np.testing.assert_array_equal(record.column("b"), samples[:, 1])
    assert record.names == ("a", "b")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"channels": (TWO[0], TWO[0])}, "channel 'a' twice"),
        ({"samples": np.zeros(4)}, r"samples of shape \(4,\); expected \(sample, channel\)"),
        ({"samples": np.zeros((4, 3))}, r"samples of shape \(4, 3\).*with 2 channels"),
        ({"samples": np.array([[0, 1], [0, np.nan]])}, "nan in sample 1 of channel 'b', 1 in all"),
        ({"samples": np.array([[np.inf, 1], [0, 1]])}, "inf in sample 0 of channel 'a'"),
        # Squares of larger numbers would overflow.
        ({"samples": [[1.0, 2.0], [2e100, 1.0]]}, r"2e\+100 in sample 1 of channel 'a', 1 in all"),
        ({"sample_rate": 0.0}, "sample rate 0.0"),
        ({"sample_rate": np.nan}, "sample rate nan"),
        ({"sample_rate": np.inf}, "sample rate inf"),
        ({"speed": np.nan}, "speed nan"),
        ({"angle": np.zeros(3)}, r"angle of shape \(3,\); expected \(2,\)"),
        ({"angle": np.array([0.0, np.nan])}, "an angle that is not finite"),
    ],
)
def test_refusals(options, message):
    given_ = {"channels": TWO, "samples": np.zeros((2, 2)), "sample_rate": 10.0, **options}
    with pytest.raises(InputError, match=f"^run.csv: found {message}"):
        Record(**given_, source="run.csv")


def test_a_channel_that_is_not_there():
    record = Record(TWO, np.zeros((4, 2)), 10.0)
    with pytest.raises(InputError, match="found no channel 'c'; expected one of a, b"):
        record.column("c")
    periodic = average(record, period_samples=2, harmonics=[0])
    assert periodic.index("b") == 1
    with pytest.raises(InputError, match="found no channel 'c'"):
        periodic.index("c")


def test_the_angle_of_the_rotor():
    record = Record(TWO, np.zeros((5, 2)), 10.0, speed=3.0)
    np.testing.assert_allclose(record.rotor_angle(), [0, 0.3, 0.6, 0.9, 1.2])
    measured = np.array([5.0, 6.0, 8.0, 9.0, 9.5])
    record = Record(TWO, np.zeros((5, 2)), 10.0, speed=3.0, angle=measured)
    np.testing.assert_array_equal(record.rotor_angle(), measured)


def test_what_a_channel_reads():
    assert Channel("x1").combination == {"x1": 1.0}
    assert Channel("s", reads={"x1": 1.0, "t": -0.2}).combination == {"x1": 1.0, "t": -0.2}


@settings(max_examples=30, deadline=None)
@given(st.integers(2, 30), st.integers(2, 9))
def test_frequencies_and_weights_of_lines(samples, periods):
    data = np.random.default_rng(samples).standard_normal((samples * periods, 2))
    every = range(samples // 2 + 1)
    periodic = average(Record(TWO, data, 50.0), period_samples=samples, harmonics=every)
    assert isinstance(periodic, PeriodicRecord)
    assert periodic.fundamental == 50.0 / samples
    np.testing.assert_allclose(periodic.frequency, np.fft.rfftfreq(samples, 1 / 50.0))
    # x = sum c_k Re(X_k exp(i omega_k t)), as the docstring says
    t = np.arange(samples) / 50.0
    waves = np.exp(1j * np.outer(t, periodic.omega)) * periodic.multiplicity
    np.testing.assert_allclose((waves @ periodic.mean_spectrum).real, periodic.mean, atol=1e-12)


def _twice() -> tuple[rid.Record, rid.Record]:
    samples = np.random.default_rng(3).standard_normal((400, 12))
    channels = [rid.Channel(f"a_rather_long_name_{k}", "m") for k in range(12)]
    one, two = (rid.Record(channels, samples.copy(), 100.0, source="run.csv") for _ in range(2))
    return one, two


@pytest.mark.parametrize("kind", ["record", "periods", "lines"])
def test_values_compare_by_content_are_read_only_and_fit_a_screen(kind):
    one, two = _twice()
    if kind != "record":
        cut = {"band": ("2 Hz", "20 Hz"), "skip": "0.5 s"}
        one, two = (rid.average(r, "2 Hz", **cut) for r in (one, two))
    if kind == "lines":
        one, two = (rid.Lines.of_periods(p) for p in (one, two))
    assert one == two
    assert one != replace(two, source="other.csv")
    array = {"record": "samples", "periods": "spectra", "lines": "mean"}[kind]
    changed = getattr(two, array).copy()
    changed[0, 0] += 1.0
    assert one != replace(two, **{array: changed})
    with pytest.raises(ValueError, match="read-only"):
        getattr(one, array)[0, 0] = 0.0
    assert len(repr(one)) < 1000


def test_records_and_periods_draw_themselves():
    one, _ = _twice()
    assert len(one.plot().axes) >= 12
    assert len(rid.average(one, 2.0, harmonics=[1]).plot().axes) >= 12


# Times and angles are made when they are first read.

WAVE = np.random.default_rng(3).standard_normal((200, 1))


def periods_at(speed, start=0.0, angle=None):
    record = Record([Channel("x", "m")], WAVE, 100.0, speed=speed, angle=angle)
    record = record if not start else replace(record, start=start)
    return average(record, 10.0, harmonics=[1, 2, 4], skip=0.25)


def test_nothing_is_made_before_it_is_read():
    periods = periods_at(30.0)
    clock = SampledClock.of(changed(periods, warnings=("w",)))
    assert (periods.begin, periods.middle) == pytest.approx((0.25, 1.095))
    assert isinstance(unread(periods, "time"), Steady)
    assert isinstance(unread(clock, "angle"), Steady)
    np.testing.assert_allclose(clock.period, 0.25 + np.arange(10) / 100)
    assert isinstance(unread(clock, "time"), Steady)
    np.testing.assert_allclose(periods.time, 0.25 + np.arange(170).reshape(17, 10) / 100)
    np.testing.assert_allclose(periods.angle, 30.0 * periods.time)
    assert periods.time is periods.time
    assert (periods.begin, periods.middle) == pytest.approx((0.25, 1.095))
    with pytest.raises(ValueError, match="read-only"):
        periods.time[0, 0] = 1.0
    assert periods == periods_at(30.0) == pickle.loads(pickle.dumps(periods))
    assert periods != periods_at(31.0)


@pytest.mark.parametrize("speed", [20 * np.pi, 20.5 * np.pi, 30.0])
def test_a_steady_angle_says_what_the_same_angle_measured_says(speed):
    steady = periods_at(speed)
    measured = periods_at(speed, angle=speed * np.arange(200) / 100)
    assert isinstance(unread(steady, "angle"), Steady)
    assert not isinstance(unread(measured, "angle"), Steady)
    ours, theirs = synchronism(steady), synchronism(measured)
    np.testing.assert_allclose(ours.leakage, theirs.leakage, atol=1e-12)
    for name in ("turns", "slip", "drift", "loss"):
        assert getattr(ours, name) == pytest.approx(getattr(theirs, name), abs=1e-9)
    grids = [SampledClock.of(p).grid(timed=False) for p in (steady, measured)]
    assert len(grids[0][0]) == len(grids[1][0]) == (1 if speed == 20 * np.pi else 17)
    np.testing.assert_allclose(grids[0][1], grids[1][1], rtol=1e-12)
    np.testing.assert_allclose(SampledClock.of(steady).at_speed(7.0).angle, 7.0 * steady.time)


# A record meets a model once: what every channel is, for every method.


MODEL = rid.load_model("jeffcott")
METHODS = ("ls", "batch", "sequential", "ml")


def periods(sensors, extra=()):
    """Return noisy periods of the shipped rotor with some sensors and further channels."""
    record = shaken(speed=40 * np.pi, noise=0.1)
    columns = [record.column("F_x"), record.column("F_y")]
    channels = list(record.channels[:2])
    for name, reads in sensors.items():
        columns.append(sum(c * record.column(q) for q, c in reads.items()))
        channels.append(rid.Channel(name, "m", reads=reads))
    for name in extra:
        columns.append(20.0 + np.random.default_rng(5).standard_normal(len(columns[0])))
        channels.append(rid.Channel(name, "K"))
    whole = replace(record, channels=tuple(channels), samples=np.column_stack(columns))
    return rid.average(whole, 10.0, harmonics=[1, 2, 5])


def test_sensors_that_read_the_same_hide_a_coordinate_from_every_method():
    same = periods({"a": {"x": 1.0}, "b": {"x": 1.0, "y": 1e-12}})
    assert bind(MODEL, same).hidden == ("y",)
    for method in ("ls", "batch", "sequential"):
        with pytest.raises(rid.InputError, match="no sensor of y"):
            by_name(method).estimate(MODEL, [same])
    with pytest.raises(rid.InputError, match="copied, a, b"):  # before any method
        rid.identify(MODEL, same, "ml")
    estimate = by_name("ml").estimate(MODEL, [same])
    assert estimate.value("m") == pytest.approx(MODEL.nominal["m"], rel=0.01)
    assert bind(MODEL, periods({"a": {"x": 1.0}, "b": {"x": 1.0, "y": 1e-3}})).hidden == ()


def test_the_tolerance_of_sensors():
    assert sensor_rank(np.array([[1.0, 0.0], [1.0, 10 * SENSORS]])) == 2
    assert sensor_rank(np.array([[1.0, 0.0], [1.0, SENSORS / 10]])) == 1


@pytest.mark.parametrize("method", METHODS)
def test_a_channel_that_is_nothing_of_the_model_is_refused_by_every_method(method):
    warm = periods({"x": {"x": 1.0}, "y": {"y": 1.0}}, extra=["temperature"])
    with pytest.raises(rid.InputError, match="a channel that reads 'temperature'"):
        rid.identify(MODEL, warm, method)
