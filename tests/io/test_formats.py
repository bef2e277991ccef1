"""Formats that a package reads, MATLAB's among them, and the sandbox around them."""

import io
import json
import pickle
import struct
import subprocess
import sys
import zlib
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
from io_writers import (
    PACKAGES,
    RATE,
    WRITERS,
    element,
    mat5,
    matrix_of,
    uff_set,
    write_hdf5,
    write_mdf,
    write_sets,
    write_tdms,
    write_uff,
)
from served import Served, served

import rotorid as rid
from rotorid import InputError, ReadError
from rotorid.io import sandbox
from rotorid.io.sandbox import Sandbox
from rotorid.io.table import Rate
from rotorid.testing import Source, open_table

# Every format, read from a file that its own library wrote.


X = np.linspace(-1.0, 1.0, 2000) ** 3
COLUMNS = {"fx": (X, "N"), "px": (100 * X[::-1], "um")}
UNITS = ("csv", "h5", "parquet", "tdms", "uff", "mf4")
RATES = ("lvm", "h5", "tdms", "uff", "mf4")


@pytest.fixture(params=WRITERS)
def path(request, tmp_path):
    path = tmp_path / request.param
    package = PACKAGES.get(path.suffix)
    if package:
        pytest.importorskip(package)
    WRITERS[request.param](path, COLUMNS)
    return path


def test_columns_units_and_rate(path):
    """As the file has them; what contradicts it is told, and may be overruled."""
    states = path.suffix[1:] in UNITS
    sources = {"F": Source("fx", "N"), "x": Source("px", None if states else "um", expected="m")}
    record = rid.read_record(path, columns=sources, sample_rate="1 kHz")
    digits = 1e-10 if path.name == "run.uff" else 1e-15
    np.testing.assert_allclose(record.column("F"), X, rtol=digits, atol=digits)
    np.testing.assert_allclose(record.column("x"), 1e-4 * X[::-1], rtol=digits, atol=1e-4 * digits)
    wrong = {"x": Source("px", "mm")}
    if states:
        with pytest.raises(InputError, match="unit 'mm', where the file says 'um'"):
            rid.read_record(path, columns=wrong, sample_rate=RATE)
    if path.suffix[1:] in RATES:
        own = rid.read_record(path, columns={"F": Source("fx", "N")})
        assert own.sample_rate == pytest.approx(RATE, rel=1e-12)
        with pytest.raises(InputError, match=r"2000 Hz, where the file says 1000 Hz.*overrule"):
            rid.read_record(path, columns={"F": "fx"}, sample_rate=2000.0)
    else:
        with pytest.raises(InputError, match=r"nor does the file state a rate.*give one"):
            rid.read_record(path, columns={"F": "fx"})
    ruled = rid.read_record(path, columns=wrong, sample_rate=2000.0, overrule=True)
    assert (ruled.sample_rate, ruled.column("x")[-1]) == (2000.0, pytest.approx(-0.1))
    with pytest.raises(ReadError, match=r"no column 'fxx'.*did you mean (?:\d/)?(?:run/)?fx"):
        open_table(path).find("fxx")


@pytest.mark.parametrize("name", ["run.h5", "run.parquet", "run.tdms", "run.mf4"])
def test_units_in_the_names_of_columns(name, tmp_path):
    """Without units of the file's own: `find` takes a name with its unit or without."""
    path, heads = tmp_path / name, ("fx [N]", "px (um)", "ix[1]")
    if path.suffix in PACKAGES:
        pytest.importorskip(PACKAGES[path.suffix])
    WRITERS[name](path, {head: (X, "") for head in heads})
    opened = open_table(path)
    assert {each.rsplit("/", 1)[-1] for each in opened.names} >= {"fx", "px", "ix"}
    sources = {"F": Source("fx", expected="N"), "x": Source("px", expected="m")}
    record = rid.read_record(path, columns=sources, sample_rate=RATE)
    np.testing.assert_allclose(record.samples, X[:, None] * [1, 1e-6], rtol=1e-14)
    with pytest.raises(InputError, match="unit 'mm', where the file says 'um'"):
        rid.read_record(path, columns={"x": Source("px", "mm")}, sample_rate=RATE)
    assert opened.find(opened.find("px")) == opened.find("px (um)") == opened.find("px")
    assert rid.read_record(path, columns={"i": Source("ix[1]", "A")}, sample_rate=RATE)


