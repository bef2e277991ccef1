"""Frequency responses of universal files (UFF): data sets 58, with their coherence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.errors import ReadError
from rotorid.frozen import frozen
from rotorid.io.table import reading
from rotorid.io.universal import read_sets, text_of
from rotorid.record import Complexes, Floats

_RESPONSE, _COHERENCE = 4, 6
_QUANTITIES = {8: "", 11: "'", 12: "''"}  # displacement, velocity, acceleration
_AXES = ("X", "Y", "Z", "RX", "RY", "RZ")


@frozen
class StoredResponse:
    """One frequency response of a file.

    Parameters
    ----------
    name : str
        ``12+X/3+Z``: node and direction of the response, then of the reference.
    frequency : array, shape (line,)
        Hz.
    values : complex array, shape (line,)
        As stored.
    unit : str or None
        Of the response over that of the reference, where the file states both.
    derivative : str or None
        ``''`` of an acceleration, ``'`` of a velocity; None where the file does not say.
    coherence : array, shape (line,), or None
    """

    name: str
    frequency: Floats
    values: Complexes
    unit: str | None
    derivative: str | None
    coherence: Floats | None


def read_responses(path: Path) -> dict[str, StoredResponse]:
    """Return the frequency responses of a universal file by name.

    Raises
    ------
    ReadError
        For a file that cannot be read, or that holds none.
    """
    sets, types = read_sets(path)
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
