"""Whatever goes wrong inside a command leaves it as one line and an exit code of ours."""

from importlib import import_module

import pytest
from working_folder import make

from rotorid import InputError, cli

NO_ANSWER, WRONG_INPUT = 1, 2  # the exit codes as they are documented

OUTPUTS = ["--json", "new.json", "--report", "new.html"]
COMMANDS = {
    "identify": ["run.toml", *OUTPUTS],
    "inspect": ["run.toml", *OUTPUTS],
    "validate": ["run.json", "run.toml", *OUTPUTS],
    "modes": ["run.json", *OUTPUTS],
    "balance": ["run.json", "--plane", "x,y", "--json", "new.json"],
    "sensitivity": ["run.toml", "--json", "new.json"],
    "report": ["run.json", "--out", "new.html"],
    "export": ["run.json", "--to", "new.csv"],
    "simulate": ["rig.toml", "--out", "new.h5"],
    "new": ["run.csv", "--out", "new.toml"],
    "models": ["jeffcott"],
    "schema": ["rig", "--out", "new.json"],
    "demo": ["--runs", "1", *OUTPUTS],
    "study": ["study.toml", "--out", "new"],
}
ERRORS = {
    WRONG_INPUT: [
        InputError("this", "that", "do so"),
        OSError(28, "No space left on device"),
        PermissionError(13, "Permission denied", "some file"),
        OSError("no number"),
        MemoryError(),
        EOFError("Compressed file ended before the end-of-stream marker was reached"),
    ],
    NO_ANSWER: [
        ValueError("operands could not be broadcast together"),
        RecursionError("maximum recursion depth exceeded"),
        UnicodeDecodeError("utf-8", b"\xff" * 3000, 0, 1, "invalid start byte"),
        UnicodeEncodeError("utf-8", "\udcff", 0, 1, "surrogates not allowed"),
        KeyError("a\x1b[2Jb\n" * 1000),
        AssertionError(),
        StopIteration(),
        RuntimeError("x" * 100_000),
        BufferError("\u202e"),
        ExceptionGroup("several", [ValueError("one"), KeyError("two")]),
    ],
}
CASES = [(code, error) for code, errors in ERRORS.items() for error in errors]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = make(tmp_path_factory.mktemp("errors"))
    experiment, result = str(folder / "run.toml"), str(folder / "run.json")
    assert cli.run(["identify", experiment, "--json", result, "-q"]) == 0
    return folder


def raiser(error: Exception):
    def fail(*_: object, **__: object) -> None:
        raise error

    return fail


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_an_error_is_one_line(command, here, monkeypatch, refusal):
    before = sorted(here.iterdir())
    module = import_module(f"rotorid.commands.{cli._MODULES.get(command, command)}")
    for code, error in CASES:
        with monkeypatch.context() as patch:
            patch.setattr(module, command if command in cli._MODULES else "run", raiser(error))
            line = refusal(command, *COMMANDS[command], code=code)
        assert "--debug" in line or code == WRONG_INPUT
    assert sorted(here.iterdir()) == before


def test_every_command_is_tried():
    assert set(COMMANDS) == set(cli.cli.commands)


@pytest.mark.parametrize("error", [ERRORS[NO_ANSWER][0], StopIteration(), MemoryError()])
def test_a_report_that_fails_spares_the_answer(error, here, monkeypatch, capsys):
    monkeypatch.setattr("rotorid.report.estimate_report.estimate_report", raiser(error))
    assert cli.run(["identify", "run.toml", *OUTPUTS]) == NO_ANSWER
    printed = capsys.readouterr()
    assert printed.out.startswith("jeffcott, batch: ok\n")
    (line,) = printed.err.splitlines()
    assert line.startswith("rotorid: new.html: no report: ")
    assert line.endswith("the answer stands")
    assert len(line) < 600
    assert (here / "new.json").read_bytes().startswith(b'{\n  "schema"')
    assert not (here / "new.html").exists()
    (here / "new.json").unlink()


def test_figures_that_cannot_be_written_are_shown(here, monkeypatch, capsys):
    full = raiser(OSError(28, "No space left on device"))
    monkeypatch.setattr("rotorid.core.files.os.fsync", full)
    before = sorted(here.iterdir())
    assert cli.run(["identify", "run.toml", *OUTPUTS]) == WRONG_INPUT
    printed = capsys.readouterr()
    assert printed.out.startswith("jeffcott, batch: ok\n")
    assert printed.err.startswith("rotorid: new.json: found No space left on device; expected")
    assert sorted(here.iterdir()) == before
