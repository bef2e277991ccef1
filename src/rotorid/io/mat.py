"""Reader of MATLAB files: a column is a one-dimensional variable."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any, Literal

import numpy as np
import scipy.io

from rotorid.io.hdf5 import open_hdf5
from rotorid.io.table import (
    Column,
    Table,
    check_size,
    content,
    head,
    is_numeric,
    loaded,
    not_what_it_says,
    reading,
)

_MATRIX, _COMPRESSED = 14, 15  # kinds of data element


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
    variables: dict[str, Column] = {}
    with reading(str(path), "MAT data"):
        if kind == "a MAT v5 file":
            _check_elements(path)
        _collect("", scipy.io.loadmat(str(path), simplify_cells=True), variables)
    return loaded(str(path), variables)


def _check_elements(path: Path) -> None:
    """Refuse compressed elements that are no matrices, or larger than their file can be."""
    with path.open("rb") as stream:
        order: Literal["little", "big"] = "big" if stream.read(128)[126:] == b"MI" else "little"
        while len(tag := stream.read(8)) == 8:
            kind, size = (int.from_bytes(tag[i : i + 4], order) for i in (0, 4))
            if kind == _COMPRESSED:
                inner = zlib.decompressobj().decompress(stream.read(min(size, 1024)), 8)
                stream.seek(max(size - 1024, 0), 1)
                if int.from_bytes(inner[:4], order) != _MATRIX:
                    raise ValueError("a compressed element that is no matrix")
                check_size(int.from_bytes(inner[4:8], order), str(path), itemsize=1)
            else:
                stream.seek(size, 1)


def _collect(prefix: str, values: dict[str, Any], into: dict[str, Column]) -> None:
    """Note the numeric variables, those of structures by their path."""
    for name, value in values.items():
        if name.startswith("__"):
            continue
        if isinstance(value, dict):
            _collect(f"{prefix}{name}/", value, into)
        elif isinstance(value, np.ndarray | np.generic | int | float) and is_numeric(
            np.asarray(value).dtype
        ):
            into[prefix + name] = Column(np.asarray(value))
