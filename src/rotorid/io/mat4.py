"""Where the arrays of a MATLAB file of version 4 lie: five numbers before each say what it is."""

from __future__ import annotations

from typing import BinaryIO

import numpy as np

from rotorid.core.limits import NODES
from rotorid.io.mat5 import TWICE, Order, Plain, Stored

_NUMBERS = ("f8", "f4", "i4", "i2", "u2", "u1")
_OTHERS = {1: "text", 2: "a sparse matrix"}
_LITTLE, _BIG = 0, 1  # what the thousands of the first number say; more are VAX and Cray
_LONGEST = 1024  # characters of a name: MATLAB allows 63


def stored_arrays(stream: BinaryIO, size: int) -> dict[str, Stored | str]:
    """Return where the real matrices lie, and what others are.

    Raises
    ------
    ValueError
        For numbers that no file of version 4 has.
    """
    found: dict[str, Stored | str] = {}
    whole = Plain(stream, size)
    first = int.from_bytes(whole.take(0, 4), "little")
    order: Order = "little" if first < 5000 else "big"
    place = 0
    while place < size:
        head = whole.take(place, 20)
        word, rows, columns, imaginary, length = (
            int.from_bytes(head[i : i + 4], order) for i in range(0, 20, 4)
        )
        thousands, tens, ones = word // 1000, word // 10 % 100, word % 10
        if thousands != (_LITTLE if order == "little" else _BIG) or imaginary > 1:
            raise ValueError(f"a matrix of type {word}")
        if tens >= len(_NUMBERS) or ones not in (0, *_OTHERS) or not 0 < length <= _LONGEST:
            raise ValueError(f"a matrix of type {word}, its name of {length} letters")
        name = whole.take(place + 20, length).partition(b"\0")[0].decode("latin-1")
        kind = np.dtype((">" if order == "big" else "<") + _NUMBERS[tens])
        stored = Stored((rows, columns), kind, place + 20 + length)
        place = stored.begin + stored.size * (1 + imaginary)
        if place > size:
            raise ValueError("a matrix cut short")
        if len(found) >= NODES:
            raise ValueError(f"more than {NODES} variables")
        kind_of = _OTHERS.get(ones, "complex numbers" if imaginary else stored)
        found[name] = TWICE if name in found else kind_of
    return found
