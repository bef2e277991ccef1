import os
import signal
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rotorid import ReadError
from rotorid.cli import run
from rotorid.io import open_table


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as data:
        data["force/x"] = np.arange(5.0)
        data["force/x"].attrs["units"] = "kN"
        data["position/x"] = np.arange(5, dtype=np.int16)
        data["position/y"] = np.arange(5, dtype=np.float32)[:, None]
        data["adc"] = np.arange(15.0).reshape(5, 3)
        data["adc"].attrs["units"] = ["N", "mm", "V"]
        data["gain"] = 2.5
        data["gain2"] = np.array([[3.5]])
        data["label"] = "run 7"
        data["complex"] = np.arange(5) * 1j
        data["cube"] = np.zeros((5, 2, 2))
        data["short"] = np.arange(3.0)
        data.create_dataset("packed", data=np.arange(5.0), compression="gzip", chunks=(2,))
    return path


def test_columns(path: Path) -> None:
    opened = open_table(path)
    wanted = ["force/x", "/position/x", "y", "adc[0]", "adc[2]", "packed"]
    found = [opened.find(name) for name in wanted]
    assert found == ["force/x", "position/x", "position/y", "adc[0]", "adc[2]", "packed"]
    columns = opened.read(found)
    assert [columns[name].unit for name in found] == ["kN", None, None, "N", "V", None]
    for name in ("force/x", "position/x", "position/y", "packed"):
        assert columns[name].values.dtype == np.float64
        assert columns[name].values.tolist() == [0, 1, 2, 3, 4]
    assert columns["adc[0]"].values.tolist() == [0, 3, 6, 9, 12]
    assert columns["adc[2]"].values.tolist() == [2, 5, 8, 11, 14]
    only = opened.read(["adc[1]"])["adc[1]"]
    assert (only.values.tolist(), only.unit) == ([1, 4, 7, 10, 13], "mm")


def test_names(path: Path) -> None:
    assert sorted(open_table(path).names) == ["force/x", "packed", "position/x", "short", "y"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("x", "'x' 2 times .*write the whole path"),
        ("adc", r"'adc' of size 5 x 3.*name\[0\]"),
        ("adc[3]", "of size 5 x 3"),
        ("force/x[0]", "of size 5"),
        ("gain", "a scalar"),
        ("cube", "5 x 2 x 2"),
        ("label", "'label' of text; expected real numbers"),
        ("complex", "'complex' of complex numbers; expected real numbers"),
        ("force", "no column 'force'"),
        ("a\0b", "no column"),
        ("packd", "did you mean packed"),
        ("adc[99999999999]", "no column"),
    ],
)
def test_names_that_are_no_columns(path: Path, name: str, message: str) -> None:
    with pytest.raises(ReadError, match=message):
        open_table(path).find(name)


def test_scalars(path: Path) -> None:
    opened = open_table(path)
    assert (opened.scalar("gain"), opened.scalar("gain2")) == (2.5, 3.5)
    with pytest.raises(ReadError, match=r"no scalar variable 'gian'.*did you mean gain"):
        opened.scalar("gian")


def test_files_that_are_no_hdf5(tmp_path: Path, path: Path) -> None:
    text = tmp_path / "text.h5"
    text.write_text("t,x\n1,2\n")
    with pytest.raises(ReadError, match=r"found text; expected HDF5 data, as the ending .h5 says"):
        open_table(text)
    cut = tmp_path / "cut.h5"
    cut.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(ReadError, match="damaged HDF5 data"):
        open_table(cut)
    with pytest.raises(ReadError, match="no such file"):
        open_table(tmp_path / "none.h5")


@pytest.mark.slow
def test_damage_inside(path: Path) -> None:
    """Bytes that changed make a wrong number or a ReadError, nothing else."""
    whole = path.read_bytes()
    rng = np.random.default_rng(7)
    for _ in range(60):
        damaged = bytearray(whole)
        for place in rng.integers(8, len(whole), size=4):
            damaged[place] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            opened = open_table(path)
            opened.read([opened.find(name) for name in opened.names])
        except ReadError as error:
            assert error.file == str(path)  # noqa: PT017