@pytest.mark.parametrize("factor", [2.0, 0.5, 1.001])
@pytest.mark.parametrize("head", ["t", "time_ms", "t [us]", "clock"])
def test_a_column_of_times_that_nobody_named_tells_the_rate(tmp_path, head, factor):
    """What the refusal says to write is accepted; jitter, a count and what is used tell nothing."""
    path, unit = tmp_path / "run.csv", {"time_ms": 1e3, "t [us]": 1e6}.get(head, 1.0)

    def read(times, rate=RATE, columns=("F",), **options):
        rows = np.column_stack([times, X])
        np.savetxt(path, rows, delimiter=",", header=f"{head},F", comments="", fmt="%.12g")
        return rid.read_record(path, columns=columns, sample_rate=rate, **options)

    times = np.arange(len(X)) / RATE * unit
    wrong = f"{factor * RATE:g} Hz, where the column .* 1000 Hz.*write time = .*is 20 Hz"
    with pytest.raises(InputError, match=wrong):
        read(times, factor * RATE, fundamental=20.0 * factor)
    with pytest.raises(InputError, match=wrong):
        read(times, factor * RATE, None, fundamental=20.0 * factor)
    name = head.split(" [")[0]
    said = Source(name, None if "[" in head else {"time_ms": "ms"}.get(head, "s"))
    assert read(times, None, time=said).sample_rate == pytest.approx(RATE, rel=1e-9)
    read(times, factor * RATE, overrule=True)
    read(times, RATE * (1 + 5e-5))
    read(times, factor * RATE, [name, "F"])
    read(times * (1 + 0.2 * np.sin(np.arange(len(X)) ** 2) / len(X)), factor * RATE)
    if unit == 1:
        read(np.arange(len(X)), factor * RATE)


def test_what_is_not_what_its_ending_says(path):
    if path.suffix in (".csv", ".lvm"):
        path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(99))
    else:
        path.write_text("t,x\n1,2\n")
    with pytest.raises(ReadError, match=r"as the ending .* says; give the file the ending"):
        open_table(path)


def test_a_file_cut_short(path):
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 3])
    if path.suffix in (".csv", ".lvm", ".tdms"):
        return  # a shorter record, or a row too few: test_hostile has them
    with pytest.raises(ReadError, match=r"damaged|data sets|no column|no samples"):
        rid.read_record(path, columns=["fx"], sample_rate=RATE)


@pytest.mark.parametrize("ending", sorted(PACKAGES))
def test_a_package_that_is_missing(ending, tmp_path, monkeypatch):
    pytest.importorskip(PACKAGES[ending])
    name = next(name for name in WRITERS if name.endswith(ending))
    WRITERS[name](tmp_path / name, COLUMNS)
    for module in [m for m in sys.modules if m.split(".")[0] == PACKAGES[ending]]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, PACKAGES[ending], None)
    with pytest.raises(ReadError, match=rf"no package {PACKAGES[ending]}.*rotorid\[files\]"):
        open_table(tmp_path / name)


