"""The direction of imports: file or rig -> record -> model and estimator -> estimate -> report."""

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from source_trees import FILES as MODULES
from source_trees import SOURCE, tree_of

# The order in which parts build on one another: a module imports from its own part and from those
# above it in this list. A part is a package, or a module where a package spans several.
LAYERS = (
    ("core",),
    ("force.channel_dynamics", "force.laws"),
    ("data.record",),
    ("force",),
    ("signals",),
    ("data",),
    ("signals.inspection",),
    ("models",),
    ("force.reading",),
    ("data.observation",),
    ("models.knowledge",),
    ("answer",),
    ("linear",),
    ("likelihood",),
    ("answer.identify", "answer.predict"),
    ("results",),
    ("rig",),
    ("io",),
    ("testing",),
    ("experiment",),
    ("report",),
    ("demo",),
    ("commands",),
    ("cli",),
    ("__main__",),
)

# What shows itself asks for its picture, or a model for ROSS, when that is called, not before.
SHOWN_LATE = {"data.record", "data.lines", "answer.estimate", "models.rotor.rotor_model"}

# Packages from outside that only some parts may import.
CONFINED = {
    "matplotlib": {"report", "answer", "data", "demo"},
    "jinja2": {"report"},
    "plotly": {"report"},
    "h5py": {"io", "rig"},
    "pint": set(),
    "control": {"results"},
    "click": {"cli", "commands"},
    "rich": {"commands"},
    "tomlkit": {"core", "rig", "experiment"},
}


def name_of(path: Path) -> str:
    """Return the dotted name of a module inside the package; "" is the package itself."""
    parts = path.relative_to(SOURCE).with_suffix("").parts
    return ".".join(part for part in parts if part != "__init__")


def part_of(module: str) -> str:
    return module.split(".")[0]


def imports(path: Path, *, late: bool = True) -> set[str]:
    """Return every dotted name that a module imports, for types only too; `late`: in functions."""
    found: set[str] = set()
    nodes = list(ast.walk(tree_of(path)))
    inside = {n for f in nodes if isinstance(f, ast.FunctionDef) for n in ast.walk(f)}
    for node in nodes:
        if node in inside and not late:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import; write the full name"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


@cache
def inner(path: Path) -> frozenset[str]:
    """Return the modules of the package on which a module rests; what shows itself, at import."""
    modules = {name_of(module) for module in MODULES}
    used = imports(path, late=name_of(path) not in SHOWN_LATE)
    names = {name.removeprefix("rotorid.") for name in used if name.startswith("rotorid.")}
    return frozenset(name if name in modules else name.rpartition(".")[0] for name in names)


def layer(module: str) -> int:
    """Return the place of a module among the layers: that of its longest prefix listed."""
    prefixes = {name: n for n, names in enumerate(LAYERS) for name in names}
    parts = module.split(".")
    known = [".".join(parts[:k]) for k in range(len(parts), 0, -1)]
    return next((prefixes[name] for name in known if name in prefixes), -1)


def label(path: Path) -> str:
    return name_of(path) or "rotorid"


def calls(path: Path) -> set[str]:
    nodes = ast.walk(tree_of(path))
    return {ast.unparse(node.func) for node in nodes if isinstance(node, ast.Call)}


def test_every_module_stands_in_a_layer():
    assert not {label(path) for path in MODULES if name_of(path) and layer(name_of(path)) < 0}


def test_imports_run_one_way():
    strayed = {}
    for path in MODULES:
        name = name_of(path)
        strayed[name] = {other for other in inner(path) if layer(other) > layer(name) >= 0}
    assert not {name: others for name, others in strayed.items() if others}


def test_outside_packages_stay_in_their_place():
    strayed = {}
    for path in MODULES:
        used = {name.split(".")[0] for name in imports(path)} & CONFINED.keys()
        part = part_of(name_of(path))
        strayed[label(path)] = {name for name in used if part not in CONFINED[name]}
    assert not {name: packages for name, packages in strayed.items() if packages}


def test_h5py_is_imported_by_single_modules():
    """One reader and one writer: a format's package is known to its own module only."""
    users = [path for path in MODULES if any(name.startswith("h5py") for name in imports(path))]
    parts = {label(path).partition("_")[0] for path in users}
    assert parts == {"io.hdf5", "rig.files"}, [label(path) for path in users]


def test_modules_form_no_cycle():
    """Packages are left out: they only collect names."""
    graph = {name_of(p): inner(p) for p in MODULES if not p.name.startswith("__init__")}
    TopologicalSorter({name: used & graph.keys() for name, used in graph.items()}).prepare()


@pytest.mark.slow
def test_only_users_import_the_package_itself():
    """`import rotorid` is for users; modules name the module that they need."""
    users = {label(path) for path in MODULES if name_of(path) and "rotorid" in imports(path)}
    assert not users


def test_text_is_never_evaluated():
    """Equations come from files: they are read to a tree."""
    evaluating = {"eval", "exec", "compile", "__import__"}
    found = {label(path): calls(path) & evaluating for path in MODULES}
    assert not {name: used for name, used in found.items() if used}
