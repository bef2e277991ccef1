"""Cases in forked children, a child per case: nothing that one leaves behind reaches another."""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
import os
import tempfile
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from multiprocessing.connection import Connection, wait
from pathlib import Path

from golden.case import Case, Result, run_case, run_command
from golden.cases import RIGS, SHARED

FORK = multiprocessing.get_context("fork")


def run_all(cases: Sequence[Case], jobs: int) -> Iterator[tuple[Case, Result, float]]:
    """Yield each case with its result and its seconds of processor, as they end."""
    with tempfile.TemporaryDirectory(prefix="golden-shared-") as name:
        shared = _prepared(cases, Path(name).resolve())
        gc.collect()
        gc.freeze()
        waiting, running = list(reversed(cases)), dict[Connection, Case]()
        while waiting or running:
            while waiting and len(running) < jobs:
                case = waiting.pop()
                running[_started(case, shared.get(case.shared))] = case
            for pipe in wait(list(running)):
                assert isinstance(pipe, Connection)
                yield running.pop(pipe), *_received(pipe)


def _started(case: Case, shared: Path | None) -> Connection:
    here, there = FORK.Pipe(duplex=False)
    child = FORK.Process(target=_work, args=(case, shared, there))
    child.start()
    there.close()
    return here


def _work(case: Case, shared: Path | None, pipe: Connection) -> None:
    try:
        result = run_case(case, shared)
    except BaseException:
        result = {"died": traceback.format_exc().splitlines()[-1]}
    pipe.send((result, time.process_time()))
    pipe.close()


def _received(pipe: Connection) -> tuple[Result, float]:
    try:
        result, seconds = pipe.recv()
    except EOFError:
        result, seconds = {"died": "without a word"}, 0.0
    pipe.close()
    return result, seconds


def _prepared(cases: Sequence[Case], folder: Path) -> Mapping[str, Path]:
    """Load what most cases need, once, and write what several of them read."""
    home, found = Path.cwd(), dict[str, Path]()
    names = sorted({case.shared for case in cases} - {""})
    for name in ["warm", *names]:
        found[name] = folder / name
        found[name].mkdir()
        os.chdir(found[name])
        with contextlib.ExitStack() as stack:
            stack.callback(os.chdir, home)
            for step in _warming() if name == "warm" else SHARED[name]:
                code, _, said = run_command(step)
                assert code == 0, said
    return found


def _warming() -> Sequence[str]:
    """Return commands that compile and load: children inherit it."""
    text = (RIGS / "three-mass.toml").read_text("utf-8").replace('"2 s"', '"0.5 s"')
    Path("rig.toml").write_text(text, "utf-8")
    return ("simulate rig.toml --out run.h5", "identify run.toml --json run.json")
