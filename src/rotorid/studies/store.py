"""Rows of a study in a folder: Parquet files of as many cases each, and a journal of the rest."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.core.errors import InputError, ReadError, one_line
from rotorid.core.files import write_whole
from rotorid.core.watch import counting
from rotorid.studies.study_case import MACHINE, STOPPED, Row

try:
    import pyarrow as pa
    import pyarrow.parquet as pq
except ImportError:
    told, cure = "no package pyarrow, which keeps the rows", "pip install 'rotorid[files]'"
    raise InputError(told, "it to be installed", cure) from None

PART = 250
"""Cases of a file: a few hundred files for 100,000 cases, and a journal that is read in no time."""
RESULTS, PARTS, JOURNAL, STUDY = "results.parquet", "part-*.parquet", "journal.jsonl", "study.json"

_HEADS = {"case", "verdict", "seconds", "error"}
_TEXTS = ("status", "verdict", "error", *MACHINE)
"""Columns that may be empty throughout a part, and are texts all the same."""


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Hold a folder for one run; the system lets go of it however that ends (not on Windows)."""
    if folder.is_file():
        found, cure = "a file", "name another with --out"
        raise InputError(found, "a folder for the results", cure, file=str(folder))
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".lock").open("a") as lock:
        with suppress(ImportError, OSError):  # of a file system without locks
            import fcntl

            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                found, cure = "a study that runs", "wait for its end, or name another folder"
                raise InputError(found, "one run per folder", cure, file=str(folder)) from None
        yield


class Store:
    """The rows of a study, each kept from the moment it is added, whatever ends the program then.

    A part is written, whole, when all its cases are there, in the order of their numbers: what is
    in it depends on neither the order in which they came nor on interruptions. What stopped a case
    within less than the time limit may have passed: the case is not kept.
    """

    def __init__(self, folder: Path, identity: str, *, resume: bool, timeout: float) -> None:
        self._results, self._journal = folder / RESULTS, folder / JOURNAL
        self._results.mkdir(parents=True, exist_ok=True)
        check_folder(folder, identity, resume=resume)
        write_whole(folder / STUDY, identity.encode())
        self._whole: set[int] = set()  # numbers of the parts that are complete
        self._open: dict[int, Row] = {}  # rows of the others
        for path in self._parts:
            heads = _read(path, ["verdict", "seconds"]).to_pylist()
            if len(heads) == PART and not any(_passes(row, timeout) for row in heads):
                self._whole.add(int(path.stem.rpartition("-")[2]))
            else:
                self._open |= {row["case"]: row for row in _read(path).to_pylist()}
        newer = {row["case"]: row for row in _journalled(self._journal)}
        found = {c: row for c, row in (self._open | newer).items() if c // PART not in self._whole}
        self._open = {c: row for c, row in found.items() if not _passes(row, timeout)}
        self._write_journal()

    @property
    def _parts(self) -> list[Path]:
        return sorted(self._results.glob(PARTS))

    def __len__(self) -> int:
        return PART * len(self._whole) + len(self._open)

    def __contains__(self, case: int) -> bool:
        return case // PART in self._whole or case in self._open

    def add(self, row: Row) -> None:
        self._open[row["case"]] = row
        part = row["case"] // PART
        if all(case in self._open for case in _cases(part)):
            self._write_part(part)
            self._write_journal()
        else:
            with self._journal.open("a", encoding="utf-8") as journal:
                journal.write(json.dumps(row) + "\n")

    def close(self) -> None:
        """Write what is left, and give all parts the same columns: one of failures has fewer."""
        for part in sorted({case // PART for case in self._open}):
            self._write_part(part)
        self._journal.unlink()
        schema = pa.unify_schemas([pq.read_schema(path) for path in self._parts])
        for path in self._parts:
            if pq.read_schema(path) != schema:
                _write(path, pa.Table.from_pylist(pq.read_table(path).to_pylist(), schema))

    def _write_part(self, part: int) -> None:
        rows = [self._open.pop(case) for case in _cases(part) if case in self._open]
        _write(self._results / PARTS.replace("*", f"{part:06}"), _table(rows))
        if len(rows) == PART:
            self._whole.add(part)

    def _write_journal(self) -> None:
        lines = (json.dumps(row) + "\n" for row in self._open.values())
        write_whole(self._journal, "".join(lines).encode())


def check_folder(folder: Path, identity: str, *, resume: bool) -> None:
    """Refuse a folder with other results, and one with results where nobody wants to go on."""
    if not (file := folder / STUDY).exists():
        if (folder / JOURNAL).exists() or any((folder / RESULTS).glob(PARTS)):
            found, cure = "no such file beside results", "put it back, or name another folder"
            raise ReadError(found, "the study that they are of", cure, file=str(file))
        return
    found, cure = "results of this study", "go on with --resume, or name another folder"
    if differs := file.read_bytes() != identity.encode():
        found, cure = "results of another study, or of this one as it was", "name another folder"
    if differs or not resume:
        raise InputError(found, "a folder without results", cure, file=str(folder))


def _passes(row: Row, timeout: float) -> bool:
    """Tell whether a case was stopped by what may pass: another limit, more memory or disk."""
    return bool(row["verdict"] == STOPPED and row["seconds"] < timeout)


def _cases(part: int) -> range:
    return range(part * PART, (part + 1) * PART)


def _table(rows: list[Row]) -> Any:
    names = dict.fromkeys(name for row in rows for name in row)
    texts = dict.fromkeys(_TEXTS, pa.string())
    return pa.table({n: pa.array([row.get(n) for row in rows], texts.get(n)) for n in names})


def _read(path: Path, columns: list[str] | None = None) -> Any:
    try:
        return pq.read_table(path, columns=columns)
    except (pa.ArrowException, OSError) as error:
        found, cure = f"a damaged file ({error})", "delete it; --resume repeats its cases"
        raise ReadError(found, "rows as a study wrote them", cure, file=str(path)) from None


def _write(path: Path, table: Any) -> None:
    content = BytesIO()
    pq.write_table(table, content, compression="zstd")
    write_whole(path, content.getvalue())


def _journalled(path: Path) -> Iterator[Row]:
    """Yield the rows of a journal; one may be cut off where the program or the machine ended."""
    lines = path.read_bytes().splitlines(keepends=True) if path.exists() else []
    for number, line in enumerate(lines, start=1):
        try:
            row = json.loads(line) if line.endswith(b"\n") else None
        except ValueError:
            continue
        if isinstance(row, dict) and row.keys() >= _HEADS and isinstance(row["case"], int):
            yield row
        elif row is not None:
            found, cure = one_line(str(row), 60), "delete this line; --resume repeats its case"
            raise ReadError(found, "a row of a case", cure, file=str(path), place=f"line {number}")


def read_rows(folder: Path) -> Any:
    """Return the rows that a folder holds, also while a study runs, as a table of pyarrow."""
    # First the journal: its rows are the newer ones, and leave it only for a part.
    rows = list(_journalled(folder / JOURNAL))
    parts = [_table(rows)] if rows else []
    paths = counting(sorted((folder / RESULTS).glob(PARTS)), "reading results")
    parts += map(_read, paths)
    if not parts:
        raise InputError("no results", "those of a study", "run it first", file=str(folder))
    table = pa.concat_tables(parts, promote_options="default")
    _, first = np.unique(table["case"].to_numpy(), return_index=True)  # some are in both
    return table.take(first)
