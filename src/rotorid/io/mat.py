"""Reader of MATLAB files: a column is a one-dimensional variable."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.core.files import open_regular
from rotorid.io.child import in_child
from rotorid.io.hdf5 import open_hdf5
from rotorid.io.table import (
    Column,
    ColumnFile,
    check_size,
    content,
    head,
    is_numeric,
    loaded,
    not_what_it_says,
    reading,
)

TWICE = "two variables of that name"
Contents = tuple[dict[str, Column], dict[str, str]]
"""The arrays of a file by their paths, and what else is in it."""


def open_mat(path: Path) -> ColumnFile:
    """Open a MAT file of version 4 to 7, or one of version 7.3, which is HDF5 inside.

    The fields of structures are named by ``structure/field``.
    """
    kind = content(head(path))
    if kind in ("a MAT v7.3 file", "HDF5 data"):
        return open_hdf5(path)
    if kind not in ("a MAT v5 file", "binary data"):  # version 4 has no signature
        raise not_what_it_says(path, kind, "a MAT file")
    import_module("scipy.io")  # here once: each child would take its time to import it
    return loaded(str(path), *in_child(_contents, str(path), path))


def _contents(path: Path) -> Contents:
    from scipy.io import loadmat, whosmat

    file = str(path)
    with open_regular(path) as opened, reading(file, "MAT data"):
        stream: Any = opened  # scipy's stubs know no streams
        declared = whosmat(stream)
        check_size(sum(math.prod(shape) for _, shape, _ in declared), file)
        counts = Counter(name for name, _, _ in declared)
        once = [name for name, count in counts.items() if count == 1]
        stream.seek(0)
        found = loadmat(stream, variable_names=once, simplify_cells=True)
    arrays, others = dict[str, Column](), {name: TWICE for name in counts if name not in once}
    for path_inside, value in _flat("", {name: found[name] for name in once if name in found}):
        if kind := _kind(value):
            others[path_inside] = kind
        else:
            arrays[path_inside] = Column(np.asarray(value, dtype=np.float64))
    check_size(sum(column.values.size for column in arrays.values()), file)
    return arrays, others


def _flat(prefix: str, fields: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield what structures hold, by its path."""
    for name, value in fields.items():
        if isinstance(value, dict):
            yield from _flat(f"{prefix}{name}/", value)
        else:
            yield prefix + name, value


def _kind(value: Any) -> str:
    """Return what holds no real numbers; empty for what does."""
    from scipy.sparse import issparse

    if issparse(value):
        return "a sparse matrix"
    array = np.asarray(value, dtype=object if isinstance(value, list) else None)
    if array.dtype.kind in "SU":
        return "text"
    if array.dtype.kind == "c":
        return "complex numbers"
    if is_numeric(array.dtype):
        return ""
    inside = [type(each) for each in array.ravel()[:1]]
    return "an array of structures" if dict in inside else "cells"
