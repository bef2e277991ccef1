"""Parquet, TDMS, MDF and MAT files that stand for far more numbers than their bytes can hold."""

from __future__ import annotations

import struct
import time
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from io_writers import WRITERS, write_mdf, write_tdms, write_uff

from rotorid import ReadError
from rotorid.io import open_table, open_tables, sandbox
from rotorid.io.table import COLUMNS, check_held

TOO_MANY = "bytes of numbers declared in .* bytes; expected numbers that the file holds"


def test_what_bytes_may_stand_for() -> None:
    for size, held in ((64_000_000, 1), (250_000_000, 1_000_000)):
        check_held(size, held, "run.h5")
        with pytest.raises(ReadError, match=TOO_MANY):
            check_held(size + 1, held, "run.h5")


def test_columns_at_rest_together(tmp_path: Path) -> None:
    """One of a few kB may be large; twenty of them are too much."""
    path = tmp_path / "run.mat"
    values = {f"x{i}": np.zeros(500_000) for i in range(20)}
    scipy.io.savemat(path, {"x0": values["x0"]}, do_compression=True)
    assert len(open_table(path).read(["x0"])["x0"].values) == 500_000
    scipy.io.savemat(path, values, do_compression=True)
    with pytest.raises(ReadError, match=TOO_MANY):
        open_table(path)


@pytest.mark.slow
def test_parquet(tmp_path: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet")
    pa = pytest.importorskip("pyarrow")
    path = tmp_path / "run.parquet"
    pq.write_table(pa.table({"x": np.zeros(8_000_001)}), path)
    with pytest.raises(ReadError, match=TOO_MANY):
        open_table(path)
    pq.write_table(pa.table({f"x{i}": np.zeros(500_000) for i in range(20)}), path)
    opened = open_table(path)
    with pytest.raises(ReadError, match=TOO_MANY):
        opened.read([f"x{i}" for i in range(20)])
    started = time.process_time()
    pq.write_table(pa.table({f"x{i}": [1.0, 2.0] for i in range(COLUMNS + 1)}), path)
    with pytest.raises(ReadError, match="found 10001 columns; expected 10000 at most"):
        open_table(path)
    assert time.process_time() - started < 5


def test_mdf(tmp_path: Path) -> None:
    """A packed block says how large it is unpacked, and the reader would believe it."""
    asammdf = pytest.importorskip("asammdf")
    path = tmp_path / "run.mf4"
    write_mdf(path, {"x": (np.sin(np.arange(20_000) / 50), "um")})
    with asammdf.MDF(path) as data:
        data.save(tmp_path / "packed.mf4", compression=2)
    path = tmp_path / "packed.mf4"
    whole = path.read_bytes()
    assert len(open_table(path).read(["0/x"])["0/x"].values) == 20_000
    place = whole.find(b"##DZ")
    damaged = bytearray(whole)
    for size in (64_000_001, 20_000_000_000, 1 << 62):
        struct.pack_into("<Q", damaged, place + 32, size)
        path.write_bytes(damaged)
        with pytest.raises(ReadError, match=r"ends the program that reads it|damaged MDF data"):
            open_table(path).read(["0/x"])


def test_many_names_take_time_by_their_number(tmp_path: Path) -> None:
    started = time.process_time()
    for part in "ab":
        rows = [",".join(f"{part}{i}" for i in range(9000)), *[",".join("1" * 9000)] * 3]
        (tmp_path / f"{part}.csv").write_text("\n".join(rows))
    assert len(open_tables([tmp_path / "a.csv", tmp_path / "b.csv"]).names) == 18_000
    assert time.process_time() - started < 4


def test_a_file_twice_by_other_names(tmp_path: Path) -> None:
    WRITERS["run.csv"](tmp_path / "run.csv", {"x": (np.ones(4), "um")})
    (tmp_path / "link.csv").symlink_to("run.csv")
    with pytest.raises(ReadError, match="found a file twice"):
        open_tables([tmp_path / "run.csv", tmp_path / "link.csv"])


def test_tdms_of_very_many_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A million segments take 40 s: a child has seconds by the size of its file."""
    pytest.importorskip("nptdms")
    path = tmp_path / "run.tdms"
    write_tdms(path, {"x": (np.arange(4.0), "m"), "y": (np.arange(4.0), "m")})
    first = path.read_bytes()
    bare = struct.pack("<4siiqq4d", b"TDSm", 1 << 3, 4712, 32, 0, *range(4))
    path.write_bytes(first + 16 * bare)
    assert len(open_table(path).read(["x"])["x"].values) == 36
    monkeypatch.setattr(sandbox, "LEAST", 1)
    monkeypatch.setattr(sandbox, "SPEED", 1e9)
    path.write_bytes(first + 300_000 * bare)
    with pytest.raises(ReadError, match="or never lets it end"):
        open_table(path)


def test_universal_files_of_very_many_sets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pyuff")
    path = tmp_path / "run.uff"
    write_uff(path, {"x": (np.arange(4.0), "m")})
    one = path.read_bytes()
    path.write_bytes(one * 5)
    assert len(open_table(path).names) == 5
    monkeypatch.setattr(sandbox, "LEAST", 1)
    monkeypatch.setattr(sandbox, "SPEED", 1e9)
    path.write_bytes(one * 20_000)
    with pytest.raises(ReadError, match="or never lets it end"):
        open_table(path)
