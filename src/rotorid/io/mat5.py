"""Where the arrays of a MATLAB file of version 5 to 7 lie: what its tags say, each held against it.

A file is a row of elements: kind and size, then the content. A matrix is an element of elements:
flags, shape, name, numbers; from version 7 on it may be packed by zlib. No tag is trusted: a size
is held against what surrounds it before anything of that size is read.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from typing import BinaryIO, Literal

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.core.limits import DEPTH, NODES
from rotorid.io.table import check_size

_INT8, _UINT8, _INT32, _UINT32, _MATRIX, _COMPRESSED, _UTF8 = 1, 2, 5, 6, 14, 15, 16
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8"} | {
    12: "i8",
    13: "u8",
}
_CELL, _STRUCTURE, _OBJECT = 1, 2, 3
_NUMERIC = range(6, 16)  # classes of array, from double to uint64
_OTHERS = {1: "cells", 4: "text", 5: "a sparse matrix", 16: "a function"}
TWICE = "two variables of that name"
_OPAQUE = 17  # tables, strings and dates of newer MATLAB: nothing of them is where arrays have it
_COMPLEX = 0x800
_HEADER = 128  # bytes before the first element
_MOST_DIMENSIONS = 32
_LONGEST_NAMES = 1 << 20  # bytes of the names of all fields of a structure
_STEP = 1 << 16  # packed bytes that are unpacked at a time
_PARTS = 10  # of an array: tags, flags, shape, name

Order = Literal["little", "big"]


@frozen
class Stored:
    """Where the numbers of an array lie, column by column, in the file or a packed part of it."""

    shape: tuple[int, ...]
    dtype: np.dtype[np.generic]  # as they are stored
    begin: int
    # begin, size and unpacked size of the packed element in which `begin` counts
    packed: tuple[int, int, int] | None = None

    @property
    def size(self) -> int:
        """Bytes of the numbers."""
        return math.prod(self.shape) * self.dtype.itemsize


class Plain:
    """Bytes as they stand in the file."""

    def __init__(self, stream: BinaryIO, end: int) -> None:
        self.stream, self.end, self.taken = stream, end, 0

    def take(self, begin: int, count: int) -> bytes:
        """Return bytes of which none is beyond the end."""
        self.taken += 1
        if self.taken > _PARTS * NODES:
            raise ValueError(f"more than {NODES} variables")
        if begin < 0 or count < 0 or begin + count > self.end:
            raise ValueError("an element cut short")
        self.stream.seek(begin)
        data = self.stream.read(count)
        if len(data) < count:
            raise ValueError("an element cut short")
        return data


class Packed:
    """Bytes of a packed element, unpacked as far as they are asked for."""

    def __init__(self, stream: BinaryIO, begin: int, size: int) -> None:
        self.source = Plain(stream, begin + size)
        self.place, self.unpack, self.data = begin, zlib.decompressobj(), bytearray()
        self.end = 8  # a tag, which says how many more

    def take(self, begin: int, count: int) -> bytes:
        """Return unpacked bytes of which none is beyond the end."""
        return bytes(self.view(begin, count))

    def view(self, begin: int, count: int) -> memoryview:
        """Return them where they lie."""
        if begin < 0 or count < 0 or begin + count > self.end:
            raise ValueError("an element cut short")
        self._reach(begin + count)
        return memoryview(self.data)[begin : begin + count]

    def close(self) -> None:
        """Make sure that the packed data end where they should, with the sum that they should."""
        self._reach(self.end)
        rest = self.unpack.decompress(self.unpack.unconsumed_tail + self._next(), 1)
        while not rest and not self.unpack.eof and (more := self._next()):
            rest = self.unpack.decompress(self.unpack.unconsumed_tail + more, 1)
        if rest or not self.unpack.eof:
            raise ValueError("a packed element that does not end where it should")

    def _next(self) -> bytes:
        count = min(_STEP, self.source.end - self.place)
        data = self.source.take(self.place, count)
        self.place += count
        return data

    def _reach(self, length: int) -> None:
        while (missing := length - len(self.data)) > 0:
            data = self.unpack.unconsumed_tail or self._next()
            if not data or self.unpack.eof:
                raise ValueError("an element cut short")
            self.data += self.unpack.decompress(data, missing)


def stored_arrays(stream: BinaryIO, size: int, file: str) -> dict[str, Stored | str]:
    """Return where the numeric arrays lie, those of structures by their path, and what others are.

    Raises
    ------
    ValueError
        For elements that contradict one another, or what surrounds them.
    """
    found: dict[str, Stored | str] = {}
    whole = Plain(stream, size)
    order: Order = "big" if whole.take(0, _HEADER)[126:] == b"MI" else "little"
    place, unpacked = _HEADER, 0
    while place < size:
        kind, begin, count, after = _tag(whole, place, size, order)
        if kind == _COMPRESSED:
            after = begin + count  # these are not filled up to eight bytes
            packed = Packed(stream, begin, count)
            kind, _begin, inner, _after = _tag(packed, 0, 2**62, order)
            check_size(inner, file, itemsize=1)
            packed.end = 8 + inner
            walker = _Walker(packed, order, (begin, count, 8 + inner))
            arrays = walker.top(kind, 8, 8 + inner)
            unpacked += len(packed.data)
            check_size(unpacked, file, itemsize=1)
        else:
            arrays = _Walker(whole, order, None).top(kind, begin, begin + count)
        found |= {name: TWICE if name in found else one for name, one in arrays.items()}
        place = after
    return found


def _tag(source: Plain | Packed, place: int, end: int, order: Order) -> tuple[int, int, int, int]:
    """Return the kind of an element, where its content begins, its size, and where the next is."""
    data = source.take(place, 8)
    kind, size = (int.from_bytes(data[i : i + 4], order) for i in (0, 4))
    if kind >> 16:  # kind and size share the first word of a small element
        kind, size, begin, after = kind & 0xFFFF, kind >> 16, place + 4, place + 8
        if size > 4:
            raise ValueError(f"a small element of {size} bytes")
    else:
        begin, after = place + 8, place + 8 + size + -size % 8
    if begin + size > end:
        raise ValueError("an element longer than what it stands in")
    return kind, begin, size, after


@frozen
class _Walker:
    """Goes through the elements of a matrix."""

    source: Plain | Packed
    order: Order
    packed: tuple[int, int, int] | None

    def top(self, kind: int, begin: int, end: int) -> dict[str, Stored | str]:
        """Return the arrays of an element of the file."""
        if kind != _MATRIX:
            raise ValueError(f"an element of kind {kind}")
        found: dict[str, Stored | str] = {}
        for name, one in self.matrix(begin, end):
            found[name] = TWICE if name in found else one
        return found

    def matrix(
        self, begin: int, end: int, prefix: str = "", depth: int = 0
    ) -> Iterator[tuple[str, Stored | str]]:
        """Yield the arrays of a matrix, or the name of its kind where it holds no real numbers."""
        if begin == end:
            return  # an empty one
        if depth > DEPTH:
            raise ValueError("structures too deep")
        flags, place = self._part(begin, end, 8, _UINT32)
        word = int.from_bytes(flags[:4], self.order)
        kind = word & 0xFF
        if kind == _OPAQUE:
            return
        sizes, place = self._part(place, end, 4 * _MOST_DIMENSIONS, _INT32, _UINT32)
        shape = tuple(np.frombuffer(sizes, self._number("i4")).tolist())
        if len(shape) < 2 or min(shape) < 0:
            raise ValueError("an array without shape")
        text, place = self._part(place, end, _LONGEST_NAMES, _INT8, _UINT8, _UTF8)
        name = prefix or _text(text)
        if kind in (_STRUCTURE, _OBJECT):
            if kind == _OBJECT:  # the name of its class
                place = self._part(place, end, _LONGEST_NAMES, _INT8)[1]
            yield from self._structure(name, place, end, math.prod(shape), depth)
        elif kind == _CELL and math.prod(shape) == 1:
            yield from self._inner(name, place, end, depth)[0]
        elif kind in _NUMERIC and not word & _COMPLEX:
            if name:  # what MATLAB keeps of its functions has none
                yield name, self._numbers(shape, place, end)
        elif kind in _NUMERIC or kind in _OTHERS:
            yield name, "complex numbers" if kind in _NUMERIC else _OTHERS[kind]
        else:
            raise ValueError(f"an array of class {kind}")

    def _structure(
        self, name: str, place: int, end: int, count: int, depth: int
    ) -> Iterator[tuple[str, Stored | str]]:
        """Yield the arrays in a structure."""
        if count != 1:
            yield name, "an array of structures"
            return
        size, place = self._part(place, end, 4, _INT32)
        length = int.from_bytes(size[:4], self.order)
        names, place = self._part(place, end, _LONGEST_NAMES, _INT8, _UINT8)
        if length < 1 or len(names) % length or len(names) // length > NODES:
            raise ValueError("fields without names")
        for i in range(0, len(names), length):
            inner = f"{name}/{_text(names[i : i + length])}"
            arrays, place = self._inner(inner, place, end, depth)
            yield from arrays

    def _inner(
        self, name: str, place: int, end: int, depth: int
    ) -> tuple[Iterator[tuple[str, Stored | str]], int]:
        """Return the arrays of a matrix in another, and where the next one is."""
        kind, begin, size, after = _tag(self.source, place, end, self.order)
        if kind != _MATRIX:
            raise ValueError(f"a field of kind {kind}")
        return self.matrix(begin, begin + size, name, depth + 1), after

    def _numbers(self, shape: tuple[int, ...], place: int, end: int) -> Stored:
        kind, begin, size, _after = _tag(self.source, place, end, self.order)
        if kind not in _STORED:
            raise ValueError(f"numbers of kind {kind}")
        stored = Stored(shape, self._number(_STORED[kind]), begin, self.packed)
        if size != stored.size:
            raise ValueError(f"{size} bytes for {math.prod(shape)} numbers")
        return stored

    def _part(self, place: int, end: int, most: int, *kinds: int) -> tuple[bytes, int]:
        """Return the content of the next part, which is one of these kinds, and where it ends."""
        kind, begin, size, after = _tag(self.source, place, end, self.order)
        if kind not in kinds or size > most:
            raise ValueError(f"{size} bytes of kind {kind}")
        return self.source.take(begin, size), after

    def _number(self, kind: str) -> np.dtype[np.generic]:
        return np.dtype((">" if self.order == "big" else "<") + kind)


def _text(data: bytes) -> str:
    """Return a name: up to its first null byte, in whatever letters it was written."""
    name = data.partition(b"\0")[0]
    try:
        return name.decode("utf-8")
    except UnicodeDecodeError:
        return name.decode("latin-1")
