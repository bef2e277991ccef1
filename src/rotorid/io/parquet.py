"""Reader of Parquet files."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.core.errors import ReadError
from rotorid.core.files import open_regular
from rotorid.core.frozen import frozen
from rotorid.core.limits import COLUMNS, FOOTER_BYTES
from rotorid.core.values import Floats
from rotorid.io.child import in_child
from rotorid.io.table import (
    Column,
    StoredArrays,
    check_content,
    check_size,
    package,
    reading,
)

_TOGETHER = 100  # columns that are read at once: each by itself takes ten times as long


@frozen
class ParquetTable(StoredArrays):
    def rows(self, names: Sequence[str], rows: int | None) -> Iterator[dict[str, Column]]:
        paths = {name: self.place(name).path for name in names}
        with reading(self.file, "Parquet data"), _opened(self.file) as data:
            schema = data.schema_arrow  # made anew each time
            units = {name: _unit(schema.field(path)) for name, path in paths.items()}
            asked = list(dict.fromkeys(paths.values()))
            if rows is None:
                for begin in range(0, len(asked), _TOGETHER):
                    some = asked[begin : begin + _TOGETHER]
                    read = data.read(columns=some, use_threads=False)
                    found = {path: _numbers(read.column(path)) for path in some}
                    yield {n: Column(found[p], units[n]) for n, p in paths.items() if p in found}
                return
            for batch in data.iter_batches(max(rows, 1024), columns=asked, use_threads=False):
                yield {n: Column(_numbers(batch.column(p)), units[n]) for n, p in paths.items()}


def open_parquet(path: Path) -> ParquetTable:
    check_content(path, "Parquet data")
    _check_footer(path)
    package("pyarrow.parquet", str(path))  # here once: a child would take its time to import it
    found: ParquetTable = in_child(_table, str(path), path)
    return found


def _check_footer(path: Path) -> None:
    """Refuse a description of columns that takes its reader a hundred times its bytes."""
    with open_regular(path) as stream:
        stream.seek(-8, os.SEEK_END)
        size, end = int.from_bytes(stream.read(4), "little"), stream.read()
    if end == b"PAR1" and size > FOOTER_BYTES:
        raise ReadError(
            f"{size // 10**6} MB that describe the columns",
            f"{FOOTER_BYTES // 10**6} MB at most",
            "export fewer columns, or larger row groups",
            file=str(path),
        )


def _table(path: Path) -> ParquetTable:
    with reading(str(path), "Parquet data"), _opened(str(path)) as data:
        import pyarrow.types as kinds

        schema, rows = data.schema_arrow, data.metadata.num_rows
        if len(schema.names) > COLUMNS:
            raise ReadError(
                f"{len(schema.names)} columns",
                f"{COLUMNS} at most",
                "export a part of them",
                file=str(path),
            )
        counts = Counter(schema.names)
        names = [
            field.name
            for field in schema
            if counts[field.name] == 1
            and (
                kinds.is_integer(field.type)
                or kinds.is_floating(field.type)
                or kinds.is_boolean(field.type)
                or kinds.is_decimal(field.type)
                or kinds.is_timestamp(field.type)
            )
        ]
        check_size(rows, str(path))
    return ParquetTable(str(path), dict.fromkeys(names, (rows,)))


def _opened(file: str) -> Any:
    return package("pyarrow.parquet", file).ParquetFile(file, memory_map=False)


def _numbers(column: Any) -> Floats:
    """Return the numbers of a column, those that are missing as NaN; times in s."""
    import pyarrow as pa

    if pa.types.is_timestamp(column.type):
        nanoseconds = (
            column.cast(pa.timestamp("ns")).cast(pa.int64()).to_numpy(zero_copy_only=False)
        )
        return np.asarray((nanoseconds - nanoseconds[:1]) * 1e-9, dtype=np.float64)
    return np.asarray(
        column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False), dtype=np.float64
    )


def _unit(field: Any) -> str | None:
    """Return the unit in the metadata of a column."""
    for key in (b"units", b"unit"):
        if field.metadata and key in field.metadata:
            return field.metadata[key].decode("utf-8", "replace").strip() or None
    return "s" if str(field.type).startswith("timestamp") else None
