"""The comparison with peers: its scores, and one entrant on a small case."""

import json
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

PEERS = Path(__file__).parents[1] / "benchmarks" / "peers"


def ran(script: str, *arguments: object) -> str:
    command = [sys.executable, PEERS / script, *map(str, arguments)]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    """Return a folder with two cases, answered by numpy and by two who know the truth."""
    out = tmp_path_factory.mktemp("bench")
    ran("cases.py", out, 2, "--seed", 1)
    for name in ("right", "wrong"):
        (out / "answers" / name).mkdir(parents=True)
    ran("with_numpy.py", out)
    for path in (out / "sealed").iterdir():
        sealed = json.loads(path.read_text("utf-8"))
        truth, bound = sealed["truth"], sealed["bound"]
        off = {name: truth[name] + bound[name] for name in truth}
        right = {"parameters": off, "std": bound, "seconds": 0.002, "peak_mb": 1}
        wrong = right | {"parameters": truth | {"k1": 2 * truth["k1"]}}
        for name, answer in (("right", right), ("wrong", wrong)):
            (out / "answers" / name / path.name).write_text(json.dumps(answer), "utf-8")
    return out


@pytest.fixture(scope="module")
def scores(out):
    ran("score.py", out)
    return json.loads((out / "scores.json").read_text("utf-8"))


def test_an_answer_one_bound_off_scores_one_and_is_covered(scores):
    right = scores["right"]
    assert (right["answered"], right["lost"]) == (2, 0)
    assert right["rms/bound, all"] == pytest.approx(1.0)
    assert right["cover %"] == 100.0
    assert right["ms"] == pytest.approx(2.0)


def test_a_stiffness_twice_as_large_is_lost(scores):
    assert scores["wrong"]["lost"] == scores["wrong"]["lost unsaid"] == 2
    assert "rms/bound" not in scores["wrong"]


def test_the_procedure_of_the_paper_finds_the_rotor_and_its_deviations_are_too_small(scores):
    assert scores["numpy"]["answered"] == 2
    assert scores["numpy"]["lost"] == 0
    assert scores["numpy"]["frequency %"] < 1.0
    assert scores["numpy"]["cover %"] < 50.0


# The benchmarks start: each is imported, none is timed.


BENCHMARKS = sorted((Path(__file__).parents[1] / "benchmarks").glob("*.py"))


@pytest.mark.parametrize("file", BENCHMARKS, ids=lambda file: file.stem)
def test_imports(file):
    """What a benchmark takes from the program is there."""
    runpy.run_path(str(file))
