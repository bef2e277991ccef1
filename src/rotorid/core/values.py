"""Values: frozen, equal by content, their arrays read-only."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from dataclasses import fields
from functools import wraps
from html import escape
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from rotorid.core.frozen import frozen as frozen
from rotorid.core.frozen import same as same

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]


Array = NDArray[Any]
Key = TypeVar("Key", bound=Hashable)
Member = TypeVar("Member")
Arguments = ParamSpec("Arguments")
Kind = TypeVar("Kind")
Found = TypeVar("Found")


def grouped(pairs: Iterable[tuple[Key, Member]]) -> dict[Key, list[Member]]:
    """Return the members of each key, both in the order of the pairs."""
    found: dict[Key, list[Member]] = {}
    for key, member in pairs:
        found.setdefault(key, []).append(member)
    return found


def fact(
    work: Callable[Concatenate[Kind, Arguments], Found],
) -> Callable[Concatenate[Kind, Arguments], Found]:
    """Keep what a function finds of a value there, for its last arguments: many ask."""
    name = f"{work.__module__}.{work.__qualname__}"

    @wraps(work)
    def found(value: Kind, /, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Found:
        asked = args, kwargs
        kept = vars(value).get(name)  # once: another thread may ask something else meanwhile
        if kept is None or kept[0] != asked:
            kept = vars(value)[name] = asked, work(value, *args, **kwargs)
        answer: Found = kept[1]
        return answer

    return found


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    view = array.view()
    view.flags.writeable = False
    return view


class Arrays:
    """A base of frozen dataclasses that hold measured arrays: read-only, and brief to look at."""

    def __post_init__(self) -> None:
        for each in fields(self):  # type: ignore[arg-type]
            value = vars(self).get(each.name)
            if isinstance(value, np.ndarray):
                object.__setattr__(self, each.name, read_only(value))

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
