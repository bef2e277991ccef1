"""Conversions of MDF channels: from stored samples to the unit of the channel.

Only numbers are taken from the file. A conversion may also be a formula, which asammdf hands to
`eval`: reading a channel could run any program. Formulas are refused, wherever they stand.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import count, takewhile
from typing import Any

import numpy as np

from rotorid.core.errors import ReadError
from rotorid.core.values import Floats


def convert(samples: np.ndarray, block: Any, version: int) -> Floats:
    """Return samples in the unit of their channel.

    Parameters
    ----------
    samples : array, shape (sample,)
        As stored: integers or floats.
    block : ChannelConversion of asammdf, or None
    version : int
        Of the file, 3 (and 2) or 4: the same type number means another conversion in each.

    Raises
    ------
    ReadError
        Where the conversion, or one that it refers to, is a formula, gives text or is unknown.
    """
    if samples.dtype.kind == "f":  # float32 would stay so, and lose digits
        samples = samples.astype(np.float64)
    if block is None:
        return samples.astype(np.float64)
    _check_no_formula(block, _FORMULA[version])
    rule = _RULES[version].get(block.conversion_type)
    if rule is None:
        raise no_numbers("a conversion to text, or of an unknown kind")
    with np.errstate(all="ignore"):  # what cannot be computed is NaN, as a missing sample is
        converted: Floats = rule(samples, block).astype(np.float64)
    converted[np.isnan(samples)] = np.nan  # a table gives every sample a value
    return converted


def no_numbers(found: str) -> ReadError:
    """Return the error for a channel that holds something else than numbers."""
    return ReadError(found, "real numbers", "name a channel of numbers, or export it so")


def _check_no_formula(block: Any, kind: int) -> None:
    """Refuse a conversion that is a formula or refers to one, used by a sample or not."""
    formulas = [block.formula] if block.conversion_type == kind else []
    for part in (block.referenced_blocks or {}).values():
        if _is_block(part):
            _check_no_formula(part, kind)
        elif part and b"{X}" in part:  # MDF 3 writes the default of a table as "2*{X}+1"
            formulas.append(part.decode("latin-1").strip("\0"))
    if formulas:
        raise ReadError(
            f"a conversion by the formula {formulas[0][:80]!r}",
            "none, or a linear, rational or table conversion: a formula could run any program",
            "export the channel in physical values",
        )


def _is_block(part: Any) -> bool:
    return hasattr(part, "conversion_type")


def _none(x: np.ndarray, block: Any) -> Any:
    return x


def _linear(x: np.ndarray, block: Any) -> Any:
    return block.a * x + block.b


def _rational(x: np.ndarray, block: Any) -> Any:
    """(P1 x^2 + P2 x + P3) / (P4 x^2 + P5 x + P6)."""
    above = [block.P1, block.P2, block.P3]
    below = [block.P4, block.P5, block.P6]
    if above[2] == below[2] == 0:  # x in both, which at x = 0 would leave 0/0
        above, below = above[:2], below[:2]
    return np.polyval(above, x) / np.polyval(below, x)


def _hyperbolic(x: np.ndarray, block: Any) -> Any:
    """(P2 - P4 y) / (P3 y - P1) with y = x - P5 - P6: "polynomial" in MDF 3."""
    y = x - block.P5 - block.P6
    return (block.P2 - block.P4 * y) / (block.P3 * y - block.P1)


def _exponential(x: np.ndarray, block: Any) -> Any:
    return _of_seven(np.exp, x, block)


def _logarithmic(x: np.ndarray, block: Any) -> Any:
    return _of_seven(np.log, x, block)


def _of_seven(function: np.ufunc, x: np.ndarray, block: Any) -> Any:
    """f(((x - P7) P6 - P3) / P1) / P2 where P4 = 0, and f((P3 / (x - P7) - P6) / P4) / P5."""
    if block.P4 == 0:
        return function(((x - block.P7) * block.P6 - block.P3) / block.P1) / block.P2
    if block.P1 == 0:
        return function((block.P3 / (x - block.P7) - block.P6) / block.P4) / block.P5
    raise ValueError("a conversion of both P1 and P4")


def _interpolated(x: np.ndarray, block: Any) -> Any:
    return np.interp(x, _values(block, "raw"), _values(block, "phys"))


def _nearest(x: np.ndarray, block: Any) -> Any:
    """Value to value without interpolation: the nearest entry, the lower one half way."""
    raw, physical = _values(block, "raw"), _values(block, "phys")
    above = np.searchsorted(raw, x).clip(max=len(raw) - 1)
    below = (above - 1).clip(min=0)
    return np.where(x - raw[below] <= raw[above] - x, physical[below], physical[above])


def _ranges(x: np.ndarray, block: Any) -> Any:
    """Range to value, else the default."""
    entry = _entry(x, block, "lower", "upper")
    return np.where(entry < 0, block.default, _values(block, "phys")[entry])


def _values_or_text(x: np.ndarray, block: Any) -> Any:
    return _referenced(x, block, _entry(x, block, "val", "val"))


def _ranges_or_text(x: np.ndarray, block: Any) -> Any:
    return _referenced(x, block, _entry(x, block, "lower", "upper"))


def _referenced(x: np.ndarray, block: Any, entry: np.ndarray) -> Floats:
    """Convert samples by the conversion that their entry refers to; text ("no signal") is NaN."""
    parts = block.referenced_blocks or {}
    if not any(map(_is_block, parts.values())):
        raise no_numbers("a conversion to text")
    found = np.full(len(x), np.nan)
    for number in np.unique(entry):
        part = parts["default_addr" if number < 0 else f"text_{number}"]
        if _is_block(part):
            found[entry == number] = convert(x[entry == number], part, 4)
    return found


def _entry(x: np.ndarray, block: Any, first: str, last: str) -> np.ndarray:
    """Return which range each sample is in, or -1.

    The end of a range belongs to it for integers, and to the next one for floats (ASAM MDF 4).
    """
    lower, upper = _values(block, first), _values(block, last)
    order = np.argsort(lower)
    place = order[np.searchsorted(lower[order], x, side="right") - 1]
    ends = x <= upper[place] if x.dtype.kind != "f" or first == last else x < upper[place]
    return np.where((x >= lower[place]) & ends, place, -1)


def _values(block: Any, name: str) -> Floats:
    """Return name_0, name_1 and so on."""
    keys = takewhile(lambda key: hasattr(block, key), (f"{name}_{i}" for i in count()))
    return np.array([getattr(block, key) for key in keys], dtype=np.float64)


# Type numbers as ASAM gives them. MDF 4 knows text to value, text to text and bit fields besides,
# MDF 3 values and ranges to text, dates and times: none of them gives numbers from numbers.
_RULES: Mapping[int, Mapping[int, Callable[[np.ndarray, Any], Any]]] = {
    3: {
        0: _linear,
        1: _interpolated,
        2: _nearest,
        6: _hyperbolic,
        7: _exponential,
        8: _logarithmic,
        9: _rational,
        65535: _none,
    },
    4: {
        0: _none,
        1: _linear,
        2: _rational,
        4: _interpolated,
        5: _nearest,
        6: _ranges,
        7: _values_or_text,
        8: _ranges_or_text,
    },
}
_FORMULA = {3: 10, 4: 3}
