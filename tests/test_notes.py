"""One class carries messages, one function decides on the status, and nobody asks for kinds."""

import ast
import re
from typing import get_args

import pytest
from source_trees import nodes

from rotorid import Note
from rotorid.answer.judge import Status, judge, ordered
from rotorid.core.notes import Severity, worst

TAKES_APART = {"startswith", "endswith", "partition", "rpartition", "removeprefix", "removesuffix"}
MESSAGE = re.compile(r"\b(terms?|warnings?|notes?|suspects?|remarks?|said|cures?)\b")


def test_a_note_reads_as_subject_finding_and_cure():
    note = Note("speed", "warns", "a tone at 50 Hz", "state the speed", on=("x1", "y1"))
    assert str(note) == "speed, x1, y1: a tone at 50 Hz; state the speed"
    assert str(Note("settled", "passes", "no transient is left")) == "settled: no transient is left"
    assert str(Note("cure", "open", cure="fix one")) == "cure: fix one"


@pytest.mark.parametrize(
    ("severities", "verdict"),
    [
        ([], "ok"),
        (["passes", "passes"], "ok"),
        (["passes", "says"], "note"),
        (["warns", "says"], "warning"),
        (["says", "refuses", "warns"], "refused"),
    ],
)
def test_the_gravest_note_gives_the_verdict(severities, verdict):
    assert worst(Note("any", severity) for severity in severities) == verdict  # type: ignore[arg-type]


@pytest.mark.parametrize("before", get_args(Status))
@pytest.mark.parametrize("severity", get_args(Severity))
def test_a_status_never_gets_better(severity, before):
    gravest_last = ("ok", "rejected", "not_identifiable", "not_converged")
    made = {"rejects": "rejected", "open": "not_identifiable", "unfinished": "not_converged"}
    alone = made.get(severity, "ok")
    assert judge([Note("any", severity)]) == alone
    assert judge([Note("any", severity)], before) == max(before, alone, key=gravest_last.index)


def test_what_says_more_is_told_first():
    notes = (
        Note("speed", "passes", "no line contradicts the speed"),
        Note("misfit", "rejects", "the data reject the model"),
        Note("record", "remarks", "no reference"),
        Note("halves", "rejects", "the halves differ"),
        Note("bias", "doubts", "noise biases m"),
        Note("gain[x1]", "doubts", drop=3.0),
        Note("suspects", "rejects", "first suspect: the gain of x1"),
        Note("speed", "rejects", "the data say otherwise"),
        Note("dead", "doubts", "before any suspect, see to x1"),
    )
    names = ["dead", "suspects", "gain[x1]", "speed", "halves", "bias", "record", "misfit", "speed"]
    assert [note.about for note in ordered(notes)] == names
    assert ordered((*notes, *notes)) == ordered(notes)


def test_one_function_decides_on_the_status():
    given = [
        (file, ast.unparse(word.value))
        for file, node in nodes(ast.Call)
        for word in node.keywords
        if word.arg == "status" and not file.startswith("results/")  # which hand it on
    ]
    assert given
    assert [(file, text) for file, text in given if not text.startswith("judge(")] == []


def test_one_class_carries_messages():
    found = []
    for file, node in nodes(ast.ClassDef):
        names = {
            each.target.id
            for each in node.body
            if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name)
        }
        if "cure" in names and names & {"found", "said"}:
            found.append((file, node.name))
    assert found == [("core/notes.py", "Note")]


def test_nobody_takes_a_message_apart():
    found = [
        (file, ast.unparse(node))
        for file, node in nodes(ast.Call)
        if isinstance(node.func, ast.Attribute)
        and node.func.attr in TAKES_APART
        and isinstance(node.func.value, ast.Name | ast.Attribute | ast.Subscript)
        and MESSAGE.search(ast.unparse(node.func.value))
    ]
    assert found == []


def test_nobody_asks_what_kind_an_unknown_is():
    """An unknown says what it does to a record by its effects; its class is its own affair."""
    unknowns = "likelihood/unknowns.py"
    kinds = {node.name for file, node in nodes(ast.ClassDef) if file == unknowns}
    assert "Scalar" in kinds
    asked = [
        (file, ast.unparse(node))
        for file, node in nodes(ast.Call)
        if ast.unparse(node.func) in {"isinstance", "issubclass"}
        and {n.id for a in node.args[1:] for n in ast.walk(a) if isinstance(n, ast.Name)} & kinds
    ]
    assert asked == []
    assert [(f, n) for f, n in nodes(ast.MatchClass) if ast.unparse(n.cls) in kinds] == []
