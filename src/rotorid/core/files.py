"""Regular files read, and files written whole or not at all.

A pipe would be waited for without end, a device may have no end or do things when it is opened. A
file that came to a target while a command worked, or changed, is kept: it is somebody else's.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import BinaryIO

from rotorid.core.errors import InputError, ReadError
from rotorid.core.frozen import frozen

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def check_regular(path: str | Path, expected: str = "a readable file") -> os.stat_result:
    """Refuse what is no regular file, without opening it."""
    with _readable(path, expected):
        found = os.stat(path)
    if not stat.S_ISREG(found.st_mode):
        kind = _KINDS.get(stat.S_IFMT(found.st_mode), "no regular file")
        raise ReadError(kind, expected, "give the path of a file", file=str(path))
    return found


def open_regular(path: str | Path, expected: str = "a readable file") -> BinaryIO:
    check_regular(path, expected)
    with _readable(path, expected):
        return open(path, "rb")


def read_regular(path: str | Path, most: int, expected: str, cure: str) -> bytes:
    with open_regular(path, expected) as stream, _readable(path, expected):
        data = stream.read(most + 1)
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
        expected = "samples in the record, or in files below its folder"
        cure = "copy that file beside the record, or write the record whole"
        raise ReadError(f"samples in {name[:80]!r}", expected, cure, file=str(record))
    check_regular(path, f"a part of {record}")
    return path


@contextlib.contextmanager
def _readable(path: str | Path, expected: str) -> Iterator[None]:
    """Say in one line why a file cannot be read."""
    try:
        yield
        return
    except FileNotFoundError:
        os.getcwd()  # where that was deleted, it says so itself
        found = "no such file"
    except ValueError:  # in whose words each Python says it otherwise
        found = "a null byte in the name"
    except OSError as error:
        found = str(error.strerror or error)
    raise ReadError(found[:1].lower() + found[1:], expected, "check the path", file=str(path))


Content = Callable[[], bytes]
Seen = tuple[int, int, int, int] | None
"""What tells a file from another, or from itself before it was edited; None where there is none."""
_NOTHING = b"0" * 64
MARK = f"rotorid-sha256:{_NOTHING.decode()}"
"""What stands in a file, in a place that its format has for such, until `Kind.signed` fills it."""
_SIGNED = re.compile(rb"(?<=rotorid-sha256:)[0-9a-f]{64}")
_LARGEST = 4_000_000_000  # bytes of a file that is read to see who wrote it
_MARKS = 10  # of a file: a result holds the text of its experiment file, with the mark of that


@frozen
class Kind:
    """A kind of file that a command writes, and how one is known that nobody edited since."""

    writer: str  # the command

    def signed(self, data: bytes) -> bytes:
        """Return the content of a file with its hash in the place of `MARK`."""
        return data.replace(MARK.encode(), MARK.encode()[:-64] + self._hash(data), 1)

    def wrote(self, path: Path) -> bool:
        if path.stat().st_size > _LARGEST:
            return False
        data = path.read_bytes()
        said = islice(_SIGNED.finditer(data), _MARKS)
        return any(
            self._hash(data[: mark.start()] + _NOTHING + data[mark.end() :]) == mark.group()
            for mark in said
        )

    def _hash(self, data: bytes) -> bytes:
        return sha256(self.writer.encode() + data).hexdigest().encode()


REPORT = Kind("rotorid ... --report")


def check_target(path: Path, kind: Kind | None = None, *, force: bool = False) -> None:
    """Refuse, before any work, an unwritable path, or another's file, which `force` replaces."""
    try:
        mode = _mode(path)
    except (OSError, ValueError) as error:
        raise _refused(path, str(getattr(error, "strerror", None) or error)) from None
    if mode is None:
        if not os.path.isdir(os.path.dirname(os.path.realpath(path))):
            raise _refused(path, "no such folder", "a folder to write into", "create it")
    elif stat.S_ISDIR(mode):
        raise _refused(path, "a folder", cure="add a file name")
    elif stat.S_ISREG(mode):
        if not os.access(path, os.W_OK):
            raise _refused(path, "a file that may not be written")
        if kind is not None and not force and not _is_own(path, kind):
            found = f"a file that `{kind.writer}` did not write, or that was edited since"
            raise _refused(path, found, "a new name, or a file of its own", _OR_FORCE)


def seen(path: Path) -> Seen:
    """Return what is at a path now, for `write_files` to find it as it was."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


_OR_FORCE = "choose another name, or replace the file with --force (Python: force=True)"


def _refused(
    path: Path, found: str, expected: str = "a file to write", cure: str = "write elsewhere"
) -> InputError:
    return InputError(found, expected, cure, file=str(path))


def _mode(path: Path) -> int | None:
    try:
        return os.stat(path).st_mode
    except FileNotFoundError:
        return None


def _is_own(path: Path, kind: Kind) -> bool:
    """Tell whether a file is of this kind; one without content is nobody's."""
    try:
        return os.path.getsize(path) == 0 or kind.wrote(path)
    except Exception:  # whatever is wrong with it, it is not what was written
        return False


def check_apart(targets: Sequence[Path], inputs: Iterable[Path]) -> None:
    """Refuse to write over what a run reads, or twice into one file."""
    # A name with a null leads nowhere, and is refused where it is opened.
    real = [os.path.realpath(path) for path in inputs if "\0" not in str(path)]
    taken = dict.fromkeys(real, "an input of this run")
    for target in targets:
        if target.is_file() or not target.exists():  # devices and pipes take all
            place = os.path.realpath(target)
            if place in taken:
                raise _refused(target, taken[place], "a file of its own")
            taken[place] = "another output of this run"


def write_whole(path: str | Path, content: bytes) -> None:
    write_files({Path(path): lambda: content})


def write_files(contents: Mapping[Path, Content], found: Mapping[Path, Seen] | None = None) -> None:
    """Make all contents, write them beside their targets, and move them there.

    Devices and pipes are written to as they are. What `seen` said of files in `found` must still be
    true: another program wrote them otherwise. Where one cannot be written, none is changed.
    """
    made = {path: content() for path, content in contents.items()}
    parts: dict[str, Path] = {}
    try:
        for path, data in made.items():
            with _named(path):
                mode = _mode(path)
                if mode is None or stat.S_ISREG(mode):
                    parts[_written(path, data, mode)] = path
                else:
                    path.write_bytes(data)
        for path, before in (found or {}).items():
            if path in parts.values() and seen(path) != before:
                expected = "what was there when the command began"
                raise _refused(path, "a file that another program changed", expected, _OR_FORCE)
        for part, path in parts.items():
            with _named(path):
                os.replace(part, os.path.realpath(path))
    finally:
        for part in parts:
            with contextlib.suppress(OSError):
                os.unlink(part)


def _written(path: Path, data: bytes, mode: int | None) -> str:
    """Write a new file beside the one that it is to replace, with its mode; return its name."""
    import tempfile  # a tenth of what --help loads

    folder, name = os.path.split(os.path.realpath(path))
    file, part = tempfile.mkstemp(".part", f".{name[:80]}.", folder)
    try:
        with open(file, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(file)  # a full disk or quota may show only now
        os.umask(mask := os.umask(0o077))
        os.chmod(part, 0o666 & ~mask if mode is None else stat.S_IMODE(mode))
    except BaseException:
        os.unlink(part)
        raise
    return part


@contextlib.contextmanager
def _named(path: Path) -> Iterator[None]:
    """Give an error of the machine the name that the user gave the file."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno or errno.EIO, error.strerror or str(error), str(path)) from None
