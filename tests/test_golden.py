"""The net of golden results: its comparer finds what moved, and nothing else."""

import copy
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1]))
from golden.comparison import compare, summary
from golden.digest import folded, text_lines

STEP = {
    "command": "identify run.toml --json run.json",
    "code": 0,
    "out": ["disc, ml: ok", "m    5.001  0.003  kg", "note, gain: taken as exact"],
    "err": [],
    "files": {
        "run.json": {
            "status": "ok",
            "parameters": [
                {"name": "m", "unit": "kg", "value": 5.001, "std": 0.003},
                {"name": "k", "unit": "N/m", "value": 4e5, "std": 20.0},
            ],
            "suspects": [
                {"term": "gain[x]", "drop": 100.0, "value": 1.1},
                {"term": "gain[y]", "drop": 100.00000001, "value": 1.2},
                {"term": "speed", "drop": 50.0, "value": 2.0},
            ],
            "checks": [{"check": "dead", "channel": "x", "found": "3 parts", "verdict": "ok"}],
            "evidence": {"measured": {"#": 500, "about": 1.23456}},
            "misfit": {"cost": 90.5},
        }
    },
}
Change = Callable[[dict], object]


def moved(change: Change) -> list:
    new = copy.deepcopy(STEP)
    change(new)
    return compare("case", {"steps": [STEP]}, {"steps": [new]})


def result(step: dict) -> dict:
    return step["files"]["run.json"]


def exchanged(step: dict, *order: int) -> None:
    suspects = result(step)["suspects"]
    result(step)["suspects"] = [suspects[k] for k in order]


MOVED: dict[str, tuple[Change, str]] = {
    "a value": (lambda s: result(s)["parameters"][0].update(value=5.00101), "values"),
    "a cost": (lambda s: result(s)["misfit"].update(cost=90.5000001), "values"),
    "evidence": (lambda s: result(s)["evidence"]["measured"].update(about=1.2346), "values"),
    "a number in a text": (
        lambda s: s.update(out=["disc, ml: ok", "m    5.002  0.003  kg", *s["out"][2:]]),
        "values",
    ),
    "a status": (lambda s: result(s).update(status="rejected"), "status"),
    "a verdict": (lambda s: result(s)["checks"][0].update(verdict="warning"), "status"),
    "an exit code": (lambda s: s.update(code=1), "status"),
    "a name": (lambda s: result(s)["parameters"][0].update(name="M"), "fields"),
    "a key that is gone": (lambda s: result(s).pop("misfit"), "fields"),
    "a length": (lambda s: result(s)["evidence"]["measured"].update({"#": 501}), "fields"),
    "a suspect elsewhere": (lambda s: exchanged(s, 2, 0, 1), "fields"),
    "a suspect less": (lambda s: exchanged(s, 0, 1), "fields"),
    "a word": (lambda s: s["out"].__setitem__(2, "note, gain: taken as known"), "wording"),
    "a line": (lambda s: s["err"].append("rotorid: interrupted"), "wording"),
    "a word in a check": (lambda s: result(s)["checks"][0].update(found="3 pieces"), "wording"),
}
ALIKE: dict[str, Change] = {
    "nothing": lambda s: None,
    "a millionth of a deviation": lambda s: result(s)["parameters"][0].update(value=5.001 + 2e-9),
    "rounding": lambda s: result(s)["misfit"].update(cost=90.5 * (1 + 1e-10)),
    "suspects that fall alike": lambda s: exchanged(s, 1, 0, 2),
    "the width of a gap": lambda s: s["out"].__setitem__(1, "m  5.001   0.003   kg"),
}  # fmt: skip


@pytest.mark.parametrize("what", MOVED)
def test_what_moved_is_found(what):
    change, kind = MOVED[what]
    found = moved(change)
    assert {one.kind for one in found} == {kind}, found


@pytest.mark.parametrize("what", ALIKE)
def test_what_is_alike_passes(what):
    assert not moved(ALIKE[what])


def test_the_same_difference_of_many_cases_is_one_line():
    new = copy.deepcopy(STEP)
    new["out"][2] = "note, gain: taken as known"
    result(new)["misfit"]["cost"] = 99.0
    found = []
    for name in ("a", "b", "c"):
        found += compare(name, {"steps": [STEP]}, {"steps": [new]})
    values, wording, count = summary(found)
    assert values.startswith("values: 3 cases (a ..): 1 identify.files.run.json.misfit.cost: by up")
    assert wording.endswith('"note, gain: taken as exact" -> "note, gain: taken as known"')
    assert count == "different things: 0 status, 0 fields, 1 values, 1 wording"
    assert len(list(summary(found, verbose=True))) == 9


def test_nothing_of_the_machine_is_kept(tmp_path):
    text = f"{tmp_path}/run.csv\nof 2026-01-02, rotorid 0.1.0, {'0f' * 32}"
    assert text_lines(text, tmp_path) == ["<here>/run.csv", "of <date>, rotorid <version>, <hash>"]
    assert folded([3.0, None, 4.0]) == {"#": 3, "about": 5.0, "none": 1}
