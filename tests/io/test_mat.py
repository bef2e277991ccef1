import io
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from rotorid import ReadError
from rotorid.io import open_table, sandbox


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "run.mat"
    log = {"x": np.arange(4.0), "sub": {"y": np.arange(4.0)[:, None], "z": np.arange(4.0)}}
    scipy.io.savemat(
        path,
        {
            "t": np.arange(4.0)[:, None],
            "row": np.arange(4.0)[None, :],
            "pulses": np.arange(4, dtype=np.uint8)[:, None],
            "adc": np.arange(8.0).reshape(4, 2),
            "gtau": 35.15,
            "z": np.arange(4.0),
            "label": "run 7",
            "complex": np.arange(4) * 1j,
            "cells": np.array([1, "a"], dtype=object),
            "log": log,
        },
    )
    return path


def test_columns(path: Path) -> None:
    opened = open_table(path)
    for name in ("t", "row", "pulses", "x", "log/sub/y", "y", "log/sub/z", "z"):
        column = opened.read([opened.find(name)])[opened.find(name)]
        assert column.values.dtype == np.float64
        assert column.values.tolist() == [0, 1, 2, 3]
    assert opened.read(["adc[1]"])["adc[1]"].values.tolist() == [1, 3, 5, 7]
    assert opened.scalar("gtau") == 35.15


def test_names(path: Path) -> None:
    names = {"t", "row", "pulses", "x", "y", "z", "log/sub/z"}
    assert set(open_table(path).names) == names


@pytest.mark.parametrize("name", ["label", "complex", "cells", "adc", "gtau", "log", "adc[2]"])
def test_names_that_are_no_columns(path: Path, name: str) -> None:
    with pytest.raises(ReadError, match="expected"):
        open_table(path).find(name)


def test_scalars_by_name(path: Path) -> None:
    with pytest.raises(ReadError, match=r"no scalar variable 'gtua'.*did you mean gtau"):
        open_table(path).scalar("gtua")


def test_uncompressed_and_compressed(tmp_path: Path) -> None:
    path = tmp_path / "c.mat"
    scipy.io.savemat(path, {"x": np.arange(1000.0)}, do_compression=True)
    assert open_table(path).read(["x"])["x"].values[-1] == 999.0


def test_files_of_other_kinds(tmp_path: Path, path: Path) -> None:
    other = tmp_path / "other.mat"
    other.write_text("t,x\n1,2\n")
    with pytest.raises(ReadError, match=r"found text; expected MAT data, as the ending .mat"):
        open_table(other)
    other.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + b"\x89HDF\r\n\x1a\n")
    with pytest.raises(ReadError, match="damaged HDF5 data"):
        open_table(other)
    other.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(99))
    with pytest.raises(ReadError, match="damaged HDF5 data"):
        open_table(other)
    other.write_bytes(path.read_bytes()[:300])
    with pytest.raises(ReadError, match="damaged MAT data"):
        open_table(other)


def test_tags_that_contradict_one_another(tmp_path: Path) -> None:
    """They may end the process that reads them: one of its own."""
    path = tmp_path / "c.mat"
    for packed in (False, True):
        scipy.io.savemat(path, {"fx": np.arange(60.0), "log": {"y": 1.0}}, do_compression=packed)
        assert open_table(path).find("fx") == "fx"
    scipy.io.savemat(path, {"fx": np.arange(60.0)})
    data = path.read_bytes()
    for place, value in ((177, 4), (176, 3), (156, 9), (160, 61), (128, 15)):
        path.write_bytes(data[:place] + bytes([value]) + data[place + 1 :])
        with pytest.raises(ReadError, match=r"damaged MAT data|ends the program that reads it"):
            open_table(path)


def element(kind: int, content: bytes, order: str = "<") -> bytes:
    """Return an element of a file of version 5, filled up to eight bytes."""
    return struct.pack(order + "II", kind, len(content)) + content + bytes(-len(content) % 8)


def matrix(
    name: str, values: np.ndarray, *, kind: int = 6, stored: int = 9, order: str = "<"
) -> bytes:
    """Return a matrix as version 5 has it."""
    shape = struct.pack(f"{order}{max(values.ndim, 2)}i", *values.shape, *[1] * (2 - values.ndim))
    parts = [(6, struct.pack(order + "II", kind, 0)), (5, shape), (1, name.encode())]
    content = b"".join(element(*part, order) for part in parts)
    data = values.astype(np.dtype(values.dtype).newbyteorder(order)).tobytes(order="F")
    return element(14, content + element(stored, data, order), order)


def mat5(*elements: bytes, order: str = "<") -> bytes:
    return (
        b"MATLAB 5.0 MAT-file".ljust(124)
        + struct.pack(order + "HH", 256, 0x4D49)
        + b"".join(elements)
    )


def packed(data: bytes) -> bytes:
    """Return an element as version 7 packs it: not filled up."""
    small = zlib.compress(data, 9)
    return struct.pack("<II", 15, len(small)) + small


VALUES = np.arange(12.0).reshape(4, 3)


@pytest.mark.parametrize("order", ["<", ">"])
def test_byte_orders_and_stored_types(order: str, tmp_path: Path) -> None:
    """A double may be stored as any whole number that holds it, whatever the machine's order."""
    stored = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8"}
    path = tmp_path / "c.mat"
    for number, kind in (stored | {12: "i8", 13: "u8"}).items():
        one = matrix("adc", VALUES.astype(kind), stored=number, order=order)
        path.write_bytes(mat5(one, order=order))
        assert open_table(path).read(["adc[2]"])["adc[2]"].values.tolist() == [2, 5, 8, 11]


