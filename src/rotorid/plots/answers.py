"""Correction masses in their planes, and the sensitivity of loops, as panels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rotorid.plots.panel import (
    BLUE,
    COLOURS,
    GREEN,
    GREY,
    MOST_PANELS,
    PINK,
    RED,
    Axis,
    Curve,
    Panel,
    label,
)

Balance = Any  # lies above
Loops = Sequence[Any]  # of AxisSensitivity

GMM = 1e6
"""g mm in a kg m."""
ROUND = 121
"""Points of a circle."""
TWO = 1.959964
"""Deviations to either side that a band holds."""
ROOM = 1.25
"""How much wider a plane is drawn than what stands in it."""


def corrections(found: Balance) -> list[Panel]:
    """Return each plane, seen along the shaft: what to add, and where the right correction lies."""
    pairs = zip(found.corrections, found.residual, strict=True)
    return [_plane(one, left) for one, left in list(pairs)[:MOST_PANELS]]


def _plane(one: Any, left: Any) -> Panel:
    tip = GMM * one.unbalance_kg_m * np.exp(1j * one.angle_rad)
    way = np.array([0j, tip])
    told = (f"{abs(tip):.4g} g mm at {np.degrees(one.angle_rad):.1f} deg",) * 2
    curves = [Curve(way.real, way.imag, "to be added", BLUE, "thick", told=told)]
    curves.append(Curve(way.real[1:], way.imag[1:], "", BLUE, "dots"))
    reach = abs(tip)
    if left.unbalance_kg_m is not None:
        radius = GMM * left.unbalance_kg_m
        ring = tip + radius * np.exp(1j * np.linspace(0, 2 * np.pi, ROUND))
        curves.append(Curve(ring.real, ring.imag, "the right one, with 95 %", RED, "line"))
        reach = max(reach, float(np.abs(ring).max()))
    if one.masses and reach > 0:
        # Where on the rim a mass goes counts, not how far out this picture draws it.
        rim = 1.1 * reach * np.exp(1j * np.array([angle for _, angle in one.masses]))
        named = tuple(f"{1e3 * m:.4g} g at {np.degrees(a) % 360:.1f} deg" for m, a in one.masses)
        curves.append(Curve(rim.real, rim.imag, "masses", GREEN, "named", told=named))
        reach *= 1.1
    ends = (-ROOM * reach, ROOM * reach) if reach > 0 else (-1.0, 1.0)
    return Panel(
        label(one.plane, 48),
        Axis("g mm towards 0 deg", ends=ends),
        Axis("g mm towards 90 deg", ends=ends),
        tuple(curves),
        level=0.0,
        upright=0.0,
        height=3.2,
        equal=True,
    )


def loops(found: Loops, limits: dict[str, float]) -> list[Panel]:
    """Return the sensitivity of each loop over the frequency, and the limits of the zones."""
    return [_loop(one, limits) for one in found[:MOST_PANELS]]


def _loop(one: Any, limits: dict[str, float]) -> Panel:
    frequency = np.asarray(one.frequency_hz, dtype=float)
    size, std = np.abs(one.sensitivity), np.asarray(one.std, dtype=float)
    ends = np.array([frequency.min(), frequency.max()])
    curves = [
        Curve(ends, np.full(2, limit), f"end of zone {zone}", colour, "dashed")
        for (zone, limit), colour in zip(limits.items(), (GREEN, PINK, COLOURS[1]), strict=True)
    ]
    low, high = np.maximum(size - TWO * std, size / 100), size + TWO * std
    curves += [
        Curve(frequency, high, "95 % of each line", BLUE, "band", base=low),
        Curve(frequency, size, "measured", BLUE, "line"),
        Curve(
            np.full(2, one.peak_hz), np.array(one.interval), "the peak, with 95 %", GREY, "thick"
        ),
        Curve(np.array([one.peak_hz]), np.array([one.peak]), "", GREY, "dots"),
    ]
    title = f"{label(one.axis, 36)}: {one.peak:.3g} at {one.peak_hz:.4g} Hz, {one.verdict}"
    y = Axis("sensitivity |S|", log=True)
    return Panel(title, Axis("frequency in Hz"), y, tuple(curves), height=2.6)
