"""Text tables that are no tables: long lines, fields and heads, in time that grows with them."""

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
from rotorid.io import text as delimited
from rotorid.io.table import COLUMNS, check_held
from rotorid.io.text import (
    DIGITS,
    LINE_CHARACTERS,
    PREAMBLE_CHARACTERS,
    SMALL_TEXT,
    UNIT_CHARACTERS,
    find_dialect,
    is_value,
)

# -------------------------------------------------------------------------------------------------
# Text tables that are no tables: long lines, fields and heads, in time that grows with them.


ROWS = "1,2\n" * 600


def table(folder: Path, text: str | bytes) -> Path:
    path = folder / "run.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(
    "head",
    [
        '"' + " (" * 60_000 + '",y\n',
        '"a' + " " * 120_000 + '[",y\n',
        '"' + "a[b" * 40_000 + ']",y\n',
        "1" * 120_000 + "x,y\n",
        "1:" * 60_000 + ",y\n",
        ("sample rate " * 90 + "\n") * 390 + "x,y\n",
        ("sampling interval" + " " * 900 + "-\n") * 390 + "x,y\n",
        ("sample time [[[(" * 70 + "\n") * 390 + "x,y\n",
    ],
)
def test_heads_take_time_by_their_length(head: str, tmp_path: Path) -> None:
    """Regular expressions that go back took 49 s for the first, and minutes for the last."""
    path, started = table(tmp_path, head + ROWS), time.process_time()
    opened = open_table(path)
    assert opened.read([opened.names[0]])[opened.names[0]].values[0] == 1
    assert time.process_time() - started < 2


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("x [um]", ("x", "um")),
        ("x(mm/s)", ("x", "mm/s")),
        ("gap [left] [um]", ("gap [left]", "um")),
        ("x []", ("x", None)),
        ("x [-]", ("x", None)),
        ("x [seven]", ("x [seven]", None)),
        ("[um]", ("[um]", None)),
        ("x [um] raw", ("x [um] raw", None)),
        ("x [um)", ("x [um)", None)),
        ("]", ("]", None)),
        (f"x [{'m' * (UNIT_CHARACTERS + 1)}]", (f"x [{'m' * 65}]", None)),
        (f"x [{'m*' * 31}mm]", ("x", "m*" * 31 + "mm")),
    ],
)
def test_names_with_units(name: str, found: tuple[str, str | None]) -> None:
    dialect = find_dialect([f"{name},y", *["1,2"] * 4])
    assert dialect is not None
    assert (dialect.names[0], dialect.units[0]) == found


@pytest.mark.parametrize(
    ("line", "hertz"),
    [
        ("Sample rate [kHz]: 5", 5000),
        ("Sampling Rate (Hz),5000", 5000),
        ("Sample Rate: 10 kHz", 10_000),
        ("scan rate (Hz)=2000", 2000),
        ("Delta_X\t0.001", 1000),
        ("Sample interval [ms]: 0.5", 2000),
        ("sampling frequency 1e4 Hz", 10_000),
        ("sample time;0.1 ms", 10_000),
        ("x" * (PREAMBLE_CHARACTERS - 25) + " sample rate 2000 Hz kept", 2000),
        ("x" * (PREAMBLE_CHARACTERS - 10) + " sample rate 2000 Hz", None),
    ],
)
def test_rates_in_the_head(line: str, hertz: float | None) -> None:
    """The unit may stand before the number or behind it: a kHz is not a Hz."""
    dialect = find_dialect([line, "x,y", *["1,2"] * 4])
    assert dialect is not None
    assert (dialect.rate and dialect.rate.hertz) == (hertz and pytest.approx(hertz))


def test_rates_that_no_logger_has(tmp_path: Path) -> None:
    for interval, kept in (("1e-320", False), ("1e-13", False), ("1e-11", True)):
        path = table(tmp_path, f"Delta_X {interval}\nx,y\n{ROWS}")
        assert (open_table(path).read(["x"])["x"].rate is not None) == kept


@pytest.mark.slow
def test_long_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, started = table(tmp_path, "x,y\n" + ROWS + "1," * 7_990_000), time.process_time()
    assert path.stat().st_size < SMALL_TEXT == 16_000_000
    assert len(open_table(path).read(["x"])["x"].values) == 601
    assert time.process_time() - started < 3
    monkeypatch.setattr(delimited, "SMALL_TEXT", 0)
    last = "1," + "2" + " " * (LINE_CHARACTERS - 5) + "\n"
    assert open_table(table(tmp_path, "x,y\n" + ROWS + last)).read(["y"])["y"].values[-1] == 2
    for more in ("1,2 " + " " * (LINE_CHARACTERS - 4), "1," * LINE_CHARACTERS):
        with pytest.raises(ReadError, match="a line of more than 1048576 characters"):
            open_table(table(tmp_path, "x,y\n" + ROWS + more)).read(["x"])


def test_a_hole_in_the_file(tmp_path: Path) -> None:
    """A file of which a terabyte was never written: the line that it makes is not read."""
    path = table(tmp_path, "x,y\n" + "1,2\n" * 20_000)
    with path.open("r+b") as stream:
        stream.truncate(10**12)
    with pytest.raises(ReadError, match="a line of more than"):
        open_table(path).read(["x"])


def test_bounds_of_columns_and_fields(tmp_path: Path) -> None:
    for count in (COLUMNS, COLUMNS + 1):
        rows = [",".join(f"c{i}" for i in range(count)), *[",".join("1" * count)] * 3]
        path = table(tmp_path, "\n".join(rows) + "\n")
        if count == COLUMNS:
            assert len(open_table(path).names) == 10_000
        else:
            with pytest.raises(ReadError, match=r"run.csv: found 10001 columns; expected 10000"):
                open_table(path)
    assert is_value("1" * DIGITS)
    assert not is_value("1" * (DIGITS + 1))


@pytest.mark.slow
def test_names_like_a_misspelt_one(tmp_path: Path) -> None:
    """The nearest is told, in a time that names of any length and number bear."""
    with pytest.raises(ReadError, match="did you mean fx"):
        open_table(table(tmp_path, "fx,y\n" + ROWS)).find("fxx")
    for count, length in ((10_000, 90), (3, 100_000)):
        names = ",".join(f"{'ab' * (length // 2)}{i}" for i in range(count))
        rows = (",".join("1" * count) + "\n") * 3
        opened, started = open_table(table(tmp_path, names + "\n" + rows)), time.process_time()
        with pytest.raises(ReadError, match="no column"):
            opened.find("ba" * (length // 2))
        assert time.process_time() - started < 3


@pytest.mark.parametrize("day", ["2024-99-45 12:00:00", "2024-02-30T12:00:00Z"])
def test_days_that_are_none(day: str, tmp_path: Path) -> None:
    path = table(tmp_path, "t,y\n" + f"{day},2\n" * 20)
    with pytest.raises(ReadError, match=r"column t: found .* out of range"):
        open_table(path).read(["t"])


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
def test_letters_of_windows(encoding: str, tmp_path: Path) -> None:
    path = table(tmp_path, ("Kr\xe4fte [\xb5m],y\n" + ROWS).encode(encoding))
    assert open_table(path).names == ("Kr\xe4fte", "y")


# -------------------------------------------------------------------------------------------------
# Parquet, TDMS, MDF and MAT files that stand for far more numbers than their bytes can hold.


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
