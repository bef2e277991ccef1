"""Directives that run what a page shows, so that what stands below it is what came out.

Each page has a folder of its own, in which its blocks run one after the other:

``file``    writes its content under the name given, and shows it
``run``     runs its lines, ``rotorid ...`` each, and shows them with what they print
``python``  runs its content as Python, and shows it with what it prints; ``:picture:`` shows the
            matplotlib figure that the variable ``figure`` holds then
``source``  is for readers of the page's source alone, where nothing has run: shows nothing

``:code:`` is the exit code that is expected, ``:lines:`` how many lines of the output are shown,
``:folded:`` the line under which a reader may open the code, whose output is not shown. A block
that fails stops the build.
"""

from __future__ import annotations

import contextlib
import html
import io
import os
import re
import shlex
import tempfile
import textwrap
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.docutils import SphinxDirective

from rotorid.cli import run as run_command

WIDTH = 88  # characters of a block beside the list of pages
_FOLDERS: dict[str, Path] = {}
_NAMES: dict[str, dict[str, Any]] = {}


class _Running(SphinxDirective):
    """What the directives share."""

    has_content = True
    option_spec: ClassVar[dict[str, Any]] = {
        "code": directives.nonnegative_int,
        "lines": directives.nonnegative_int,
        "folded": directives.unchanged_required,
        "picture": directives.unchanged,
        "alt": directives.unchanged,
    }

    @property
    def folder(self) -> Path:
        """Where the blocks of this page run."""
        page = self.env.docname
        if page not in _FOLDERS:
            _FOLDERS[page] = Path(tempfile.mkdtemp(prefix="rotorid-docs-"))
        return _FOLDERS[page]

    def shown(self, text: str, language: str = "none") -> list[nodes.Node]:
        """Return a block of code, or the line that opens it."""
        block = nodes.literal_block(text.rstrip("\n"), text.rstrip("\n"))
        block["language"] = language
        block["classes"] += ["terminal"] * (language == "none")
        if line := self.options.get("folded"):
            head = f"<details><summary>{html.escape(line)}</summary>"
            ends = [nodes.raw("", each, format="html") for each in (head, "</details>")]
            return [ends[0], block, ends[1]]
        return [block]

    def cut(self, text: str) -> str:
        """Return the first lines of what was printed, without this machine's folder in it."""
        kept = self.options.get("lines")
        lines = text.replace(f"{self.folder}{os.sep}", "").rstrip().splitlines()
        lines = [part for line in lines for part in _broken(line)]
        if kept is None or len(lines) <= kept:
            return "\n".join(lines)
        return "\n".join([*lines[:kept], "..."])

    def failed(self, what: str, why: str) -> ExtensionError:
        """Return the error of a block that did not do what the page says."""
        return ExtensionError(f"{self.env.docname}, line {self.lineno}: {what}: {why}")


def _broken(line: str) -> list[str]:
    """Return a sentence in lines that a page can show; rows of tables stay as they are."""
    if len(line) <= WIDTH or "  " in line.strip():
        return [line]
    return textwrap.wrap(
        line, WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )


@contextlib.contextmanager
def _inside(folder: Path) -> Any:
    """Work in a folder, and gather what is printed."""
    before, out = Path.cwd(), io.StringIO()
    os.chdir(folder)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
            yield out
    finally:
        os.chdir(before)


class File(_Running):
    """``file NAME``: write it and show it."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Write the content."""
        path = self.folder / self.arguments[0]
        path.write_text("\n".join(self.content) + "\n", encoding="utf-8")
        language = {".toml": "toml", ".py": "python"}.get(path.suffix, "none")
        block = self.shown("\n".join(self.content), language)
        return [nodes.paragraph("", "", nodes.literal("", path.name), nodes.Text(":")), *block]


class Run(_Running):
    """``run``: commands, with what they print."""

    def run(self) -> list[nodes.Node]:
        """Run every line."""
        parts = []
        for line in re.split(r"(?<!\\)\n", "\n".join(self.content)):
            program, *arguments = shlex.split(re.sub(r"\\\n\s*", "", line), comments=True)
            assert program == "rotorid", line
            with _inside(self.folder) as out:
                code = run_command(arguments)
            if code != self.options.get("code", 0):
                raise self.failed(line, f"exit code {code}\n{out.getvalue()}")
            parts.append("\n".join(filter(None, (f"$ {line}", self.cut(out.getvalue())))))
        return self.shown("\n\n".join(parts))


class Python(_Running):
    """``python``: code, with what it prints and draws."""

    def run(self) -> list[nodes.Node]:
        """Run the content with the names of the page's earlier blocks."""
        names = _NAMES.setdefault(self.env.docname, {"__name__": "page"})
        code = "\n".join(self.content)
        with _inside(self.folder) as out:
            exec(compile(code, f"{self.env.docname}.py", "exec"), names)
        found = self.shown(code, "python")
        if (printed := self.cut(out.getvalue())) and "folded" not in self.options:
            found += self.shown(printed)
        if name := self.options.get("picture"):
            target = Path(self.env.srcdir) / "generated" / name
            names["figure"].savefig(target, dpi=120, metadata={"Software": None})
            image = nodes.image(uri=f"generated/{name}", alt=self.options.get("alt", ""))
            found.append(image)
        return found


class Source(_Running):
    """``source``: words for those who read the source of a page."""

    def run(self) -> list[nodes.Node]:
        """Show nothing."""
        return []


def setup(app: Sphinx) -> dict[str, bool]:
    """Tell Sphinx the directives."""
    for directive in (File, Run, Python, Source):
        app.add_directive(directive.__name__.lower(), directive)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
