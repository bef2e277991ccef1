"""What a case is, and how one is run: steps in a folder of its own, what each says and writes."""

from __future__ import annotations

import contextlib
import io
import os
import shlex
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from golden.digest import file_digest, text_lines

Step = str | Callable[[Path], None]
"""A command line without its `rotorid`, or a function that writes files into the folder."""
Result = dict[str, Any]


class Skipped(Exception):  # noqa: N818 - it is no error
    """A case that cannot be run here, with the reason."""


@dataclass(frozen=True)
class Case:
    """Steps that are taken one after the other in an empty folder."""

    name: str
    steps: tuple[Step, ...]
    shared: str = ""
    """A folder that several cases read: its name among `golden.cases.SHARED`."""


def run_case(case: Case, shared: Path | None = None) -> Result:
    """Return what a case says and writes: {"steps": [...]}, or {"skipped": reason}."""
    home = Path.cwd()
    with tempfile.TemporaryDirectory(prefix="golden-") as name:
        folder = Path(name).resolve()
        for file in sorted(shared.iterdir()) if shared else []:
            (folder / file.name).symlink_to(file)
        os.chdir(folder)
        try:
            found = [_told(step, folder) for step in case.steps]
        except Skipped as reason:
            return {"skipped": str(reason)}
        finally:
            os.chdir(home)
    return {"steps": [step for step in found if step]}


def _told(step: Step, folder: Path) -> Result:
    if callable(step):
        step(folder)
        return {}
    before = _files(folder)
    code, out, err = run_command(step)
    after = _files(folder)
    written = {
        file.relative_to(folder).as_posix(): file_digest(file, folder)
        for file in sorted(after)
        if after[file] != before.get(file)
    }
    gone = [file.relative_to(folder).as_posix() for file in sorted(set(before) - set(after))]
    told: Result = {"command": step, "code": code}
    told["out"], told["err"] = text_lines(out, folder), text_lines(err, folder)
    return told | ({"files": written} if written else {}) | ({"gone": gone} if gone else {})


def run_command(command: str) -> tuple[int, str, str]:
    """Return exit code, standard output and standard error of a command line."""
    from rotorid.cli import run

    out, err = io.StringIO(), io.StringIO()
    streams = contextlib.redirect_stdout(out), contextlib.redirect_stderr(err)
    with streams[0], streams[1], warnings.catch_warnings():
        warnings.simplefilter("ignore")
        code = run(shlex.split(command))
    return code, out.getvalue(), err.getvalue()


def _files(folder: Path) -> dict[Path, tuple[int, int]]:
    found = {}
    for file in folder.rglob("*"):
        if file.is_file() and not file.is_symlink():
            state = file.stat()
            found[file] = (state.st_mtime_ns, state.st_size)
    return found
