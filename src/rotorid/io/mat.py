"""Reader of MATLAB files: a column is a one-dimensional variable."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from rotorid.core.files import open_regular
from rotorid.core.frozen import frozen
from rotorid.core.values import Floats
from rotorid.io import mat4, mat5
from rotorid.io.hdf5 import open_hdf5
from rotorid.io.mat5 import Packed, Plain, Stored
from rotorid.io.table import (
    Column,
    NamedArrays,
    Table,
    as_column,
    content,
    head,
    not_what_it_says,
    reading,
)


@frozen
class MatTable(NamedArrays):
    """A MATLAB file; its numbers are read when they are asked for."""

    stored: Mapping[str, Stored]

    def read(self, names: Iterable[str]) -> dict[str, Column]:
        """Return columns by the names that `find` returned."""
        places = {name: self.place(name) for name in names}
        self.check_held(list(places))
        whole: dict[str, Floats] = {}
        for path in dict.fromkeys(place.path for place in places.values()):
            whole[path] = self._numbers(path)
        return {name: Column(as_column(whole[p.path], p)) for name, p in places.items()}

    def scalar(self, name: str) -> float:
        """Return a variable of one number."""
        return float(self._numbers(self.find_scalar(name)).ravel()[0])

    def _numbers(self, path: str) -> Floats:
        """Read a variable."""
        found = self.stored[path]
        with open_regular(self.file) as stream, reading(self.file, "MAT data"):
            data: bytes | memoryview
            if found.packed is None:
                data = Plain(stream, found.begin + found.size).take(found.begin, found.size)
            else:
                begin, size, unpacked = found.packed
                source = Packed(stream, begin, size)
                source.end = unpacked
                source.close()
                data = source.view(found.begin, found.size)
            values = np.frombuffer(data, found.dtype).astype(np.float64, copy=False)
        return values.reshape(self.shapes[path], order="F")


def open_mat(path: Path) -> Table:
    """Open a MAT file of version 4 to 7, or one of version 7.3, which is HDF5 inside.

    The fields of structures are named by ``structure/field``.
    """
    start = head(path)
    kind = content(start)
    if kind in ("a MAT v7.3 file", "HDF5 data"):
        return open_hdf5(path)
    if kind not in ("a MAT v5 file", "binary data"):  # version 4 has no signature
        raise not_what_it_says(path, start, "a MAT file")
    size = path.stat().st_size
    with open_regular(path) as stream, reading(str(path), "MAT data"):
        if 0 in start[:4]:  # version 4 has a number of four bytes there
            found = mat4.stored_arrays(stream, size)
        else:
            found = mat5.stored_arrays(stream, size, str(path))
    stored = {name: one for name, one in found.items() if isinstance(one, Stored)}
    shapes = {name: tuple(n for n in one.shape if n != 1) for name, one in stored.items()}
    others = {name: one for name, one in found.items() if isinstance(one, str)}
    return MatTable(str(path), shapes, stored, others=others)
