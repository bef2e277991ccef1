"""What the notes on an answer come to: its status, and the order in which they are told.

No other place weighs notes against one another: doubts that are cast only on an answer of a certain
status ask `judge` for that of the notes so far.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal

from rotorid.core.notes import VERDICTS, Note, Severity

Status = Literal["ok", "rejected", "not_identifiable", "not_converged"]
STATUSES: dict[str, Status] = {
    "unfinished": "not_converged",
    "open": "not_identifiable",
    "rejects": "rejected",
}
"""What a note makes of an answer, the gravest first."""
CONTRADICTING = frozenset(
    {
        "drift",
        "settled",
        "knock",
        "lost samples",
        "clocks",
        "speed",
        "period",
        "repeats",
        "copied periods",
        "clipped",
        "stuck",
        "wander",
    }
)
"""Checks whose warnings contradict what every method takes for granted: that the machine, its
speed and its period stay what they are, and that the samples are the quantity."""
SILENT = frozenset({"dead", "stuck", "quantized"})
"""Checks whose warnings are of a channel that reads nothing: no suspect explains it better, and
can but say that the gain of a dead sensor is 1e-19."""
OPEN = "not identifiable"
"""What a note on an open direction, and on what would close it, is about."""
DIRECTION = "direction"
"""What the note is about that the records contradict in one direction what was assumed."""
LACKS, LATE, RECORDS = "missing force", "late forces", "records"
"""What notes are about that the equations of filtered samples lack a force, or that forces come
late, or that records of one machine differ."""
OFF = frozenset({DIRECTION, LACKS, LATE, RECORDS})
"""What makes an answer doubtful by so many deviations, though nothing shows that it is wrong."""
EFFORT = "effort"
"""What the note is about that not everything was asked that may change the answer."""
SUSPECTS = "suspects"
"""What the sentence on the possible causes is about: it says what to do, and stands first."""
_LATER = (
    "units",
    "record",
    "noise",
    "bound",
    "search",
    "modes",
    "other answers",
    "sign",
    "misfit",
    OPEN,
    "blocks",
    "unbalance",
    "report",
)
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