def test_samples_along_either_axis(tmp_path):
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as data:
        data["down"] = np.column_stack([X, 2 * X, 3 * X])
        data["along"] = data["down"][()].T
        data["table"] = np.rec.fromarrays([X, 2 * X], names="a,b")
        data["run/across"], data["single"] = data["down"][()], X[:, None]
    opened = open_table(path)
    names = ["down[1]", "along[1]", "along[1,:]", "down[:,1]", "table/b"]
    for column in opened.read([opened.find(name) for name in names]).values():
        np.testing.assert_array_equal(column.values, 2 * X)
    across = opened.read(["along[:,3]"])["along[:,3]"].values
    np.testing.assert_array_equal(across, X[3] * np.arange(1, 4))
    assert opened.find("across[1,:]") == "run/across[1,:]"
    for column in opened.read(["single", "single[0]"]).values():  # one column by both names
        np.testing.assert_array_equal(column.values, X)
    for name, message in (("along", r"of size 3 x 2000.*name"), ("along[3]", "column of")):
        with pytest.raises(ReadError, match=message):
            opened.find(name)


def write_slashes(path: Path, _: object) -> None:
    write_tdms(path, {"cDAQ1Mod1/ai0": (X, "V"), "cDAQ1Mod2/ai0": (100 * X[::-1], "V")})


NAMED = {  # what a file's own names are, and what is told of one that is none
    "run-v73.mat": (WRITERS["run-v73.mat"], None, "log/all[1]", "label", "'label' of text"),
    "run.tdms": (write_slashes, None, "cDAQ1Mod2/ai0", "ai0", r"'ai0' 2 times.*the whole path"),
    "run.mf4": (write_mdf, ["time", "fx", "px"], "0/px", "py", "no column 'py'"),
    "run.uff": (
        lambda path, columns: write_uff(path, columns, named=False),
        ["1+Z", "2+Z"], "2+Z", "px", "no column 'px'",
    ),
}  # fmt: skip


@pytest.mark.parametrize("file", NAMED)
def test_names_of_columns(file, tmp_path):
    writer, names, name, none, message = NAMED[file]
    pytest.importorskip(PACKAGES.get(Path(file).suffix, "h5py"))
    writer(tmp_path / file, COLUMNS)
    opened = open_table(tmp_path / file)
    assert names is None or opened.names == names
    found = opened.find(name)
    np.testing.assert_allclose(opened.read([found])[found].values, 100 * X[::-1], rtol=1e-10)
    with pytest.raises(ReadError, match=message):
        opened.find(none)


def test_channels_of_two_rates_are_refused(tmp_path):
    path = tmp_path / "run.h5"
    write_hdf5(path, COLUMNS)
    with h5py.File(path, "a") as data:
        data["px"].attrs["dt"] = 1e-4
    with pytest.raises(ReadError, match="sampled at 1000 Hz and at 10000 Hz"):
        rid.read_record(path, columns=["fx", "px"])


def two_starts(path: Path, apart: float) -> None:
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
        sets = [
            uff_set(name, values, "m", node=node, binary=0)
            | {"x": np.arange(50) / 1000 + later, "abscissa_min": later}
            for node, name, values, later in ((1, "f", force, 0.0), (2, "x", motion, apart))
        ]
        write_sets(path, sets)


@pytest.mark.parametrize("name", ["run.mf4", "run.tdms", "run.uff"])
def test_columns_that_begin_at_other_times(name, tmp_path):
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


# A child that reads: its answers, its refusals, and its end.


@contextmanager
def not_opened(file):
    raise OSError("no such block")
    yield


@pytest.fixture(params=[pytest.param(True, id="forked"), pytest.param(False, id="spawned")])
def child(request, monkeypatch):
    """Both ways to a child: that of systems that cannot fork works on any."""
    if request.param and not sandbox.FORKS:
        pytest.skip("this system makes no process by itself")
    monkeypatch.setattr(sandbox, "FORKS", request.param)
    return Sandbox(served, "run.mf4", "MDF data")


