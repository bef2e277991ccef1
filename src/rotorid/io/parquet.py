"""Reader of Parquet files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.core.errors import ReadError
from rotorid.core.frozen import frozen
from rotorid.core.limits import COLUMNS
from rotorid.core.values import Floats
from rotorid.io.table import (
    Column,
    NamedArrays,
    check_content,
    check_size,
    package,
    reading,
)


@frozen
class ParquetTable(NamedArrays):
    """A Parquet file; its numbers are read when they are asked for."""

    def read(self, names: Iterable[str]) -> dict[str, Column]:
        wanted = {name: self.place(name).path for name in names}
        self.check_held(list(wanted))
        with reading(self.file, "Parquet data"), _opened(self.file) as data:
            table = data.read(columns=list(dict.fromkeys(wanted.values())))
            return {
                name: Column(_numbers(table.column(path)), _unit(table.schema.field(path)))
                for name, path in wanted.items()
            }

    def blocks(self, names: Sequence[str], rows: int) -> Iterator[dict[str, Column]]:
        with reading(self.file, "Parquet data"), _opened(self.file) as data:
            units = {name: _unit(data.schema_arrow.field(name)) for name in names}
            for batch in data.iter_batches(batch_size=max(rows, 1024), columns=list(names)):
                yield {n: Column(_numbers(batch.column(n)), units[n]) for n in names}


def open_parquet(path: Path) -> ParquetTable:
    check_content(path, "Parquet data")
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
