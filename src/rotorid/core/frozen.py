"""The decorator of every value: a frozen dataclass with methods that all classes share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import FrozenInstanceError, dataclass, field, fields
from operator import attrgetter
from typing import Any, TypeVar, dataclass_transform, overload

Class = TypeVar("Class", bound=type[Any])


@overload
def frozen(kind: Class, /) -> Class: ...
@overload
def frozen(*, kw_only: bool = False) -> Callable[[Class], Class]: ...
@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def frozen(kind: Any = None, /, *, kw_only: bool = False) -> Any:
    """Make a class a frozen dataclass; what it or its base says of ``==`` and of text, stands.

    ``dataclass`` writes and compiles six methods of each class when it is imported, which for all
    that a command needs was a seventh of its time. Only ``__init__`` is left to it; nothing is set
    a second time, nor anything that is no field.
    """

    def made(kind: Any) -> Any:
        kind = dataclass(eq=False, repr=False, kw_only=kw_only)(kind)
        kind._fields = frozenset(each.name for each in fields(kind))
        kind.__setattr__, kind.__delattr__ = _set_once, _keep
        if kind.__repr__ is object.__repr__:
            kind.__repr__ = _told
        if kind.__eq__ is object.__eq__:
            kind.__eq__, kind.__hash__ = _equal, _hashed
        if kind.__eq__ is _equal:
            names = [each.name for each in fields(kind) if each.compare]
            kind._content = staticmethod(attrgetter(*names) if names else lambda _: ())
        return kind

    return made if kind is None else made(kind)


def _set_once(self: Any, name: str, value: object) -> None:
    if name in self.__dict__ or name not in self._fields:
        raise FrozenInstanceError(f"cannot assign to field {name!r}")
    self.__dict__[name] = value


def _keep(self: Any, name: str) -> None:
    raise FrozenInstanceError(f"cannot delete field {name!r}")


def _equal(self: Any, other: Any) -> Any:
    if other.__class__ is not self.__class__:
        return NotImplemented
    return same(self._content(self), other._content(other))


PLAIN = {int, str, bool}
"""What equals its like and no array; NaN is not among them."""


def same(first: Any, second: Any) -> bool:
    """Compare by content: arrays whole, NaN as NaN."""
    if first is second:
        return True
    if first.__class__ in PLAIN and second.__class__ in PLAIN:
        return bool(first == second)
    if hasattr(first, "dtype") or hasattr(second, "dtype"):
        import numpy as np  # no command loads it for its values alone

        one, other = np.asarray(first), np.asarray(second)
        numbers = one.dtype.kind in "fc" and other.dtype.kind in "fc"
        return one.shape == other.shape and np.array_equal(one, other, equal_nan=numbers)
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        return first.keys() == second.keys() and all(same(first[k], second[k]) for k in first)
    if isinstance(first, tuple | list) and isinstance(second, tuple | list):
        return len(first) == len(second) and all(map(same, first, second))
    if isinstance(first, float | complex) and isinstance(second, float | complex):
        return bool(first == second or (first != first and second != second))
    return bool(first == second)


def _hashed(self: Any) -> int:
    return hash(self._content(self))


def _told(self: Any) -> str:
    told = (f"{each.name}={getattr(self, each.name)!r}" for each in fields(self) if each.repr)
    return f"{type(self).__qualname__}({', '.join(told)})"
