"""What damage does to a file: its bytes, its blocks, or the words of its text."""

import re
import struct
import zlib
from collections.abc import Callable, Sequence
from random import Random

ENDS = 96  # bytes at both ends, and around a tag, where a format's own numbers are
NUMBERS = (0, 1, 2, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1)
NUMBERS_8 = (*NUMBERS, 2**40, 2**63 - 1, 2**63, 2**64 - 1)
Damage = Callable[[bytearray, Random, Sequence[bytes]], None]


def _place(data: bytes | bytearray, rng: Random) -> int:
    """Draw a place: near the beginning, near the end, or anywhere."""
    reach = min(len(data), rng.choice((ENDS, 4 * ENDS, len(data), len(data))))
    place = rng.randrange(reach) if reach else 0
    return len(data) - 1 - place if data and rng.random() < 0.25 else place


def _block(data: bytes | bytearray, rng: Random) -> tuple[int, int]:
    begin = _place(data, rng)
    return begin, min(len(data), begin + rng.choice((1, 4, 8, 16, 64, 256, 1024)))


def _flip(data: bytearray, rng: Random, _: Sequence[bytes]) -> None:
    data[_place(data, rng)] ^= 1 << rng.randrange(8)


def _byte(data: bytearray, rng: Random, _: Sequence[bytes]) -> None:
    data[_place(data, rng)] = rng.randrange(256)


def _number(data: bytearray, rng: Random, _: Sequence[bytes]) -> None:
    """Write a number that sizes and offsets do not expect, over 2, 4 or 8 bytes."""
    place, width = _place(data, rng) & ~rng.choice((0, 1, 3, 7)), rng.choice((2, 4, 4, 8))
    number = rng.choice(NUMBERS_8) & (1 << 8 * width) - 1
    order = rng.choice(("little", "big"))
    data[place : place + width] = number.to_bytes(width, order)[: len(data) - place]


def _step(data: bytearray, rng: Random, _: Sequence[bytes]) -> None:
    """Make a number of four bytes a little larger or smaller."""
    place = _place(data, rng) & ~3
    if place + 4 <= len(data):
        number = struct.unpack_from("<I", data, place)[0] + rng.choice((-8, -4, -1, 1, 4, 8))
        struct.pack_into("<I", data, place, number % 2**32)


def _cut(data: bytearray, rng: Random, _: Sequence[bytes]) -> None:
    del data[_place(data, rng) :]


def _drop(data: bytearray, rng: Random, _: Sequence[bytes]) -> None:
    begin, end = _block(data, rng)
    del data[begin:end]


def _double(data: bytearray, rng: Random, _: Sequence[bytes]) -> None:
    begin, end = _block(data, rng)
    place = rng.choice((end, _place(data, rng)))
    data[place:place] = data[begin:end] * rng.choice((1, 1, 2, 20))


def _swap(data: bytearray, rng: Random, _: Sequence[bytes]) -> None:
    (a, b), (c, d) = sorted((_block(data, rng), _block(data, rng)))
    if b <= c:
        data[a:d] = data[c:d] + data[b:c] + data[a:b]


def _zeros(data: bytearray, rng: Random, _: Sequence[bytes]) -> None:
    begin, end = _block(data, rng)
    data[begin:end] = rng.choice((b"\0", b"\xff", b" ")) * (end - begin)


def _splice(data: bytearray, rng: Random, others: Sequence[bytes]) -> None:
    """Go on as another file does, from the same place or any."""
    other = rng.choice(others)
    place = _place(data, rng)
    data[place:] = other[rng.choice((place, rng.randrange(len(other) or 1))) :]


BYTE_DAMAGES: tuple[Damage, ...] = (
    _flip, _flip, _byte, _byte, _number, _number, _step, _cut, _drop, _double, _swap, _zeros,
    _splice,
)  # fmt: skip