@pytest.mark.parametrize("shape", [(5,), (1, 5), (5, 2)])
def test_packed_numbers(shape: tuple[int, ...], tmp_path: Path) -> None:
    """As netCDF packs them; read as they are stored they would be other numbers, and ok."""
    path = tmp_path / "run.h5"
    stored = np.resize(np.array([0, 100, -100, -32768, 7], dtype=np.int16), shape)
    with h5py.File(path, "w") as data:
        packed = data.create_dataset("x", data=stored)
        packed.attrs["scale_factor"], packed.attrs["add_offset"] = np.float32([0.5]), 2.0
        packed.attrs["_FillValue"] = np.int16(-32768)
        data["plain"] = stored
        counts = data.create_dataset("counts", data=stored)
        counts.attrs["_Unsigned"] = "true"
        scale = data.create_dataset("scale", data=np.int16(3))
        scale.attrs["scale_factor"] = 0.1
    name = "x[0]" if shape == (5, 2) else "x"
    opened = open_table(path)
    raw = (stored[:, 0] if shape == (5, 2) else stored.ravel()).astype(float)
    expected = np.where(raw == -32768, np.nan, 0.5 * raw + 2.0)
    np.testing.assert_array_equal(opened.read([name])[name].values, expected)
    blocks = np.concatenate([block[name].values for block in opened.blocks([name], 2)])
    np.testing.assert_array_equal(blocks, expected)
    plain, counts = name.replace("x", "plain"), name.replace("x", "counts")
    found = opened.read([plain, counts])
    np.testing.assert_array_equal(found[plain].values, raw)
    np.testing.assert_array_equal(found[counts].values, np.where(raw < 0, raw + 65536, raw))
    assert opened.scalar("scale") == pytest.approx(0.3)


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf, "much", [1.0, 2.0]])
def test_numbers_packed_in_no_way_that_is_known(value: object, tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as data:
        data["x"] = np.arange(5)
        data["x"].attrs["scale_factor"] = value
    with pytest.raises(ReadError, match="an attribute scale_factor of '/x' that is no number"):
        open_table(path).read(["x"])


@pytest.mark.parametrize(
    ("said", "hertz"),
    [
        ({"dt": 0.2, "dt_units": "ms"}, 5000.0),
        ({"sample_rate": 5, "sample_rate_unit": b"kHz"}, 5000.0),
        ({"dt": 200, "time_units": "us"}, 5000.0),
        ({"dt": 0.2, "dt_units": "ticks"}, None),
        ({"dt": 0.2, "dt_units": "ticks", "wf_increment": 1e-3}, 1000.0),
        ({"fs": 5000.0}, 5000.0),
    ],
)
def test_the_unit_of_a_rate(said: dict, hertz: float | None, tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as data:
        data["x"] = np.arange(5.0)
        data["x"].attrs.update(said)
    rate = open_table(path).read(["x"])["x"].rate
    assert (rate and rate.hertz) == (hertz and pytest.approx(hertz))


def test_attributes_that_are_lists_are_not_read(tmp_path: Path) -> None:
    """With one bit of its type changed a text is such a list, and HDF5 reads beyond its memory."""
    with h5py.File(tmp_path / "run.h5", "w") as data:
        data["x"] = np.arange(5.0)
        listed = np.empty(1, dtype=object)
        listed[0] = np.arange(3, dtype=np.int8)
        data["x"].attrs.create("units", listed, dtype=h5py.vlen_dtype(np.int8))
    assert open_table(tmp_path / "run.h5").read(["x"])["x"].unit is None


def ended(*_: object) -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


@pytest.mark.parametrize(
    ("what", "work"),
    [
        ("rotorid.io.hdf5._walk", lambda path: open_table(path).names),
        ("rotorid.io.hdf5.check_stored", lambda path: open_table(path).read(["packed"])),
        ("rotorid.io.hdf5.h5py.Dataset.__getitem__", lambda path: open_table(path).scalar("gain")),
        ("rotorid.io.hdf5._rows", lambda path: list(open_table(path).blocks(["packed"], 2))),
    ],
)
def test_what_ends_hdf5_ends_a_child(
    what: str, work: Any, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(what, ended)
    with pytest.raises(
        ReadError, match=r"run\.h5: found a file that ends the program that reads it"
    ):
        work(path)


def numbers(kind: str) -> np.ndarray[Any, Any]:
    return (np.arange(24).reshape(12, 2) % 2).astype(kind)


@pytest.mark.sampled(10)
@pytest.mark.parametrize("kind", ["<f8", ">f8", "<f4", ">i2", "u1", "<i8", "?", "<f2"])
@pytest.mark.parametrize("shape", [(24,), (24, 1), (1, 24), (12, 2), (2, 12)])
def test_numbers_are_those_written(kind: str, shape: tuple[int, ...], tmp_path: Path) -> None:
    """After a user's block, in blocks, and whole."""
    path = tmp_path / "run.h5"
    with h5py.File(path, "w", userblock_size=512) as data:
        data["before"] = np.arange(5.0)
        data["x"] = numbers(kind).reshape(shape)
        data["later"] = np.arange(5.0)
    table = open_table(path)
    names = ["x"] if len(shape) == 1 or 1 in shape else ["x[1]", "x[0]"]
    expected = {"x": numbers(kind).ravel()}
    if len(names) > 1:
        longer = numbers(kind).reshape(shape) if shape[0] > 2 else numbers(kind).reshape(shape).T
        expected = {f"x[{i}]": longer[:, i] for i in range(2)}
    for asked in (names, names[:1]):
        found = table.read(asked)
        blocks = list(table.blocks(asked, 5))
        for name in asked:
            np.testing.assert_array_equal(found[name].values, expected[name])
            parts = [block[name].values for block in blocks]
            assert [len(p) for p in parts] == [*[5] * (len(expected[name]) // 5), len(parts[-1])]
            np.testing.assert_array_equal(np.concatenate(parts), expected[name])


def test_numbers_that_hdf5_converts(tmp_path: Path) -> None:
    """Numbers of an analogue converter: 12 bits of 16, from the fourth on."""
    path = tmp_path / "run.h5"
    stored = h5py.h5t.STD_I16LE.copy()
    stored.set_precision(12)
    stored.set_offset(4)
    values = np.array([-2048, -1, 0, 1, 2047], np.int16)
    with h5py.File(path, "w") as data:
        made = h5py.h5d.create(data.id, b"x", stored, h5py.h5s.create_simple((5,)))
        made.write(h5py.h5s.ALL, h5py.h5s.ALL, values)
    assert open_table(path).read(["x"])["x"].values.tolist() == values.tolist()


def test_blocks_of_single_precision_are_those_of_the_whole(tmp_path: Path) -> None:
    """Whatever they are multiplied by afterwards: a block is in double precision, as all is."""
    with h5py.File(tmp_path / "run.h5", "w") as data:
        data["x"] = np.random.default_rng(1).standard_normal(1000).astype(np.float32)
    opened = open_table(tmp_path / "run.h5")
    whole = opened.read(["x"])["x"].values * 1e-6
    parts = [block["x"].values * 1e-6 for block in opened.blocks(["x"], 300)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_what_nobody_wrote_is_known_by_a_few_questions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One question for each field of a table took a minute; links lead to nothing more."""
    with h5py.File(tmp_path / "run.h5", "w") as data:
        table = np.dtype([(f"c{k}", "f8") for k in range(500)])
        data.create_dataset("run/table", (700,), table)
        data["run/link"] = h5py.SoftLink("/nowhere")
        data["run/x"] = np.arange(700.0)
    asked, fork = [], os.fork
    monkeypatch.setattr(os, "fork", lambda: (asked.append(None), fork())[1])
    assert run(["new", str(tmp_path / "run.h5")]) == 0
    assert "# not used: x" in capsys.readouterr().out
    assert 0 < len(asked) < 10
    opened = open_table(tmp_path / "run.h5")
    with pytest.raises(ReadError, match=r"no sample written: a gap in '/run/table'"):
        opened.read([opened.find("c3")])


def test_the_fields_of_a_table_of_records_are_read_together(tmp_path: Path) -> None:
    """A thousand fields one by one take a minute: for each the library goes through all."""
    rng = np.random.default_rng(2)
    kinds = np.dtype([("name", "S4"), *((f"c{k}", "f4" if k % 2 else "i2") for k in range(1000))])
    records = np.zeros(700, kinds)
    for k in range(1000):
        records[f"c{k}"] = rng.integers(-99, 99, 700)
    with h5py.File(tmp_path / "run.h5", "w") as data:
        data["run/table"] = records
    opened = open_table(tmp_path / "run.h5")
    keys = [opened.find(name) for name in opened.names]
    whole = opened.read(keys)
    assert len(whole) == 1000  # within the seconds that a child has
    parts = list(opened.blocks(keys[:3], 300))
    for key in keys:
        np.testing.assert_array_equal(whole[key].values, records[key.rsplit("/", 1)[-1]])
    for key in keys[:3]:
        joined = np.concatenate([part[key].values for part in parts])
        np.testing.assert_array_equal(joined, whole[key].values)
