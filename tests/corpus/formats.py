"""Records in binary formats: what small files declare, refer to, or hide."""

import functools
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import fuzz_files as good
import h5py
import numpy as np
from fuzz_harness import Case

HERE = Path(__file__).parent
IDENTIFY = ("identify", "experiment.toml", "--json", "out.json")


def case(
    name: str,
    write: Callable[[Path], object] | bytes,
    codes: tuple[int, ...] = (2,),
    says: str = "",
    arguments: tuple[str, ...] = IDENTIFY,
) -> Callable[[], Case]:
    """Return what makes a case of one record."""
    told = good.EXPERIMENT.format(name=name).encode()

    def make() -> Case:
        files = {"model.toml": good.MODEL, "experiment.toml": told}
        if isinstance(write, bytes):
            return Case("", arguments, {**files, name: write}, None, ("out.json",), codes, says)
        prepare = functools.partial(_prepared, write, name)
        return Case("", arguments, files, prepare, ("out.json",), codes, says)

    return make


def _prepared(write: Callable[[Path], object], name: str, folder: Path) -> None:
    write(folder / name)


def hdf5(fill: Callable[[h5py.File], object], **options: object) -> Callable[[Path], object]:
    """Return a writer of an HDF5 file."""

    def write(path: Path) -> None:
        with h5py.File(path, "w", **options) as data:
            fill(data)

    return write


def samples(data: h5py.Group, *but: str) -> None:
    """Put the good columns into a file."""
    for name, (values, _) in good.columns().items():
        if name not in but:
            data[name] = values


def declared(shape: tuple[int, ...], chunks: tuple[int, ...]) -> Callable[[h5py.File], object]:
    """Declare numbers that nobody wrote."""

    def fill(data: h5py.File) -> None:
        for name in ("fx", "px"):
            data.create_dataset(name, shape, "f8", chunks=chunks, compression="gzip")

    return fill


def one_huge_chunk(data: h5py.File) -> None:
    """Write one number into a chunk of 2 GB."""
    samples(data, "px")
    made = data.create_dataset("px", (80,), "f8", chunks=(250_000_000,), maxshape=(None,))
    made.id.write_direct_chunk((0,), bytes(8))


def nested(data: h5py.File) -> None:
    """Put five thousand groups into one another."""
    samples(data)
    group = data
    for _ in range(5000):
        group = group.create_group("g")


def crowded(count: int) -> Callable[[h5py.File], object]:
    """Put very many data sets beside the columns."""

    def fill(data: h5py.File) -> None:
        samples(data)
        space = h5py.h5s.create_simple((4,))
        for number in range(count):
            h5py.h5d.create(data.id, b"d%d" % number, h5py.h5t.NATIVE_DOUBLE, space)

    return fill


def cyclic(data: h5py.File) -> None:
    """Let a group hold itself, by a hard link."""
    samples(data)
    data["a/b/c"] = np.zeros(3)
    data["a/b/up"] = data["a"]
    data["a/b/root"] = data["/"]


def external(target: str) -> Callable[[h5py.File], object]:
    """Take the numbers of a column from any file of the machine."""

    def fill(data: h5py.File) -> None:
        samples(data, "px")
        data.create_dataset("px", (80,), "u1", external=[(target, 0, 80)])

    return fill


def virtual(target: str, count: int = 80, dataset: str = "px") -> Callable[[Path], object]:
    """Make a column of another file's data set."""

    def write(path: Path) -> None:
        layout = h5py.VirtualLayout((80,), "f8")
        layout[:count] = h5py.VirtualSource(target, dataset, (count,))
        with h5py.File(path, "w") as data:
            samples(data, "px")
            data.create_virtual_dataset("px", layout)

    return write


def virtual_in_parts(missing: bool) -> Callable[[Path], object]:
    """Make both columns of four files, as some loggers do; of one the file may be missing."""

    def write(path: Path) -> None:
        layouts = {name: h5py.VirtualLayout((80,), "f8") for name in ("fx", "px")}
        for part in range(4):
            begin = 20 * part
            if not (missing and part == 2):
                with h5py.File(path.with_name(f"part{part}.h5"), "w") as data:
                    for name, (values, _) in good.columns().items():
                        data[name] = values[begin : begin + 20]
            for name, layout in layouts.items():
                layout[begin : begin + 20] = h5py.VirtualSource(f"part{part}.h5", name, (20,))
        with h5py.File(path, "w") as data:
            for name, layout in layouts.items():
                data.create_virtual_dataset(name, layout)

    return write


def virtual_of_pipe(path: Path) -> None:
    """Make a column of a pipe to which nobody writes."""
    import os

    os.mkfifo(path.with_name("pipe.h5"))
    virtual("pipe.h5")(path)


def linked(target: str) -> Callable[[Path], object]:
    """Take a column from another file by an external link."""

    def write(path: Path) -> None:
        with h5py.File(path, "w") as data:
            samples(data, "px")
            data["px"] = h5py.ExternalLink(target, "/px")

    return write


