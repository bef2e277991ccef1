"""The value of an expression on arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike, NDArray

from rotorid.errors import ModelError
from rotorid.models.expression import FUNCTIONS, Expression

MAX_VALUE = 1e100
# Functions that the algebra may put in their place: tan(pi/2 - x) becomes cot(x).
_NUMERIC: dict[Any, Callable[..., Any]] = {
    sp.sin: np.sin,
    sp.cos: np.cos,
    sp.tan: np.tan,
    sp.cot: lambda x: 1 / np.tan(x),
    sp.sec: lambda x: 1 / np.cos(x),
    sp.csc: lambda x: 1 / np.sin(x),
    sp.exp: np.exp,
    sp.Abs: np.abs,
    sp.sign: np.sign,
    sp.tanh: np.tanh,
    sp.coth: lambda x: 1 / np.tanh(x),
}


def evaluate(value: Expression, arrays: Mapping[str, ArrayLike]) -> NDArray[np.float64]:
    """Return the value of a symbolic expression on arrays that broadcast.

    It is infinite or NaN, without a warning, where the expression has no finite value.
    """
    with np.errstate(all="ignore"):
        return _evaluate(value, arrays)


def _evaluate(value: Expression, arrays: Mapping[str, ArrayLike]) -> NDArray[np.float64]:
    if value.is_Symbol:
        return np.asarray(arrays[str(value)], dtype=float)
    if value.is_number:
        return np.asarray(float(value))
    inner = [_evaluate(argument, arrays) for argument in value.args]
    if value.is_Add:
        return np.asarray(sum(inner[1:], start=inner[0]))
    if value.is_Mul:
        return np.asarray(np.prod(np.broadcast_arrays(*inner), axis=0))
    if value.is_Pow:
        exponent = float(value.exp)
        whole = int(exponent)
        return np.asarray(inner[0] ** (whole if whole == exponent else exponent))
    return np.asarray(_NUMERIC[value.func](inner[0]))


def is_usable(value: ArrayLike) -> bool:
    """Tell whether all numbers are finite, and far from where their squares are not."""
    return bool((np.abs(value) < MAX_VALUE).all())


def check_evaluable(value: Expression) -> None:
    """Refuse an expression that `evaluate` could not compute."""
    for node in sp.preorder_traversal(value):
        if node.is_Function and node.func not in _NUMERIC:
            raise ModelError(f"the function {node.func}", ", ".join(FUNCTIONS), "rewrite the term")
