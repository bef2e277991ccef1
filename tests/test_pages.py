"""No example escapes: Python of every page runs, commands are ones that there are, help is true."""

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from rotorid import cli

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^ *```(\w*)\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
ELSEWHERE = {"README.md", "maximum-likelihood.md", "models.md", "rig.md", "signals.md"}
"""Pages whose Python runs with what it prints, in test_docs and rig/test_rig_docs."""
INDENTED = re.compile(r"^ {4}rotorid (\w.*)$", re.MULTILINE)
IN_BLOCK = re.compile(r"^(?:\$ )?rotorid (\w.*)$", re.MULTILINE)
INLINE = re.compile(r"`rotorid ([a-z]+ [^`]*)`")
SWEEP = """
model = "jeffcott"
[[records]]
file = "sweep.csv"
sample_rate = "1 kHz"
speed = "0 rpm"
band = ["20 Hz", "300 Hz"]
references = ["r1", "r2"]
[channels]
F_x = { column = "e1", unit = "N" }
F_y = { column = "e2", unit = "N" }
x = { column = "x", unit = "um" }
y = { column = "y", unit = "um" }
"""


def python_of(page: Path) -> list[str]:
    found = BLOCK.findall(page.read_text(encoding="utf-8"))
    return [text for language, text in found if language == "python"]


WITH_PYTHON = [p for p in PAGES if python_of(p) and p.name not in ELSEWHERE]


@pytest.mark.slow
@pytest.mark.parametrize("page", WITH_PYTHON, ids=lambda page: page.name)
def test_python_of_every_page_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "page"}
    for code in python_of(page):
        exec(compile(code, page.name, "exec"), names)


def commands() -> list[str]:
    """Return every command line that a page shows: in blocks, indented, and within sentences."""
    found = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8").replace("\\\n", " ")
        for block in re.findall(r"^ *```[^\n]*\n(.*?)^ *```", text, re.MULTILINE | re.DOTALL):
            found += IN_BLOCK.findall(block)
        found += INDENTED.findall(text)
        found += [line.replace("\n", " ") for line in INLINE.findall(text)]
    return sorted({line.partition("  #")[0].strip() for line in found})


def test_commands_of_the_pages_are_ones_that_there_are():
    """Names and options; the files that they name are the reader's."""
    every = commands()
    assert len(every) > 30
    for line in every:
        name, *arguments = shlex.split(line.replace("RIG", "rigid"), comments=True)
        command = cli.cli.commands[name]
        known = {text for parameter in command.params for text in parameter.opts}
        asked = {word.partition("=")[0] for word in arguments if re.match(r"--?[a-z]", word)}
        assert asked <= known | {"--help", "-h"}, line


def examples() -> list[list[str]]:
    """Return the examples of every help, in an order in which each has what it reads."""
    order = ("simulate", "identify", "report", "inspect", "validate", "modes", "balance")
    order = (*order, "export", "models", "new", "sensitivity", "schema")
    assert {*order, "demo"} == {*cli.cli.commands}  # that of demo runs in test_demo
    texts = [str(cli.cli.commands[name].epilog) for name in order]
    return [shlex.split(text.partition("rotorid ")[2]) for text in texts]


@pytest.mark.slow
def test_the_example_of_every_help_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(5)
    r = rng.standard_normal((10_000, 2))
    e = 1.4 * r + 0.1 * rng.standard_normal(r.shape)
    table = np.column_stack([e, r, rng.standard_normal(r.shape)])
    np.savetxt("sweep.csv", table, delimiter=",", header="e1,e2,r1,r2,x,y", comments="")
    np.savetxt("run.csv", table, delimiter=",", header="a,b,c,d,x,y", comments="")
    Path("loop.toml").write_text(SWEEP)
    for arguments in examples():
        if arguments[0] == "validate":
            shutil.copy("run.toml", arguments[2])
        if arguments[0] == "new":
            arguments[-1] = "draft.toml"  # which is not to take the place of what others read
        assert cli.run(arguments) == 0, arguments
