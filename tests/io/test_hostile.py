"""Malformed files of every format: exit code 2 and one line; never a traceback, long, or large."""

import functools
import re
import resource
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
from io_writers import PACKAGES, WRITERS

from rotorid.cli import run

MODEL = """
title = "a mass on a damper"
equations = ["m*x'' + c*x' = F"]
coordinates = { x = "m" }
inputs = { F = "N" }
parameters = { m = { unit = "kg" }, c = { unit = "N s/m" } }
"""
EXPERIMENT = """
model = "model.toml"
estimator = {{ method = "ls" }}

[[records]]
file = "{name}"
sample_rate = "1 kHz"
fundamental = "10 Hz"
harmonics = [1]

[channels]
F = {{ column = "fx", unit = "N" }}
x = {{ column = "px", unit = "um" }}
"""
LINE = re.compile(r"rotorid: [^\n]+\n")
TIME = np.arange(600) / 1000.0
COLUMNS = {
    "fx": (np.cos(20 * np.pi * TIME), "N"),
    "px": (np.sin(20 * np.pi * TIME + 0.3), "um"),
}
SECONDS, BYTES = 10.0, 1_000_000_000


def truncated(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: int(rng.integers(1, max(2, len(data) - 1)))]


def flipped(data: bytes, rng: np.random.Generator) -> bytes:
    """Flip bits, most of them near the start, where a format's own numbers are."""
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 40))):
        reach = min(len(data), int(rng.choice([64, 512, 4096, len(data)])))
        changed[int(rng.integers(reach))] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def overwritten(data: bytes, rng: np.random.Generator) -> bytes:
    """Put the largest numbers where sizes and offsets may be."""
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 6))):
        place = int(rng.integers(len(data)))
        changed[place : place + 8] = rng.choice([b"\xff" * 8, b"\x00" * 8, b"\x7f" + b"\xff" * 7])
    return bytes(changed[: len(data)])


def repeated(data: bytes, rng: np.random.Generator) -> bytes:
    place = int(rng.integers(len(data)))
    return data[:place] + data[place // 2 :]


def emptied(data: bytes, rng: np.random.Generator) -> bytes:
    return b"" if rng.integers(2) else bytes(len(data))


DAMAGES: tuple[Callable[[bytes, np.random.Generator], bytes], ...] = (
    truncated,
    flipped,
    overwritten,
    repeated,
    emptied,
)


@functools.cache
def whole(name: str) -> bytes:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        WRITERS[name](path, COLUMNS)
        return path.read_bytes()


def damaged_files() -> Iterator[tuple[str, bytes]]:
    """Yield files of every format, each damaged in every way; `test_fuzz.py` damages more."""
    rng = np.random.default_rng(20261121)
    for name in WRITERS:
        for damage in DAMAGES:
            yield name, damage(whole(name), rng)


def text(rows: str, name: str = "run.csv") -> tuple[str, bytes]:
    return name, rows.encode()


def made(name: str, write: Callable[[Path], object]) -> Callable[[Path], tuple[str, bytes]]:
    def make(folder: Path) -> tuple[str, bytes]:
        write(folder / name)
        return name, (folder / name).read_bytes()

    return make


def hdf5(**arrays: object) -> Callable[[Path], object]:
    def write(path: Path) -> None:
        with h5py.File(path, "w") as data:
            for key, value in arrays.items():
                data[key] = value

    return write


def huge_hdf5(path: Path) -> None:
    """Declare a terabyte that nobody wrote."""
    with h5py.File(path, "w") as data:
        for name in ("fx", "px"):
            data.create_dataset(name, shape=(10**11,), dtype="f8", chunks=(10**6,))


def looped_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as data:
        data["a/b"] = np.zeros(4)
        data["a/loop"] = h5py.SoftLink("/a")
        data["fx"] = h5py.ExternalLink("gone.h5", "/x")
        data["px"] = h5py.SoftLink("/nowhere")


def deep_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as data:
        data["/".join(["g"] * 300) + "/fx"] = np.zeros(4)


def zipped_mat(path: Path) -> None:
    """A compressed element that unpacks to 256 MB of zeros."""
    packer = zlib.compressobj(9)
    packed = b"".join(packer.compress(bytes(1 << 20)) for _ in range(256)) + packer.flush()
    element = (15).to_bytes(4, "little") + len(packed).to_bytes(4, "little") + packed
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + element)


