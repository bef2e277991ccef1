"""The structure of a MATLAB file of version 5 to 7, checked before it is read.

The reader of scipy trusts the tags of its elements, and a damaged one can end the process.
"""

from __future__ import annotations

import math
import zlib
from pathlib import Path
from typing import Literal

from rotorid.io.table import check_size

_INT8, _INT32, _UINT32, _MATRIX, _COMPRESSED = 1, 5, 6, 14, 15
_BYTES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8, 16: 1, 17: 2, 18: 4}
_CELL, _STRUCT, _OBJECT = 1, 2, 3
_NUMERIC = range(6, 16)  # classes of array, from double to uint64
_COMPLEX = 0x800
_DEEPEST = 30  # structures in structures
_HEADER = 4096  # bytes of a compressed element that tell its kind, size and name


class _Element:
    """The tags of a matrix, one after the other."""

    def __init__(self, data: bytes, order: Literal["little", "big"], *, whole: bool) -> None:
        self.data, self.order, self.whole, self.place = data, order, whole, 0

    def number(self, place: int) -> int:
        return int.from_bytes(self.data[place : place + 4], self.order)

    def next(self, *kinds: int) -> tuple[int, bytes, int]:
        """Return kind, content and size of the next part, which is one of these kinds."""
        if self.place + 8 > len(self.data):
            raise ValueError("an element cut short")
        kind, size, begin = self.number(self.place), self.number(self.place + 4), self.place + 8
        small = kind >> 16
        if small:  # kind and size share the first word of a small element
            kind, size, begin = kind & 0xFFFF, small, self.place + 4
        if kind not in kinds or (small and size > 4):
            raise ValueError(f"an element of kind {kind}")
        if self.whole and begin + size > len(self.data):
            raise ValueError("an element longer than its file")
        self.place = begin + 4 if small else begin + size + -size % 8
        return kind, self.data[begin : begin + size], size


def check_elements(path: Path) -> None:
    """Raise ValueError for elements that contradict one another, or are larger than can be."""
    with path.open("rb") as stream:
        header = stream.read(128)
        order: Literal["little", "big"] = "big" if header[126:] == b"MI" else "little"
        while tag := stream.read(8):
            kind, size = (int.from_bytes(tag[i : i + 4], order) for i in (0, 4))
            data = stream.read(size)
            if len(data) < size or len(tag) < 8:
                raise ValueError("an element cut short")
            whole = True
            if kind == _COMPRESSED:
                unpack = zlib.decompressobj()
                data = unpack.decompress(data, _HEADER)
                kind, size = (int.from_bytes(data[i : i + 4], order) for i in (0, 4))
                check_size(size, str(path), itemsize=1)
                whole = not unpack.unconsumed_tail
                if not whole and _class_of(data[8:], order) not in _NUMERIC:
                    data += unpack.decompress(unpack.unconsumed_tail, size)
                    whole = True
                data = data[8:]
            if kind != _MATRIX:
                raise ValueError(f"an element of kind {kind}")
            _check_matrix(_Element(data, order, whole=whole))


def _class_of(data: bytes, order: Literal["little", "big"]) -> int:
    return int.from_bytes(data[8:12], order) & 0xFF


def _check_matrix(element: _Element, depth: int = 0) -> None:
    """Check an array and those in it; an empty one has no parts."""
    if not element.data:
        return
    if depth > _DEEPEST:
        raise ValueError("structures too deep")
    flags = int.from_bytes(element.next(_UINT32)[1][:4], element.order)
    kind = flags & 0xFF
    if kind >= 16:
        return  # functions and objects of newer MATLAB: scipy leaves them alone
    sizes = element.next(_INT32)[1]
    shape = [int.from_bytes(sizes[i : i + 4], element.order) for i in range(0, len(sizes), 4)]
    count = math.prod(shape)
    if not 2 <= len(shape) <= 32 or max(shape) >= 2**31:
        raise ValueError("an array without shape")
    element.next(_INT8)
    if kind in _NUMERIC:
        for _ in range(2 if flags & _COMPLEX else 1):
            stored, _data, size = element.next(*_BYTES)
            if size != count * _BYTES[stored]:
                raise ValueError(f"{size} bytes for {count} numbers")
            if not element.whole:
                return  # the rest was not unpacked
    elif kind in (_CELL, _STRUCT, _OBJECT):
        for _ in range(count * _fields(element, kind)):
            inner = element.next(_MATRIX)[1]
            _check_matrix(_Element(inner, element.order, whole=True), depth + 1)
    else:  # text, sparse
        while element.place + 8 <= len(element.data):
            element.next(*_BYTES)


def _fields(element: _Element, kind: int) -> int:
    """Return how many arrays stand in each entry."""
    if kind == _CELL:
        return 1
    if kind == _OBJECT:
        element.next(_INT8)
    length = int.from_bytes(element.next(_INT32)[1][:4], element.order)
    names = len(element.next(_INT8)[1])
    if not 0 < length <= 1024 or names % length:
        raise ValueError("fields without names")
    return names // length
