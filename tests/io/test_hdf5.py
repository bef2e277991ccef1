"""HDF5: what is read, how it is stored, and what is refused."""

import os
import resource
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
import pytest

from rotorid import ReadError
from rotorid.io.hdf5 import CHUNK_BYTES, NODES
from rotorid.io.table import DEPTH
from rotorid.testing import open_table


@pytest.fixture
def path(tmp_path):
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


def test_columns(path):
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
    assert sorted(opened.names) == ["force/x", "packed", "position/x", "short", "y"]
    only = opened.read(["adc[1]"])["adc[1]"]
    assert (only.values.tolist(), only.unit) == ([1, 4, 7, 10, 13], "mm")


def test_attributes_of_units(tmp_path):
    """With one bit of its type changed a text is a list, and HDF5 reads beyond its memory."""
    listed = np.empty(1, dtype=object)
    listed[0] = np.arange(3, dtype=np.int8)
    with h5py.File(tmp_path / "run.h5", "w") as data:
        for name in ("one", "two", "list", "empty", "long"):
            data[name] = np.arange(5.0)
        data["one"].attrs["unit"] = "mm"
        data["two"].attrs.update({"units": "", "unit": b"mm"})
        data["list"].attrs.create("units", listed, dtype=h5py.vlen_dtype(np.int8))
        data["empty"].attrs.update({"units": h5py.Empty("f8"), "fs": np.ones(3)})
        data["long"].attrs.create("units", np.zeros(1000))
    found = open_table(tmp_path / "run.h5").read(["one", "two", "list", "empty"])
    assert [column.unit for column in found.values()] == ["mm", "mm", None, None]
    assert open_table(tmp_path / "run.h5").read(["long"])["long"].unit in ("0.0", None)


def test_names_that_are_no_columns(path):
    opened = open_table(path)
    for name, message in {
        "x": "'x' 2 times .*write the whole path",
        "adc": r"'adc' of size 5 x 3.*name\[0\]",
        "adc[3]": "of size 5 x 3",
        "force/x[0]": "of size 5",
        "gain": "a scalar",
        "cube": "5 x 2 x 2",
        "label": "'label' of text; expected real numbers",
        "complex": "'complex' of complex numbers; expected real numbers",
        "force": "no column 'force'",
        "a\0b": "no column",
        "packd": "did you mean packed",
        "adc[99999999999]": "no column",
    }.items():
        with pytest.raises(ReadError, match=message):
            opened.find(name)


def test_scalars(path):
    opened = open_table(path)
    assert (opened.scalar("gain"), opened.scalar("gain2")) == (2.5, 3.5)
    with pytest.raises(ReadError, match=r"no scalar variable 'gian'.*did you mean gain"):
        opened.scalar("gian")


@pytest.mark.parametrize("shape", [(5,), (1, 5), (5, 2)])
def test_packed_numbers(shape, tmp_path):
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
        data.create_dataset("scale", data=np.int16(3)).attrs["scale_factor"] = 0.1
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


def test_numbers_packed_in_no_way_that_is_known(tmp_path):
    factors = (0.0, np.nan, np.inf, "much", [1.0, 2.0])
    with h5py.File(tmp_path / "run.h5", "w") as data:
        for i, value in enumerate(factors):
            data[f"x{i}"] = np.arange(5)
            data[f"x{i}"].attrs["scale_factor"] = value
    opened = open_table(tmp_path / "run.h5")
    for i in range(len(factors)):
        with pytest.raises(ReadError, match=f"scale_factor of '/x{i}' that is no number"):
            opened.read([f"x{i}"])


def test_the_unit_of_a_rate(tmp_path):
    rates = [
        ({"dt": 0.2, "dt_units": "ms"}, 5000.0),
        ({"sample_rate": 5, "sample_rate_unit": b"kHz"}, 5000.0),
        ({"sample_rate": "10 kHz"}, 10_000.0),
        ({"fs": b"2500"}, 2500.0),
        ({"dt": "0.2 ms"}, 5000.0),
        ({"fs": "fast"}, None),
        ({"dt": 200, "time_units": "us"}, 5000.0),
        ({"dt": 0.2, "dt_units": "ticks"}, None),
        ({"dt": 0.2, "dt_units": "ticks", "wf_increment": 1e-3}, 1000.0),
        ({"fs": 5000.0}, 5000.0),
    ]
    with h5py.File(tmp_path / "run.h5", "w") as data:
        for i, (said, _) in enumerate(rates):
            data[f"x{i}"] = np.arange(5.0)
            data[f"x{i}"].attrs.update(said)
    found = open_table(tmp_path / "run.h5").read([f"x{i}" for i in range(len(rates))])
    for column, (said, hertz) in zip(found.values(), rates, strict=True):
        rate = column.rate
        assert (rate and rate.hertz) == (hertz and pytest.approx(hertz)), said


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
def test_what_ends_hdf5_ends_a_child(what, work, path, monkeypatch):
    monkeypatch.setattr(what, ended)
    with pytest.raises(ReadError, match=r"run\.h5: found a file that ends the program that"):
        work(path)


