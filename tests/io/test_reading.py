"""Reading a record: columns, clocks, blocks."""

from dataclasses import replace
from pathlib import Path

import h5py
import io_writers
import numpy as np
import pytest
import scipy.io

import rotorid as rid
from rotorid import InputError, ReadError
from rotorid.io import columns as blocks
from rotorid.io.clock import (
    BEARABLE,
    EARLY,
    LATE,
    NEGLIGIBLE,
    SAME_RATE,
    error_as_they_are,
    interpolation_error,
    onto_grid,
    read_clock,
)
from rotorid.io.columns import open_blocks
from rotorid.signals.average import PeriodSums, average_blocks
from rotorid.testing import Source

# From files to records in SI units.


T = np.arange(8) / 1000.0
X = np.array([1.0, -2.0, 3.0, -4.0, 5.0, -6.0, 7.0, -8.0])


def write(folder: Path, name: str = "run.h5") -> Path:
    """Write t in s, x in um and f in N, and a scalar."""
    path = folder / name
    with h5py.File(path, "w") as data:
        for column, values, unit in (("t", T, "s"), ("x", X, "um"), ("f", 2 * X, "N")):
            data[column] = values
            data[column].attrs["units"] = unit
        data["half"] = 0.5
    return path


def test_channels_time_speed_and_phase(tmp_path):
    path = write(tmp_path, "run.hdf5")
    channels = {"F": Source("f", unit="N", expected="N"), "x": Source("x", unit="um")}
    record = rid.read_record(path, columns=channels, time="t", speed="8400 rpm", phase="90 deg")
    assert record.names == ("F", "x")
    assert [channel.unit for channel in record.channels] == ["N", "m"]
    np.testing.assert_allclose(record.samples, np.column_stack([2 * X, 1e-6 * X]), rtol=1e-15)
    assert record.sample_rate == pytest.approx(1000.0, rel=1e-12)
    assert record.speed == pytest.approx(2 * np.pi * 140)
    np.testing.assert_allclose(record.rotor_angle(), np.pi / 2 + record.speed * T)
    assert record.source == str(path)


def test_units_of_the_file(tmp_path):
    record = rid.read_record(write(tmp_path), sample_rate="1 kHz")
    assert record.names == ("f", "t", "x")
    assert [channel.unit for channel in record.channels] == ["N", "s", "m"]
    np.testing.assert_allclose(record.column("x"), 1e-6 * X)
    assert record.angle is None


def test_columns_of_another_length_are_left_out(tmp_path):
    path = tmp_path / "run.mat"
    scipy.io.savemat(path, {"x": X, "short": X[:3]})
    assert rid.read_record(path, sample_rate=1e3).names == ("x",)
    with pytest.raises(ReadError, match=r"channels.short.column: found 3 samples where .* have 8"):
        rid.read_record(path, sample_rate=1e3, columns=["x", "short"])


@pytest.mark.parametrize(("scale", "value"), [(0.5, 0.5), ("half", 0.5), (-2, -2.0)])
def test_scale(tmp_path, scale, value):
    """Value = column x scale, in unit: the unit of the column itself does not matter."""
    channels = {"F": Source("x", unit="kN", scale=scale)}
    record = rid.read_record(write(tmp_path), columns=channels, sample_rate=1e3)
    np.testing.assert_allclose(record.column("F"), 1e3 * value * X)
    assert record.channels[0].unit == "N"


