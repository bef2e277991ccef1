"""Records read in blocks give what they give at once."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from io_writers import write_parquet, write_tdms

import rotorid as rid
from rotorid import InputError
from rotorid.io import Source, open_table
from rotorid.io import columns as blocks
from rotorid.io.columns import open_blocks
from rotorid.signals.average import PeriodSums, average_blocks

SIZE, PERIODS, RATE = 50, 67, 1000.0
RNG = np.random.default_rng(8)
ANGLE = 2 * np.pi * np.arange(SIZE * PERIODS + 17) / SIZE
FORCE = np.cos(ANGLE) + 0.1 * RNG.normal(size=len(ANGLE))
MOTION = 1e3 + np.sin(3 * ANGLE) + 0.1 * RNG.normal(size=len(ANGLE))
COLUMNS = {"fx": (FORCE, "N"), "px": (MOTION, "um")}
SOURCES = {"F": Source("fx", "N"), "x": Source("px", "um")}
OPTIONS = {"harmonics": [0, 1, 3, 25], "skip": 0.123}


def write_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as data:
        for name, (values, unit) in COLUMNS.items():
            data.create_dataset(name, data=values, chunks=(100,))
            data[name].attrs["unit"] = unit


def write_table(path: Path) -> None:
    with h5py.File(path, "w") as data:
        data["log"] = np.stack([FORCE, MOTION])
        data["log"].attrs["unit"] = ["N", "um"]


@pytest.fixture(params=["hdf5", "table", "parquet", "tdms"])
def path(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    kind = request.param
    path = tmp_path / {"hdf5": "run.h5", "table": "log.h5"}.get(kind, f"run.{kind}")
    if kind == "hdf5":
        write_hdf5(path)
    elif kind == "table":
        write_table(path)
    elif kind == "parquet":
        pytest.importorskip("pyarrow")
        write_parquet(path, COLUMNS)
    else:
        pytest.importorskip("nptdms")
        write_tdms(path, COLUMNS)
    return path


@pytest.mark.sampled(8)
@pytest.mark.parametrize("rows", [1, 7, 100, 1001, 10**6])
def test_blocks_are_the_whole(path: Path, rows: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blocks, "WORTH", 0)
    monkeypatch.setattr(blocks, "ROWS", rows)
    sources = SOURCES
    if path.name == "log.h5":
        sources = {"F": Source("log[0]", "N"), "x": Source("log[1]", "um")}
    opened = open_blocks([path], columns=sources, sample_rate=RATE, speed=3.0, phase=0.2)
    assert opened is not None
    found = average_blocks(opened, 20.0, **OPTIONS)
    record = rid.read_record(path, columns=sources, sample_rate=RATE, speed=3.0, phase=0.2)
    whole = rid.average(record, 20.0, **OPTIONS)
    assert found.channels == whole.channels
    assert found.periods == whole.periods == 64
    assert {check.about for check in found.checks} == {check.about for check in whole.checks}
    for name in ("spectra", "mean", "variance", "time", "angle"):
        ours, theirs = getattr(found, name), getattr(whole, name)
        size = np.abs(theirs).max(axis=tuple(range(theirs.ndim - 1)))
        digits = 1e-11 if name == "variance" else 1e-12  # beside a mean 10,000 times the noise
        np.testing.assert_allclose(ours / size, theirs / size, rtol=digits, atol=1e-13)


def test_as_numpy_averages() -> None:
    """Also beside a mean that is ten thousand times the noise, and in two parts."""
    samples = RNG.normal(size=(40, SIZE, 2)) + 1e4
    total = PeriodSums((rid.Channel("F"), rid.Channel("x")), RATE, SIZE, np.array([0, 2, 25]))
    total.add(samples[:13])
    total.add(samples[13:])
    np.testing.assert_allclose(total.mean, samples.mean(axis=0), rtol=1e-14)
    np.testing.assert_allclose(total.variance, samples.var(axis=0, ddof=1), rtol=1e-11)
    lines = np.fft.rfft(samples, axis=1, norm="forward")[:, [0, 2, 25]]
    np.testing.assert_allclose(total.spectra, lines, atol=1e-10)
    assert not total.spectra[:, [0, 2]].imag.any()


def test_faults_are_told_with_their_sample(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blocks, "WORTH", 0)
    monkeypatch.setattr(blocks, "ROWS", 100)
    write_hdf5(tmp_path / "run.h5")
    with h5py.File(tmp_path / "run.h5", "a") as data:
        data["px"][1234] = np.nan
    opened = open_blocks([tmp_path / "run.h5"], columns=SOURCES, sample_rate=RATE)
    assert opened is not None
    with pytest.raises(InputError, match="found nan in sample 1234 of channel 'x'"):
        average_blocks(opened, 20.0, **OPTIONS)
    until = open_blocks([tmp_path / "run.h5"], columns=SOURCES, sample_rate=RATE, until=1.2)
    assert until is not None
    assert average_blocks(until, 20.0, **OPTIONS).periods == 21
    with pytest.raises(InputError, match=r"87 samples|50 samples|1 whole periods"):
        average_blocks(until, 20.0, harmonics=[1], skip=1.12)
    with pytest.raises(InputError, match="no column 'fz'"):
        open_blocks([tmp_path / "run.h5"], columns={"F": Source("fz")}, sample_rate=RATE)


def test_small_records_and_jittered_ones_are_read_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_hdf5(tmp_path / "run.h5")
    with h5py.File(tmp_path / "run.h5", "a") as data:
        data["t"] = np.arange(len(FORCE)) / RATE + RNG.uniform(-1e-4, 1e-4, len(FORCE))
    assert open_blocks([tmp_path / "run.h5"], columns=SOURCES, sample_rate=RATE) is None
    monkeypatch.setattr(blocks, "WORTH", 0)
    assert open_blocks([tmp_path / "run.h5"], columns=SOURCES, sample_rate=RATE) is not None
    jittered = open_blocks([tmp_path / "run.h5"], columns=SOURCES, time=Source("t", "s"))
    assert jittered is None
    assert not isinstance(open_table(tmp_path / "run.h5"), type(None))


@pytest.mark.parametrize("scale", [1e-162, 1e155])
def test_samples_that_no_machine_has(
    scale: float, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(blocks, "WORTH", 0)
    sources = {"F": Source("fx", "N"), "x": Source("px", "m", scale=scale)}
    if path.name == "log.h5":
        sources = {"F": Source("log[0]", "N"), "x": Source("log[1]", "m", scale=scale)}
    opened = open_blocks([path], columns=sources, sample_rate=RATE)
    assert opened is not None
    with pytest.raises(InputError, match=r"channels\.x\.unit: found samples up to"):
        average_blocks(opened, period_samples=SIZE, **OPTIONS)
