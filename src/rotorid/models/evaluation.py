"""The value of an expression on arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotorid.models.expression import Expression

MAX_VALUE = 1e100
_NUMERIC: dict[str, Callable[..., Any]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "cot": lambda x: 1 / np.tan(x),
    "sec": lambda x: 1 / np.cos(x),
    "csc": lambda x: 1 / np.sin(x),
    "exp": np.exp,
    "abs": np.abs,
    "sign": np.sign,
    "tanh": np.tanh,
    "coth": lambda x: 1 / np.tanh(x),
}


def evaluate(value: Expression, arrays: Mapping[str, ArrayLike]) -> NDArray[np.float64]:
    """Return the value of an expression on arrays that broadcast.

    It is infinite or NaN, without a warning, where the expression has no finite value.
    """
    with np.errstate(all="ignore"):
        return _evaluate(value, arrays)


def _evaluate(value: Expression, arrays: Mapping[str, ArrayLike]) -> NDArray[np.float64]:
    if value.kind == "name":
        return np.asarray(arrays[value.parts[0]], dtype=float)
    if value.kind == "number":
        return np.asarray(float(value.parts[0]))
    if value.kind == "pi":
        return np.asarray(np.pi)
    if value.kind == "power":
        base, exponent = value.parts
        whole = exponent.denominator == 1
        return np.asarray(_evaluate(base, arrays) ** (int(exponent) if whole else float(exponent)))
    inner = [_evaluate(part, arrays) for part in value.parts]
    if value.kind == "sum":
        return np.asarray(sum(inner[1:], start=inner[0]))
    if value.kind == "product":
        return np.asarray(np.prod(np.broadcast_arrays(*inner), axis=0))
    return np.asarray(_NUMERIC[value.kind](inner[0]))


def is_usable(value: ArrayLike) -> bool:
    """Tell whether all numbers are finite, and far from where their squares are not."""
    return bool((np.abs(value) < MAX_VALUE).all())
