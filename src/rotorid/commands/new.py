"""``rotorid new``."""

from __future__ import annotations

from pathlib import Path

from rotorid.commands import OK
from rotorid.commands.console import STDOUT, as_text, check_outputs, write
from rotorid.core.errors import printable
from rotorid.core.files import check_apart
from rotorid.core.watch import watch
from rotorid.experiment.draft import DRAFT, draft


def run(files: tuple[Path, ...], model: str | None, out: Path | None, force: bool) -> int:
    targets = check_outputs((out, DRAFT), force=force)
    check_apart(targets, [*files, *([] if model is None else [Path(model)])])
    watch("reading")
    folder = Path() if out is None else out.parent
    text = printable(draft(files, model, folder), keep="\n")
    write((STDOUT if out is None else out, as_text(lambda: text, DRAFT)))
    return OK
