"""What a command was given: its arguments, and its files with their sha256."""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import file_digest
from pathlib import Path
from platform import python_version

import numpy as np
import scipy

from rotorid.answer.contents import SourceFile
from rotorid.core.files import check_regular, is_hollow
from rotorid.core.limits import HASHED_BYTES


def done(given: str, files: Sequence[Path]) -> list[str]:
    from rotorid import __version__  # its look-up takes its time

    there = [path for path in dict.fromkeys(files) if path.is_file()]
    sums = (source_of(path) for path in there)
    return [
        given,
        f"rotorid {__version__}, {environment()}",
        *(f"{s.file}: sha256 {s.sha256 or 'not taken'}" for s in sums),
    ]


def environment() -> str:
    return f"Python {python_version()}, numpy {np.__version__}, scipy {scipy.__version__}"


def source_of(path: Path) -> SourceFile:
    """Return a file with its sha256; without it, where it is beyond measure or made of holes."""
    found = check_regular(path)
    if is_hollow(found) or found.st_size > HASHED_BYTES:
        return SourceFile(str(path), "")
    with path.open("rb") as stream:
        return SourceFile(str(path), file_digest(stream, "sha256").hexdigest())