WIDE = ",".join(f"c{i}" for i in range(100_000))
MADE: dict[str, Callable[[Path], tuple[str, bytes]]] = {
    "no rows": lambda _: text("fx,px\n"),
    "one row": lambda _: text("fx,px\n1,2\n"),
    "words": lambda _: text("fx,px\n" + "a,b\n" * 600),
    "a name twice": lambda _: text("fx,fx,px\n" + "1,2,3\n" * 600),
    "names of bytes": lambda _: ("run.csv", b"\xff\xfe\x00\x01,px\n1,2\n" * 50),
    "odd names": lambda _: text("__class__,{fx!r},%s%n,\x1b[31m\n" + "1,2,3,4\n" * 600),
    "a very long line": lambda _: text("fx,px\n" + "1," * 5_000_000),
    "a very long name": lambda _: text("f" * 3_000_000 + ",px\n" + "1,2\n" * 600),
    "a hundred thousand columns": lambda _: text(WIDE + "\n" + "1," * 99_999 + "1\n"),
    "a preamble without end": lambda _: text("note\n" * 400_000),
    "an open quote": lambda _: text('fx,px\n"1,2\n' * 600),
    "huge numbers": lambda _: text("fx,px\n" + f"{'9' * 400},1e999\n" * 600),
    "not numbers": lambda _: text("fx,px\n" + "nan,inf\n" * 600),
    "ragged": lambda _: text("fx,px\n" + "1,2\n1\n1,2,3\n" * 200),
    "half an utf-16": lambda _: ("run.csv", "fx,px\n1,2\n".encode("utf-16")[:-3]),
    "a null in the middle": lambda _: text("fx,px\n" + "1,2\n" * 300 + "\0\0,\0\n1,2\n"),
    "another kind in .csv": lambda _: ("run.csv", whole("run.parquet")),
    "strings": made("run.h5", hdf5(fx=b"text", px=["a", "b"])),
    "complex": made("run.h5", hdf5(fx=np.ones(600) * 1j, px=np.ones(600))),
    "three dimensions": made("run.h5", hdf5(fx=np.ones((3, 4, 5)), px=np.ones(600))),
    "no dimension": made("run.h5", hdf5(fx=1.0, px=2.0)),
    "two lengths": made("run.h5", hdf5(fx=np.ones(600), px=np.ones(599))),
    "groups for columns": made("run.h5", lambda p: hdf5(**{"fx/a": [1.0], "px/b": [1.0]})(p)),
    "a terabyte": made("run.h5", huge_hdf5),
    "links to nowhere": made("run.h5", looped_hdf5),
    "deep groups": made("run.h5", deep_hdf5),
    "cells": made("run.mat", lambda p: scipy.io.savemat(p, {"fx": np.array([1, "a"], object)})),
    "a structure": made("run.mat", lambda p: scipy.io.savemat(p, {"fx": {"fx": {"fx": 1.0}}})),
    "a quarter of a gigabyte of zeros": made("run.mat", zipped_mat),
}  # fmt: skip


def check(name: str, data: bytes, folder: Path, capfd: pytest.CaptureFixture[str]) -> int:
    """Identify a file: an answer, or a refusal in one line; return the exit code."""
    (folder / "model.toml").write_text(MODEL)
    (folder / "experiment.toml").write_text(EXPERIMENT.format(name=name))
    (folder / name).write_bytes(data)
    started = time.process_time()
    code = run(["identify", str(folder / "experiment.toml")])
    spent = time.process_time() - started
    told = capfd.readouterr().err
    assert spent < SECONDS, (name, spent)
    assert code in (0, 1, 2, 3), told
    assert not told if code in (0, 3) else LINE.fullmatch(told) or code == 1, told
    assert "internal error" not in told
    return code


def peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


@pytest.mark.parametrize("case", MADE)
def test_made_files(case, tmp_path, capfd):
    before = peak()
    name, data = MADE[case](tmp_path)
    if Path(name).suffix in PACKAGES or case == "another kind in .csv":
        pytest.importorskip("pyarrow")
    assert check(name, data, tmp_path, capfd) == 2
    assert peak() - before < BYTES


def test_damaged_files(tmp_path, capfd):
    """Every file is refused, or is still one from which the columns can be read."""
    for package in PACKAGES.values():
        pytest.importorskip(package)
    before = peak()
    codes = [check(name, data, tmp_path, capfd) for name, data in damaged_files()]
    assert codes.count(2) > 0.6 * len(codes)
    assert peak() - before < BYTES
