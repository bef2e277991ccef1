"""What every value of the package keeps to: equal by content, its arrays read-only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


class ByContent:
    """A base of frozen dataclasses (``eq=False``) that hold arrays: ``==`` compares content.

    NaN equals NaN: what is not determined is the same as what is not determined.
    """

    __hash__: ClassVar[None]  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        return same(self, other) if type(other) is type(self) else NotImplemented


def same(first: Any, second: Any) -> bool:
    """Say whether two values hold the same, arrays and NaN included."""
    if first is second:
        return True
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        return _same_arrays(np.asarray(first), np.asarray(second))
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        return first.keys() == second.keys() and all(same(first[k], second[k]) for k in first)
    if isinstance(first, tuple | list) and isinstance(second, tuple | list):
        return len(first) == len(second) and all(map(same, first, second))
    if type(first) is type(second) and is_dataclass(first):
        names = [field.name for field in fields(first) if field.compare]
        return all(same(getattr(first, name), getattr(second, name)) for name in names)
    if isinstance(first, float) and isinstance(second, float) and first != first:
        return second != second
    return bool(first == second)


def _same_arrays(first: NDArray[Any], second: NDArray[Any]) -> bool:
    numbers = first.dtype.kind in "fc" and second.dtype.kind in "fc"
    return first.shape == second.shape and np.array_equal(first, second, equal_nan=numbers)


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return a view of an array that refuses to be written to."""
    view = array.view()
    view.flags.writeable = False
    return view
