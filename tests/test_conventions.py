"""Conventions of what users see: every public name is described, in full and truly."""

import ast
import inspect
import re
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import pytest
from source_trees import nodes

import rotorid as rid

ROOT = Path(__file__).parents[1]
PUBLIC = {name: getattr(rid, name) for name in rid.__all__}
FUNCTIONS = {name: found for name, found in PUBLIC.items() if inspect.isfunction(found)}
CLASSES = {name: found for name, found in PUBLIC.items() if inspect.isclass(found)}
SECTION = re.compile(r"^(?P<title>[A-Z][a-z]+(?: [A-Z]?[a-z]+)?)\n-+$", re.M)


def sections(found: Any) -> dict[str, str]:
    """Return the sections of a docstring in numpydoc's manner; "" is what comes first."""
    parts = SECTION.split(inspect.getdoc(found) or "")
    return {"": parts[0], **dict(zip(parts[1::2], parts[2::2], strict=True))}


def described(section: str) -> list[str]:
    """Return the names of the parameters that a section describes."""
    rows = re.findall(r"^(\*{0,2}\w[\w, *]*?)(?: :.*)?$", section, re.M)
    return [name.strip("* ") for row in rows for name in row.split(",") if name.strip()]


def parameters(found: Callable[..., Any]) -> list[str]:
    if is_dataclass(found):
        return [field.name for field in fields(found) if field.init]
    return [name for name in inspect.signature(found).parameters if name != "self"]


def methods() -> dict[str, Any]:
    """Return the public methods that the public classes define themselves."""
    return {
        f"{name}.{key}": value
        for name, found in CLASSES.items()
        for key, value in vars(found).items()
        if inspect.isfunction(value) and not key.startswith("_")
    }


def test_described_parameters_of_methods_exist():
    for name, found in methods().items():
        assert {*described(sections(found).get("Parameters", ""))} <= {*parameters(found)}, name


@pytest.mark.parametrize("name", sorted({**FUNCTIONS, **CLASSES}))
def test_every_parameter_is_documented_and_no_other(name):
    found = PUBLIC[name]
    told = {*described(sections(found).get("Parameters", ""))}
    row = is_dataclass(found) and len(fields(found)) <= 4  # its sentence and its fields say it
    like_its_parent = inspect.isclass(found) and "__init__" not in vars(found)
    if told or not (row or like_its_parent or getattr(found, "_is_protocol", False)):
        assert told == {*parameters(found)}


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_public_functions_are_documented_in_full(name):
    parts = sections(FUNCTIONS[name])
    assert len(parts[""].strip().splitlines()[0]) <= 100
    assert "Returns" in parts or inspect.signature(FUNCTIONS[name]).return_annotation == "None"
    assert parts.get("Raises", "").strip(), "what it raises"
    assert ">>> " in parts.get("Examples", ""), "an example that runs"


@pytest.mark.parametrize("name", rid.__all__)
def test_every_public_name_and_method_says_what_it_is(name):
    found = PUBLIC[name]
    if not callable(found):
        return
    own = (vars(found) if inspect.isclass(found) else {"__doc__": found.__doc__})["__doc__"]
    assert own, name
    assert not own.startswith(name + "("), "the signature that dataclasses write"
    for method, value in vars(found).items() if inspect.isclass(found) else ():
        value = getattr(value, "func", getattr(value, "__func__", value))  # cached, of the class
        if not method.startswith("_") and (
            inspect.isfunction(value) or isinstance(value, property)
        ):
            assert inspect.getdoc(value), f"{name}.{method}"


def test_the_reference_page_holds_every_public_name_and_no_other():
    text = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `rid\.(\w+)` \| (.*) \|$", text, re.M))
    first = {name: (inspect.getdoc(found) or "").splitlines()[0] for name, found in PUBLIC.items()}
    assert rows == {name: line.replace("|", "\\|") for name, line in first.items()}


def test_about_fifty_names_are_public():
    assert 35 <= len(rid.__all__) <= 61


def test_pages_that_are_named_are_shipped():
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("examples/**/*.md")]
    shipped = {page.name for page in pages}
    for source in [*ROOT.glob("src/**/*.py"), *ROOT.glob("src/**/*.toml")]:
        named = set(re.findall(r"[\w-]+\.md\b", source.read_text(encoding="utf-8")))
        assert named <= shipped, source.name


def test_the_map_is_right():
    """CONTRIBUTING names every part of the package, and nothing that is not there."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    source = ROOT / "src" / "rotorid"
    named = re.findall(r"`(?:src/rotorid/)?([\w/]+(?:\.pyi?|/))`", text)
    for name in named:
        assert any(place.exists() for place in (ROOT / name, source / name)), name
    parts = {path.name for path in source.iterdir() if path.is_dir() and path.name != "__pycache__"}
    parts |= {path.name for path in source.glob("*.py") if not path.name.startswith("__")}
    told = {name.rstrip("/") for name in named}
    assert not parts - told - {"demo"}


def test_what_a_newcomer_looks_for_is_found_in_one_search():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    table = text[text.index("Where is ...?") :].split("\n\n")[1]
    searches = re.findall(r"^\| .+ \| `(.+)` \|$", table, re.M)
    assert len(searches) >= 7
    paths = [*ROOT.glob("src/**/*.py"), *ROOT.glob("src/**/*.pyi")]
    sources = {path: path.read_text(encoding="utf-8") for path in paths}
    for search in searches:
        assert [p for p, text in sources.items() if search in text or search == p.name], search


SCREEN = 50
"""Lines of a function, but for its signature and docstring, that fit a screen."""

LONGER = {
    "rig.kernel.run": "compiled: in parts that pass its state on it takes twice the time",
}


def test_functions_fit_a_screen():
    found = {}
    for file, node in nodes(ast.FunctionDef):
        body = node.body[bool(ast.get_docstring(node)) and len(node.body) > 1 :]
        lines = (body[-1].end_lineno or 0) - body[0].lineno + 1
        if lines > SCREEN:
            found[f"{file.removesuffix('.py').replace('/', '.')}.{node.name}"] = lines
    assert found.keys() == LONGER.keys(), found


def test_a_class_name_means_one_thing():
    names = [node.name for _, node in nodes(ast.ClassDef) if not node.name.startswith("_")]
    assert len(set(names)) == len(names), {name for name in names if names.count(name) > 1}


def test_cures_say_what_to_do():
    """No message ends in "correct it": whoever could do that would have done it."""
    empty = re.compile(r"\bcorrect (?:it|its|them|the|this|what)\b")
    texts = ((file, node) for file, node in nodes(ast.Constant) if isinstance(node.value, str))
    assert not [f"{file}, {n.lineno}: {n.value}" for file, n in texts if empty.search(n.value)]
