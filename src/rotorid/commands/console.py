"""What commands share: printing, progress, files written whole or not at all."""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from rotorid.commands import BROKEN_PIPE
from rotorid.io.output import check_target, write_files
from rotorid.tables import Page, page_text

_COLOURS = {
    "rejected": "yellow",
    "ok": "green",
    "not_identifiable": "red",
    "not_converged": "red",
    "predicts": "green",
    "fails": "red",
}
_COLOURED = re.compile(
    r"^warning[:,] .*(?:\n  .*)*"
    r"|(?<=: )(?:ok|rejected|not_identifiable|not_converged|predicts|fails)$",
    re.M,
)


STDOUT = Path("-")
"""In place of a file: what is written goes to the standard output, and nothing else does."""
_SILENT: ContextVar[bool] = ContextVar("silent", default=False)


@contextmanager
def silence(wanted: bool) -> Iterator[None]:
    """Let `show` print nothing meanwhile, where that is wanted."""
    token = _SILENT.set(wanted)
    try:
        yield
    finally:
        _SILENT.reset(token)


def show(page: Page) -> None:
    """Print sentences and tables, as wide as the terminal and in colour where there is one."""
    if _SILENT.get():
        return
    text = page_text(page)
    if sys.stdout.isatty():
        text = page_text(page, shutil.get_terminal_size().columns)
        text = _COLOURED.sub(_coloured, text)
    _print(text)


def _print(text: str) -> None:
    try:
        print(text, flush=True)
    except BrokenPipeError:  # the reader has had enough, as with `rotorid models | head -1`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise click.exceptions.Exit(BROKEN_PIPE) from None


def _coloured(found: re.Match[str]) -> str:
    word = found.group().partition(" ")[0]
    return click.style(found.group(), _COLOURS.get(word, "yellow"))


@contextmanager
def progress(description: str) -> Iterator[Callable[[int, int], None]]:
    """Show the progress of long work on a terminal; nothing where the output is a pipe."""
    if not sys.stderr.isatty():
        yield lambda done, total: None
        return
    from rich.console import Console  # for terminals only
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(description, total=None)
        yield lambda done, total: bars.update(task, completed=done, total=total)


def check_outputs(*targets: Path | None) -> list[Path]:
    """Refuse what cannot be written before the work begins; return the targets there are."""
    given = [path for path in targets if path is not None and path != STDOUT]
    for path in given:
        check_target(path)
    return given


def write(*outputs: tuple[Path | None, Callable[[Path], object]]) -> None:
    """Write the outputs that are asked for, all or none; then those to the standard output."""
    given = [(path, write) for path, write in outputs if path is not None]
    write_files({path: write for path, write in given if path != STDOUT})
    for write in (write for path, write in given if path == STDOUT):
        with TemporaryDirectory() as folder:
            file = Path(folder) / "output"
            write(file)
            _print(file.read_text(encoding="utf-8").rstrip("\n"))


def write_text(text: Callable[[], str]) -> Callable[[Path], object]:
    """Return a writer of a text that is made when it is needed."""
    return lambda path: path.write_text(text(), encoding="utf-8")
