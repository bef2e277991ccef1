"""Files written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from rotorid.errors import InputError


def check_target(path: Path) -> None:
    """Refuse a path that cannot be written, before the work that leads to it."""
    if not path.absolute().parent.is_dir():
        raise InputError("no such folder", "a folder to write into", "create it", file=str(path))
    if path.is_dir():
        raise InputError("a folder", "a file to write", "add a file name", file=str(path))


def check_apart(targets: Sequence[Path], inputs: Iterable[Path]) -> None:
    """Refuse to write over what a run reads, or twice into one file."""
    taken = {path.resolve(): "an input of this run" for path in inputs}
    for target in targets:
        if target.is_file() or not target.exists():  # devices and pipes take all
            found = taken.get(target.resolve())
            if found is not None:
                raise InputError(found, "a file of its own", "write elsewhere", file=str(target))
            taken[target.resolve()] = "another output of this run"


def write_files(writers: Mapping[Path, Callable[[Path], object]]) -> None:
    """Write files beside their targets, and move them there once all are written."""
    written: dict[Path, Path] = {}
    try:
        for path, write in writers.items():
            if path.exists() and not path.is_file():  # a device or a pipe
                write(path)
                continue
            target = path.resolve()
            part = target.with_name(f".{target.name}.{os.getpid()}.part")
            written[part] = target
            write(part)
        for part, target in written.items():
            os.replace(part, target)
    finally:
        for part in written:
            part.unlink(missing_ok=True)
