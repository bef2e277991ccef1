"""What the notes on an answer come to: its status, their order, what errors of assumptions move.

No other place weighs notes against one another: doubts that are cast only on an answer of a certain
status ask `judge` for that of the notes so far.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from rotorid.core.notes import VERDICTS, Note, Severity
from rotorid.core.values import Floats

Status = Literal["ok", "rejected", "not_identifiable", "not_converged"]
STATUSES: dict[str, Status] = {
    "unfinished": "not_converged",
    "open": "not_identifiable",
    "rejects": "rejected",
}
"""What a note makes of an answer, the gravest first."""
_STAYS = {"drift", "settled", "knock", "speed", "period", "repeats", "wander"}
_SAMPLED = {"lost samples", "clocks", "copied periods", "clipped", "stuck"}
CONTRADICTING = frozenset(_STAYS | _SAMPLED)
"""Checks whose warnings contradict what every method takes for granted: that the machine, its
speed and its period stay what they are, and that the samples are the quantity."""
SILENT = frozenset({"dead", "stuck", "quantized"})
"""Checks whose warnings are of a channel that reads nothing: no suspect explains it better, and
can but say that the gain of a dead sensor is 1e-19."""
OPEN = "not identifiable"  # what a note on an open direction, and on what would close it, is about
DIRECTION = "direction"  # of the note that records contradict in one direction what was assumed
LACKS, LATE, RECORDS = "missing force", "late forces", "records"
PULLED = "noise in the motion"
"""What notes are about that the equations of filtered samples lack a force, or that forces come
late, or that records of one machine differ, or that least squares takes noise for motion."""
OFF = frozenset({DIRECTION, LACKS, LATE, RECORDS, PULLED})
"""What makes an answer doubtful by so many deviations, though nothing shows that it is wrong."""
EFFORT = "effort"  # what the note is about that not everything was asked that may change the answer
SUSPECTS = "suspects"  # of the sentence on possible causes: it says what to do, and stands first
_FIT = ("units", "record", "noise", "bound", "search", "modes", "other answers", "sign", "misfit")
_LATER = (*_FIT, OPEN, "blocks", "unbalance", "report")
"""What is told behind the reasons to turn an answer away and the doubts about it, in this order."""


def judge(notes: Iterable[Note], before: Status = "ok") -> Status:
    """Return the status of an answer by its notes; one that was none before stays none."""
    found = {STATUSES[note.severity] for note in notes if note.severity in STATUSES} | {before}
    return next((status for status in STATUSES.values() if status in found), "ok")


def ordered(notes: Iterable[Note]) -> tuple[Note, ...]:
    """Return each note once, those that say more first; those on the data are the last."""
    return tuple(sorted(dict.fromkeys(notes), key=_place))


def _place(note: Note) -> int:
    if note.severity in VERDICTS:
        return 6 + len(_LATER)
    if note.about in SILENT:
        return 0
    if note.drop is not None:
        return 2
    if note.about in _LATER:
        return 6 + _LATER.index(note.about)
    if note.about in CONTRADICTING:
        return 3
    return 1 if note.about == SUSPECTS else 4 if note.severity == "rejects" else 5


def of_data(checks: Sequence[Note], status: Status) -> list[Note]:
    """Return what the data, before any model, say against an answer of a status."""
    found = []
    for c in sorted(checks, key=lambda c: c.about not in SILENT):
        if c.severity == "warns" and c.about in CONTRADICTING | SILENT:
            severity: Severity = "rejects" if c.about in CONTRADICTING else "doubts"
            said = "before any suspect, see to" if c.about in SILENT else "the data say otherwise:"
            found.append(Note(c.about, severity, f"{said} {c}", on=c.on))
    if judge(found, status) != "ok":
        return found
    return [note for note in found if note.about not in SILENT]


MATTERS = 1.0  # deviations by which an unseen error moves a quantity, above which it is told


def weighed(
    found: Iterable[tuple[Note, Floats, float]], names: Sequence[str]
) -> tuple[Floats, list[Note]]:
    """Return how far all together move each quantity, in its deviations, and notes on them.

    `found`: what is assumed, by how many it moves them, (quantity,), from how many on it is told.
    Of what is wrong in one way or another the worst counts. First stands what moves a quantity
    most, then what moves another one most, and so on: what small errors of many quantities are made
    of comes last.
    """
    told, worst = dict[str, Note](), dict[str, Floats]()
    for one, moved, least in found:
        most = int(np.argmax(moved))
        size, name = float(moved[most]), one.about
        if size > max(least, told[name].value or 0.0 if name in told else 0.0):
            figure = f"{size:.2g}" if size < 99.5 else f"{size:.0f}"
            text = f"assumed {one.found} would shift {names[most]} by {figure} std unseen"
            told[name] = replace(one, found=text, on=(names[most],), value=size, unit="1")
        worst[name] = np.maximum(worst.get(name, 0.0), moved)
    total = sum((moved**2 for moved in worst.values()), np.zeros(len(names)))

    moved = np.array([worst[name] for name in told]).reshape(len(told), len(names))
    leads = np.where(moved == moved.max(axis=0, initial=0.0), moved, 0.0)
    order = np.lexsort([-each.max(axis=1, initial=0.0) for each in (moved, leads)])
    return np.sqrt(total), [list(told.values())[k] for k in order]