def linked_to_outside(path: Path) -> None:
    """Take a column from a good file above the folder of the record."""
    inner = path.parent / "inner"
    inner.mkdir()
    with h5py.File(path.parent / "secret.h5", "w") as data:
        samples(data)
    for made in (path, inner / path.name):
        with h5py.File(made, "w") as data:
            samples(data, "px")
            data["px"] = h5py.ExternalLink("../secret.h5", "/px")


def linked_in_a_ring(path: Path) -> None:
    """Let two files refer to one another for ever."""
    for one, other in (("run.h5", "other.h5"), ("other.h5", "run.h5")):
        with h5py.File(path.with_name(one), "w") as data:
            samples(data, "px")
            data["px"] = h5py.ExternalLink(other, "/px")


def odd_names(data: h5py.File) -> None:
    """Name data sets by bytes that are no UTF-8, nulls apart, and by escape sequences."""
    samples(data)
    space = h5py.h5s.create_simple((80,))
    for name in (b"\xff\xfe", b"\x1b[2J", b"a\nb", b"\xed\xa0\x80", b"x" * 50_000):
        h5py.h5d.create(data.id, name, h5py.h5t.NATIVE_DOUBLE, space)


def only_odd_names(data: h5py.File) -> None:
    """Have no other columns than such, so that a message lists them."""
    space = h5py.h5s.create_simple((80,))
    for name in (b"\xff\xfe", b"\x1b[2J", b"a\nb", b"x" * 50_000):
        h5py.h5d.create(data.id, name, h5py.h5t.NATIVE_DOUBLE, space)


def odd_attributes(data: h5py.File) -> None:
    """State units and rates that are none."""
    samples(data)
    data["fx"].attrs["units"] = np.bytes_(b"\xff\xfe\x1b[2J")
    data["px"].attrs["units"] = "m" * 30_000
    data["px"].attrs["sample_rate"] = 1e308
    data.attrs["sample_rate"] = np.arange(10.0)


def bomb(path: Path) -> None:
    """Pack 800 MB of zeros into a chunked data set of less than a megabyte."""
    with h5py.File(path, "w") as data:
        for name in ("fx", "px"):
            made = data.create_dataset(name, (10**8,), "f8", chunks=(10**6,), compression="gzip")
            packed = zlib.compress(bytes(8 * 10**6), 9)
            for begin in range(0, 10**8, 10**6):
                made.id.write_direct_chunk((begin,), packed)


def with_block(path: Path) -> None:
    """Put a block of the user's own before the HDF5 data, as the standard allows."""
    with h5py.File(path, "w", userblock_size=1024) as data:
        samples(data)
    with path.open("r+b") as stream:
        stream.write(b"measured on a Monday".ljust(1024))


# MATLAB files, element by element.


def element(kind: int, body: bytes) -> bytes:
    """Return an element of a version 5 file: tag, content, padding."""
    return struct.pack("<II", kind, len(body)) + body + bytes(-len(body) % 8)


def array(name: bytes, shape: tuple[int, ...], body: bytes, kind: int = 6, flags: int = 0) -> bytes:
    """Return a matrix, its content as given."""
    head = element(6, struct.pack("<II", kind | flags, 0))
    head += element(5, struct.pack(f"<{len(shape)}i", *shape)) + element(1, name)
    return element(14, head + body)


def mat5(*elements: bytes) -> bytes:
    """Return a file of such elements."""
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"".join(elements)


def doubles(name: str) -> bytes:
    """Return a good column."""
    values = good.columns()[name][0]
    return array(name.encode(), (len(values), 1), element(9, values.tobytes()))


def mat4(
    rows: int, columns: int, kind: int = 0, imaginary: int = 0, name: bytes = b"fx\0"
) -> bytes:
    """Return the head of a matrix of version 4."""
    return struct.pack("<IIIII", kind, rows, columns, imaginary, len(name)) + name


