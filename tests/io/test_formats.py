"""Every format, read from a file that its own library wrote."""

import gc
import subprocess
import sys
import warnings
from pathlib import Path

import h5py
import numpy as np
import pytest
from io_writers import (
    PACKAGES,
    RATE,
    WRITERS,
    uff_set,
    write_hdf5,
    write_mdf,
    write_tdms,
    write_uff,
)

import rotorid as rid
from rotorid import InputError, ReadError
from rotorid.io import Source, open_table

X = np.linspace(-1.0, 1.0, 2000) ** 3
COLUMNS = {"fx": (X, "N"), "px": (100 * X[::-1], "um")}
UNITS = ("csv", "h5", "parquet", "tdms", "uff", "mf4")
RATES = ("lvm", "h5", "tdms", "uff", "mf4")


@pytest.fixture(params=WRITERS)
def path(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / request.param
    package = PACKAGES.get(path.suffix)
    if package:
        pytest.importorskip(package)
    WRITERS[request.param](path, COLUMNS)
    return path


def test_columns_and_units(path: Path) -> None:
    states = path.suffix[1:] in UNITS
    unit = None if states else "um"
    record = rid.read_record(
        path, columns={"F": Source("fx", "N"), "x": Source("px", unit, expected="m")},
        sample_rate="1 kHz",
    )  # fmt: skip
    digits = 1e-10 if path.name == "run.uff" else 1e-15
    np.testing.assert_allclose(record.column("F"), X, rtol=digits, atol=digits)
    np.testing.assert_allclose(record.column("x"), 1e-4 * X[::-1], rtol=digits, atol=1e-4 * digits)


def test_a_stated_unit_that_is_not_the_given_one(path: Path) -> None:
    if path.suffix[1:] in UNITS:
        with pytest.raises(InputError, match="unit 'mm', where the file says 'um'"):
            rid.read_record(path, columns={"x": Source("px", "mm")}, sample_rate=RATE)
    ruled = rid.read_record(
        path, columns={"x": Source("px", "mm")}, sample_rate=RATE, overrule=True
    )
    assert ruled.column("x")[-1] == pytest.approx(-0.1)


def test_the_rate_of_the_file(path: Path) -> None:
    columns = {"F": Source("fx", "N")}
    if path.suffix[1:] in RATES:
        record = rid.read_record(path, columns=columns)
        assert record.sample_rate == pytest.approx(RATE, rel=1e-12)
        with pytest.raises(InputError, match=r"2000 Hz, where the file says 1000 Hz.*overrule"):
            rid.read_record(path, columns=columns, sample_rate=2000.0)
        ruled = rid.read_record(path, columns=columns, sample_rate=2000.0, overrule=True)
        assert ruled.sample_rate == 2000.0
        assert rid.read_record(path, columns=columns, sample_rate=1000.05).sample_rate == 1000.05
    else:
        with pytest.raises(InputError, match=r"nor does the file state a rate.*give one"):
            rid.read_record(path, columns=columns)


def test_a_missing_column(path: Path) -> None:
    with pytest.raises(ReadError, match=r"no column 'fxx'.*did you mean (?:\d/)?(?:run/)?fx"):
        open_table(path).find("fxx")


def test_what_is_not_what_its_ending_says(path: Path) -> None:
    if path.suffix in (".csv", ".lvm"):
        path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(99))
    else:
        path.write_text("t,x\n1,2\n")
    with pytest.raises(ReadError, match=r"as the ending .* says; give the file the ending"):
        open_table(path)


def test_a_file_cut_short(path: Path) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 3])
    if path.suffix in (".csv", ".lvm", ".tdms"):
        return  # a shorter record, or a row too few: test_hostile has them
    with pytest.raises(ReadError, match=r"damaged|data sets|no column|no samples"):
        rid.read_record(path, columns=["fx"], sample_rate=RATE)


@pytest.mark.parametrize("ending", sorted(PACKAGES))
def test_a_package_that_is_missing(
    ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip(PACKAGES[ending])
    name = next(name for name in WRITERS if name.endswith(ending))
    WRITERS[name](tmp_path / name, COLUMNS)
    for module in [m for m in sys.modules if m.split(".")[0] == PACKAGES[ending]]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, PACKAGES[ending], None)
    with pytest.raises(ReadError, match=rf"no package {PACKAGES[ending]}.*rotorid\[files\]"):
        open_table(tmp_path / name)


def test_no_format_is_imported_before_its_file() -> None:
    packages = "{'pyarrow', 'nptdms', 'pyuff', 'asammdf', 'h5py'}"
    code = f"import sys, rotorid.io; print(*{packages} & {{*sys.modules}})"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == ""


