"""What a table of phasors shows before any model: dead probes, phases in another unit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from rotorid.record import Check, Complexes, Floats

LEAST_ROWS = 3
"""Rows that must agree to the last digit before a probe counts as stuck."""
ABOVE = 3.0
"""Deviations by which some row must rise above nothing."""
TURNS = 2.0
"""Revolutions beyond which no instrument counts a phase."""
LIKE_RADIANS = 1.5
"""Spread of phases, all within 2 pi degrees, from which on they look like radians: near a critical
speed phases pass through pi, far from one they keep their place."""


def check_probes(names: Sequence[str], phasors: Complexes, std: Floats | None) -> Iterator[Check]:
    """Find probes that read nothing, or ever the same; phasors of shape (row, probe)."""
    for k, name in enumerate(names):
        size = np.abs(phasors[:, k])
        if not size.any():
            text = "0 in every row: check its cable, or leave the channel out"
            yield Check("dead", name, text, "refused")
        elif len(size) >= LEAST_ROWS and (phasors[:, k] == phasors[0, k]).all():
            text = f"the same in all {len(size)} rows: check its columns, or leave the channel out"
            yield Check("dead", name, text, "refused")
        elif std is not None and (size < ABOVE * std[:, k]).all():
            text = f"no row rises above {ABOVE:g} times its std: check its cable and its unit"
            yield Check("silent", name, text, "warning")


def check_phases(name: str, phases: Floats, *, degrees: bool) -> Iterator[Check]:
    """Find phases, as the table states them, that are hardly in their unit."""
    size, spread = float(np.abs(phases).max(initial=0.0)), float(np.ptp(phases))
    low, high = float(phases.min()), float(phases.max())
    if not degrees and size > TURNS * 2 * np.pi:
        text = f'phases up to {size:.4g} rad: if they are degrees, set phase_unit = "deg"'
        yield Check("phase unit", name, text, "refused")
    elif degrees and size <= 2 * np.pi and spread > LIKE_RADIANS and len(phases) >= LEAST_ROWS:
        text = (
            f"phases from {low:.3g} to {high:.3g} degrees, no more: if they are radians, set "
            'phase_unit = "rad"'
        )
        yield Check("phase unit", name, text, "warning")
