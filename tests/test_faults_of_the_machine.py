"""Full disks, closed descriptors, signals and little memory: the old file or the new one."""

import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import h5py
import numpy as np
import pytest
from working_folder import make

import rotorid as rid
from rotorid import cli

PROGRAM = [sys.executable, "-m", "rotorid"]
# One child for each line that it is sent: all that a command imports is there. Each step of writing
# takes its time, so that a signal falls into it.
CHILDREN = """
import os, sys, time
import rotorid.core.files as writing
from rotorid import cli
class Slow:
    def __getattr__(self, name):
        found = getattr(os, name)
        if name not in ("write", "fsync", "replace", "open", "fchmod"):
            return found
        return lambda *given, **named: (time.sleep(0.03), found(*given, **named))[1]
assert cli.run([*sys.argv[1:], "-q"]) == 0
writing.os = Slow()
for _ in sys.stdin:
    child = os.fork()
    if not child:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        cli.main()
    print(child, flush=True)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return make(tmp_path_factory.mktemp("machine"))


def run(
    *arguments: str,
    limit: Callable[[], None] | None = None,
    out: int | IO[str] = subprocess.PIPE,
    err: int | IO[str] = subprocess.PIPE,
) -> subprocess.CompletedProcess[str]:
    process = subprocess.run(
        [*PROGRAM, *arguments],
        stdout=out,
        stderr=err,
        text=True,
        errors="replace",
        preexec_fn=limit,
        # A limit on the size of files would cut compiled modules short as well.
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
        timeout=60,
    )
    assert process.returncode >= 0, f"signal {-process.returncode}"
    assert "Traceback" not in (process.stderr or "")
    return process


def limited(what: int, most: int) -> Callable[[], None]:
    return lambda: resource.setrlimit(what, (most, most))


@contextmanager
def files_of(most: int) -> Iterator[None]:
    """Let this process write files of so many bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
    compiled, sys.dont_write_bytecode = sys.dont_write_bytecode, True  # it would be cut short
    try:
        yield
    finally:
        sys.dont_write_bytecode = compiled
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_full_disk_is_one_line_and_leaves_what_was_there(here, capsys, refusal):
    """A record of simulate, too: HDF5 itself would end the process."""
    rid.load_rig("rig.toml").rig.run(1e-3, np.random.default_rng(0))  # which is compiled by then
    (here / "old.h5").touch()  # nobody's, to be replaced
    before = content(here)
    with files_of(10_000):
        told = refusal("simulate", "rig.toml", "--out", "old.h5")
    assert told.startswith("rotorid: old.h5: found File too large; expected")
    with files_of(100):
        assert cli.run(["identify", "run.toml", "--json", "new.json"]) == 2
    shown, told = capsys.readouterr()
    assert shown.startswith("jeffcott, batch: ok\n")  # what took the time is shown
    assert told.startswith("rotorid: new.json: found File too large; expected")
    assert content(here) == before


@pytest.mark.slow
def test_an_output_that_is_full(here):
    with Path("/dev/full").open("w") as full:
        found = run("identify", "run.toml", "--json", "full.json", out=full)
        assert run("--help", out=full).returncode == 2
        assert run("identify", "none.toml", err=full).returncode == 2
    assert found.returncode == 2
    assert found.stderr == "rotorid: standard output: No space left on device\n"
    assert json.loads((here / "full.json").read_text())["status"] == "ok"
    (here / "full.json").unlink()


@pytest.mark.sampled(1)
@pytest.mark.parametrize("closed", [(1,), (2,), (0, 1, 2)], ids=str)
def test_closed_descriptors(here, closed):
    """No file that is opened takes the place of a closed output, and gets its text."""

    def close() -> None:
        for descriptor in closed:
            os.close(descriptor)

    before = content(here)
    found = run("identify", "run.toml", "--json", "closed.json", limit=close)
    assert found.returncode == 0
    assert found.stderr == ""
    assert json.loads((here / "closed.json").read_text())["status"] == "ok"
    (here / "closed.json").unlink()
    assert run("identify", "none.toml", limit=close).returncode == 2
    assert content(here) == before


@pytest.mark.sampled(1)
@pytest.mark.parametrize("command", [["--help"], ["models"], ["new", "run.csv"]], ids=str)
def test_a_reader_that_has_gone(here, command):
    reading, writing = os.pipe()
    os.close(reading)
    found = run(*command, out=writing)
    os.close(writing)
    assert found.returncode == 141
    assert found.stderr == ""


@pytest.mark.slow
def test_a_terminal_that_lacks_letters(here, monkeypatch):
    monkeypatch.setenv("PYTHONIOENCODING", "cp1252")
    text = (here / "run.toml").read_text().replace('"run.csv"', '"läuft 日.csv"')
    (here / "läuft 日.csv").write_bytes((here / "run.csv").read_bytes())
    (here / "named.toml").write_text(text, encoding="utf-8")
    assert run("inspect", "named.toml").returncode == 0
    (here / "läuft 日.csv").unlink()
    found = run("inspect", "named.toml")
    assert found.returncode == 2
    assert "\\u65e5.csv" in found.stderr


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_leaves_no_part_of_a_file(here, monkeypatch, capsys, number):
    before = content(here)
    monkeypatch.setattr("rotorid.core.files.os.fsync", lambda _: os.kill(os.getpid(), number))
    old = signal.signal(number, cli._stop)
    try:
        assert cli.run(["identify", "run.toml", "--json", "new.json", "-q"]) == 128 + number
    finally:
        signal.signal(number, old)
    assert capsys.readouterr().err == "rotorid: terminated\n"
    assert content(here) == before


