"""``rotorid new``."""

from __future__ import annotations

from pathlib import Path

import click

from rotorid.commands import OK
from rotorid.commands.console import check_outputs, progress, write, write_text
from rotorid.errors import InputError
from rotorid.experiment.draft import draft


def run(files: tuple[Path, ...], model: str | None, out: Path | None) -> int:
    """Write a draft experiment file for some records."""
    check_outputs(out)
    if out is not None and out.exists():
        raise InputError("a file", "a new one", "choose another name, or delete it", file=str(out))
    with progress("reading"):
        text = draft(files, model, Path() if out is None else out.parent)
    if out is None:
        click.echo(text, nl=False)
    else:
        write((out, write_text(lambda: text)))
    return OK