def test_how_a_channel_was_recorded(tmp_path):
    source = Source("x", hold=True, delay=5e-5, gain_std=0.01, reads={"a": 2.0})
    record = rid.read_record(write(tmp_path), columns={"s": source}, sample_rate=1e3)
    (channel,) = record.channels
    assert (channel.hold, channel.delay, channel.gain_std) == (True, 5e-5, 0.01)
    assert channel.combination == {"a": 2.0}


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (Source("xx"), "channels.q.column: found no column 'xx'.*did you mean x"),
        (Source("x", unit="mm"), "channels.q.unit: found unit 'mm', where the file says 'um'"),
        (Source("x", expected="N"), "channels.q.unit: found unit 'um'; .* converts to N"),
        (Source("x", unit="V", scale=2, expected="m"), "found unit 'V'; .* converts to m"),
        (Source("x", scale=2, expected="m"), "channels.q.unit: found no unit"),
        (Source("x", unit="m", scale="gtau"), "channels.q.scale: found no scalar .* 'gtau'"),
    ],
)
def test_refused_channels(tmp_path, source, message):
    path = write(tmp_path)
    with pytest.raises(InputError, match=message) as caught:
        rid.read_record(path, columns={"q": source}, sample_rate=1e3)
    assert caught.value.file == str(path)


@pytest.mark.parametrize(
    ("unit", "time", "hertz"),
    [(" [ms]", "t", 500.0), ("", "t", 0.5), ("", Source("t", unit="us"), 5e5)],
)
def test_time_in_its_unit(unit, time, hertz, tmp_path):
    path = tmp_path / "RUN.CSV"
    path.write_text(f"t{unit},x\n0,1\n2,1\n4,1\n6,nan\n")
    until = 5 / (2 * hertz)
    record = rid.read_record(path, time=time, until=f"{until} s")
    assert record.sample_rate == pytest.approx(hertz)
    assert record.column("x").tolist() == [1, 1, 1]


def test_one_source_of_time(tmp_path):
    path = write(tmp_path)
    assert rid.read_record(path, sample_rate=1000.05, time="t").sample_rate == 1000.05
    for clock, message in (
        ({}, "one of sample_rate and time"),
        ({"sample_rate": 1.0, "time": "t"}, "1 Hz, where the time column says 1000 Hz"),
        ({"sample_rate": 1e6, "time": "t"}, r'if its times are in ms: .* unit = "ms"'),
        ({"time": "tt"}, "time: found no column 'tt'"),
        ({"time": "x"}, r"time.*found unit 'um'; expected .* converts to s"),
    ):
        with pytest.raises(InputError, match=message):
            rid.read_record(path, **clock)


@pytest.mark.parametrize(
    ("time", "message"),
    [
        ([0, 1, 2, 4, 5, 6], r"a step of 2 s after sample 2 \(t = 2 s\); expected steps of 1 s"),
        ([0, 1, 2, 5, 6, 7, 8, 10, 11], "2 such in all"),
        ([0, 1, 2, 2, 3, 4], "a step of 0 s after sample 2"),
        ([0, 1, 2, 1, 2, 3], "a step of -1 s after sample 2"),
        ([3, 2, 1, 0], "a step of -1 s after sample 0"),
        ([0, 0, 0], "a step of 0 s"),
        ([0, 1, np.nan, 3], "not finite"),
        ([0], "a single sample"),
    ],
)
def test_dropped_samples(time, message):
    with pytest.raises(ReadError, match=message):
        read_clock(np.array(time, dtype=float))


def test_samples_that_are_not_finite(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("x,y\n0,1\n2,nan\n4,1\n")
    with pytest.raises(InputError, match="found nan in sample 1 of channel 'y'") as caught:
        rid.read_record(path, sample_rate=1.0)
    assert caught.value.file == str(path)
    assert rid.read_record(path, sample_rate=1.0, columns=["x"]).names == ("x",)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("run.xls", b"PK\x03\x04", "found a zip archive.*, ending .xls; expected .* .csv, .txt"),
        ("run", b"x,y", "found text, no ending"),
        ("run.csv", b"", "an empty file"),
        ("run.csv", b"x,y\n", "no samples"),
    ],
)
def test_files_without_samples(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ReadError, match=message):
        rid.read_record(tmp_path / name, sample_rate=1.0)


