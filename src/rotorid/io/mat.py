"""Reader of MATLAB files: a column is a one-dimensional variable."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from rotorid.io.hdf5 import open_hdf5
from rotorid.io.mat5 import check_elements
from rotorid.io.table import (
    Column,
    Table,
    content,
    head,
    is_numeric,
    loaded,
    not_what_it_says,
    reading,
)


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
        if 0 not in start[:4]:  # no version 4, which has a number of four bytes there
            check_elements(path)
        _collect("", scipy.io.loadmat(str(path), simplify_cells=True), variables)
    return loaded(str(path), variables)


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
