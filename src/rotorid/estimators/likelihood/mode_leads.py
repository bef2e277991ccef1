"""What may be wrong with measured natural frequencies: one of them, their count, their unit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from rotorid.estimators.likelihood.known import Known
from rotorid.estimators.likelihood.modal import Configuration, ModalRows
from rotorid.estimators.likelihood.preparation import Prepared
from rotorid.estimators.modes import Mode, number
from rotorid.frozen import frozen

UNITS = {"rad/s": 2 * np.pi, "cycles per minute": 60.0}
"""Units in which frequencies are written by mistake: so many of them are one Hz."""


@frozen
class ModeMistake:
    """A mistake with measured modes, and what is prepared without it.

    Parameters
    ----------
    term, said, cure : str
    value : float
    unit : str
    prepared : Prepared
    """

    term: str
    said: str
    cure: str
    value: float
    unit: str
    prepared: Prepared


def mode_mistakes(prepared: Prepared) -> Iterator[ModeMistake]:
    """Yield mistakes with measured modes that are no small changes."""
    rows = prepared.known.modes
    if not len(rows):
        return
    for name, factor in UNITS.items():
        changed = _changed(rows, partial(_scaled, factor=factor))
        yield ModeMistake(
            "unit[modes]",
            f"natural frequencies in {name}, not in Hz",
            "write frequency and std in [[modes]] with their unit",
            1 / factor,
            "1",
            _with(prepared, changed),
        )
    for each in rows.configurations:
        for skipping in each.modes:
            yield from _skipped(prepared, each, skipping)


def _skipped(prepared: Prepared, each: Configuration, first: Mode) -> Iterator[ModeMistake]:
    """Yield that a mode below one, and so below all above it, was not found in the test."""
    if number(each.modes[-1]) >= len(each.pattern):
        return
    above = [mode for mode in each.modes if number(mode) >= number(first)]

    def raised(mode: Mode) -> Mode:
        return replace(mode, mode=number(mode) + 1) if mode in above else mode

    yield ModeMistake(
        f"skipped below {first.in_si[0]:.4g} Hz",
        f"a mode below {first} that was not measured, so that this one is number "
        f"{number(first) + 1}",
        f"write mode = {number(first) + 1} there",
        number(first) + 1.0,
        "1",
        _with(prepared, _changed(prepared.known.modes, raised)),
    )


def _scaled(mode: Mode, factor: float) -> Mode:
    hertz, std, _ = mode.in_si
    return replace(mode, frequency=hertz / factor, std=std / factor)


def _changed(rows: ModalRows, change: Callable[[Mode], Mode]) -> ModalRows:
    """Return the rows with every mode changed."""
    return ModalRows(
        tuple(
            replace(each, modes=tuple(change(mode) for mode in each.modes))
            for each in rows.configurations
        )
    )


def _with(prepared: Prepared, rows: ModalRows) -> Prepared:
    return replace(prepared, known=Known(prepared.known.relations, rows))