def damaged(data: bytes, rng: Random, others: Sequence[bytes]) -> bytes:
    """Return a file damaged in its bytes, once or several times."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 8))):
        if changed:
            rng.choice(BYTE_DAMAGES)(changed, rng, others)
    return bytes(changed)


def damaged_inside(data: bytes, rng: Random, others: Sequence[bytes]) -> bytes:
    """Return a compressed MAT file whose elements are unpacked, damaged, and packed again."""
    if rng.random() < 0.25:
        return damaged(data, rng, others)
    parts, place = [data[:128]], 128
    while place + 8 <= len(data):
        kind, size = struct.unpack_from("<II", data, place)
        body = data[place + 8 : place + 8 + size]
        if kind == 15 and rng.random() < 0.7:
            body = zlib.compress(damaged(zlib.decompress(body), rng, [data]))
        parts.append(struct.pack("<II", kind, len(body)) + body)
        place += 8 + size
    return b"".join(parts)


_WORD = re.compile(rb"\w+|\s+|[^\w\s]")
ODD_WORDS = (
    b"0", b"-1", b"1e308", b"-1e308", b"1e-320", b"1e999", b"nan", b"inf", b"-inf", b"1e155",
    b"1" * 30, b"9" * 5000, b"0x10", b"1_000", b"1,5", b"1.2.3", b"true", b"null", b"None", b"''",
    b'"', b"'", b'"""', b"#", b"[", b"]", b"{", b"}", b"[[", b"]]", b"=", b".", b",", b";", b"\t",
    b"\n", b"\r", b"\r\n", b"\0", b"\x1b[31m", b"\xff\xfe", b"\xef\xbb\xbf", "µm".encode(),
    "\u202e".encode(), "\U0001f600".encode(), b"^", b"**", b"''", b"(", b")", b"(" * 200,
    b"-" * 300, b"^2" * 40, b"/0", b"*0", b"sqrt", b"exp", b"pi", b"Omega", b"phi", b"t",
    b"x''", b"1/3", b"{ }", b"[[]]", b"1979-05-27", b"../", b"/dev/zero", b"%s%n", b"\\u0000",
    b"a" * 3000, b"rpm", b"Hz", b"kg", b"degC", b"m^2/s", b"1e6 Hz", b"0 Hz", b"-3 s",
)  # fmt: skip


def reworded(data: bytes, rng: Random, others: Sequence[bytes]) -> bytes:
    """Return a text with words changed, lines moved, or bytes damaged."""
    if rng.random() < 0.12:
        return damaged(data, rng, others)
    words = _WORD.findall(data)
    pool = _WORD.findall(rng.choice(others))
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 6))):
        if not words:
            break
        # Half of the time among the first words: in a table the rest are numbers.
        reach = rng.choice((len(words), min(len(words), 60)))
        at = rng.randrange(reach)
        kind = rng.randrange(7)
        if kind == 0:
            words[at] = rng.choice(ODD_WORDS)
        elif kind == 1:
            words[at] = rng.choice(pool)
        elif kind == 2:
            del words[at : at + rng.choice((1, 1, 2, 5, 20))]
        elif kind == 3:
            words[at:at] = words[at : at + rng.choice((1, 3, 10))] * rng.choice((1, 1, 3, 300))
        elif kind == 4:
            other = rng.randrange(reach)
            words[at], words[other] = words[other], words[at]
        elif kind == 5:
            words[at:at] = [rng.choice(ODD_WORDS)]
        elif words[at].isdigit():
            words[at] = _odd_number(int(words[at][:18]), rng)
    return b"".join(words)


def _odd_number(number: int, rng: Random) -> bytes:
    """Return a number beside, or far from, the one that stood there."""
    return rng.choice(
        (b"%d" % (number + 1), b"%d" % (number - 1), b"-%d" % number, b"%de9" % number,
         b"%d" % (number * 1000), b"%d" % 2**63, b"%d" % 2**64, b"1e%d" % rng.randrange(-400, 400))
    )  # fmt: skip