def test_a_mask_leaves_out_periods(tmp_path):
    path = tmp_path / "run.csv"
    wave = np.cos(2 * np.pi * np.arange(50) / 10)
    mask = np.ones(50)
    wave[23], mask[23] = np.nan, 0.0
    path.write_text("x,ok\n" + "".join(f"{x},{m}\n" for x, m in zip(wave, mask, strict=True)))
    record = rid.read_record(path, columns=["x"], sample_rate=100.0, mask="ok")
    periods = rid.average(record, 10.0, harmonics=[1])
    assert periods.periods == 4
    assert periods.warnings == ("1 of 5 periods hold samples that are masked: left out",)
    np.testing.assert_allclose(periods.mean_spectrum, 0.5, rtol=1e-12)
    np.testing.assert_allclose(periods.time[2], 0.3 + np.arange(10) / 100)
    with pytest.raises(InputError, match="found nan in sample 23"):
        rid.read_record(path, columns=["x"], sample_rate=100.0)
    with pytest.raises(InputError, match="0 of 5 periods without a sample that the mask"):
        rid.average(replace(record, valid=np.zeros(50, dtype=bool)), 10.0, harmonics=[1])


@pytest.mark.parametrize("columns", [None, ["x"]])
def test_a_mask_of_another_length(columns, tmp_path):
    with h5py.File(tmp_path / "run.h5", "w") as data:
        data["x"], data["ok"] = np.ones(10), np.ones(8)
    with pytest.raises(ReadError, match="mask: found 8 samples where the channels have 10"):
        rid.read_record(tmp_path / "run.h5", columns=columns, sample_rate=1.0, mask="ok")


def test_several_files_of_one_clock(tmp_path):
    files = [tmp_path / "f.csv", tmp_path / "p.csv"]
    io_writers.write_table(files[0], "t,fx,z", T, X, 0 * X)
    io_writers.write_table(files[1], "px;z", 2 * X, X / X, separator=";")
    record = rid.read_record(files, columns={"F": "fx", "x": "px", "z": "p.csv:z"}, time="t")
    np.testing.assert_array_equal(record.samples, np.column_stack([X, 2 * X, np.ones(8)]))
    assert record.sample_rate == pytest.approx(1000.0)
    with pytest.raises(ReadError, match=r"'z' in f.csv and p.csv.*such as f.csv:z"):
        rid.read_record(files, columns=["z"], time="t")
    with pytest.raises(ReadError, match="no column 'fy'"):
        rid.read_record(files, columns=["fy"], time="t")
    files[1].write_text("px\n1\n2\n")
    with pytest.raises(ReadError, match=r"2 samples where others have 8; .* cut them alike"):
        rid.read_record(files, columns=["fx", "px"], time="t")


@pytest.mark.parametrize("size", [1e-162, 0.9e-60, 1.1e60, 1e308])
@pytest.mark.parametrize("defect", [False, True])
def test_samples_that_no_machine_has(size, defect, tmp_path):
    """Their squares leave what doubles hold: an answer of them would be no number."""
    path = tmp_path / "run.csv"
    gap = "nan" if defect else "0"
    path.write_text("x,F\n" + f"{gap},1\n" + "".join(f"{x / 8 * size},1\n" for x in X))
    with pytest.raises(InputError, match=r"channels\.x\.unit: found samples up to .*; .*1e-60"):
        rid.read_record(path, sample_rate=1000.0)
    scaled = {"x": Source("x", scale=1.0 / size), "F": Source("F")}
    assert rid.read_record(path, columns=scaled, sample_rate=1000.0, skip=0.001).samples.max() <= 1