DEEP = functools.reduce(lambda inner, _: array(b"", (1, 1), inner, kind=1), range(3000), b"")
BOTH = doubles("fx") + doubles("px")
ZEROS = zlib.compress(bytes(10**6), 9)
MAT = {
    "a shape of negative numbers": mat5(array(b"fx", (-80, 1), element(9, bytes(640))), BOTH),
    "a shape of 2^31 by 2^31": mat5(array(b"q", (2**31 - 1, 2**31 - 1), element(9, b"")), BOTH),
    "a shape without dimensions": mat5(array(b"fx", (), element(9, bytes(640)))),
    "a shape of forty dimensions": mat5(array(b"fx", (1,) * 40, element(9, bytes(8)))),
    "more numbers than bytes": mat5(array(b"fx", (8000, 1), element(9, bytes(640))), BOTH),
    "numbers of an unknown kind": mat5(array(b"fx", (80, 1), element(77, bytes(640))), BOTH),
    "cells in three thousand cells": mat5(DEEP, BOTH),
    "a cell that declares 1e9": mat5(array(b"q", (10**9, 1), b"", kind=1), BOTH),
    "a structure with names of length 0": mat5(
        array(b"q", (1, 1), element(5, bytes(4)) + element(1, b""), kind=2), BOTH
    ),
    "a structure with names of length -1": mat5(
        array(b"q", (1, 1), element(5, b"\xff" * 4) + element(1, b"abc"), kind=2), BOTH
    ),
    "a sparse matrix of lies": mat5(
        array(
            b"q",
            (9, 9),
            element(5, b"\xff" * 400) + element(5, b"\x7f" * 40) + element(9, bytes(800)),
            kind=5,
        ),
        BOTH,
    ),
    "an element of 4 GB": mat5(struct.pack("<II", 14, 2**32 - 8), BOTH),
    "a packed element that is no packing": mat5(element(15, b"\x78\x9c" + bytes(50)), BOTH),
    "a packed element in a packed element": mat5(
        element(15, zlib.compress(element(15, zlib.compress(BOTH))))
    ),
    "a packed element cut short": mat5(
        element(15, zlib.compress(doubles("fx"))[:-9]), doubles("px")
    ),
    "a packed element of a million zeros": mat5(element(15, ZEROS) * 400, BOTH),
    "a name twice": mat5(doubles("fx"), doubles("fx"), doubles("px")),
    "a name of escape sequences": mat5(array(b"\x1b[2J\xff", (1, 1), element(9, bytes(8)))),
    "a name of 100 kB": mat5(array(b"n" * 100_000, (1, 1), element(9, bytes(8)))),
    "an object": mat5(array(b"fx", (1, 1), element(1, b"inline"), kind=3), BOTH),
    "a function": mat5(array(b"fx", (1, 1), b"", kind=16), BOTH),
    "version 4, 2^31 rows": mat4(2**31 - 1, 2**31 - 1) + bytes(640),
    "version 4, negative rows": mat4(2**32 - 80, 1) + bytes(640),
    "version 4, of a VAX": mat4(80, 1, kind=2000) + bytes(640),
    "version 4, sparse": mat4(80, 3, kind=2) + bytes(80 * 24),
    "version 4, a name of 4 GB": struct.pack("<IIIII", 0, 80, 1, 0, 2**32 - 1) + bytes(640),
    "version 4, a million empty matrices": mat4(0, 0) * 300_000,
}
KILLERS = sorted((HERE / "mat").glob("*.mat"))
FORMAT_CASES: dict[str, Callable[[], Case]] = {
    "hdf5: 1e8 numbers that nobody wrote": case("run.h5", hdf5(declared((10**8,), (10**6,)))),
    "hdf5: 1e8 by 1e8 numbers": case("run.h5", hdf5(declared((10**8, 10**8), (10**3, 10**3)))),
    "hdf5: a chunk of 2 GB": case("run.h5", hdf5(one_huge_chunk), (0, 1, 2)),
    "hdf5: five thousand groups in one another": case("run.h5", hdf5(nested), (0, 2)),
    "hdf5: ten thousand data sets": case("run.h5", hdf5(crowded(12_000)), (0, 2)),
    "hdf5: groups in a ring": case("run.h5", hdf5(cyclic), (0, 2)),
    "hdf5: zeros that unpack to 1.6 GB": case("run.h5", bomb),
    "hdf5: external storage in /etc/passwd": case("run.h5", hdf5(external("/etc/passwd"))),
    "hdf5: external storage in /dev/zero": case("run.h5", hdf5(external("/dev/zero"))),
    "hdf5: external storage above": case("run.h5", hdf5(external("../../secret"))),
    "hdf5: a virtual data set of one file": case("run.h5", virtual_in_parts(missing=False), (0, 2)),
    "hdf5: a virtual data set, one part missing": case("run.h5", virtual_in_parts(missing=True)),
    "hdf5: a virtual data set with a gap": case("run.h5", virtual("gone.h5", 40)),
    "hdf5: a virtual data set of a pipe": case("run.h5", virtual_of_pipe),
    "hdf5: a virtual data set of /dev/zero": case("run.h5", virtual("/dev/zero")),
    "hdf5: a virtual data set of itself": case("run.h5", virtual("run.h5")),
    "hdf5: a virtual data set of its own file": case("run.h5", virtual(".", dataset="/px")),
    "hdf5: a link to another file above": case("run.h5", linked_to_outside),
    "hdf5: a link to /dev/zero": case("run.h5", linked("/dev/zero")),
    "hdf5: links in a ring": case("run.h5", linked_in_a_ring),
    "hdf5: odd names": case("run.h5", hdf5(odd_names), (0, 2)),
    "hdf5: only odd names": case("run.h5", hdf5(only_odd_names)),
    "hdf5: odd names, drafted": case("run.h5", hdf5(odd_names), (0, 2), "", ("new", "run.h5")),
    "hdf5: odd attributes": case("run.h5", hdf5(odd_attributes), (0, 2)),
    "hdf5: a user block": case("run.h5", with_block, (0,)),
    **{f"mat: {name}": case("run.mat", data, (0, 1, 2)) for name, data in MAT.items()},
    **{f"mat: {p.stem}": case("run.mat", p.read_bytes(), (0, 1, 2)) for p in KILLERS},
}
