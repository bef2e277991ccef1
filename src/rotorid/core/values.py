"""Values: frozen, equal by content, their arrays read-only."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import fields, is_dataclass
from functools import cached_property
from html import escape
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from rotorid.core.frozen import frozen as frozen

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]


Array = NDArray[Any]
Key = TypeVar("Key", bound=Hashable)
Member = TypeVar("Member")


def grouped(pairs: Iterable[tuple[Key, Member]]) -> dict[Key, list[Member]]:
    """Return the members of each key, both in the order of the pairs."""
    found: dict[Key, list[Member]] = {}
    for key, member in pairs:
        found.setdefault(key, []).append(member)
    return found


class ByContent:
    """A base of frozen dataclasses (``eq=False``) with arrays: ``==`` by content, NaN as NaN."""

    __hash__: ClassVar[None]  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        return same(self, other) if type(other) is type(self) else NotImplemented


def same(first: Any, second: Any) -> bool:
    if first is second:
        return True
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        one, other = np.asarray(first), np.asarray(second)
        numbers = one.dtype.kind in "fc" and other.dtype.kind in "fc"
        return one.shape == other.shape and np.array_equal(one, other, equal_nan=numbers)
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


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    view = array.view()
    view.flags.writeable = False
    return view


class Arrays(ByContent):
    """A base of frozen dataclasses that hold measured arrays: read-only, and brief to look at."""

    def __post_init__(self) -> None:
        for each in fields(self):  # type: ignore[arg-type]
            value = vars(self).get(each.name)
            if isinstance(value, np.ndarray):
                object.__setattr__(self, each.name, read_only(value))

    @cached_property
    def facts(self) -> dict[str, tuple[Any, Any]]:
        """What was found of these arrays: see `rotorid.models.model.fact`."""
        return {}

    def __repr__(self) -> str:
        """Return the fields, arrays by their shape, names for channels: what fits a screen."""
        told = (f"{f.name}={_brief(getattr(self, f.name))}" for f in fields(self))  # type: ignore[arg-type]
        return f"{type(self).__name__}({', '.join(told)})"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th>{escape(f.name)}</th><td>{escape(_brief(getattr(self, f.name)))}</td></tr>"
            for f in fields(self)  # type: ignore[arg-type]
        )
        return f"<table><caption>{escape(type(self).__name__)}</caption>{rows}</table>"


LONGEST = 80
"""Characters of a field in a brief text."""


def _brief(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"<{'x'.join(map(str, value.shape)) or 'one'} {value.dtype}>"
    if isinstance(value, tuple) and value and all(hasattr(v, "name") for v in value):
        value = tuple(v.name for v in value)
    elif isinstance(value, tuple) and len(value) > 3:
        return f"<{len(value)} of {type(value[0]).__name__}>"
    text = repr(value)
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."
