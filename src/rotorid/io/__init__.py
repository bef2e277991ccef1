"""One reader per file format."""

from rotorid.io.reading import READERS, Source, open_table, read_record

__all__ = ["READERS", "Source", "open_table", "read_record"]
