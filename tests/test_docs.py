"""What the documentation says is there, is there; code and commands that it shows run."""

import ast
import builtins
import importlib
import re
import shlex
import shutil
import tomllib
from pathlib import Path

import h5py
import numpy as np
import pytest
from io_writers import write_table
from source_trees import script
from working_folder import load

import rotorid as rid
from rotorid import cli
from rotorid.core.units import quantity, si_factor
from rotorid.force.laws import Linear
from rotorid.models.parser import MAX_DEGREE, MAX_NESTING, MAX_TERMS
from rotorid.rig.file import parse_rig
from rotorid.rig.files import EXAMPLES, example_files

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("examples/**/*.md")])
MANUAL = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
LINK = re.compile(r"\[[^\]]*\]\(([^)#\s]+)[^)]*\)")
NAME = re.compile(r"`(rotorid(?:\.\w+)+)`")
BLOCK = re.compile(r"^( *)```(\w+)\n(.*?)^\1```", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"^ {4}rotorid (\w.*)$", re.MULTILINE)
IN_BLOCK = re.compile(r"^(?:\$ )?rotorid (\w.*)$", re.MULTILINE)
INLINE = re.compile(r"`rotorid ([a-z]+ [^`]*)`")


def blocks(page: Path, language: str) -> list[str]:
    """Return the fenced blocks of a language, without the indentation of a list."""
    found = BLOCK.findall(page.read_text(encoding="utf-8"))
    return [
        "".join(line.removeprefix(indent) for line in text.splitlines(keepends=True))
        for indent, kind, text in found
        if kind == language
    ]


def resolve(name: str) -> object:
    """Return the module, or the object in a module, of a dotted name."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError:
        module, _, attribute = name.rpartition(".")
        return getattr(resolve(module), attribute)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_names_and_toml_of_a_page_hold(page):
    text = page.read_text(encoding="utf-8")
    for target in LINK.findall(text):
        made = ROOT / "examples" / Path(target).with_suffix(".py")  # by the gallery
        assert "://" in target or (page.parent / target).exists() or made.exists(), target
    for name in NAME.findall(text) if page.name != "CHANGELOG.md" else ():  # it tells what was
        assert resolve(name) is not None
    for block in blocks(page, "toml"):
        assert tomllib.loads(block)


def forces(wave: np.ndarray, model: rid.Model) -> np.ndarray:
    """Return different forces on every input, shape (sample, input)."""
    return wave[:, None] * np.array([0.5, 1.0, 1.0, -0.5])[: len(model.inputs)]


def simulated(name: str) -> rid.Record:
    """Return a record as the pages assume it: 5 kHz, 8400 rpm, odd harmonics of 20 Hz."""
    model = rid.load_model(name)
    angle = 2 * np.pi * np.outer(np.arange(250) / 250, [1, 3, 5, 7, 9, 11])
    wave = 10 * (np.sin(angle) + np.cos(angle)).sum(axis=1)
    noise = dict.fromkeys(model.inputs, 0.1) | dict.fromkeys(model.coordinates, 1e-8)
    when = {"sample_rate": 5000.0, "periods": 40, "speed": 2 * np.pi * 140}
    values, rng = model.values(model.nominal), np.random.default_rng(7)
    return rid.simulate(model, values, forces(wave, model), noise=noise, rng=rng, **when)


def commanded(force: np.ndarray, rate: float, delay: float) -> np.ndarray:
    """Return what a converter holds for a sample, logged so much late."""
    omega = 2 * np.pi * np.fft.rfftfreq(len(force), 1 / rate)
    half = omega / (2 * rate)
    held = np.sinc(half / np.pi) * np.exp(-1j * half)
    late = np.exp(-1j * omega * delay)
    return np.fft.irfft(np.fft.rfft(force) / held * late, len(force))


def logged(record: rid.Record, name: str, channel: dict[str, str]) -> np.ndarray:
    """Return the column of a channel, before what the channel says that is done to it."""
    if "hold" not in channel:
        return record.column(name)
    return commanded(record.column(name), record.sample_rate, quantity(channel["delay"], "s"))


def write(record: rid.Record, path: Path, channels: dict[str, dict[str, str]]) -> None:
    """Write a record as a logger would, each channel under a column's name and in its unit."""
    table = {
        each["column"]: logged(record, name, each) / si_factor(each["unit"])
        for name, each in channels.items()
    }
    if path.suffix == ".csv":
        write_table(path, ",".join(table), *table.values(), fmt="%.12g")
    else:
        with h5py.File(path, "w") as file:
            for column, samples in table.items():
                file[column] = samples


