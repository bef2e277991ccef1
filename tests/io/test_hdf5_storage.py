"""HDF5 files whose samples are not there, are elsewhere, or are far too many."""

from __future__ import annotations

import os
import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
import pytest

from rotorid import ReadError
from rotorid.io import hdf5, open_table
from rotorid.io.hdf5 import CHUNK_BYTES, NODES
from rotorid.io.table import DEPTH

VALUES = np.arange(600.0)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.h5"


@contextmanager
def cheap(seconds: float = 5.0, megabytes: float = 500.0) -> Iterator[None]:
    """Hold what is inside to a time and a memory."""
    before, started = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    yield
    assert time.process_time() - started < seconds
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1000 * megabytes


def column(path: Path, name: str = "x") -> list[float]:
    opened = open_table(path)
    found = opened.find(name)
    return list(opened.read([found])[found].values.tolist())


def part(path: Path, values: np.ndarray = VALUES, name: str = "x") -> Path:
    with h5py.File(path, "a") as data:
        data[name] = values
    return path


def virtual(path: Path, *sources: tuple[str, str, int], size: int = 600) -> None:
    """Write a virtual data set of parts of 200 samples: file, data set, where it goes."""
    layout = h5py.VirtualLayout(shape=(size,), dtype="f8")
    for file, name, begin in sources:
        layout[begin : begin + 200] = h5py.VirtualSource(file, name, shape=(200,))
    with h5py.File(path, "w") as data:
        data.create_virtual_dataset("x", layout)


PARTS = tuple((f"part{i}.h5", "x", 200 * i) for i in range(3))


def write_parts(folder: Path) -> None:
    for i, (file, _, begin) in enumerate(PARTS):
        part(folder / file, VALUES[begin : begin + 200] + 0 * i)


def test_virtual_data_sets_that_are_whole(path: Path, tmp_path: Path) -> None:
    write_parts(tmp_path)
    virtual(path, *PARTS)
    assert column(path) == VALUES.tolist()
    opened = open_table(path)
    blocks = [block["x"].values for block in opened.blocks(["x"], 100)]
    assert np.concatenate(blocks).tolist() == VALUES.tolist()
    (tmp_path / "inner").mkdir()
    nested = tmp_path / "nested.h5"
    layout = h5py.VirtualLayout(shape=(600,), dtype="f8")
    layout[:] = h5py.VirtualSource(path.name, "x", shape=(600,))
    with h5py.File(nested, "w") as data:
        data.create_virtual_dataset("x", layout)
    assert column(nested) == VALUES.tolist()


def test_virtual_data_sets_in_their_own_file(path: Path) -> None:
    part(path, VALUES, "raw")
    layout = h5py.VirtualLayout(shape=(300,), dtype="f8")
    with h5py.File(path, "a") as data:
        layout[:] = h5py.VirtualSource(".", "raw", shape=(600,))[::2]
        data.create_virtual_dataset("x", layout)
    assert column(path) == VALUES[::2].tolist()


@pytest.mark.slow
@pytest.mark.parametrize("gone", range(3))
def test_a_part_that_is_gone_is_a_gap(gone: int, path: Path, tmp_path: Path) -> None:
    """HDF5 reads it as 0.0 without a word."""
    write_parts(tmp_path)
    virtual(path, *PARTS)
    (tmp_path / PARTS[gone][0]).unlink()
    with pytest.raises(ReadError, match=rf"part{gone}.h5: found no such file; expected a part of"):
        column(path)
    part(tmp_path / PARTS[gone][0], VALUES[:200], "y")
    with pytest.raises(ReadError, match=rf"part{gone}.h5: found no numbers 'x', a part of '/x'"):
        column(path)
    part(tmp_path / PARTS[gone][0], VALUES[:199])
    with pytest.raises(ReadError, match=rf"part{gone}.h5: found \(199,\) where /x takes \(200,\)"):
        column(path)
    with pytest.raises(ReadError, match="a gap"):
        next(open_table(path).blocks(["x"], 100))


def test_a_stretch_in_no_part_is_a_gap(path: Path, tmp_path: Path) -> None:
    write_parts(tmp_path)
    virtual(path, PARTS[0], PARTS[2])
    with pytest.raises(ReadError, match="found 200 samples in none of its parts: a gap in '/x'"):
        column(path)
    virtual(path, *PARTS, ("part0.h5", "x", 100), size=601)
    with pytest.raises(ReadError, match="found 1 samples in none of its parts"):
        column(path)


