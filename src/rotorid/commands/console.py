"""What commands share: printing, progress, order of outputs, provenance."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from hashlib import file_digest
from pathlib import Path
from platform import python_version
from threading import Timer
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO

import click

from rotorid.commands import BROKEN_PIPE
from rotorid.core import files
from rotorid.core.errors import InputError, UnfinishedError, one_line
from rotorid.core.tables import Page, page_text
from rotorid.core.watch import Pace, watch, watched, words

if TYPE_CHECKING:
    from rich.live import Live

    from rotorid.answer.parts import SourceFile

HASHED_BYTES = 16_000_000_000
"""Of a file whose sha256 is kept with a result: ten to twenty seconds. Of a larger one a fraction
was read, and to hash the rest would take longer than to answer."""

Output = tuple[Path | None, files.Content]
_COLOURS = {  # others are yellow
    **dict.fromkeys(("ok", "predicts"), "green"),
    **dict.fromkeys(("not_identifiable", "not_converged", "fails"), "red"),
}
_COLOURED = re.compile(
    r"^warning[:,] .*(?:\n  .*)*"
    r"|(?<=: )(?:ok|rejected|not_identifiable|not_converged|predicts|fails)$"
    r"|(?<=: )ok(?:, but doubtful| under assumptions)\b.*$",
    re.M,
)


STDOUT = Path("-")
"""In place of a file: what is written goes to the standard output, and nothing else does."""
_FOUND: ContextVar[Mapping[Path, files.Seen]] = ContextVar("found")
"""What was at the targets when they were checked: `write` replaces nothing else."""
_SILENT: ContextVar[bool] = ContextVar("silent", default=False)


@contextmanager
def silence(wanted: bool) -> Iterator[None]:
    token = _SILENT.set(wanted)
    try:
        yield
    finally:
        _SILENT.reset(token)


def show(page: Page) -> None:
    if _SILENT.get():
        return
    text = page_text(page)
    if sys.stdout is not None and sys.stdout.isatty():
        text = page_text(page, shutil.get_terminal_size().columns)

        def coloured(found: re.Match[str]) -> str:
            colour = _COLOURS.get(found.group().partition(" ")[0], "yellow")
            return click.style(found.group(), colour)

        if not os.environ.get("NO_COLOR"):  # no-color.org
            text = _COLOURED.sub(coloured, text)
    say(text + "\n")


def say(text: str) -> None:
    """Print a text; `click.exceptions.Exit` where its reader has had enough (``| head -1``)."""
    display = _DISPLAY.get()
    if display is not None:
        display.hide()
    try:
        put(text, sys.stdout)
    except BrokenPipeError:
        raise click.exceptions.Exit(BROKEN_PIPE) from None
    except OSError as error:
        raise OSError(error.errno, error.strerror, "standard output") from None
    finally:
        if display is not None:
            display.wait()


def put(text: str, stream: TextIO | None) -> None:
    """Write a text to a stream that may be closed, and say nothing more there if it fails."""
    if stream is None:  # closed before the process began: nobody wants to read it
        return
    try:
        # Not what the stream's encoding lacks, as in a terminal without UTF-8, is a reason to fail.
        encoding = stream.encoding or "utf-8"
        stream.write(text.encode(encoding, "backslashreplace").decode(encoding))
        stream.flush()
    except OSError:
        # What is left in its buffer would be tried again at the end, and fail there.
        with contextlib.suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        raise


PATIENCE = 2.0  # seconds after which a command says what it does


class _Display:
    """What is being done, on a terminal: from `PATIENCE` after a command begins, or has printed."""

    def __init__(self) -> None:
        self._pace = Pace()
        self._text = self._steps = self._best = ""
        self._live: Live | None = None

    def __call__(self, say: str, done: int = 0, of: int | None = None, best: str = "") -> None:
        if not say:
            self._steps = f", step {done}"
            return
        self._best = f"; best so far: {best}" if best else self._best
        self._text, self._steps = words(say, done, of, self._pace.left(say, done, of)), ""

    def wait(self) -> None:
        self._timer = Timer(PATIENCE, self._show)
        self._timer.daemon = True
        self._timer.start()

    def hide(self) -> None:
        self._timer.cancel()
        self._timer.join()
        if self._live is not None:
            self._live.stop()
            self._live = None

    def _show(self) -> None:
        from rich.console import Console  # for terminals only
        from rich.live import Live
        from rich.spinner import Spinner
        from rich.text import Text

        def rendered() -> Spinner:
            spinner.update(text=Text(self._text + self._steps + self._best))
            return spinner

        spinner = Spinner("dots")
        live = Live(
            console=Console(stderr=True),
            get_renderable=rendered,
            transient=True,
            redirect_stdout=False,
            redirect_stderr=False,
        )
        live.start()
        self._live = live


_DISPLAY: ContextVar[_Display | None] = ContextVar("display", default=None)
"""What is shown on the terminal meanwhile: it makes room for what is printed."""


@contextmanager
def progress(quiet: bool) -> Iterator[None]:
    if quiet or sys.stderr is None or not sys.stderr.isatty():
        yield
        return
    display = _Display()
    token = _DISPLAY.set(display)
    display.wait()
    try:
        with watched(display):
            yield
    finally:
        _DISPLAY.reset(token)
        display.hide()


def check_outputs(*targets: tuple[Path | None, files.Kind], force: bool = False) -> list[Path]:
    """Refuse what cannot be written before the work begins; return the targets there are."""
    given = [(path, kind) for path, kind in targets if path is not None and path != STDOUT]
    for path, kind in given:
        if kind is files.REPORT and path.suffix.lower() not in ("", ".html", ".htm"):
            found = f"a report of the ending {path.suffix}"
            cure = f"write {path.with_suffix('.html').name}; a browser prints it to PDF"
            raise InputError(found, "a page: .html", cure, file=str(path))
    for path, kind in given:
        files.check_target(path, kind, force=force)
    _FOUND.set({} if force else {path: files.seen(path) for path, _ in given})
    return [path for path, _ in given]


def write(*outputs: Output) -> None:
    """Write the outputs that are asked for, all or none; then those to the standard output."""
    given = [(path, content) for path, content in outputs if path is not None]
    targets = {path: content for path, content in given if path != STDOUT}
    try:
        files.write_files(targets, _FOUND.get({}))
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        raise InputError(
            str(error.strerror),
            "a file that can be written",
            "make room there, or write elsewhere" if full else "write elsewhere",
            file=str(error.filename or ""),
        ) from error
    for content in (content for path, content in given if path == STDOUT):
        say(content().decode())


class Outputs(NamedTuple):
    json: Path | None
    report: Path | None
    force: bool = False
    given: str = ""
    kind: files.Kind = files.REPORT  # of the JSON

    def check(self, *reports: Path | None) -> list[Path]:
        pages = ((path, files.REPORT) for path in (self.report, *reports))
        return check_outputs((self.json, self.kind), *pages, force=self.force)

    def give(self, page: Page, data: Any, html: Callable[[], str]) -> None:
        """Write the figures, show the page, make the report, whatever becomes of the others."""
        faults: list[Exception] = []
        figures = data if callable(data) else as_json(data, self.kind)
        for step in (partial(write, (self.json, figures)), partial(show, page)):
            try:
                step()
            except (InputError, click.exceptions.Exit, OSError) as error:
                faults.append(error)
        if not any(isinstance(fault, InputError) for fault in faults):
            if self.report is not None:
                watch("writing the report")
            try:
                write((self.report, as_text(html, files.REPORT)))
            except Exception as error:
                found = f"{type(error).__name__}: {error}; --debug shows where"
                found = one_line(error.found if isinstance(error, InputError) else found)
                told = f"{one_line(str(self.report))}: no report: {found}; the answer stands"
                raise UnfinishedError(told) from error
        if faults:
            raise faults[0]


def as_text(text: Callable[[], str], kind: files.Kind) -> files.Content:
    """Return the content of a file of text that holds its mark."""
    return lambda: kind.signed(text().encode("utf-8", "backslashreplace"))


def as_json(data: Any, kind: files.Kind) -> files.Content:
    """Return the content of a JSON file, null for no number."""

    def text() -> str:
        plain = json.dumps({**data, "written": files.MARK}, default=_plain)
        finite = json.loads(plain, parse_constant=lambda _: None)
        return json.dumps(finite, indent=2) + "\n"

    return as_text(text, kind)


def _plain(value: Any) -> Any:
    """Return what JSON has none of: arrays as lists, complex numbers as pairs, values as tables."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, complex):
        return [value.real, value.imag]
    return {name: getattr(value, name) for name in value.__dataclass_fields__}


def done(given: str, files: Sequence[Path]) -> list[str]:
    from rotorid import __version__  # its look-up takes its time

    there = [path for path in dict.fromkeys(files) if path.is_file()]
    sums = (source_of(path) for path in there)
    return [
        given,
        f"rotorid {__version__}, {environment()}",
        *(f"{s.file}: sha256 {s.sha256 or 'not taken'}" for s in sums),
    ]


def environment() -> str:
    import numpy as np  # which --help does without
    import scipy

    return f"Python {python_version()}, numpy {np.__version__}, scipy {scipy.__version__}"


def source_of(path: Path) -> SourceFile:
    """Return a file with its sha256; without it, where it is beyond measure."""
    from rotorid.answer.parts import SourceFile

    if files.check_regular(path).st_size > HASHED_BYTES:
        return SourceFile(str(path), "")
    with path.open("rb") as stream:
        return SourceFile(str(path), file_digest(stream, "sha256").hexdigest())
