"""Reader of MATLAB files up to version 7: a column is a one-dimensional variable."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from rotorid.errors import ReadError
from rotorid.io.table import (
    Column,
    NamedArrays,
    as_column,
    content,
    head,
    is_numeric,
    not_what_it_says,
    resolve,
    too_large,
)


@dataclass(frozen=True)
class MatTable(NamedArrays):
    """The numeric variables of a MAT file; those in structures by ``structure/field``."""

    variables: dict[str, Any]

    def read(self, names: Iterable[str]) -> dict[str, Column]:
        """Return columns by the names that `find` returned."""
        columns = {}
        for name in names:
            path, index = resolve(name, self.shapes, self.file)
            columns[name] = Column(as_column(self.variables[path], index))
        return columns

    def scalar(self, name: str) -> float:
        """Return a variable of one number."""
        return float(np.ravel(self.variables[self.find_scalar(name)])[0])


def open_mat(path: Path) -> MatTable:
    """Open a MAT file of version 4 to 7."""
    start = head(path)
    kind = content(start)
    if kind == "a MAT v7.3 file":
        raise ReadError(
            kind,
            "MAT v5 (this version does not read v7.3)",
            "save it in MATLAB with save(..., '-v7'), or write HDF5",
            file=str(path),
        )
    if kind not in ("a MAT v5 file", "binary data"):  # version 4 has no signature
        raise not_what_it_says(path, start, "a MAT file")
    try:
        loaded = scipy.io.loadmat(str(path), simplify_cells=True)
    except MemoryError:
        raise too_large(str(path)) from None
    except Exception as error:  # scipy raises whatever the damage leads to
        raise ReadError(
            f"damaged MAT data ({error})", "a whole MAT v5 file", "write it again", file=str(path)
        ) from error
    variables: dict[str, Any] = {}
    _collect("", loaded, variables)
    shapes = {name: np.shape(values) for name, values in variables.items()}
    return MatTable(str(path), shapes, variables)


def _collect(prefix: str, values: dict[str, Any], into: dict[str, Any]) -> None:
    """Note the numeric variables, those of structures by their path."""
    for name, value in values.items():
        if name.startswith("__"):
            continue
        if isinstance(value, dict):
            _collect(f"{prefix}{name}/", value, into)
        elif isinstance(value, np.ndarray | np.generic | int | float) and is_numeric(
            np.asarray(value).dtype
        ):
            into[prefix + name] = np.asarray(value)