def test_a_child_answers_what_it_is_asked(child):
    *arrays, told, column, error = child.ask("values")
    *sent, as_told, _, _ = Served().values()
    for found, expected in zip(arrays, sent, strict=True):
        assert found.dtype == expected.dtype
        np.testing.assert_array_equal(found, expected)
    assert told == as_told
    assert (column.unit, column.rate, column.values.tolist()) == ("mm", Rate(100.0), [0, 1, 2, 3])
    assert str(error) == "found a; expected b; c"
    assert type(error) is rid.ReadError
    for _ in range(2):  # an error is not the end of a child
        with pytest.raises(rid.ReadError, match=r"run\.mf4: x: found nothing; expected numbers"):
            child.ask("refused")
        with pytest.raises(rid.ReadError, match=r"run\.mf4: found damaged MDF data \('block'\)"):
            child.ask("failed")
        assert list(child.stream("counted", 3)) == [0, 1, 2]
    folder = child.ask("left")
    assert Path(folder, "left").exists()
    child.close()
    assert not Path(folder).exists()  # nothing is left of it


def test_a_child_that_ends_is_a_damaged_file(child, capfd):
    for _ in range(2):
        with pytest.raises(rid.ReadError, match=r"run\.mf4: found a file that ends the program"):
            child.ask("loud")
    assert capfd.readouterr() == ("", "")


def test_a_file_that_does_not_open():
    with pytest.raises(rid.ReadError, match=r"run\.h5: found damaged HDF5 data \(no such block\)"):
        Sandbox(not_opened, "run.h5", "HDF5 data")


@pytest.mark.slow
@pytest.mark.parametrize("method", ["endless", "busy"])
def test_a_file_has_so_many_seconds_for_all_that_is_asked(method, monkeypatch):
    monkeypatch.setattr(sandbox, "LEAST", 1)
    child = Sandbox(served, "run.mf4")
    answers = (child.ask(method) for _ in range(50))
    with pytest.raises(rid.ReadError, match="takes more than 1 s to read"):
        list(answers)


def framed(text, after=b""):
    return io.BytesIO(len(text).to_bytes(8, "little") + text + after)


def sent(kind, *parts):
    return json.dumps([0, {f"\0{kind}": parts}]).encode()


@pytest.mark.parametrize(
    "answer",
    [
        framed(pickle.dumps((0, 1))),
        framed(sent("object", "subprocess", "Popen", {"args": "touch RAN"})),
        framed(sent("object", "rotorid.io.sandbox", "open", {"file": "x"})),
        framed(sent("object", "rotorid.cli", "main", {})),
        framed(sent("array", "O", 1), b"12345678"),
        framed(sent("array", "<f8", 2), b"12345678"),
        framed(sent("array", "<f8", 100000000000000)),
        framed(sent("array", "<f8", -1)),
        io.BytesIO(b"\xff" * 8),
    ],
)
def test_what_a_child_sends_runs_nothing(answer, monkeypatch):
    """Damaged files may make anything of the process that reads them."""
    child = Sandbox(served, "run.mf4")
    monkeypatch.setattr(child, "_answers", answer)
    with pytest.raises(rid.ReadError, match="a file that ends the program"):
        child.ask("values")


# MATLAB's own files of versions 4 and 5.


@pytest.fixture
def run_mat(tmp_path):
    run_mat = tmp_path / "run.mat"
    log = {"x": np.arange(4.0), "sub": {"y": np.arange(4.0)[:, None], "z": np.arange(4.0)}}
    values = {
        "t": np.arange(4.0)[:, None],
        "row": np.arange(4.0)[None, :],
        "pulses": np.arange(4, dtype=np.uint8)[:, None],
        "adc": np.arange(8.0).reshape(4, 2),
        "complex": np.arange(4) * 1j,
        "cells": np.array([1, "a"], dtype=object),
    }
    values |= {"gtau": 35.15, "z": np.arange(4.0), "label": "run 7", "log": log}
    scipy.io.savemat(run_mat, values)
    return run_mat


