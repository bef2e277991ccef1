"""What a command was given, said so that it can be done again."""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import file_digest
from pathlib import Path

from rotorid.estimate import SourceFile


def done(given: str, files: Sequence[Path]) -> list[str]:
    """Return the command, the version, and the files with their sha256."""
    from rotorid import __version__  # its look-up takes its time

    there = [path for path in dict.fromkeys(files) if path.is_file()]
    sums = (source_of(path) for path in there)
    return [given, f"rotorid {__version__}", *(f"{s.file}: sha256 {s.sha256}" for s in sums)]


def source_of(path: Path) -> SourceFile:
    """Return a file with its sha256."""
    with path.open("rb") as stream:
        return SourceFile(str(path), file_digest(stream, "sha256").hexdigest())