SHOWN = {"README.md": "m2", "maximum-likelihood.md": "L1, I_t, I_p, L2, mu, eta scale together"}
"""What the Python of a page prints."""
WITH_PYTHON = [page for page in MANUAL if blocks(page, "python")]


SCRIPT = re.compile(r"([^\n]*)\n\n```\{python\}\n((?:^:.*\n)*)(.*?)^```", re.MULTILINE | re.DOTALL)


def borrowed(code: str) -> set[str]:
    """Return the names that a script reads and nothing in it makes."""
    read, made = set[str](), set(dir(builtins))
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Name):
            (read if isinstance(node.ctx, ast.Load) else made).add(node.id)
        elif isinstance(node, ast.arg):
            made.add(node.arg)
        elif isinstance(node, ast.FunctionDef):
            made.add(node.name)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            made |= {(each.asname or each.name).partition(".")[0] for each in node.names}
    return read - made


def test_a_script_of_a_page_is_a_file_of_its_own():
    """Unless the line before it says that it goes on with the last one."""
    found = [
        (page.name, said, borrowed(code))
        for page in MANUAL
        for said, _, code in SCRIPT.findall(page.read_text(encoding="utf-8"))
    ]
    assert len(found) > 10
    assert [each for each in found if each[2] and "the script continued" not in each[1]] == []


@pytest.mark.slow
@pytest.mark.parametrize("page", WITH_PYTHON, ids=lambda page: page.name)
def test_python_of_every_page_runs(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "page"}
    for code in blocks(page, "python"):
        exec(compile(code, page.name, "exec"), names)
    assert SHOWN.get(page.name, "") in capsys.readouterr().out
    if page.name == "README.md":
        assert len([line for line in code.splitlines() if line]) <= 10
        assert rid.load_estimate("run.json").value("m2") == pytest.approx(11.322, rel=0.01)


@pytest.mark.parametrize(
    ("page", "file"), [("README.md", "run7.csv"), ("docs/experiments.md", "run-140hz.h5")]
)
def test_experiment_files_of_the_pages_identify(page, file, tmp_path):
    (text,) = (t for t in blocks(ROOT / page, "toml") if "[[records]]" in t and "model =" in t)
    name = tomllib.loads(text)["model"]
    write(simulated(name), tmp_path / file, tomllib.loads(text)["channels"])
    assert load(tmp_path, text).identify().status == "ok"


@pytest.mark.slow
def test_rig_file_of_the_page_runs():
    (text,) = blocks(ROOT / "docs" / "rig.md", "toml")
    plan = parse_rig(text.replace('"13 s"', '"50 ms"'))
    assert plan.run().names == ("F_x1", "F_y1", "F_x3", "F_y3", "x1", "y1", "s3", "y3")
    assert plan.seed == 1


def test_model_of_the_page_is_one():
    (text,) = blocks(ROOT / "docs" / "models.md", "toml")
    assert rid.parse_model(text).base.names == ("m", "k", "Fc")


def test_limits_of_the_models_page_are_those_of_the_code():
    text = " ".join((ROOT / "docs" / "models.md").read_text(encoding="utf-8").split())
    for limit in (f"{MAX_NESTING} levels", f"degree {MAX_DEGREE}", f"{MAX_TERMS:,} terms"):
        assert limit in text


def test_experiment_file_of_the_maximum_likelihood_page_is_one(tmp_path):
    (text,) = blocks(ROOT / "docs" / "maximum-likelihood.md", "toml")
    estimator = load(tmp_path, text).estimator()
    assert estimator.gains == ("ki", "ks")
    assert estimator.runout


