"""Notes by what they do to an answer."""

from collections.abc import Iterable

from rotorid import Note, Suspect


def rejecting(notes: Iterable[Note]) -> list[str]:
    return [note.text for note in notes if note.severity == "rejects"]


def doubting(notes: Iterable[Note]) -> list[str]:
    return [note.text for note in notes if note.severity == "doubts"]


def causes(*suspects: Suspect) -> tuple[Note, ...]:
    return tuple(
        Note(s.term, "doubts", value=s.value, unit=s.unit, drop=s.drop, share=s.share)
        for s in suspects
    )