def test_a_gap_in_a_part(path: Path, tmp_path: Path) -> None:
    write_parts(tmp_path)
    with h5py.File(tmp_path / "part1.h5", "w") as data:
        data.create_dataset("x", shape=(200,), dtype="f8")
    virtual(path, *PARTS)
    with pytest.raises(ReadError, match=r"part1.h5: found no sample written: a gap"):
        column(path)


def test_parts_elsewhere(path: Path, tmp_path: Path) -> None:
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


def test_parts_of_themselves_and_without_end(path: Path, tmp_path: Path) -> None:
    virtual(path, ("run.h5", "x", 0), size=200)
    with pytest.raises(ReadError, match=r"parts of parts, 4 deep, of '/x'"):
        column(path)
    part(tmp_path / "part0.h5", VALUES[:200], "raw")
    for name in ("part%b.h5", "run.h5"):
        plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        space = h5py.h5s.create_simple((200,), (h5py.h5s.UNLIMITED,))
        source = h5py.h5s.create_simple((200,), None if "%" in name else (h5py.h5s.UNLIMITED,))
        space.select_hyperslab((0,), (h5py.h5s.UNLIMITED,), (200,), (200,))
        if "%" not in name:
            source.select_hyperslab((0,), (h5py.h5s.UNLIMITED,), (200,), (200,))
        plan.set_virtual(space, name.encode(), b"raw", source)
        with h5py.File(path, "w") as data:
            data["raw"] = VALUES
            h5py.h5d.create(data.id, b"x", h5py.h5t.IEEE_F64LE, space, plan)
        with pytest.raises(ReadError, match="parts without end"):
            column(path)