KINDS = ("<f8", ">f8", "<f4", ">i2", "u1", "<i8", "?", "<f2")


@pytest.mark.parametrize("shape", [(24,), (24, 1), (1, 24), (12, 2), (2, 12)])
def test_numbers_are_those_written(shape, tmp_path):
    """After a user's block, in blocks, and whole."""
    values = (np.arange(24) % 2).reshape(shape)
    longer = values if shape[0] > 2 else values.T
    one = 1 in longer.shape or longer.ndim == 1
    with h5py.File(tmp_path / "run.h5", "w", userblock_size=512) as data:
        data["before"] = np.arange(5.0)
        for kind in KINDS:
            data[kind] = values.astype(kind)
        data["later"] = np.arange(5.0)
    table = open_table(tmp_path / "run.h5")
    expected = {kind: values.ravel() for kind in KINDS}
    if not one:
        expected = {f"{kind}[{i}]": longer[:, i] for kind in KINDS for i in range(2)}
    for asked in ([*expected][::-1], [*expected][::2]):
        found, blocks = table.read(asked), list(table.blocks(asked, 5))
        sizes = [len(block[asked[0]].values) for block in blocks]
        assert sizes == [5] * (len(longer) // 5) + [len(longer) % 5]
        for name in asked:
            parts = [block[name].values for block in blocks]
            assert {found[name].values.dtype, *(p.dtype for p in parts)} == {np.dtype(float)}
            np.testing.assert_array_equal(found[name].values, expected[name])
            np.testing.assert_array_equal(np.concatenate(parts), expected[name])


def test_numbers_that_hdf5_converts(tmp_path):
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


def test_what_nobody_wrote_is_known_by_a_few_questions(tmp_path, monkeypatch, output):
    """One question for each field of a table took a minute; links lead to nothing more."""
    with h5py.File(tmp_path / "run.h5", "w") as data:
        table = np.dtype([(f"c{k}", "f8") for k in range(500)])
        data.create_dataset("run/table", (700,), table)
        data["run/link"] = h5py.SoftLink("/nowhere")
        data["run/x"] = np.arange(700.0)
    asked, fork = [], os.fork
    monkeypatch.setattr(os, "fork", lambda: (asked.append(None), fork())[1])
    assert "# not used: x" in output("new", tmp_path / "run.h5")
    assert 0 < len(asked) < 10
    opened = open_table(tmp_path / "run.h5")
    with pytest.raises(ReadError, match=r"no sample written: a gap in '/run/table'"):
        opened.read([opened.find("c3")])


def test_the_fields_of_a_table_of_records_are_read_together(tmp_path):
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


# HDF5 files whose samples are not there, are elsewhere, or are far too many.


VALUES = np.arange(600.0)


@pytest.fixture
def file(tmp_path):
    return tmp_path / "run.h5"


@contextmanager
def cheap(seconds: float = 5.0, megabytes: float = 500.0) -> Iterator[None]:
    """Hold what is inside to a time and a memory."""
    before, started = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    yield
    assert time.process_time() - started < seconds
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1000 * megabytes


def column(file: Path, name: str = "x") -> list[float]:
    opened = open_table(file)
    found = opened.find(name)
    return list(opened.read([found])[found].values.tolist())


def refused(file: Path, told: str, name: str = "x") -> None:
    with pytest.raises(ReadError, match=told):
        column(file, name)


def part(file: Path, values: np.ndarray = VALUES, name: str = "x") -> Path:
    with h5py.File(file, "a") as data:
        data[name] = values
    return file


def virtual(file: Path, *sources: tuple[str, str, int], size: int = 600) -> None:
    """Write a virtual data set of parts of 200 samples: file, data set, where it goes."""
    layout = h5py.VirtualLayout(shape=(size,), dtype="f8")
    for source, name, begin in sources:
        layout[begin : begin + 200] = h5py.VirtualSource(source, name, shape=(200,))
    with h5py.File(file, "w") as data:
        data.create_virtual_dataset("x", layout)


PARTS = tuple((f"part{i}.h5", "x", 200 * i) for i in range(3))


def write_parts(folder: Path) -> None:
    for file, _, begin in PARTS:
        part(folder / file, VALUES[begin : begin + 200])


def test_virtual_data_sets_that_are_whole(file, tmp_path):
    write_parts(tmp_path)
    virtual(file, *PARTS)
    assert column(file) == VALUES.tolist()
    blocks = [block["x"].values for block in open_table(file).blocks(["x"], 100)]
    assert np.concatenate(blocks).tolist() == VALUES.tolist()
    nested = part(tmp_path / "nested.h5", VALUES, "raw")  # of another file, and of its own
    for name, (source, inside) in {"x": (file.name, "x"), "own": (".", "raw")}.items():
        layout = h5py.VirtualLayout(shape=(300,), dtype="f8")
        layout[:] = h5py.VirtualSource(source, inside, shape=(600,))[::2]
        with h5py.File(nested, "a") as data:
            data.create_virtual_dataset(name, layout)
        assert column(nested, name) == VALUES[::2].tolist()


@pytest.mark.slow
@pytest.mark.parametrize("gone", range(3))
def test_a_part_that_is_gone_is_a_gap(gone, file, tmp_path):
    """HDF5 reads it as 0.0 without a word."""
    write_parts(tmp_path)
    virtual(file, *PARTS)
    (tmp_path / PARTS[gone][0]).unlink()
    refused(file, rf"part{gone}.h5: found no such file; expected a part of")
    part(tmp_path / PARTS[gone][0], VALUES[:200], "y")
    refused(file, rf"part{gone}.h5: found no numbers 'x', a part of '/x'")
    part(tmp_path / PARTS[gone][0], VALUES[:199])
    refused(file, rf"part{gone}.h5: found \(199,\) where /x takes \(200,\)")
    with pytest.raises(ReadError, match="a gap"):
        next(open_table(file).blocks(["x"], 100))


def test_a_stretch_in_no_part_is_a_gap(file, tmp_path):
    write_parts(tmp_path)
    virtual(file, PARTS[0], PARTS[2])
    refused(file, "found 200 samples in none of its parts: a gap in '/x'")
    virtual(file, *PARTS, ("part0.h5", "x", 100), size=601)
    refused(file, "found 1 samples in none of its parts")
    with h5py.File(tmp_path / "part1.h5", "w") as data:  # and a gap in a part
        data.create_dataset("x", shape=(200,), dtype="f8")
    virtual(file, *PARTS)
    refused(file, r"part1.h5: found no sample written: a gap")


def test_parts_elsewhere(file, tmp_path):
    """Parts lie below the record's folder, and are files."""
    inner = tmp_path / "data"
    inner.mkdir()
    part(tmp_path / "outside.h5", VALUES[:200])
    os.mkfifo(inner / "pipe.h5")
    (inner / "link.h5").symlink_to(tmp_path / "outside.h5")
    for name in ("../outside.h5", str(tmp_path / "outside.h5"), "link.h5", "/dev/zero"):
        virtual(inner / "run.h5", (name, "x", 0), size=200)
        with pytest.raises(ReadError, match="expected samples in the record, or in files below"):
            column(inner / "run.h5")
    virtual(inner / "run.h5", ("pipe.h5", "x", 0), size=200)
    with cheap(), pytest.raises(ReadError, match=r"pipe.h5: found a pipe; expected a part of"):
        column(inner / "run.h5")


def test_parts_of_themselves_and_without_end(file, tmp_path):
    virtual(file, ("run.h5", "x", 0), size=200)
    refused(file, r"parts of parts, 4 deep, of '/x'")
    part(tmp_path / "part0.h5", VALUES[:200], "raw")
    for name in ("part%b.h5", "run.h5"):
        plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        space = h5py.h5s.create_simple((200,), (h5py.h5s.UNLIMITED,))
        source = h5py.h5s.create_simple((200,), None if "%" in name else (h5py.h5s.UNLIMITED,))
        space.select_hyperslab((0,), (h5py.h5s.UNLIMITED,), (200,), (200,))
        if "%" not in name:
            source.select_hyperslab((0,), (h5py.h5s.UNLIMITED,), (200,), (200,))
        plan.set_virtual(space, name.encode(), b"raw", source)
        with h5py.File(file, "w") as data:
            data["raw"] = VALUES
            h5py.h5d.create(data.id, b"x", h5py.h5t.IEEE_F64LE, space, plan)
        refused(file, "parts without end")


@pytest.mark.slow
def test_many_parts(file):
    layout = h5py.VirtualLayout(shape=(500, 2), dtype="f8")
    with h5py.File(file, "w") as data:
        data["raw"] = np.arange(1000.0).reshape(-1, 2)
        source = h5py.VirtualSource(data["raw"])
        for i in range(500):
            layout[i] = source[i]
        data.create_virtual_dataset("x", layout)
    with cheap():
        assert column(file, "x[1]") == list(range(1, 1000, 2))


def test_samples_in_files_of_their_own_are_refused(file):
    with h5py.File(file, "w") as data:
        data.create_dataset("x", shape=(600,), dtype="f8", external=[("x.bin", 0, 4800)])
    refused(file, "samples of '/x' in files of their own; expected samples in the file itself")


def test_links_into_other_files_are_not_followed(file, tmp_path):
    part(tmp_path / "other.h5")
    with h5py.File(file, "w") as data:
        data["x"] = h5py.ExternalLink("other.h5", "/x")
        data["soft"] = h5py.SoftLink("/x")
        data["group/x2"] = VALUES
        data["alias"] = h5py.SoftLink("/group")
        data["round"] = h5py.SoftLink("/round")
    for name in ("x", "soft"):
        refused(file, r"a link into another file \(other.h5: name it in", name)
    assert column(file, "alias/x2") == VALUES.tolist()
    refused(file, "no column 'round'", "round")


def test_samples_that_nobody_wrote(file):
    """They read as the fill value: 1.7 kB for a hundred million of them."""
    with h5py.File(file, "w") as data:
        data.create_dataset("x", shape=(10**8,), dtype="f8")
        data.create_dataset("y", shape=(10**8,), dtype="i1", chunks=(10**6,))
        data.create_dataset("half", shape=(600,), dtype="f8", chunks=(100,))[:350] = 1.0
        data.create_dataset("told", (600,), "f8", chunks=(100,), fillvalue=np.nan)[:350] = 1.0
        data.create_dataset("one", shape=(), dtype="f8")
        data.create_dataset("none", shape=(0,), dtype="f8")
    with cheap(1.0, 50):
        for name, found in (
            ("x", "no sample written: a gap in '/x'"),
            ("y", "100 of 100 chunks never written"),
            ("half", "2 of 6 chunks never written"),
        ):
            with pytest.raises(ReadError, match=found):
                column(file, name)
            with pytest.raises(ReadError, match=found):
                next(open_table(file).blocks([name], 100))
    assert np.isnan(column(file, "told")).sum() == 200 + 50
    assert column(file, "none") == []
    with pytest.raises(ReadError, match="no sample written"):
        open_table(file).scalar("one")


def test_chunks_that_fill_the_memory(file):
    rows = CHUNK_BYTES // 8
    with h5py.File(file, "w") as data:
        for name, more in (("x", 1), ("y", 0)):
            shape = (rows + more,)
            one = data.create_dataset(name, shape, "f8", chunks=shape, compression="gzip")
            one.id.write_direct_chunk((0,), b"no zlib data")
    with cheap(1.0, 50), pytest.raises(ReadError, match=r"chunks of 256 MB in '/x'.*h5repack"):
        column(file)
    with cheap(1.0, 50), pytest.raises(ReadError, match="bytes of numbers declared"):
        column(file, "y")


@pytest.mark.slow
def test_zeros_that_pack_without_bound(file):
    """A channel at rest may be large; twelve of them from a few kB are too much."""
    with h5py.File(file, "w") as data:
        for i in range(12):
            zeros, packed = np.zeros(2_000_000), {"chunks": (10**5,), "compression": "gzip"}
            data.create_dataset(f"x{i}", data=zeros, **packed)
    opened = open_table(file)
    assert len(opened.read(["x0"])["x0"].values) == 2_000_000
    with pytest.raises(ReadError, match="192000000 bytes of numbers declared"):
        opened.read([f"x{i}" for i in range(12)])


@pytest.mark.slow
def test_many_data_sets(file):
    """One that is named whole is found among any number; a search has its bounds."""
    with h5py.File(file, "w", libver="latest") as data:
        space = h5py.h5s.create_simple((4,))
        for i in range(NODES):
            h5py.h5d.create(data.id, b"d%d" % i, h5py.h5t.IEEE_F64LE, space)
        data["log/x"] = np.arange(4.0)
        data["log/adc"] = np.arange(8.0).reshape(4, 2)
    with cheap():
        assert column(file, "log/x") == [0, 1, 2, 3]
        assert column(file, "log/adc[1]") == column(file, "/log/adc[:,1]") == [1, 3, 5, 7]
        refused(file, r"more than 10000 groups and data sets.*whole path", "x")


@pytest.mark.slow
def test_nested_groups(file):
    deep = "a/" * DEPTH + "x"
    with h5py.File(file, "w") as data:
        data[deep] = VALUES
        group = data.create_group("b")
        for _ in range(5000):
            group = group.create_group("b")
    with cheap():
        assert column(part(file.with_name("deep.h5"), VALUES, deep)) == VALUES.tolist()
        assert column(file, deep) == VALUES.tolist()
        for name in ("x", "a/" * (DEPTH + 1) + "x"):
            refused(file, "more than 64 groups in one another", name)


def test_groups_that_hold_themselves(file):
    with h5py.File(file, "w") as data:
        data["a/x"] = VALUES
        data["a/a"] = data["a"]
        data["again"] = data["a/x"]
    assert open_table(file).names in (["x"], ["again"])


@pytest.mark.parametrize("raw", ["Kr\xe4fte".encode(), "Kr\xe4fte".encode("latin-1")])
def test_names_in_older_letters(raw, file):
    """Programs of Windows wrote names in their own code page."""
    with h5py.File(file, "w") as data:
        group = data.create_group(raw)
        group[b"x"] = VALUES
        group.attrs["fs"] = 1000.0
        data[raw + b"2"] = VALUES
    opened = open_table(file)
    assert sorted(opened.names) == ["Kr\xe4fte2", "x"]
    assert column(file, "Kr\xe4fte/x") == column(file, "Kr\xe4fte2") == VALUES.tolist()
    assert opened.read(["Kr\xe4fte/x"])["Kr\xe4fte/x"].rate is not None


@pytest.mark.parametrize("size", [512, 2048, 1 << 20])
def test_a_block_before_the_file(size, file):
    with h5py.File(file, "w", userblock_size=size) as data:
        data["x"] = VALUES
    with file.open("r+b") as stream:
        stream.write(b"written by a logger")
    assert column(file) == VALUES.tolist()
    other = file.with_suffix(".mat")
    file.rename(other)
    assert open_table(other).names == ["x"]


def test_types_that_are_no_numbers(file):
    kinds = {
        "text": (np.array([b"a", b"b"]), "text"),
        "texts": (np.array(["a", "b"], dtype=h5py.string_dtype()), "text"),
        "lists": (np.array([np.ones(2), np.ones(3)], dtype=object), "lists"),
        "states": (np.zeros(3, dtype=h5py.enum_dtype({"OFF": 0, "ON": 1})), "names of an enumera"),
        "complex": (np.ones(3) * 1j, "complex numbers"),
        "nested": (np.zeros(3, dtype=[("a", [("b", "f8")])]), None),
        "opaque": (np.zeros(3, dtype="V8"), "another type"),
    }
    with h5py.File(file, "w") as data:
        for kind, (values, _) in kinds.items():
            dtype = h5py.vlen_dtype("f8") if kind == "lists" else values.dtype
            data.create_dataset(kind, data=values, dtype=dtype)
        data["bits"] = np.array([True, False])
    opened = open_table(file)
    for kind, (_, told) in kinds.items():
        message = f"'{kind}' of {told}" if told else "no column 'nested'"
        with pytest.raises(ReadError, match=message):
            opened.find(kind)
    assert opened.names == ["bits"]
    assert column(file, "bits") == [1, 0]


def test_references_and_fields(file):
    table = np.zeros(3, dtype=[("f", "f8"), ("c", "c16"), ("s", "S3"), ("row", "f8", (2,))])
    table["f"] = [1, 2, 3]
    with h5py.File(file, "w") as data:
        data["raw"] = VALUES
        data.create_dataset("x", data=np.array([data["raw"].ref], dtype=h5py.ref_dtype))
        data["table"] = table
    refused(file, "'x' of references")
    assert column(file, "table/f") == [1, 2, 3]
    for name in ("c", "s", "row"):
        refused(file, "real numbers", f"table/{name}")
    refused(file, "no column 'table'", "table")