@pytest.mark.parametrize("size", [1.1e-60, 0.9e60, 0.0])
def test_samples_that_some_machine_might_have(size, tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("x\n" + "".join(f"{x / 8 * size}\n" for x in X))
    record = rid.read_record(path, sample_rate=1000.0)
    assert np.abs(record.samples).max() == pytest.approx(size, rel=1e-12)


# Sample times: even, rounded, jittered, late, missing.


RNG = np.random.default_rng(11)
EVEN = np.arange(4000) / 1000.0
JITTER = EVEN + np.r_[0.0, RNG.uniform(-2e-4, 2e-4, 3998), 0.0]


def wave(time: np.ndarray, frequency: float = 20.0) -> np.ndarray:
    return np.cos(2 * np.pi * frequency * time + 0.3)


def recorded(path: Path, time: np.ndarray, values: np.ndarray) -> Path:
    io_writers.write_table(path, "t,x", time, values, fmt="%.12g")
    return path


def test_even_and_rounded_times_are_left_alone():
    for time in (EVEN, np.round(np.arange(4000) / 400.0, 3), 1.7e9 + EVEN, EVEN + 1e-9 * JITTER):
        assert read_clock(time).even
    assert read_clock(np.round(np.arange(4001) / 400.0, 3)).rate.hertz == pytest.approx(400.0)
    assert not read_clock(JITTER).even
    assert read_clock(JITTER).rate.hertz == pytest.approx(1000.0, rel=1e-12)


def test_times_whose_error_does_not_tell_are_left_alone(tmp_path):
    """What the samples of a wave are off, taken as they are, is at most a ten-thousandth."""
    step, few = 1e-3, NEGLIGIBLE * 1e-3 / np.pi
    for size, even in ((0.9 * few, True), (1.2 * few, False)):
        jitter = size * np.where(np.arange(4000) % 2, 1.0, -1.0)
        assert read_clock(EVEN + jitter).even == even
        near = wave(EVEN + jitter, 499.0) - wave(EVEN, 499.0)
        assert np.abs(near).max() == pytest.approx(2 * np.pi * 499 * size, rel=0.01)
    assert pytest.approx(1e-4) == np.pi * few / step  # at half the sample rate
    for size, told in ((0.9, 0), (1.1, 1)):
        furthest = size * NEGLIGIBLE / (2 * np.pi * 20.0)
        jitter = furthest * np.r_[0.0, np.tile([1.0, -1.0], 1999), 0.0]
        assert error_as_they_are(EVEN + jitter, 1000.0, 20.0) == pytest.approx(size * NEGLIGIBLE)
        path = recorded(tmp_path / "run.csv", EVEN + jitter, wave(EVEN))
        record = rid.read_record(path, columns=["x"], time="t", highest=20.0)
        assert len(record.warnings) == told
        assert (np.abs(record.column("x") - wave(EVEN)).max() < 1e-11) == (told == 0)
        assert len(rid.read_record(path, columns=["x"], time="t").warnings) == 1


def test_jittered_samples_come_onto_the_grid(tmp_path):
    path = recorded(tmp_path / "run.csv", JITTER, wave(JITTER))
    record = rid.read_record(path, columns=["x"], time="t", highest="20 Hz")
    assert np.abs(record.column("x") - wave(EVEN)).max() < 1e-6
    as_if_even = rid.read_record(path, columns=["x"], sample_rate=1000.0)
    assert np.abs(as_if_even.column("x") - wave(EVEN)).max() > 0.02
    (told,) = record.warnings
    assert "jitter by 0.0001 s (rms): samples interpolated to equal steps" in told
    assert "an error below 0.001 % at 20 Hz" in told


def test_a_clock_that_wanders_is_told_by_its_steps():
    """A clock that goes half a percent fast, then slow, is off by milliseconds, by no jitter."""
    wander = EVEN + 5e-3 * np.sin(2 * np.pi * EVEN / 4.0) / (2 * np.pi / 4.0)
    assert read_clock(wander).jitter == pytest.approx(5e-3 * 1e-3 / np.sqrt(2), rel=1e-3)
    assert read_clock(JITTER).jitter == pytest.approx(2e-4 / np.sqrt(3), rel=0.03)


def test_the_stated_error_is_the_error():
    """Also where it is large: two fifths of the sample rate."""
    for frequency in (100.0, 250.0, 400.0):
        found, error, _ = onto_grid(JITTER, wave(JITTER, frequency)[:, None], 1000.0, frequency)
        actual = np.sqrt(2 * np.mean((found[:, 0] - wave(EVEN, frequency)) ** 2))
        assert error == pytest.approx(actual, rel=0.25, abs=1e-10)


def test_where_the_lines_cannot_bear_it(tmp_path):
    path = recorded(tmp_path / "run.csv", JITTER, wave(JITTER))
    with pytest.raises(ReadError, match=r"off by 0.000114 s.*% at 480 Hz.*keep lines"):
        rid.read_record(path, columns=["x"], time="t", highest=480.0)
    (told,) = rid.read_record(path, columns=["x"], time="t").warnings
    highest = float(told.partition(" at ")[2].partition(" Hz")[0])
    assert 100 < highest < 400
    assert interpolation_error(JITTER, EVEN, highest) <= BEARABLE
    assert interpolation_error(JITTER, EVEN, 1.3 * highest) > BEARABLE


def test_one_late_sample(tmp_path):
    """A clock that stands for half a step, once: what follows is later by that much."""
    late = EVEN + 5e-4 * (EVEN > 1.7)
    path = recorded(tmp_path / "run.csv", late, wave(late))
    record = rid.read_record(path, columns=["x"], time="t", highest=20.0)
    grid = np.arange(len(record.samples)) / record.sample_rate
    assert np.abs(record.column("x") - wave(grid)).max() < 1e-5
    assert len(record.warnings) == 1


def test_a_missing_sample_is_told_with_the_longest_stretch(tmp_path):
    time = np.delete(EVEN, [500, 3000])
    path = recorded(tmp_path / "run.csv", time, wave(time))
    said = r"a step of 0.002 s after sample 499 \(t = 0.499 s\), 2 such"
    with pytest.raises(ReadError, match=said) as caught:
        rid.read_record(path, columns=["x"], time="t")
    assert 'skip = "0.501 s" and until = "2.9995 s"' in caught.value.cure
    assert len(rid.read_record(path, columns=["x"], time="t", until="0.4995 s").samples) == 500
    stretch = {"skip": "0.501 s", "until": "2.9995 s"}
    middle = rid.read_record(path, columns=["x"], time="t", speed=10.0, phase=0.5, **stretch)
    assert (middle.start, len(middle.samples)) == (pytest.approx(0.501), 2499)
    np.testing.assert_allclose(middle.rotor_angle(), 0.5 + 10 * time[499 + 1 : 2999], rtol=1e-12)
    periods = rid.average(middle, 20.0, harmonics=[1], skip=0.75)
    assert periods.time[0, 0] == pytest.approx(0.75)
    np.testing.assert_allclose(periods.angle, 0.5 + 10 * periods.time)


@pytest.mark.parametrize(("edge", "inside"), [(LATE, -0.01), (EARLY, 0.01)])
def test_between_late_and_missing(edge, inside):
    def clock(step: float) -> np.ndarray:
        return np.cumsum(np.r_[0.0, np.ones(50), step, np.ones(50)])

    assert not read_clock(clock(edge + inside)).even
    with pytest.raises(ReadError, match="no dropped samples"):
        read_clock(clock(edge - inside))


def test_two_statements_of_the_rate(tmp_path):
    path = recorded(tmp_path / "run.csv", np.arange(10**4) / 1000.0, np.ones(10**4))
    near, far = 1000 * (1 + 0.9 * SAME_RATE), 1000 * (1 + 2.2 * SAME_RATE)
    assert rid.read_record(path, time="t", sample_rate=near).sample_rate == near
    with pytest.raises(rid.InputError, match=r"where the time column says 1000 Hz"):
        rid.read_record(path, time="t", sample_rate=far)


def test_a_rate_of_few_digits_fits_the_period(tmp_path):
    """Times in whole milliseconds at 2.5 ms end within a digit of the truth, not on it."""
    time = np.round(np.arange(4000) / 400.0, 3)
    path = recorded(tmp_path / "run.csv", time, wave(time))
    assert rid.read_record(path, time="t").sample_rate != 400.0
    assert rid.read_record(path, time="t", fundamental="20 Hz").sample_rate == 400.0
    odd = rid.read_record(path, time="t", fundamental="19.3 Hz").sample_rate
    assert odd == rid.read_record(path, time="t").sample_rate


def test_what_is_no_number_before_skip_does_no_harm(tmp_path):
    values = wave(EVEN)
    values[:30] = np.nan
    path = recorded(tmp_path / "run.csv", EVEN, values)
    for clock in ({"time": "t"}, {"sample_rate": 1000.0}):
        record = rid.read_record(path, columns=["x"], skip="0.1 s", speed=7.0, **clock)
        assert record.start == pytest.approx(0.1)
        np.testing.assert_allclose(record.column("x"), values[100:], atol=1e-11)
        np.testing.assert_allclose(record.rotor_angle(), 7 * EVEN[100:])
        with pytest.raises(rid.InputError, match="found nan in sample"):
            rid.read_record(path, columns=["x"], skip="0.02 s", **clock)


# Records read in blocks give what they give at once.


SIZE, PERIODS, RATE = 50, 27, 1000.0
DRAWN = np.random.default_rng(8)
ANGLE = 2 * np.pi * np.arange(SIZE * PERIODS + 17) / SIZE
FORCE = np.cos(ANGLE) + 0.1 * DRAWN.normal(size=len(ANGLE))
MOTION = 1e3 + np.sin(3 * ANGLE) + 0.1 * DRAWN.normal(size=len(ANGLE))
COLUMNS = {"fx": (FORCE, "N"), "px": (MOTION, "um")}
SOURCES = {"F": Source("fx", "N"), "x": Source("px", "um")}
OPTIONS = {"harmonics": [0, 1, 3, 25], "skip": 0.123}


def write_chunks(path: Path, columns: object = None) -> None:
    with h5py.File(path, "w") as data:
        for name, (values, unit) in COLUMNS.items():
            data.create_dataset(name, data=values, chunks=(100,))
            data[name].attrs["unit"] = unit


def write_table(path: Path, columns: object) -> None:
    with h5py.File(path, "w") as data:
        data["log"] = np.stack([FORCE, MOTION])
        data["log"].attrs["unit"] = ["N", "um"]


KINDS = {  # and what is needed
    "run.h5": (write_chunks, "h5py"),
    "log.h5": (write_table, "h5py"),
    "run.parquet": (io_writers.write_parquet, "pyarrow"),
    "run.tdms": (io_writers.write_tdms, "nptdms"),
}


@pytest.fixture(params=KINDS)
def path(request, tmp_path, monkeypatch):
    """A record of any size that is read in blocks."""
    monkeypatch.setattr(blocks, "WORTH", 0)
    writer, package = KINDS[request.param]
    pytest.importorskip(package)
    writer(tmp_path / request.param, COLUMNS)
    return tmp_path / request.param


def sources_of(path: Path, *of_x: object) -> dict[str, Source]:
    """Return the columns of force and motion, by the unit and the scale of the second."""
    force, motion = ("log[0]", "log[1]") if path.name == "log.h5" else ("fx", "px")
    return {"F": Source(force, "N"), "x": Source(motion, *of_x)}


@pytest.mark.sampled(6)
@pytest.mark.parametrize("rows", [7, 100, 501, 10**6])
def test_blocks_are_the_whole(path, rows, monkeypatch):
    monkeypatch.setattr(blocks, "ROWS", rows)
    sources = sources_of(path, "um")
    opened = open_blocks([path], columns=sources, sample_rate=RATE, speed=3.0, phase=0.2)
    found = average_blocks(opened, 20.0, **OPTIONS)
    record = rid.read_record(path, columns=sources, sample_rate=RATE, speed=3.0, phase=0.2)
    whole = rid.average(record, 20.0, **OPTIONS)
    assert found.channels == whole.channels
    assert found.periods == whole.periods == 24
    assert {check.about for check in found.checks} == {check.about for check in whole.checks}
    for name in ("spectra", "mean", "variance", "time", "angle"):
        ours, theirs = getattr(found, name), getattr(whole, name)
        size = np.abs(theirs).max(axis=tuple(range(theirs.ndim - 1)))
        digits = 1e-11 if name == "variance" else 1e-12  # beside a mean 10,000 times the noise
        np.testing.assert_allclose(ours / size, theirs / size, rtol=digits, atol=1e-13)


def test_as_numpy_averages():
    """Also beside a mean that is ten thousand times the noise, and in two parts."""
    samples = DRAWN.normal(size=(40, SIZE, 2)) + 1e4
    total = PeriodSums((rid.Channel("F"), rid.Channel("x")), RATE, SIZE, np.array([0, 2, 25]))
    total.add(samples[:13])
    total.add(samples[13:])
    np.testing.assert_allclose(total.mean, samples.mean(axis=0), rtol=1e-14)
    np.testing.assert_allclose(total.variance, samples.var(axis=0, ddof=1), rtol=1e-11)
    lines = np.fft.rfft(samples, axis=1, norm="forward")[:, [0, 2, 25]]
    np.testing.assert_allclose(total.spectra, lines, atol=1e-10)
    assert not total.spectra[:, [0, 2]].imag.any()


def test_faults_are_told_with_their_sample(tmp_path, monkeypatch):
    monkeypatch.setattr(blocks, "WORTH", 0)
    monkeypatch.setattr(blocks, "ROWS", 100)
    write_chunks(tmp_path / "run.h5")
    with h5py.File(tmp_path / "run.h5", "a") as data:
        data["px"][1034] = np.nan
    files = [tmp_path / "run.h5"]
    opened = open_blocks(files, columns=SOURCES, sample_rate=RATE)
    with pytest.raises(InputError, match="found nan in sample 1034 of channel 'x'"):
        average_blocks(opened, 20.0, **OPTIONS)
    until = open_blocks(files, columns=SOURCES, sample_rate=RATE, until=1.0)
    assert average_blocks(until, 20.0, **OPTIONS).periods == 17
    with pytest.raises(InputError, match=r"87 samples|50 samples|1 whole periods"):
        average_blocks(until, 20.0, harmonics=[1], skip=0.92)
    with pytest.raises(InputError, match="no column 'fz'"):
        open_blocks(files, columns={"F": Source("fz")}, sample_rate=RATE)


def test_small_records_and_jittered_ones_are_read_at_once(tmp_path, monkeypatch):
    write_chunks(tmp_path / "run.h5")
    files = [tmp_path / "run.h5"]
    with h5py.File(files[0], "a") as data:
        data["t"] = np.arange(len(FORCE)) / RATE + DRAWN.uniform(-1e-4, 1e-4, len(FORCE))
    assert open_blocks(files, columns=SOURCES, sample_rate=RATE) is None
    monkeypatch.setattr(blocks, "WORTH", 0)
    assert open_blocks(files, columns=SOURCES, sample_rate=RATE) is not None
    assert open_blocks(files, columns=SOURCES, time=Source("t", "s")) is None


@pytest.mark.parametrize("scale", [1e-162, 1e155])
def test_blocks_that_no_machine_has(scale, path):
    opened = open_blocks([path], columns=sources_of(path, "m", scale), sample_rate=RATE)
    with pytest.raises(InputError, match=r"channels\.x\.unit: found samples up to"):
        average_blocks(opened, period_samples=SIZE, **OPTIONS)


def test_empty_column_is_no_channel(tmp_path):
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        file.update({"F": np.arange(5.0), "spare": np.full(9, np.nan), "x": np.arange(5.0)})
    record = rid.read_record(path, sample_rate=1e3)
    assert record.names == ("F", "x")
    assert record.warnings == ("no number in 'spare': left out",)
    with pytest.raises(InputError, match=r"nan in sample 0 of channel 'spare', 9 in all"):
        rid.read_record(path, sample_rate=1e3, columns=["spare"])
    with h5py.File(path, "a") as file:
        file["spare"][8] = 1.0
    with pytest.raises(InputError, match=r"nan in sample 0 of channel 'spare', 8 in all"):
        rid.read_record(path, sample_rate=1e3)
