"""Damaged files of every format through the command line: see `fuzz_run.py` and `fuzz_harness.py`.

Where one of these fails, it prints the seed and the number of the file that did it, and
`python tests/fuzz_run.py --seed SEED --only FORMAT:NUMBER` runs that one again.
"""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import fuzz_harness as harness
import pytest
from commit import SEED, seed_of_commit
from corpus import CASES
from fuzz_files import FORMATS
from fuzz_harness import Case, faults_of, run_cases
from fuzz_mutations import reworded
from fuzz_run import builds_of, findings

TEXTS = [name for name, one in FORMATS.items() if one.damage is reworded]
GROUPS = (TEXTS, [name for name in FORMATS if name not in TEXTS])


@pytest.fixture(scope="module")
def packages():
    for package in ("pyarrow", "nptdms", "pyuff", "asammdf"):
        pytest.importorskip(package)


# A thousand files, 100 of each kind that is read by itself: 20 are the same in every run, so that a
# run says what a change did; the others are the commit's own, so that the search goes on. Formats
# that are read by one piece of code share them: see `Format.share`. What one file in thirty does is
# found with 97 %, one in a hundred by four commits. What those find was there before, more often
# than not: it is a fault all the same, and the seed that is printed finds it again.
@pytest.mark.slow
@pytest.mark.parametrize("formats", GROUPS, ids=["texts", "others"])
def test_damaged_files_of_each_format(formats, packages):
    own = seed_of_commit()
    builds = builds_of(formats, SEED, range(20)) + builds_of(formats, own, range(20, 100))
    found = findings(formats, builds)
    assert not found, f"--seed {SEED}, and {own} from number 20 on\n{found}"


@pytest.fixture(scope="module")
def corpus(request, packages):
    """What came of every case of the corpus that is a test of this run."""
    tests = [item for item in request.session.items if item.name.startswith("test_corpus[")]
    names = [item.callspec.params["name"] for item in tests]
    builds = [lambda name=name: replace(CASES[name](), name=name) for name in names]
    return {outcome.name: outcome for outcome in run_cases(builds)}


LONG = ("mat: version 4, a million empty matrices",)  # for all the seconds that reading has
NAMES = [pytest.param(n, marks=pytest.mark.slow) if n in LONG else n for n in CASES]


@pytest.mark.sampled(24)
@pytest.mark.parametrize("name", NAMES)
def test_corpus(name, corpus):
    assert not corpus[name].faults, corpus[name]


CASE = Case("one", ("models",))
GOOD = "rotorid: run.csv: found nothing; expected numbers; write some\n"


@pytest.mark.parametrize(
    ("code", "out", "told", "fault"),
    [
        (4, "", "", "exit 4"),
        (None, "", "Traceback (most recent call last)", "exit None"),
        (0, "", "Traceback (most recent call last)", "Traceback"),
        (1, "", "rotorid: internal error, KeyError: 1\n", "internal error"),
        (2, "", "", "0 lines"),
        (2, "", GOOD * 2, "2 lines"),
        (2, "", "rotorid: " + "a" * 600 + "\n", "610 characters"),
        (0, "\x1b[31m", "", "prints '\\x1b'"),
        (0, "", "RuntimeWarning: overflow\n", "something else"),
    ],
)
def test_what_is_said_is_judged(code, out, told, fault):
    assert any(found.startswith(fault) for found in faults_of(CASE, code, out, told))
    assert not faults_of(CASE, 2, "", GOOD)


def in_a_child(work: Callable[[], object]) -> None:
    if not (child := os.fork()):
        work()
        os._exit(0)
    os.waitpid(child, 0)


def outcomes(*cases: Case) -> list[tuple[str, ...]]:
    builds = [lambda case=case: case for case in cases]
    return [tuple(o.faults) for o in run_cases(builds)]


@pytest.mark.slow
def test_what_is_done_is_judged(monkeypatch):
    """A harness that finds nothing must find what there is: a signal, a hang, memory, files."""
    monkeypatch.setattr(harness, "SECONDS", 0.05)
    monkeypatch.setattr(harness, "PATIENCE", 10.0)
    monkeypatch.setattr(harness, "BYTES", 40_000_000)
    monkeypatch.setattr(harness, "LOADED", ())

    endless = '{"status": "ok", "parameters": [{"value": NaN}]}'
    # The system keeps the largest of all children: what weighs comes before what is only slow.
    bad: dict[str, Callable[[], object]] = {
        "signal": lambda: os.kill(os.getpid(), 11),
        "hang": lambda: os.read(os.pipe()[0], 1),
        "slow": lambda: sum(range(10_000_000)),
        "memory": lambda: bytearray(b"a") * (2 * harness.BYTES),
        "memory of a child": lambda: in_a_child(lambda: bytearray(b"a") * (4 * harness.BYTES)),
        "slow child": lambda: in_a_child(lambda: sum(range(10_000_000))),
        "file": lambda: Path("left.part").write_text("half"),
        "change": lambda: Path("model.toml").write_text("gone"),
        "nan": lambda: Path("out.json").write_text(endless),
        "nothing": lambda: None,
    }

    def badly(arguments: list[str]) -> int:
        bad[arguments[0]]()
        return 0

    monkeypatch.setattr("rotorid.cli.run", badly)
    files = {"model.toml": b"title"}
    found = outcomes(*(Case(w, (w,), files, outputs=("out.json",)) for w in bad))
    told = dict(zip(bad, found, strict=True))
    assert told["signal"] == ("SIGSEGV",)
    assert told["hang"] == ("hangs",)
    assert told["slow"][0].endswith(" s")
    assert told["memory"][-1].endswith(" GB")
    assert told["slow child"][0].endswith(" s")
    assert told["memory of a child"][-1].endswith(" GB")
    assert told["file"] == ("changed left.part",)
    assert told["change"] == ("changed model.toml",)
    assert told["nan"] == ("ok with NaN",)
    assert told["nothing"] == ()
    monkeypatch.setattr(harness, "REFERENCE", 1e-6)  # on a machine that is slow itself
    assert outcomes(Case("slow", ("slow",), files)) == [()]
