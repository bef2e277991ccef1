"""Reader of TDMS files, as LabVIEW writes them: a column is a channel of a group."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.core.values import Floats
from rotorid.io.child import in_child
from rotorid.io.table import (
    Column,
    Rate,
    StoredArrays,
    check_content,
    check_size,
    is_numeric,
    package,
    reading,
    silent,
)


@frozen
class TdmsTable(StoredArrays):
    channels: Mapping[str, tuple[str, str]]

    def rows(self, names: Sequence[str], rows: int | None) -> Iterator[dict[str, Column]]:
        with _opened(self.file) as data:
            channels = {}
            for name in names:
                group, channel = self.channels[self.place(name).path]
                channels[name] = data[group][channel]
            if rows is None:
                for name, channel in channels.items():
                    yield {name: Column(_floats(channel[:]), *_stated(channel))}
                return
            for begin in range(0, max(len(channel) for channel in channels.values()), rows):
                yield {
                    name: Column(_floats(c[begin : begin + rows]), *_stated(c))
                    for name, c in channels.items()
                }


def open_tdms(path: Path) -> TdmsTable:
    check_content(path, "TDMS data")
    package("nptdms", str(path))  # here once: each child would take its time to import it
    found: TdmsTable = in_child(_table, str(path), path)
    return found


def _table(path: Path) -> TdmsTable:
    channels, shapes = {}, {}
    with _opened(str(path)) as data:
        for group in data.groups():
            for channel in group.channels():
                if channel.dtype is not None and _is_number(channel.dtype):
                    name = f"{group.name}/{channel.name}"
                    check_size(len(channel), str(path))
                    channels[name], shapes[name] = (group.name, channel.name), (len(channel),)
    return TdmsTable(str(path), shapes, channels)


@contextmanager
def _opened(file: str) -> Iterator[Any]:
    nptdms = package("nptdms", file)
    with (
        silent(),
        reading(file, "TDMS data"),
        Path(file).open("rb") as stream,
        nptdms.TdmsFile.open(stream) as data,
    ):
        yield data


def _is_number(dtype: Any) -> bool:
    return is_numeric(dtype) or np.dtype(dtype).kind == "M"


def _floats(values: Any) -> Floats:
    """Return numbers as floats; time stamps in s from the first."""
    array = np.asarray(values)
    if array.dtype.kind == "M":
        array = (array - array[:1]).astype("timedelta64[ns]").astype(np.int64) * 1e-9
    return np.asarray(array, dtype=np.float64)


def _stated(channel: Any) -> tuple[str | None, Rate | None, float | None]:
    """Return unit, sample rate and time of the first sample in the properties of a channel."""
    unit = str(channel.properties.get("unit_string", "")).strip() or None
    step = channel.properties.get("wf_increment")
    usable = isinstance(step, int | float) and np.isfinite(step) and step > 0
    if np.dtype(channel.dtype).kind == "M":
        unit = "s"
    return unit, Rate(1 / float(step)) if usable and step != 1.0 else None, _start(channel)


def _start(channel: Any) -> float | None:
    """Return when the first sample was taken, in s; None where the file does not say."""
    begun, offset = (channel.properties.get(f"wf_start_{key}") for key in ("time", "offset"))
    if begun is None and offset is None:
        return None
    later = float(offset) if isinstance(offset, int | float) and np.isfinite(offset) else 0.0
    if not isinstance(begun, np.datetime64) or np.isnat(begun):
        return later
    since = begun.astype("datetime64[us]") - np.datetime64("2000-01-01", "us")
    return float(since.astype(np.int64)) * 1e-6 + later
