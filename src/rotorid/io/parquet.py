"""Reader of Parquet files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.core.errors import ReadError
from rotorid.core.frozen import frozen
from rotorid.core.limits import COLUMNS
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


@frozen
class ParquetTable(StoredArrays):
    def rows(self, names: Sequence[str], rows: int | None) -> Iterator[dict[str, Column]]:
        paths = {name: self.place(name).path for name in names}
        with reading(self.file, "Parquet data"), _opened(self.file) as data:
            units = {name: _unit(data.schema_arrow.field(path)) for name, path in paths.items()}
            if rows is None:
                for name, path in paths.items():
                    column = data.read(columns=[path], use_threads=False).column(path)
                    yield {name: Column(_numbers(column), units[name])}
                return
            asked = list(dict.fromkeys(paths.values()))
            for batch in data.iter_batches(max(rows, 1024), columns=asked, use_threads=False):
                yield {n: Column(_numbers(batch.column(p)), units[n]) for n, p in paths.items()}


def open_parquet(path: Path) -> ParquetTable:
    check_content(path, "Parquet data")
    package("pyarrow.parquet", str(path))  # here once: a child would take its time to import it
    found: ParquetTable = in_child(_table, str(path), path)
    return found


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
