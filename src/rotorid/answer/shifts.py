"""What errors of what is assumed move, all together, and what is told of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from rotorid.answer.estimate import FAR, Shift
from rotorid.core.notes import Note
from rotorid.core.values import Floats

MATTERS = 1.0
"""Deviations by which an unseen error moves a quantity, above which it is told."""


def weighed(
    found: Iterable[tuple[Shift, Floats, float]], names: Sequence[str]
) -> tuple[Floats, list[Note]]:
    """Return how far all together move each quantity, in its deviations, and notes on them.

    `found`: by how many each moves them, (quantity,), and from how many on it is told. Of what is
    wrong in one way or another the worst counts. First stands what matters most to most of them:
    what makes the largest shares of their variances.
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

    def place(note: Note) -> tuple[bool, float]:
        share = float((worst[note.about] ** 2 / (1 + total)).sum())
        return (note.value or 0.0) <= FAR, -share

    return np.sqrt(total), sorted(told.values(), key=place)