@pytest.mark.slow
@pytest.mark.parametrize("more", [0, 1])
def test_many_parts(more: int, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second a file for an hour is looked at in seconds; more is refused."""
    monkeypatch.setattr(hdf5, "PARTS", 500)
    layout = h5py.VirtualLayout(shape=(500 + more, 2), dtype="f8")
    with h5py.File(path, "w") as data:
        data["raw"] = np.arange(1000.0 + 2 * more).reshape(-1, 2)
        source = h5py.VirtualSource(data["raw"])
        for i in range(500 + more):
            layout[i] = source[i]
        data.create_virtual_dataset("x", layout)
    if more:
        with pytest.raises(ReadError, match="501 parts of '/x'; expected 500 at most"):
            column(path, "x[1]")
    else:
        with cheap():
            assert column(path, "x[1]") == list(range(1, 1000, 2))


def external(path: Path, *files: tuple[str, int, int]) -> None:
    with h5py.File(path, "w") as data:
        data.create_dataset("x", shape=(600,), dtype="f8", external=list(files))


def test_samples_in_files_of_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They lie below the record's folder, wherever the process runs, and hold every sample."""
    inner = tmp_path / "data"
    inner.mkdir()
    VALUES.tofile(inner / "x.bin")
    monkeypatch.chdir(tmp_path)
    path = inner / "run.h5"
    external(path, ("x.bin", 0, 4800))
    assert column(path) == VALUES.tolist()
    external(path, ("x.bin", 0, h5py.h5f.UNLIMITED))
    assert column(path) == VALUES.tolist()
    external(path, ("x.bin", 8, 4800))
    with pytest.raises(ReadError, match=r"4792 of 4800 bytes in x.bin: a gap in '/x'"):
        column(path)
    os.mkfifo(inner / "pipe")
    external(path, ("pipe", 0, 4800))
    with cheap(), pytest.raises(ReadError, match="found a pipe; expected a part of"):
        column(path)
    for name in ("/dev/zero", "../x.bin", "/etc/passwd"):
        external(path, (name, 0, 4800))
        with pytest.raises(ReadError, match="expected samples in the record, or in files below"):
            column(path)


def test_links_into_other_files_are_not_followed(path: Path, tmp_path: Path) -> None:
    part(tmp_path / "other.h5")
    with h5py.File(path, "w") as data:
        data["x"] = h5py.ExternalLink("other.h5", "/x")
        data["soft"] = h5py.SoftLink("/x")
        data["group/x2"] = VALUES
        data["alias"] = h5py.SoftLink("/group")
        data["round"] = h5py.SoftLink("/round")
    for name in ("x", "soft"):
        with pytest.raises(ReadError, match=r"a link into another file \(other.h5: name it in"):
            column(path, name)
    assert column(path, "alias/x2") == VALUES.tolist()
    with pytest.raises(ReadError, match="no column 'round'"):
        column(path, "round")


def test_samples_that_nobody_wrote(path: Path) -> None:
    """They read as the fill value: 1.7 kB for a hundred million of them."""
    with h5py.File(path, "w") as data:
        data.create_dataset("x", shape=(10**8,), dtype="f8")
        data.create_dataset("y", shape=(10**8,), dtype="i1", chunks=(10**6,))
        half = data.create_dataset("half", shape=(600,), dtype="f8", chunks=(100,))
        half[:350] = 1.0
        told = data.create_dataset("told", (600,), "f8", chunks=(100,), fillvalue=np.nan)
        told[:350] = 1.0
        data.create_dataset("one", shape=(), dtype="f8")
        data.create_dataset("none", shape=(0,), dtype="f8")
    with cheap(1.0, 50):
        for name, found in (
            ("x", "no sample written: a gap in '/x'"),
            ("y", "100 of 100 chunks never written"),
            ("half", "2 of 6 chunks never written"),
        ):
            with pytest.raises(ReadError, match=found):
                column(path, name)
            with pytest.raises(ReadError, match=found):
                next(open_table(path).blocks([name], 100))
    assert np.isnan(column(path, "told")).sum() == 200 + 50
    assert column(path, "none") == []
    with pytest.raises(ReadError, match="no sample written"):
        open_table(path).scalar("one")


def test_chunks_that_fill_the_memory(path: Path) -> None:
    rows = CHUNK_BYTES // 8
    with h5py.File(path, "w") as data:
        for name, more in (("x", 1), ("y", 0)):
            one = data.create_dataset(
                name, (rows + more,), "f8", chunks=(rows + more,), compression="gzip"
            )
            one.id.write_direct_chunk((0,), b"no zlib data")
    with cheap(1.0, 50), pytest.raises(ReadError, match=r"chunks of 256 MB in '/x'.*h5repack"):
        column(path)
    with cheap(1.0, 50), pytest.raises(ReadError, match="bytes of numbers declared"):
        column(path, "y")


@pytest.mark.slow
def test_zeros_that_pack_without_bound(path: Path) -> None:
    """A channel at rest may be large; twelve of them from a few kB are too much."""
    with h5py.File(path, "w") as data:
        for i in range(12):
            data.create_dataset(
                f"x{i}", data=np.zeros(2_000_000), chunks=(10**5,), compression="gzip"
            )
    opened = open_table(path)
    assert len(opened.read(["x0"])["x0"].values) == 2_000_000
    with pytest.raises(ReadError, match="192000000 bytes of numbers declared"):
        opened.read([f"x{i}" for i in range(12)])


@pytest.mark.slow
def test_many_data_sets(path: Path) -> None:
    """One that is named whole is found among any number; a search has its bounds."""
    with h5py.File(path, "w", libver="latest") as data:
        space = h5py.h5s.create_simple((4,))
        for i in range(NODES):
            h5py.h5d.create(data.id, b"d%d" % i, h5py.h5t.IEEE_F64LE, space)
        data["log/x"] = np.arange(4.0)
        data["log/adc"] = np.arange(8.0).reshape(4, 2)
    with cheap():
        assert column(path, "log/x") == [0, 1, 2, 3]
        assert column(path, "log/adc[1]") == column(path, "/log/adc[:,1]") == [1, 3, 5, 7]
        with pytest.raises(ReadError, match=r"more than 10000 groups and data sets.*whole path"):
            column(path, "x")


@pytest.mark.slow
def test_nested_groups(path: Path) -> None:
    with h5py.File(path, "w") as data:
        data["a/" * DEPTH + "x"] = VALUES
        group = data.create_group("b")
        for _ in range(5000):
            group = group.create_group("b")
    with cheap():
        assert column(path, "a/" * DEPTH + "x") == VALUES.tolist()
        with pytest.raises(ReadError, match="more than 64 groups in one another"):
            column(path, "x")
        with pytest.raises(ReadError, match="more than 64 groups in one another"):
            column(path, "a/" * (DEPTH + 1) + "x")


def test_a_search_to_the_allowed_depth(path: Path) -> None:
    part(path, VALUES, "a/" * DEPTH + "x")
    assert column(path, "x") == VALUES.tolist()


def test_groups_that_hold_themselves(path: Path) -> None:
    with h5py.File(path, "w") as data:
        data["a/x"] = VALUES
        data["a/a"] = data["a"]
        data["again"] = data["a/x"]
    assert open_table(path).names in (["x"], ["again"])


@pytest.mark.parametrize("raw", ["Kr\xe4fte".encode(), "Kr\xe4fte".encode("latin-1")])
def test_names_in_older_letters(raw: bytes, path: Path) -> None:
    """Programs of Windows wrote names in their own code page."""
    with h5py.File(path, "w") as data:
        group = data.create_group(raw)
        group[b"x"] = VALUES
        group.attrs["fs"] = 1000.0
        data[raw + b"2"] = VALUES
    opened = open_table(path)
    assert sorted(opened.names) == ["Kr\xe4fte2", "x"]
    assert column(path, "Kr\xe4fte/x") == column(path, "Kr\xe4fte2") == VALUES.tolist()
    assert opened.read(["Kr\xe4fte/x"])["Kr\xe4fte/x"].rate is not None


@pytest.mark.parametrize("size", [512, 2048, 1 << 20])
def test_a_block_before_the_file(size: int, path: Path) -> None:
    with h5py.File(path, "w", userblock_size=size) as data:
        data["x"] = VALUES
    with path.open("r+b") as stream:
        stream.write(b"written by a logger")
    assert column(path) == VALUES.tolist()
    other = path.with_suffix(".mat")
    path.rename(other)
    assert open_table(other).names == ["x"]


KINDS = {
    "text": (np.array([b"a", b"b"]), "text"),
    "texts": (np.array(["a", "b"], dtype=h5py.string_dtype()), "text"),
    "lists": (np.array([np.ones(2), np.ones(3)], dtype=object), "lists"),
    "states": (np.zeros(3, dtype=h5py.enum_dtype({"OFF": 0, "ON": 1})), "names of an enumeration"),
    "complex": (np.ones(3) * 1j, "complex numbers"),
    "nested": (np.zeros(3, dtype=[("a", [("b", "f8")])]), None),
    "opaque": (np.zeros(3, dtype="V8"), "another type"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_types_that_are_no_numbers(kind: str, path: Path) -> None:
    values, told = KINDS[kind]
    with h5py.File(path, "w") as data:
        dtype = h5py.vlen_dtype("f8") if kind == "lists" else values.dtype
        data.create_dataset("x", data=values, dtype=dtype)
        data["bits"] = np.array([True, False])
    expected = f"'x' of {told}; expected real numbers" if told else "no column 'x'"
    with pytest.raises(ReadError, match=expected):
        column(path)
    assert open_table(path).names == ["bits"]
    assert column(path, "bits") == [1, 0]


def test_references_and_fields(path: Path) -> None:
    table = np.zeros(3, dtype=[("f", "f8"), ("c", "c16"), ("s", "S3"), ("row", "f8", (2,))])
    table["f"] = [1, 2, 3]
    with h5py.File(path, "w") as data:
        data["raw"] = VALUES
        data.create_dataset("x", data=np.array([data["raw"].ref], dtype=h5py.ref_dtype))
        data["table"] = table
    with pytest.raises(ReadError, match="'x' of references"):
        column(path)
    assert column(path, "table/f") == [1, 2, 3]
    for name in ("c", "s", "row"):
        with pytest.raises(ReadError, match="real numbers"):
            column(path, f"table/{name}")
    with pytest.raises(ReadError, match="no column 'table'"):
        column(path, "table")


def test_attributes_that_are_no_units(path: Path) -> None:
    with h5py.File(path, "w", track_order=True) as data:
        data["x"] = VALUES
        data["x"].attrs["units"] = h5py.Empty("f8")
        data["x"].attrs["fs"] = np.ones(3)
        data["y"] = VALUES
        data["y"].attrs.create("units", np.zeros(7000))
    opened = open_table(path)
    assert opened.read(["x"])["x"].unit is None
    assert opened.read(["y"])["y"].unit in ("0.0", None)
