"""Notes by what they do to an answer."""

from collections.abc import Iterable

from rotorid import Note, Suspect


def rejecting(notes: Iterable[Note]) -> list[str]:
    """Return what turns an answer away."""
    return [note.text for note in notes if note.severity == "rejects"]


def doubting(notes: Iterable[Note]) -> list[str]:
    """Return what leaves an answer doubtful."""
    return [note.text for note in notes if note.severity == "doubts"]


def causes(*suspects: Suspect) -> tuple[Note, ...]:
    """Return the notes of possible causes of a misfit."""
    return tuple(
        Note(s.term, "doubts", value=s.value, unit=s.unit, drop=s.drop, share=s.share)
        for s in suspects
    )
