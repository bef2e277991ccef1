"""Write the pages that follow from the program: its commands and its Python names.

Called by ``conf.py``; ``docs/generated`` is not kept.
"""

from __future__ import annotations

import re
from pathlib import Path

import click

from rotorid.cli import cli

HERE = Path(__file__).parent
COMPLETION = """
## Completion

Your shell completes commands, options, files, and the names of shipped models and rigs, once it is
told to. For bash, in `~/.bashrc`:

```
eval "$(_ROTORID_COMPLETE=bash_source rotorid)"
```

For zsh put `zsh_source` there, and for fish, in a file of `~/.config/fish/completions`,
`_ROTORID_COMPLETE=fish_source rotorid | source`.
"""
PYTHON = """# Python, name by name

What the docstrings say: the equation, what is taken as known, shapes and units, errors, an example
that runs. `help(rid.identify)` shows the same.
"""
HEAD = """# Commands

What `rotorid COMMAND --help` prints, for every command. Exit codes: 0 done; 1 no answer, 3 one
that the data reject, both written all the same; 2 wrong usage or unreadable
input, one line on the standard error, nothing written; 130 interrupted, but for `identify`, which
ends with the best answer so far. What takes more than two seconds says on a terminal how far it is.
"""


def write_pages(folder: Path) -> None:
    """Write all pages into a folder."""
    folder.mkdir(exist_ok=True)
    _write(folder / "commands.md", commands_page())
    for name, text in python_pages().items():
        _write(folder / f"{name}.md", text)


def _write(path: Path, text: str) -> None:
    """Write what has changed: Sphinx reads again what is newer."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def commands_page() -> str:
    """Return the help of every command."""
    parts = [HEAD]
    for name, command in cli.commands.items():
        context = click.Context(command, info_name=f"rotorid {name}", max_content_width=96)
        context.terminal_width = 96
        parts.append(f"## rotorid {name}\n\n```\n{command.get_help(context).rstrip()}\n```\n")
    return "\n".join([*parts, COMPLETION.lstrip()])


def python_pages() -> dict[str, str]:
    """Return a page per section of reference.md, with what the docstrings say of its names."""
    import rotorid as rid

    text = (HERE / "reference.md").read_text(encoding="utf-8")
    pages = {}
    for section in text.split("\n## ")[1:]:
        title, _, rest = section.partition("\n")
        names = re.findall(r"^\| `rid\.(\w+)`", rest, re.M)
        parts = [f"# Python: {title.lower()}\n"]
        for name in names:
            kind = "class" if isinstance(getattr(rid, name), type) else "function"
            members = "   :members:\n" if kind == "class" else ""
            parts.append(f"```{{eval-rst}}\n.. auto{kind}:: rotorid.{name}\n{members}```\n")
        pages[f"python-{title.lower().replace(' ', '-')}"] = "\n".join(parts)
    listed = "\n".join(pages)
    return {**pages, "python": f"{PYTHON}\n```{{toctree}}\n{listed}\n```\n"}
