"""One reader per file format."""

from rotorid.io.opening import READERS, open_table, open_tables
from rotorid.io.record import Source, read_record

__all__ = ["READERS", "Source", "open_table", "open_tables", "read_record"]
