"""Numbers that an HDF5 file holds packed, by the attributes beside them, as netCDF does.

``value = scale_factor * stored + add_offset``, and a stored ``_FillValue`` is no sample at all.
"""

from __future__ import annotations

from typing import Any

import h5py
import numpy as np

from rotorid.core.errors import ReadError
from rotorid.core.frozen import frozen
from rotorid.core.limits import COLUMNS
from rotorid.io.table import is_numeric


@frozen
class Packing:
    """How stored numbers become samples."""

    scale: float = 1.0
    offset: float = 0.0
    missing: tuple[float, ...] = ()  # stored numbers that stand for a gap
    wrap: float = 0.0  # added to negative numbers: unsigned ones that were stored as signed

    def unpacked(self, stored: Any) -> Any:
        """Return samples, gaps as NaN; what is not packed as it is."""
        if self == Packing():
            return stored
        found = np.array(stored, dtype=np.float64)
        gaps = np.isin(found, self.missing) if self.missing else None
        if self.wrap:
            found[found < 0] += self.wrap
        found *= self.scale
        found += self.offset
        if gaps is not None:
            found[gaps] = np.nan
        return found


def packing_of(dataset: Any, file: str) -> Packing:
    """Return how the numbers of a data set are packed.

    Raises
    ------
    ReadError
        Where its attributes are no single numbers.
    """
    attributes = dataset.attrs
    one = {"scale_factor": 1.0, "add_offset": 0.0}
    for key in one:
        if key in attributes:
            one[key] = _number(attributes, key, dataset.name, file)
    missing = []
    for key in ("_FillValue", "missing_value"):
        found = attribute(attributes, key)
        if found is not None and is_numeric(found.dtype):
            missing += [float(x) for x in found if np.isfinite(x)]
    text = attribute(attributes, "_Unsigned")
    unsigned = text is not None and str(text[0]).strip("b'").lower() == "true"
    wrap = 2.0 ** (8 * dataset.dtype.itemsize) if unsigned and dataset.dtype.kind == "i" else 0.0
    return Packing(one["scale_factor"], one["add_offset"], tuple(missing), wrap)


def _number(attributes: Any, key: str, name: str, file: str) -> float:
    found = attribute(attributes, key)
    number = float(found[0]) if found is not None and _is_one(found) else float("nan")
    if not np.isfinite(number) or (number == 0 and key == "scale_factor"):
        raise ReadError(
            f"an attribute {key} of {name[:80]!r} that is no number to scale by",
            "one number that is not 0" if key == "scale_factor" else "one number",
            "write the samples as they are, or that attribute anew",
            file=file,
        )
    return number


def _is_one(found: Any) -> bool:
    return len(found) == 1 and is_numeric(found.dtype)


def attribute(attributes: Any, key: str) -> Any:
    """Return an attribute as a row of values; None where there is none, or none that we ask for."""
    if key not in attributes or (shape := (told := attributes.get_id(key)).shape) is None:
        return None
    if told.dtype.kind == "O" and h5py.check_string_dtype(told.dtype) is None:
        return None  # a list of any length: of a damaged one HDF5 ends the process
    return np.ravel(attributes[key]) if 0 < np.prod(shape) <= COLUMNS else None
