"""What takes long says how far it is, and an interrupt leaves the best answer so far."""

import json
import os
import re
import select
import signal
import sys
import time
from itertools import pairwise
from threading import Thread

import pytest
from rotor_files import CORED

from rotorid import cli, load_rig
from rotorid.core.watch import watched
from rotorid.likelihood import solver

pty = pytest.importorskip("pty", reason="no terminals of this kind here")
HUNG, SPRUNG = (229.37, 632.02, 1250.0), (84.56, 109.2, 270.94)  # 1186.48 Hz would be right
LONG = ["identify", "run.toml", "--json", "run.json"]
"""A frequency is wrong: the first minimum comes at once, possible mistakes take seconds."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    tables = [
        f'[[modes]]\nfrequency = "{f} Hz"\nstd = "{2e-4 * f} Hz"\n{support}'
        for hertz, support in ((HUNG, 'parameters = { k_s = "0 N/m" }\n'), (SPRUNG, ""))
        for f in hertz
    ]
    (tmp_path / "rotor.toml").write_text(CORED)
    (tmp_path / "run.toml").write_text("\n".join(['model = "rotor.toml"', *tables]))
    monkeypatch.chdir(tmp_path)
    # A shell starts what runs in the background with the signal ignored, these tests included.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield tmp_path
    signal.signal(signal.SIGINT, before)


def read_until(screen: int, text: str, seconds: float = 60.0) -> str:
    """Return what a terminal shows until a text stands there, or until it is closed."""
    seen, until = b"", time.monotonic() + seconds
    while text.encode() not in seen and time.monotonic() < until:
        if select.select([screen], [], [], 0.1)[0]:
            try:
                seen += os.read(screen, 65536)
            except OSError:  # closed at the other end
                break
    return seen.decode()


def test_what_is_tried_is_told_and_an_interrupt_leaves_the_best(folder, monkeypatch, capsys):
    shown = shown_in_process(monkeypatch, *LONG, until=" s left, step ")
    assert re.search(r"trying [a-z ]+, \d+ of \d+, about \d+ s left, step \d+", shown)
    assert re.search(r"best so far: misfit \S+, \S+ expected", shown)
    assert "Traceback" not in shown
    assert "this is the best answer so far" in " ".join(capsys.readouterr().out.split())
    result = json.loads((folder / "run.json").read_text())
    assert result["status"] == "not_converged"
    assert "interrupted" in [note["about"] for note in result["notes"]]
    assert all(row["value"] is not None for row in result["parameters"])


def shown_in_process(
    monkeypatch: pytest.MonkeyPatch, *arguments: str, patience: float = 0.0, until: str = "never"
) -> str:
    """Return what a command shows on a terminal after so many seconds, interrupted at a text."""
    screen, terminal = pty.openpty()
    seen: list[str] = []

    def read() -> None:
        seen.append(read_until(screen, until))
        if until in seen[0]:
            interrupt()
        seen.append(read_until(screen, "never"))

    reader = Thread(target=read)
    reader.start()
    with os.fdopen(terminal, "w") as stream, monkeypatch.context() as patch:
        patch.setattr("rotorid.commands.console.PATIENCE", patience)
        patch.setattr(sys, "stderr", stream)
        patch.setenv("TERM", "xterm")
        assert cli.run(arguments) in (0, 1)
    reader.join()
    os.close(screen)
    return "".join(seen)


def test_nothing_is_tried_without_a_word(folder, monkeypatch):
    """Every step is told before it is tried; what leads it back to its valley takes a few more."""
    told, silent, evaluated = list[tuple[str, int]](), [0], solver.evaluated

    def watch(say, done=0, of=None, best=""):
        told.append((say, done))
        silent.append(0)

    def counted(*point):
        silent[-1] += 1
        return evaluated(*point)

    monkeypatch.setattr("rotorid.likelihood.solver.evaluated", counted)
    with watched(watch):
        assert cli.run([*LONG, "--quiet"]) == 3
    assert max(silent) <= 1 + solver.BENDS
    steps = [(one, other) for (say, one), (now, other) in pairwise(told) if not say and not now]
    assert all(other in (one + 1, 1) for one, other in steps)
    assert max(other for _, other in steps) > 10


def test_little_effort_is_silent_in_a_pipe_and_says_what_it_left_out(folder, capsys):
    assert cli.run([*LONG, "--effort", "quick"]) == 1
    shown, told = capsys.readouterr()
    assert told == ""
    assert "the first minimum, with little effort" in " ".join(shown.split())
    result = json.loads((folder / "run.json").read_text())
    assert [n["severity"] for n in result["notes"] if n["about"] == "effort"] == ["unfinished"]
    assert result["suspects"] == []


def test_the_file_may_ask_for_little_effort_and_the_command_line_for_all(folder, monkeypatch):
    text = (folder / "run.toml").read_text().replace("1250.0", "1186.48")
    (folder / "run.toml").write_text(text + '\n[estimator]\neffort = "quick"\n')
    for more, severities in ((), ["doubts"]), (("--effort", "normal"), []):
        assert cli.run([*LONG, "--quiet", "--force", *more]) == 0
        result = json.loads((folder / "run.json").read_text())
        assert result["status"] == "ok"
        assert [n["severity"] for n in result["notes"] if n["about"] == "effort"] == severities


def interrupt(*_: object, **__: object) -> None:
    os.kill(os.getpid(), signal.SIGINT)


def test_a_second_interrupt_ends_it(folder, monkeypatch, capsys):
    monkeypatch.setattr("rotorid.likelihood.estimator.trials_of", interrupt)
    assert cli.run([*LONG, "--quiet"]) == 1
    assert (folder / "run.json").exists()
    (folder / "run.json").unlink()
    monkeypatch.setattr("rotorid.likelihood.estimator.summarize", interrupt)
    assert cli.run([*LONG, "--quiet"]) == 130
    assert not (folder / "run.json").exists()
    assert capsys.readouterr().err.split() == ["rotorid:", "interrupted"]


def test_an_interrupt_behind_the_search_takes_no_answer_with_it(folder, monkeypatch):
    monkeypatch.setattr("rotorid.results.evidence.record_evidence", interrupt)
    assert cli.run([*LONG, "--quiet", "--effort", "quick"]) == 1
    notes = json.loads((folder / "run.json").read_text())["notes"]
    told = "nothing of the records is kept for a report: KeyboardInterrupt"
    assert told in [note["found"] for note in notes]
    monkeypatch.setattr("rotorid.likelihood.estimator.trials_of", interrupt)
    assert cli.run([*LONG, "--quiet", "--force"]) == 130


@pytest.mark.parametrize("effort", ["quick", "normal"])
def test_an_interrupt_before_the_first_minimum_leaves_the_point_that_was_reached(
    folder, monkeypatch, effort
):
    costs, tangent = list[float](), solver.tangent

    def third(point, *rest):
        costs.append(point.problem.best_at(point.unknowns).cost)
        return interrupt() if len(costs) == 3 else tangent(point, *rest)

    monkeypatch.setattr("rotorid.likelihood.solver.tangent", third)
    assert cli.run([*LONG, "--quiet", "--effort", effort]) == 1
    result = json.loads((folder / "run.json").read_text())
    assert result["status"] == "not_converged"
    assert "looking for the first minimum" in next(
        note["found"] for note in result["notes"] if note["about"] == "interrupted"
    )
    assert result["misfit"]["cost"] == pytest.approx(costs[-1])
    assert costs[-1] < costs[0]


@pytest.mark.parametrize(
    ("patience", "more", "says"), [(0.0, [], True), (60.0, [], False), (0.0, ["-q"], False)]
)
def test_quiet_or_done_sooner_than_that_says_nothing(folder, monkeypatch, patience, more, says):
    shown = shown_in_process(monkeypatch, *LONG, "--effort", "quick", *more, patience=patience)
    assert bool(shown) == says


def test_other_commands_say_how_far_they_are(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rig.toml").write_text(load_rig("three-mass").text.replace('"13 s"', '"1 s"'))
    rig = ("simulate", "rig.toml", "--out", "run.h5")
    assert re.search(r"simulating samples, \d+ of \d+", shown_in_process(monkeypatch, *rig))
    shown = shown_in_process(monkeypatch, "modes", "three-mass", "--to", "9000 rpm")
    assert re.search(r"looking for critical speeds, \d+ of \d+", shown)
