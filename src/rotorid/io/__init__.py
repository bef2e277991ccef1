"""One reader per file format."""

from rotorid.io.columns import Source, read_record
from rotorid.io.table import READERS, open_table, open_tables

__all__ = ["READERS", "Source", "open_table", "open_tables", "read_record"]
