"""Universal files (UFF 58): time responses and frequency responses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.core.errors import ReadError
from rotorid.core.frozen import frozen
from rotorid.core.values import Complexes, Floats
from rotorid.io.child import in_child
from rotorid.io.table import (
    Column,
    LoadedArrays,
    Rate,
    content,
    head,
    loaded,
    not_what_it_says,
    package,
    reading,
)

_FUNCTION = 58  # the data set of a function at nodal degrees of freedom
_TIME_RESPONSE, _TIME_AXIS = 1, 17
_EVEN = 1
_DIGITS = 5e-6  # the abscissa's step is written with six digits
_DIRECTION = {0: "", 1: "+X", 2: "+Y", 3: "+Z", -1: "-X", -2: "-Y", -3: "-Z"}


def open_universal(path: Path) -> LoadedArrays:
    """Open a universal file, text or binary.

    A column has the name in the first line of its data set, or its node and direction, ``12+X``,
    where that line does not tell the sets apart.
    """
    return loaded(str(path), _in_child(_columns, path))


def _in_child(work: Callable[[Path], Any], path: Path) -> Any:
    start = head(path)
    if not start.lstrip(b"\r\n").startswith(b"    -1"):
        raise not_what_it_says(path, content(start), "a universal file")
    package("pyuff", str(path))  # here once: each child would take its time to import it
    return in_child(work, str(path), path)


def _columns(path: Path) -> dict[str, Column]:
    found, types = _read_sets(path)
    with reading(str(path), "universal file data"):
        sets = [one for one in found if _is_over_time(one)]
        columns = {name: _column(s) for name, s in zip(_names(sets), sets, strict=True)}
    if not columns:
        raise ReadError(
            f"data sets {sorted(set(types))}, none of a signal over time" if types else "no sets",
            "data sets 58 of time responses",
            "export the time histories",
            file=str(path),
        )
    return columns


def _read_sets(path: Path) -> tuple[list[Any], list[int]]:
    """Return the functions of a universal file, and the types of all its data sets."""
    pyuff = package("pyuff", str(path))
    with reading(str(path), "universal file data"), np.errstate(all="ignore"):
        file = pyuff.UFF(str(path))
        types = [int(kind) for kind in np.atleast_1d(file.get_set_types())]
        return [file.read_sets(i) for i, kind in enumerate(types) if kind == _FUNCTION], types


def _is_over_time(found: Mapping[str, Any]) -> bool:
    time = found.get("abscissa_spec_data_type") == _TIME_AXIS
    return (time or found.get("func_type") == _TIME_RESPONSE) and not np.iscomplexobj(found["data"])


def _names(sets: list[Mapping[str, Any]]) -> list[str]:
    first = [text_of(s.get("id1")) for s in sets]
    if all(first) and len(set(first)) == len(first):
        return first
    nodes = [f"{s.get('rsp_node', '')}{_DIRECTION.get(int(s.get('rsp_dir', 0)), '')}" for s in sets]
    counts = Counter(nodes)
    return [name if counts[name] == 1 else f"{name}#{number}" for number, name in enumerate(nodes)]


def text_of(value: Any) -> str:
    """Return a text of a data set, empty where it says NONE."""
    text = str(value or "").strip()
    return "" if text == "NONE" else text


def _column(found: Mapping[str, Any]) -> Column:
    values = np.asarray(found["data"], dtype=np.float64)
    if len(values) != int(found.get("num_pts", len(values))):
        raise ValueError(f"{len(values)} values where {found['num_pts']} are announced")
    step = float(found.get("abscissa_inc") or 0.0)
    even = found.get("abscissa_spacing") == _EVEN and np.isfinite(step) and step > 0
    unit = text_of(found.get("ordinate_axis_units_lab")) or None
    start = float(found.get("abscissa_min") or 0.0)
    return Column(values, unit, *((Rate(1 / step, _DIGITS), start) if even else ()))


_RESPONSE, _COHERENCE = 4, 6
_QUANTITIES = {8: "", 11: "'", 12: "''"}  # displacement, velocity, acceleration
_AXES = ("X", "Y", "Z", "RX", "RY", "RZ")


@frozen
class StoredResponse:
    """One frequency response of a file."""

    name: str  # ``12+X/3+Z``: node and direction of the response, then of the reference
    frequency: Floats  # (line,): hz
    values: Complexes  # (line,): as stored
    unit: str | None  # of the response over that of the reference, where the file states both
    # ``''`` of an acceleration, ``'`` of a velocity; None where the file does not say
    derivative: str | None
    coherence: Floats | None  # (line,), or None


def read_responses(path: Path) -> dict[str, StoredResponse]:
    """Return the frequency responses of a universal file by name."""
    responses: dict[str, StoredResponse] = _in_child(_stored_responses, path)
    return responses


def _stored_responses(path: Path) -> dict[str, StoredResponse]:
    sets, types = _read_sets(path)
    with reading(str(path), "universal file data"):
        found = _responses(sets, path)
    if not found:
        kinds = sorted({int(s.get("func_type", 0)) for s in sets})
        raise ReadError(
            f"functions of type {kinds}, none a frequency response" if kinds else f"sets {types}",
            "data sets 58 of frequency responses (function type 4)",
            "export the frequency responses",
            file=str(path),
        )
    return found


def _responses(sets: Sequence[Mapping[str, Any]], path: Path) -> dict[str, StoredResponse]:
    """Return the responses among data sets, each with its coherence."""
    coherence = {_name(s): s for s in sets if s.get("func_type") == _COHERENCE}
    found: dict[str, StoredResponse] = {}
    for one in sets:
        if one.get("func_type") != _RESPONSE:
            continue
        name = _name(one)
        if name in found:
            raise ReadError(
                f"two responses {name}",
                "one of each pair of nodes and directions",
                "export them into files of their own",
                file=str(path),
            )
        found[name] = _response(name, one, coherence.get(name))
    return found


def _name(found: Mapping[str, Any]) -> str:
    """Return node and direction of response and reference, such as ``12+X/3-RZ``."""
    ends = []
    for end in ("rsp", "ref"):
        axis = int(found.get(f"{end}_dir") or 0)
        along = "" if axis == 0 else "+-"[axis < 0] + _AXES[abs(axis) - 1]
        ends.append(f"{int(found.get(f'{end}_node') or 0)}{along}")
    return "/".join(ends)


def _response(
    name: str, found: Mapping[str, Any], coherence: Mapping[str, Any] | None
) -> StoredResponse:
    frequency = np.asarray(found["x"], dtype=np.float64)
    values = np.asarray(found["data"], dtype=np.complex128)
    if values.shape != frequency.shape or frequency.ndim != 1 or not len(values):
        raise ValueError(f"{values.shape} values at {frequency.shape} frequencies")
    other = None
    if coherence is not None and np.array_equal(coherence["x"], found["x"]):
        other = np.asarray(np.real(coherence["data"]), dtype=np.float64)
    quantity = int(found.get("ordinate_spec_data_type") or 0)
    return StoredResponse(name, frequency, values, _unit(found), _QUANTITIES.get(quantity), other)


def _unit(found: Mapping[str, Any]) -> str | None:
    """Return the unit of a response: labels where the file has them, else what its codes mean."""
    over = text_of(found.get("ordinate_axis_units_lab"))
    under = text_of(found.get("orddenom_axis_units_lab"))
    if over and under:
        return f"({over})/({under})"
    return None