def test_nohup_stays_in_force(here):
    script = "import os, signal; from rotorid import cli; cli._prepare([]); os.kill(os.getpid(), 1)"
    quiet = subprocess.run(
        [sys.executable, "-c", script], preexec_fn=lambda: signal.signal(1, signal.SIG_IGN)
    )
    assert quiet.returncode == 0


@pytest.mark.parametrize("name", ["run\udcff.toml", "a\x1b[2J.toml", "a\nb.toml", "n" * 5000])
def test_odd_names_on_the_command_line(here, capsys, name):
    for arguments in (
        ["identify", name],
        ["models", name],
        ["identify", "run.toml", "--json", name],
    ):
        code, told = cli.run(arguments), capsys.readouterr().err
        if code == 0:
            assert rid.load_estimate(here / name).status == "ok"
            (here / name).unlink()
            continue
        assert code == 2
        (line,) = told.splitlines()
        assert line.isprintable()
        assert len(line) < 600


@pytest.mark.parametrize(
    "arguments",
    [
        ["demo", "--runs", "9" * 5000],
        ["demo", "--runs", "9" * 30],
        ["simulate", "rig.toml", "--out", "x.h5", "--seed", "9" * 5000],
        ["simulate", "rig.toml", "--out", "x.h5", "--fault", "gain=1e999999"],
        ["simulate", "rig.toml", "--out", "x.h5", "--fault", "a" * 100_000],
        ["b" * 100_000],
        ["--" + "c" * 100_000],
    ],
    ids=range(7),
)
def test_arguments_out_of_all_bounds(here, refusal, arguments):
    before = sorted(here.iterdir())
    refusal(*arguments)
    assert sorted(here.iterdir()) == before


@pytest.mark.slow
@pytest.mark.parametrize("megabytes", [150, 350, 600])
def test_little_memory(here, megabytes):
    before = content(here)
    found = run("identify", "run.toml", limit=limited(resource.RLIMIT_AS, megabytes * 1_000_000))
    assert found.returncode in (0, 1, 2)
    assert len(found.stderr.splitlines()) <= 1
    assert content(here) == before


def whole(path: Path) -> bool:
    """Tell whether a file that a command writes is all there."""
    data = path.read_bytes()
    if path.suffix == ".json":
        return json.loads(data)["status"] == "ok"
    if path.suffix == ".h5":
        with h5py.File(path) as found:
            return len(found["t"]) == 2000
    return data.rstrip().endswith(b"</html>" if path.suffix == ".html" else b"}")


@pytest.mark.slow
@pytest.mark.parametrize(("command", "count"), [("identify", 12), ("simulate", 6)])
def test_random_kills(here, command, count):
    """Eighteen in all: every file is the old one or the new one, and whole."""
    generator = random.Random(11)
    arguments = {
        "identify": ["identify", "run.toml", "--json", "kill.json", "--report", "kill.html"],
        "simulate": ["simulate", "rig.toml", "--out", "kill.h5"],
    }[command]
    hit = 0
    with subprocess.Popen(
        [sys.executable, "-c", CHILDREN, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        bufsize=1,
    ) as parent:
        assert parent.stdin
        assert parent.stdout
        for number in range(count):
            how = generator.choice([signal.SIGTERM, signal.SIGKILL])
            parent.stdin.write("\n")
            child = int(parent.stdout.readline())
            before = {path.name for path in here.iterdir() if path.suffix != ".part"}
            while not list(here.glob(".*.part")):
                time.sleep(0.002)
            time.sleep(generator.uniform(0.0, 0.2))
            os.kill(child, how)
            code = int(parent.stdout.readline())
            hit += code in (-how, 128 + how)
            left = list(here.glob(".*.part"))
            assert not left or how == signal.SIGKILL
            for path in left:
                path.unlink()
            assert {path.name for path in here.iterdir()} == before, number
            assert all(whole(path) for path in here.glob("kill.*")), number
    assert hit > count // 3
    for path in here.glob("kill.*"):
        path.unlink()


@pytest.mark.parametrize("arguments", [("new", "run.csv"), ("inspect", "run.toml")])
def test_a_working_folder_that_is_gone(tmp_path, monkeypatch, refusal, arguments):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert refusal(*arguments).startswith("rotorid: found no working folder")


def test_an_interrupt_while_modules_are_imported_is_one_line(tmp_path):
    """The first module that the command line imports is where Ctrl-C falls."""
    (tmp_path / "click.py").write_text("raise KeyboardInterrupt")
    paths = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    env = {**os.environ, "PYTHONPATH": paths}
    told = subprocess.run([*PROGRAM, "models"], env=env, capture_output=True, text=True)
    assert (told.returncode, told.stderr) == (130, "rotorid: interrupted\n")