@pytest.mark.parametrize("order", ["<", ">"])
def test_version_4(order: str, tmp_path: Path) -> None:
    path, big = tmp_path / "c.mat", 1000 * (order == ">")
    words = [(0, "f8", "adc"), (30, "i2", "n"), (50, "u1", "m")]
    parts = []
    for word, kind, name in words:
        head = struct.pack(order + "5I", big + word, *VALUES.shape, 0, len(name) + 1)
        data = VALUES.astype(np.dtype(kind).newbyteorder(order)).tobytes(order="F")
        parts.append(head + name.encode() + b"\0" + data)
    path.write_bytes(b"".join(parts))
    for _, _, name in words:
        column = f"{name}[1]"
        assert open_table(path).read([column])[column].values.tolist() == [1, 4, 7, 10]
    path.write_bytes(b"".join(parts)[:-1])
    with pytest.raises(ReadError, match=r"damaged MAT data \(Not enough bytes"):
        open_table(path)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("label", "text"),
        ("complex", "complex numbers"),
        ("cells", "cells"),
        ("several", "an array of structures"),
    ],
)
def test_what_holds_no_real_numbers_is_named(name: str, kind: str, tmp_path: Path) -> None:
    path = tmp_path / "c.mat"
    several = np.zeros(3, dtype=[("a", float)])
    values = {"label": "run", "complex": np.ones(4) * 1j, "cells": np.array([1, "a"], object)}
    scipy.io.savemat(path, {**values, "several": several, "x": np.ones(4)})
    with pytest.raises(ReadError, match=f"found '{name}' of {kind}; expected real numbers"):
        open_table(path).find(name)


def test_a_name_twice(tmp_path: Path) -> None:
    path = tmp_path / "c.mat"
    path.write_bytes(mat5(matrix("x", np.ones(4)), matrix("x", np.zeros(4)), matrix("y", VALUES)))
    with pytest.raises(ReadError, match="found 'x' of two variables of that name"):
        open_table(path).find("x")
    assert open_table(path).find("y[0]") == "y[0]"


def test_the_sum_of_packed_bytes_tells_of_damage(tmp_path: Path) -> None:
    path = tmp_path / "c.mat"
    whole = packed(matrix("x", np.arange(4000.0)))
    path.write_bytes(mat5(whole[:-1] + bytes([whole[-1] ^ 1])))
    with pytest.raises(ReadError, match="damaged MAT data"):
        open_table(path)


def test_packed_elements_that_stand_for_too_much(tmp_path: Path) -> None:
    """Zeros pack a thousandfold: 64 MB are nothing, more is too much, in one or in many."""
    path = tmp_path / "c.mat"
    path.write_bytes(mat5(packed(matrix("x", np.zeros(7_900_000)))))
    assert len(open_table(path).read(["x"])["x"].values) == 7_900_000
    path.write_bytes(mat5(packed(matrix("x", np.zeros(8_100_000)))))
    with pytest.raises(ReadError, match="bytes of numbers declared"):
        open_table(path)
    path.write_bytes(mat5(*[packed(structure(f"s{k}", np.zeros(1_500_000))) for k in range(8)]))
    with pytest.raises(ReadError, match="bytes of numbers declared"):
        open_table(path)


def structure(name: str, values: np.ndarray) -> bytes:
    """Return the element of a structure whose last field lies behind many numbers."""
    stream = io.BytesIO()
    scipy.io.savemat(stream, {name: {"a": values, "b": 1.0}})
    return stream.getvalue()[128:]


def test_memory_is_bounded_before_it_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "c.mat"
    # More than 32 MB at once: what a process has freed before never holds so much.
    path.write_bytes(mat5(packed(structure("s", np.zeros(7_500_000)))))
    assert open_table(path).scalar("s/b") == 1.0
    monkeypatch.setattr(sandbox, "MEMORY", 20_000_000)
    with pytest.raises(ReadError, match="more samples than memory holds"):
        open_table(path)


def test_structures_in_structures(tmp_path: Path) -> None:
    path, inner = tmp_path / "c.mat", {"s": np.arange(4.0)}
    for _ in range(59):
        inner = {"s": inner}
    scipy.io.savemat(path, inner)
    assert open_table(path).find("s/" * 59 + "s")


@pytest.mark.slow
@pytest.mark.parametrize(("each", "form"), [(700, "5"), (700, "7"), (300, "4")])
def test_damaged_files_do_not_end_the_process(each: int, form: str, tmp_path: Path) -> None:
    """A reader that trusts the tags of a file ends the process on one damaged byte in seventy."""
    rng, stream = np.random.default_rng(20261122), io.BytesIO()
    values = {"fx": np.arange(60.0), "n": np.arange(5, dtype=np.int16), "label": "run"}
    more = {} if form == "4" else {"log": {"y": 1.0, "sub": {"z": VALUES}}, "c": [1, "a"]}
    scipy.io.savemat(
        stream, values | more, format="4" if form == "4" else "5", do_compression=form == "7"
    )
    whole, path, refused = stream.getvalue(), tmp_path / "c.mat", 0
    for _ in range(each):
        damaged = bytearray(whole)
        for place in rng.integers(len(whole), size=rng.choice([1, 1, 1, 4])):
            damaged[place] = rng.choice([0, 1, 0x7F, 0xFF, rng.integers(256)])
        path.write_bytes(damaged)
        try:
            opened = open_table(path)
            for name in opened.names:
                opened.read([opened.find(name)])
        except ReadError as error:
            refused += "\n" not in str(error)
    assert each / 8 < refused < each
