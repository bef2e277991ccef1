"""What modes, critical speeds and unbalance response say, as tables and sentences."""

from __future__ import annotations

import re

import numpy as np

from rotorid.results.critical import Campbell
from rotorid.results.modes import Modes
from rotorid.results.unbalance import UnbalanceResponse
from rotorid.tables import Page, Table, table

RPM = 30 / np.pi
_NODE = re.compile(r"node\d+$")
SHOWN = 11
"""Speeds of the table of a diagram."""
MOST_MODES = 16
"""Modes of the table: what a screen holds; those above are seldom the machine's."""
MOST_PLACES = 16
"""Coordinates of the table of a response."""
REACH = 2.0
"""Curves of the table of a diagram begin below this many times the last speed."""
FEWEST, MOST_CURVES = 2, 8
"""Curves of that table at the least, and at the most."""
NOTHING = 1e-9
"""Damping ratios below this are rounding."""


def modes_page(
    found: Modes,
    diagram: Campbell | None,
    response: UnbalanceResponse | None,
    inputs: tuple[str, ...],
) -> Page:
    """Return the page of a machine's modes at a speed, and up to a speed."""
    whose = f"without forces at its inputs ({', '.join(inputs)})" if inputs else "without inputs"
    page: list[str | Table] = [
        f"{found.model} at {found.speed * RPM:.6g} rpm, as its equations have it, {whose}: what a "
        "controller or magnets add is no part of it"
    ]
    if found.modes:
        page.append(mode_table(found))
    page += summary(found)
    if diagram is not None:
        page += [critical_table(diagram)] if diagram.critical else [_none(diagram)]
        page.append(campbell_table(diagram))
    if response is not None:
        page.append(response_table(response))
    return page


def mode_table(found: Modes) -> Table:
    """Return a row per natural frequency."""
    rows = [
        (
            f"{number}{'~' if mode.close else ''}",
            f"{mode.frequency_hz:.6g}",
            _std(mode.std_hz),
            _ratio(mode.damping_ratio),
            _std(mode.damping_std),
            mode.whirl + (", both planes" if mode.count > 1 else ""),
        )
        for number, mode in enumerate(found.modes[:MOST_MODES], start=1)
    ]
    return table(("mode", "frequency in Hz", "std", "damping ratio", "std", "whirl"), rows)


def summary(found: Modes) -> list[str]:
    """Return what is to be said of modes besides their table."""
    said = list(found.remarks)
    if len(found.modes) > MOST_MODES:
        said.append(f"{len(found.modes) - MOST_MODES} modes above; --json holds all")
    growing = [mode for mode in found.modes if mode.damping_ratio < -NOTHING]
    if not found.modes:
        said.append("no natural frequencies: only free motion, or poles that do not oscillate")
    if found.rigid:
        said.append(f"free motion (rigid body): {found.rigid} poles at zero, which are no modes")
    if growing:
        listed = ", ".join(f"{mode.frequency_hz:.5g} Hz" for mode in growing)
        said.append(f"warning: modes that grow, with negative damping: {listed}")
    if any(pole > 0 for pole in found.real_poles):
        listed = ", ".join(f"{pole:.4g}" for pole in found.real_poles if pole > 0)
        said.append(f"warning: unstable poles that do not oscillate, at {listed} rad/s")
    damped = [pole for pole in found.real_poles if pole <= 0]
    if damped:
        listed = ", ".join(f"{pole:.4g}" for pole in damped[-4:])
        said.append(f"{len(damped)} poles that do not oscillate, the slowest at {listed} rad/s")
    if any(mode.close for mode in found.modes):
        said.append("~: so close to another that order or shapes are uncertain; std from draws")
    if any(mode.whirl == "mixed" for mode in found.modes):
        said.append("mixed: forward at some places and backward at others")
    return said


def critical_table(found: Campbell) -> Table:
    """Return a row per critical speed."""
    rows = [
        (
            str(number),
            f"{each.speed_rad_s * RPM:.6g}",
            _std(None if each.std is None else each.std * RPM),
            f"{each.speed_rad_s:.6g}",
            each.whirl,
            _ratio(each.damping_ratio),
        )
        for number, each in enumerate(found.critical, start=1)
    ]
    headings = ("critical speed", "rpm", "std", "rad/s", "whirl", "damping ratio")
    return table(headings, rows)


def _none(found: Campbell) -> str:
    return f"no critical speed up to {found.speed[-1] * RPM:.6g} rpm"


def campbell_table(found: Campbell) -> Table:
    """Return some speeds of a Campbell diagram, a column per curve, in Hz."""
    chosen = np.unique(np.linspace(0, len(found.speed) - 1, SHOWN).round().astype(int))
    low = np.nanmin(found.frequency_hz, axis=0, initial=np.inf)
    within = low <= REACH * abs(found.speed[-1]) / (2 * np.pi)
    within[np.argsort(low, kind="stable")[:FEWEST]] = True
    curves = np.flatnonzero(within)[:MOST_CURVES]
    headings = ("rpm", *(found.whirl[i] for i in curves))
    rows = [
        (
            f"{found.speed[k] * RPM:.5g}",
            *("-" if np.isnan(f) else f"{f:.5g}" for f in found.frequency_hz[k, curves]),
        )
        for k in chosen
    ]
    return table(headings, rows)


def response_table(found: UnbalanceResponse) -> Table:
    """Return amplitude and angle of each coordinate at the first speed of a response."""
    every = list(zip(found.coordinates, found.motion[0], found.std[0], strict=True))
    named = [row for row in every if len(every) <= MOST_PLACES or not _NODE.search(row[0])]
    rows = []
    for name, value, std in named[:MOST_PLACES]:
        size = abs(value)
        rows.append(
            (
                name,
                f"{size:.4g}" if np.isfinite(size) else "no bound",
                "-" if np.isnan(std) else f"{std:.2g}",
                f"{np.degrees(np.angle(value)):.1f}" if np.isfinite(size) else "",
            )
        )
    return table(
        (
            f"unbalance response at {found.speed[0] * RPM:.6g} rpm",
            "amplitude (SI)",
            "std",
            "phase in deg",
        ),
        rows,
    )


def _ratio(value: float) -> str:
    return "0" if abs(value) < NOTHING else f"{value:.4g}"


def _std(value: float | None) -> str:
    return "-" if value is None else f"{value:.2g}"