def test_the_drawing_is_that_of_its_script_and_of_the_models():
    """Signs of the drawing: those of the equations of the shipped models and rigs."""
    shown = script("make_drawing").drawing()
    assert shown == (ROOT / "docs" / "images" / "coordinates.svg").read_text(encoding="utf-8")
    assert "x_a = x - L_a θ_y,  y_a = y + L_a θ_x" in shown
    assert "F_x = k_i i + k_s x" in shown
    rigid = rid.load_model("rigid")
    work = rigid.require_linear().matrices(rigid.values(rigid.nominal)).B
    length = rigid.nominal["L_a"]
    # The displacement that does work with F_xa and F_ya, over x, y, theta_x, theta_y.
    assert work[:, 0].tolist() == [1.0, 0.0, 0.0, -length]
    assert work[:, 1].tolist() == [0.0, 1.0, length, 0.0]
    # Rotation from x to y: what lies along x at phi = 0 lies along y a quarter turn later.
    loads = rigid.require_linear().load_columns([0.0, 0.0], [0.0, np.pi / 2], 1.0)
    along = loads @ rigid.monomial_values(rigid.values({**rigid.nominal, "zeta": 0.0}))
    assert along[0, 0] > 0
    assert along[1, 1] == pytest.approx(along[0, 0])
    law = Linear(120.0, 2e5)
    assert law.force(np.array([1.0]), np.array([0.0]))[0] > 0
    assert law.force(np.array([0.0]), np.array([1e-6]))[0] > 0


# Commands: of the pages, and of the help of each.


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


def commands() -> list[str]:
    """Return every command line that a page shows: in blocks, indented, and within sentences."""
    found = []
    for page in MANUAL:
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
    order = (*order, "export", "models", "new", "sensitivity", "schema", "study")
    assert {*order, "demo"} == {*cli.cli.commands}  # that of demo runs in test_cli
    texts = [str(cli.cli.commands[name].epilog) for name in order]
    return [shlex.split(text.partition("rotorid ")[2]) for text in texts]


@pytest.mark.slow
def test_the_example_of_every_help_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(5)
    r = rng.standard_normal((10_000, 2))
    e = 1.4 * r + 0.1 * rng.standard_normal(r.shape)
    other = rng.standard_normal(r.shape)
    write_table("sweep.csv", "e1,e2,r1,r2,x,y", e, r, other)
    write_table("run.csv", "a,b,c,d,x,y", e, r, other)
    Path("loop.toml").write_text(SWEEP)
    Path("study.toml").write_text('rig = "three-mass"\nvary.duration = "1 s"')
    for arguments in examples():
        if arguments[0] == "validate":
            shutil.copy("run.toml", arguments[2])
        if arguments[0] == "new":
            arguments[-1] = "draft.toml"  # which is not to take the place of what others read
        assert cli.run(arguments) == 0, arguments


def test_the_files_of_a_page_are_made_by_one_command(tmp_path, monkeypatch, capsys):
    """The draft of them opens; they are written again, but not over a file that was edited."""
    monkeypatch.chdir(tmp_path)
    assert cli.run(["simulate", "--example", "your-rig"]) == 0
    assert cli.run(["new", "run7.csv", "--model", "three-mass", "--out", "run7.toml"]) == 0
    assert "wrote run7.toml: 9 things open" in capsys.readouterr().out
    assert cli.run(["simulate", "--example", "your-rig", "--quiet"]) == 0
    with open("run7.csv", "a") as file:
        file.write("\n")
    assert cli.run(["simulate", "--example", "your-rig"]) == 2
    assert "did not write, or that was edited" in capsys.readouterr().err


@pytest.mark.parametrize("page", EXAMPLES)
def test_every_page_with_files_says_what_makes_them(page):
    text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    assert f"```{{run}}\nrotorid simulate --example {page}\n```" in text
    _, *after = text.partition(f"--example {page}")
    assert all(name in "".join(after) for name in example_files(page))
    (option,) = (o for o in cli.cli.commands["simulate"].params if o.name == "example")
    assert tuple(option.type.choices) == EXAMPLES
