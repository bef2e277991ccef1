"""Records in binary formats: what small files declare, refer to, or hide."""

import struct
import zlib
from collections.abc import Callable
from functools import reduce
from pathlib import Path

import fuzz_files as good
import h5py
from fuzz_harness import Case
from io_writers import element, mat5, matrix_of

HERE = Path(__file__).parent
IDENTIFY = ("identify", "experiment.toml", "--json", "out.json")


def case(
    name: str,
    write: Callable[[Path], object] | bytes,
    codes: tuple[int, ...] = (2,),
    says: str = "",
    arguments: tuple[str, ...] = IDENTIFY,
) -> Callable[[], Case]:
    told = good.EXPERIMENT.format(name=name).encode()

    def make() -> Case:
        files = {"model.toml": good.MODEL, "experiment.toml": told}
        if isinstance(write, bytes):
            return Case("", arguments, {**files, name: write}, None, ("out.json",), codes, says)
        return Case("", arguments, files, lambda at: write(at / name), ("out.json",), codes, says)

    return make


def hdf5(fill: Callable[[h5py.File], object], **options: object) -> Callable[[Path], object]:

    def write(path: Path) -> None:
        with h5py.File(path, "w", **options) as data:
            fill(data)

    return write


def declared(shape: tuple[int, ...], chunks: tuple[int, ...]) -> Callable[[h5py.File], object]:

    def fill(data: h5py.File) -> None:
        for name in ("fx", "px"):
            data.create_dataset(name, shape, "f8", chunks=chunks, compression="gzip")

    return fill


def odd_names(data: h5py.File) -> None:
    """Name data sets by bytes that are no UTF-8, nulls apart, and by escape sequences."""
    space = h5py.h5s.create_simple((80,))
    for name in (b"\xff\xfe", b"\x1b[2J", b"a\nb", b"\xed\xa0\x80", b"x" * 50_000):
        h5py.h5d.create(data.id, name, h5py.h5t.NATIVE_DOUBLE, space)


# MATLAB files, element by element.


def doubles(name: str) -> bytes:
    values = good.columns()[name][0]
    return matrix_of(name.encode(), (len(values), 1), element(9, values.tobytes()))


def packed(content: bytes) -> bytes:
    return element(15, zlib.compress(content))


def mat4(rows: int, columns: int) -> bytes:
    return struct.pack("<IIIII", 0, rows, columns, 0, 3) + b"fx\0"


DEEP = reduce(lambda inner, _: matrix_of(b"", (1, 1), inner, kind=1), range(3000), b"")
BOTH = doubles("fx") + doubles("px")
LIES = element(5, b"\xff" * 400) + element(5, b"\x7f" * 40) + element(9, bytes(800))
ZEROS = zlib.compress(bytes(10**6), 9)
MAT = {
    "a shape of 2^31 by 2^31": mat5(matrix_of(b"q", (2**31 - 1, 2**31 - 1), element(9, b"")), BOTH),
    "more numbers than bytes": mat5(matrix_of(b"fx", (8000, 1), element(9, bytes(640))), BOTH),
    "cells in three thousand cells": mat5(DEEP, BOTH),
    "a cell that declares 1e9": mat5(matrix_of(b"q", (10**9, 1), b"", kind=1), BOTH),
    "a sparse matrix of lies": mat5(matrix_of(b"q", (9, 9), LIES, kind=5), BOTH),
    "an element of 4 GB": mat5(struct.pack("<II", 14, 2**32 - 8), BOTH),
    "a packed element in a packed element": mat5(packed(packed(BOTH))),
    "a packed element of a million zeros": mat5(element(15, ZEROS) * 400, BOTH),
    "a name of escape sequences": mat5(matrix_of(b"\x1b[2J\xff", (1, 1), element(9, bytes(8)))),
    "version 4, 2^31 rows": mat4(2**31 - 1, 2**31 - 1) + bytes(640),
    "version 4, a name of 4 GB": struct.pack("<IIIII", 0, 80, 1, 0, 2**32 - 1) + bytes(640),
    "version 4, a million empty matrices": mat4(0, 0) * 300_000,
}
KILLERS = sorted((HERE / "mat").glob("*.mat"))
FORMAT_CASES: dict[str, Callable[[], Case]] = {
    "hdf5: 1e8 by 1e8 numbers": case("run.h5", hdf5(declared((10**8, 10**8), (10**3, 10**3)))),
    "hdf5: odd names": case("run.h5", hdf5(odd_names)),
    "hdf5: odd names, drafted": case("run.h5", hdf5(odd_names), (0, 2), "", ("new", "run.h5")),
    **{f"mat: {name}": case("run.mat", data, (0, 1, 2)) for name, data in MAT.items()},
    **{f"mat: {p.stem}": case("run.mat", p.read_bytes(), (0, 1, 2)) for p in KILLERS},
}