def test_columns(run_mat):
    opened = open_table(run_mat)
    for name in ("t", "row", "pulses", "x", "log/sub/y", "y", "log/sub/z", "z"):
        column = opened.read([opened.find(name)])[opened.find(name)]
        assert column.values.dtype == np.float64
        assert column.values.tolist() == [0, 1, 2, 3]
    assert opened.read(["adc[1]"])["adc[1]"].values.tolist() == [1, 3, 5, 7]
    assert opened.scalar("gtau") == 35.15
    assert {*opened.names} == {"t", "row", "pulses", "x", "y", "z", "log/sub/z"}
    for name in ("adc", "gtau", "log", "adc[2]"):
        with pytest.raises(ReadError, match="expected"):
            opened.find(name)


def test_files_of_other_kinds(tmp_path, run_mat):
    other, head = tmp_path / "other.mat", b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512)
    for content, message in (
        (head + b"\x89HDF\r\n\x1a\n", "damaged HDF5 data"),
        (b"\x89HDF\r\n\x1a\n" + bytes(99), "damaged HDF5 data"),
        (run_mat.read_bytes()[:300], "damaged MAT data"),
    ):
        other.write_bytes(content)
        with pytest.raises(ReadError, match=message):
            open_table(other)


def test_tags_that_contradict_one_another(tmp_path):
    """They may end the process that reads them: one of its own."""
    run_mat = tmp_path / "c.mat"
    for small in (False, True):
        scipy.io.savemat(run_mat, {"fx": np.arange(60.0), "log": {"y": 1.0}}, do_compression=small)
        assert open_table(run_mat).find("fx") == "fx"
    scipy.io.savemat(run_mat, {"fx": np.arange(60.0)})
    data = run_mat.read_bytes()
    damaged = [
        data[:place] + bytes([value]) + data[place + 1 :]
        for place, value in ((177, 4), (176, 3), (156, 9), (160, 61), (128, 15))
    ]
    whole = packed(matrix("x", np.arange(4000.0)))  # whose sum of bytes tells
    for each in (*damaged, mat5(whole[:-1] + bytes([whole[-1] ^ 1]))):
        run_mat.write_bytes(each)
        with pytest.raises(ReadError, match=r"damaged MAT data|ends the program that reads it"):
            open_table(run_mat)


def matrix(name: str, values: np.ndarray, *, stored: int = 9, order: str = "<") -> bytes:
    data = values.astype(np.dtype(values.dtype).newbyteorder(order)).tobytes(order="F")
    shape = (*values.shape, 1)[:2]
    return matrix_of(name.encode(), shape, element(stored, data, order), order=order)


def packed(data: bytes) -> bytes:
    """Return an element as version 7 packs it: not filled up."""
    small = zlib.compress(data, 9)
    return struct.pack("<II", 15, len(small)) + small


VALUES = np.arange(12.0).reshape(4, 3)


@pytest.mark.parametrize("order", ["<", ">"])
def test_byte_orders_and_stored_types(order, tmp_path):
    """A double may be stored as any whole number that holds it, whatever the machine's order."""
    stored = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8"}
    stored |= {12: "i8", 13: "u8"}
    run_mat = tmp_path / "c.mat"
    several = [
        matrix(kind, VALUES.astype(kind), stored=number, order=order)
        for number, kind in stored.items()
    ]
    run_mat.write_bytes(mat5(*several, order=order))
    found = open_table(run_mat).read([f"{kind}[2]" for kind in stored.values()])
    for column in found.values():
        assert column.values.tolist() == [2, 5, 8, 11]


