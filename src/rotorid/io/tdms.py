"""Reader of TDMS files, as LabVIEW writes them: a column is a channel of a group."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np

from rotorid.core.errors import ReadError
from rotorid.core.files import open_regular
from rotorid.core.frozen import frozen
from rotorid.core.limits import VISITS
from rotorid.core.values import Floats
from rotorid.io.table import (
    Column,
    NamedArrays,
    Rate,
    check_content,
    check_size,
    is_numeric,
    package,
    reading,
    silent,
)

_LEAD = struct.Struct("<4siiqq")  # of a segment: its contents as bits, its version, two sizes
_LISTS, _ANEW, _BIG = 1 << 1, 1 << 2, 1 << 6  # objects listed, all anew, numbers of the other order


@frozen
class TdmsTable(NamedArrays):
    """A TDMS file; its numbers are read when they are asked for."""

    channels: Mapping[str, tuple[str, str]]

    def read(self, names: Iterable[str]) -> dict[str, Column]:
        names = list(names)
        self.check_held(names)
        with _opened(self.file) as data:
            found = {name: self._channel(data, name) for name in names}
            return {name: Column(_floats(c[:]), *_stated(c)) for name, c in found.items()}

    def blocks(self, names: Sequence[str], rows: int) -> Iterator[dict[str, Column]]:
        with _opened(self.file) as data:
            channels = {name: self._channel(data, name) for name in names}
            count = max(len(channel) for channel in channels.values())
            for begin in range(0, count, rows):
                yield {
                    name: Column(_floats(c[begin : begin + rows]), *_stated(c))
                    for name, c in channels.items()
                }

    def _channel(self, data: Any, name: str) -> Any:
        group, channel = self.channels[self.place(name).path]
        return data[group][channel]


def open_tdms(path: Path) -> TdmsTable:
    check_content(path, "TDMS data")
    _check_segments(path)
    channels, shapes = {}, {}
    with _opened(str(path)) as data:
        for group in data.groups():
            for channel in group.channels():
                if channel.dtype is not None and _is_number(channel.dtype):
                    name = f"{group.name}/{channel.name}"
                    check_size(len(channel), str(path))
                    channels[name], shapes[name] = (group.name, channel.name), (len(channel),)
    return TdmsTable(str(path), shapes, channels)


def _check_segments(path: Path) -> None:
    """Refuse a file of more pieces than one has patience for: each is looked at by itself."""
    visits, listed, place, size = 0, 0, 0, path.stat().st_size
    with open_regular(path) as stream:
        while place + _LEAD.size <= size and visits <= VISITS:
            stream.seek(place)
            lead = stream.read(_LEAD.size + 4)
            tag, contents, _version, after, _raw = _LEAD.unpack_from(lead)
            if tag != b"TDSm" or not 0 <= after < size:  # damaged, or the last of a broken record
                return
            if contents & _LISTS and len(lead) > _LEAD.size:
                order: Literal["big", "little"] = "big" if contents & _BIG else "little"
                number = int.from_bytes(lead[_LEAD.size :], order)
                listed = number if contents & _ANEW else max(listed, number)
            visits += 1 + listed
            place += _LEAD.size + after
    if visits > VISITS:
        raise ReadError(
            f"more than {VISITS} pieces of channels",
            "longer pieces",
            "put them together: TDMS Defragment in LabVIEW",
            file=str(path),
        )


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
