"""What commands share: printing, progress, files written whole or not at all."""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

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
    r"^warning: .*|(?<=: )(?:ok|rejected|not_identifiable|not_converged|predicts|fails)$", re.M
)


def show(page: Page) -> None:
    """Print sentences and tables, as wide as the terminal and in colour where there is one."""
    text = page_text(page)
    if sys.stdout.isatty():
        text = page_text(page, shutil.get_terminal_size().columns)
        text = _COLOURED.sub(_coloured, text)
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
    given = [path for path in targets if path is not None]
    for path in given:
        check_target(path)
    return given


def write(*outputs: tuple[Path | None, Callable[[Path], object]]) -> None:
    """Write the outputs that are asked for, all or none."""
    write_files({path: write for path, write in outputs if path is not None})


def write_text(text: Callable[[], str]) -> Callable[[Path], object]:
    """Return a writer of a text that is made when it is needed."""
    return lambda path: path.write_text(text(), encoding="utf-8")