@pytest.mark.parametrize("order", ["<", ">"])
def test_version_4(order, tmp_path):
    run_mat, big = tmp_path / "c.mat", 1000 * (order == ">")
    words = [(0, "f8", "adc"), (30, "i2", "n"), (50, "u1", "m")]
    parts = []
    for word, kind, name in words:
        head = struct.pack(order + "5I", big + word, *VALUES.shape, 0, len(name) + 1)
        data = VALUES.astype(np.dtype(kind).newbyteorder(order)).tobytes(order="F")
        parts.append(head + name.encode() + b"\0" + data)
    run_mat.write_bytes(b"".join(parts))
    for _, _, name in words:
        column = f"{name}[1]"
        assert open_table(run_mat).read([column])[column].values.tolist() == [1, 4, 7, 10]
    run_mat.write_bytes(b"".join(parts)[:-1])
    with pytest.raises(ReadError, match=r"damaged MAT data \(Not enough bytes"):
        open_table(run_mat)


def test_what_holds_no_real_numbers_is_named(tmp_path):
    kinds = {
        "label": ("run", "text"),
        "complex": (np.ones(4) * 1j, "complex numbers"),
        "cells": (np.array([1, "a"], object), "cells"),
        "several": (np.zeros(3, dtype=[("a", float)]), "an array of structures"),
    }
    values = {name: value for name, (value, _) in kinds.items()}
    scipy.io.savemat(tmp_path / "c.mat", {**values, "x": np.ones(4)})
    opened = open_table(tmp_path / "c.mat")
    for name, (_, kind) in kinds.items():
        with pytest.raises(ReadError, match=f"found '{name}' of {kind}; expected real numbers"):
            opened.find(name)


def test_a_name_twice_and_one_in_many_structures(tmp_path):
    run_mat, inner = tmp_path / "c.mat", {"s": np.arange(4.0)}
    x = (matrix("x", np.ones(4)), matrix("x", np.zeros(4)))
    run_mat.write_bytes(mat5(*x, matrix("y", VALUES)))
    with pytest.raises(ReadError, match="found 'x' of two variables of that name"):
        open_table(run_mat).find("x")
    assert open_table(run_mat).find("y[0]") == "y[0]"
    for _ in range(59):
        inner = {"s": inner}
    scipy.io.savemat(run_mat, inner)
    assert open_table(run_mat).find("s/" * 59 + "s")


def test_packed_elements_that_stand_for_too_much(tmp_path, monkeypatch):
    """Zeros pack a thousandfold: some are nothing, more is too much, in one or in many."""
    monkeypatch.setattr("rotorid.io.table.UNPACKED_BYTES", 6_400_000)
    run_mat = tmp_path / "c.mat"
    run_mat.write_bytes(mat5(packed(matrix("x", np.zeros(790_000)))))
    assert len(open_table(run_mat).read(["x"])["x"].values) == 790_000
    one = packed(matrix("x", np.zeros(810_000)))
    many = [packed(structure(f"s{k}", np.zeros(150_000))) for k in range(8)]
    for elements in ([one], many):
        run_mat.write_bytes(mat5(*elements))
        with pytest.raises(ReadError, match="bytes of numbers declared"):
            open_table(run_mat)


def structure(name: str, values: np.ndarray) -> bytes:
    """Return the element of a structure whose last field lies behind many numbers."""
    stream = io.BytesIO()
    scipy.io.savemat(stream, {name: {"a": values, "b": 1.0}})
    return stream.getvalue()[128:]


SCARCE = """
import sys
from rotorid.io import sandbox
from rotorid.testing import open_table
print(open_table(sys.argv[1]).scalar("s/b"))
sandbox.MEMORY = 20_000_000
open_table(sys.argv[1])
"""


def test_memory_is_bounded_before_it_is_asked_for(tmp_path):
    run_mat = tmp_path / "c.mat"
    run_mat.write_bytes(mat5(packed(structure("s", np.zeros(4_500_000)))))
    # In a process of its own: what this one has freed before may hold as much.
    command = [sys.executable, "-c", SCARCE, str(run_mat)]
    told = subprocess.run(command, capture_output=True, text=True, check=False)
    assert told.stdout == "1.0\n"
    assert "more samples than memory holds" in told.stderr.splitlines()[-1]
