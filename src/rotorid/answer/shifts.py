"""What errors of what is assumed move, all together, and what is told of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from rotorid.answer.estimate import Shift
from rotorid.core.notes import Note
from rotorid.core.values import Floats

MATTERS = 1.0
"""Deviations by which an unseen error moves a quantity, above which it is told."""


def weighed(
    found: Iterable[tuple[Shift, Floats, float]], names: Sequence[str]
) -> tuple[Floats, list[Note]]:
    """Return how far all together move each quantity, in its deviations, and notes on them.

    `found`: by how many each moves them, (quantity,), and from how many on it is told. Of what is
    wrong in one way or another the worst counts. First stands what moves a quantity most, then what
    moves another one most, and so on: what small errors of many quantities are made of comes last.
    """
    told, worst = dict[str, Note](), dict[str, Floats]()
    for one, moved, least in found:
        most = int(np.argmax(moved))
        size, name = float(moved[most]), one.about
        if size > max(least, told[name].value or 0.0 if name in told else 0.0):
            figure = f"{size:.2g}" if size < 99.5 else f"{size:.0f}"
            text = f"assumed {one.text} would shift {names[most]} by {figure} std unseen"
            told[name] = Note(
                name, "assumes", text, one.cure, (names[most],), size, "1", size=one.size
            )
        worst[name] = np.maximum(worst.get(name, 0.0), moved)
    total = sum((moved**2 for moved in worst.values()), np.zeros(len(names)))

    moved = np.array([worst[name] for name in told]).reshape(len(told), len(names))
    leads = np.where(moved == moved.max(axis=0, initial=0.0), moved, 0.0)
    order = np.lexsort([-each.max(axis=1, initial=0.0) for each in (moved, leads)])
    return np.sqrt(total), [list(told.values())[k] for k in order]