def test_samples_along_either_axis(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as data:
        data["down"] = np.column_stack([X, 2 * X, 3 * X])
        data["along"] = data["down"][()].T
        data["table"] = np.rec.fromarrays([X, 2 * X], names="a,b")
    opened = open_table(path)
    names = ["down[1]", "along[1]", "along[1,:]", "down[:,1]", "table/b"]
    for column in opened.read([opened.find(name) for name in names]).values():
        np.testing.assert_array_equal(column.values, 2 * X)
    assert (
        opened.read(["along[:,3]"])["along[:,3]"].values.tolist()
        == (X[3] * np.arange(1, 4)).tolist()
    )
    with pytest.raises(ReadError, match=r"'along' of size 3 x 2000.*name"):
        opened.find("along")
    with pytest.raises(ReadError, match="column of samples"):
        opened.find("along[3]")


def test_columns_of_matlab_7_3(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    WRITERS["run-v73.mat"](path, COLUMNS)
    opened = open_table(path)
    np.testing.assert_array_equal(opened.read(["log/all[1]"])["log/all[1]"].values, 100 * X[::-1])
    with pytest.raises(ReadError, match="'label' of text or cells"):
        opened.find("label")


def test_channels_of_two_rates_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    write_hdf5(path, COLUMNS)
    with h5py.File(path, "a") as data:
        data["px"].attrs["dt"] = 1e-4
    with pytest.raises(ReadError, match="sampled at 1000 Hz and at 10000 Hz"):
        rid.read_record(path, columns=["fx", "px"])


def test_names_of_channels_with_a_slash(tmp_path: Path) -> None:
    pytest.importorskip("nptdms")
    write_tdms(tmp_path / "run.tdms", {"cDAQ1Mod1/ai0": (X, "V"), "cDAQ1Mod2/ai0": (2 * X, "V")})
    opened = open_table(tmp_path / "run.tdms")
    name = opened.find("cDAQ1Mod2/ai0")
    np.testing.assert_array_equal(opened.read([name])[name].values, 2 * X)
    with pytest.raises(ReadError, match=r"'ai0' 2 times.*write the whole path"):
        opened.find("ai0")


@pytest.mark.slow
def test_groups_of_an_mdf_file(tmp_path: Path) -> None:
    pytest.importorskip("asammdf")
    write_mdf(tmp_path / "run.mf4", COLUMNS)
    opened = open_table(tmp_path / "run.mf4")
    assert opened.names == ["time", "fx", "px"]
    np.testing.assert_array_equal(opened.read(["0/px"])["0/px"].values, 100 * X[::-1])


def test_data_sets_that_their_names_do_not_tell_apart(tmp_path: Path) -> None:
    pytest.importorskip("pyuff")
    write_uff(tmp_path / "run.uff", COLUMNS, named=False)
    opened = open_table(tmp_path / "run.uff")
    assert opened.names == ["1+Z", "2+Z"]
    np.testing.assert_allclose(opened.read(["2+Z"])["2+Z"].values, 100 * X[::-1], rtol=1e-10)


def two_starts(path: Path, apart: float) -> None:
    """Write two columns of 1 kHz, the second of which begins later."""
    force, motion = np.arange(50.0), np.arange(50.0) ** 2
    if path.suffix == ".mf4":
        from asammdf import MDF, Signal

        with MDF(version="4.10") as data:
            for name, values, later in (("f", force, 0.0), ("x", motion, apart)):
                data.append([Signal(values, np.arange(50) / 1000 + later, name=name, unit="m")])
            data.save(path, overwrite=True)
    elif path.suffix == ".tdms":
        from nptdms import ChannelObject, TdmsWriter

        begun = np.datetime64("2026-03-11T12:00:00", "us")
        with TdmsWriter(path) as writer:
            for name, values, later in (("f", force, 0.0), ("x", motion, apart / 2)):
                said = {"wf_increment": 1e-3, "wf_start_offset": later}
                said["wf_start_time"] = begun + np.timedelta64(round(later * 1e6), "us")
                writer.write_segment([ChannelObject("run", name, values, properties=said)])
    else:
        import pyuff

        sets = [
            uff_set(name, values, "m", node=node, binary=0)
            | {"x": np.arange(50) / 1000 + later, "abscissa_min": later}
            for node, (name, values, later) in enumerate(
                (("f", force, 0.0), ("x", motion, apart)), start=1
            )
        ]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ResourceWarning)
            pyuff.UFF(str(path)).write_sets(sets, "add")
            gc.collect()


@pytest.mark.parametrize("name", ["run.mf4", "run.tdms", "run.uff"])
def test_columns_that_begin_at_other_times(name: str, tmp_path: Path) -> None:
    """Side by side their samples would be those of other times: a wrong machine, or a delay."""
    path = tmp_path / name
    pytest.importorskip(PACKAGES[path.suffix])
    two_starts(path, 0.0214)
    with pytest.raises(ReadError, match=r"columns that begin 0\.0214 s apart.*overrule = true"):
        rid.read_record(path, columns=["f", "x"])
    rate = rid.read_record(path, columns=["x"]).sample_rate
    ruled = rid.read_record(path, columns=["f", "x"], sample_rate=rate, overrule=True)
    assert not ruled.warnings
    for apart, told in ((0.0002, 1), (0.000004, 0)):
        path.unlink()
        two_starts(path, apart)
        found = rid.read_record(path, columns=["f", "x"]).warnings
        assert len(found) == told
        assert all("0.0002 s apart" in text for text in found)
