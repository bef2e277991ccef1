"""What may be opened: regular files, and of what a file refers to only what lies beside it.

A pipe would be waited for without end, a device may have no end or do things when it is opened.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

from rotorid.errors import ReadError

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}
_BLOCK = 512  # bytes of what `stat` counts as blocks
_HOLLOW = 16_000_000  # bytes up to which holes do not matter: reading them takes 10 ms
_NOT_BLOCKING = getattr(os, "O_NONBLOCK", 0)  # a pipe put there since is opened at once, too


def check_regular(path: str | Path, expected: str = "a readable file") -> os.stat_result:
    """Refuse what is no regular file, without opening it."""
    try:
        found = os.stat(path)
    except (OSError, ValueError) as error:  # ValueError: a path with a null byte
        raise _unreadable(path, error, expected) from None
    _require_regular(path, found, expected)
    return found


def open_regular(path: str | Path, expected: str = "a readable file") -> BinaryIO:
    """Open a regular file for reading; anything else is refused at once."""
    check_regular(path, expected)
    try:
        stream = open(path, "rb", opener=_open)  # noqa: SIM115 - the caller closes it
    except (OSError, ValueError) as error:
        raise _unreadable(path, error, expected) from None
    try:
        _require_regular(path, os.fstat(stream.fileno()), expected)
    except ReadError:
        stream.close()
        raise
    return stream


def read_regular(path: str | Path, most: int, expected: str, cure: str) -> bytes:
    """Return the content of a regular file of at most so many bytes."""
    with open_regular(path, expected) as stream:
        try:
            data = stream.read(most + 1)
        except OSError as error:
            raise _unreadable(path, error, expected) from None
    if len(data) > most:
        raise ReadError(f"more than {most // 1000} kB", expected, cure, file=str(path))
    return data


def check_beside(name: str, record: str | Path) -> Path:
    """Return the path of a file that a record refers to; it must lie in the record's folder."""
    folder = Path(record).absolute().parent.resolve()  # of a link, where it lies
    path = folder / name
    try:
        inside = path.resolve().is_relative_to(folder)
    except (OSError, RuntimeError, ValueError):  # links that go in a circle, a null byte
        inside = False
    if not inside:
        raise ReadError(
            f"samples in {name[:80]!r}",
            "samples in the record, or in files below its folder",
            "copy that file beside the record, or write the record whole",
            file=str(record),
        )
    check_regular(path, f"a part of {record}")
    return path


def is_hollow(found: os.stat_result) -> bool:
    """Tell whether a file is made of holes for the most part: nobody measured those."""
    held = _BLOCK * getattr(found, "st_blocks", found.st_size)
    return found.st_size > _HOLLOW and 2 * held < found.st_size


def _open(path: str, flags: int) -> int:
    return os.open(path, flags | _NOT_BLOCKING)


def _require_regular(path: str | Path, found: os.stat_result, expected: str) -> None:
    if not stat.S_ISREG(found.st_mode):
        kind = _KINDS.get(stat.S_IFMT(found.st_mode), "no regular file")
        raise ReadError(kind, expected, "give the path of a file", file=str(path))


def _unreadable(path: str | Path, error: Exception, expected: str) -> ReadError:
    if isinstance(error, FileNotFoundError):
        found = "no such file"
    elif isinstance(error, ValueError):  # in whose words each Python says it otherwise
        found = "a null byte in the name"
    else:
        found = str(getattr(error, "strerror", None) or error)
        found = found[:1].lower() + found[1:]
    return ReadError(found, expected, "check the path", file=str(path))
