"""The direction of imports: file or rig -> record -> model and estimator -> estimate -> report."""

import ast
import os
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter

import pytest
from source_trees import nodes
from working_folder import make

import rotorid as rid

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
    ("studies",),
    ("demo",),
    ("commands",),
    ("cli",),
    ("__main__",),
)

# What shows itself asks for its picture, or a model for ROSS, when that is called, not before.
SHOWN_LATE = {"core.values", "data.record", "answer.estimate", "models.rotor.rotor_model"}

# Packages from outside that only some parts may import.
CONFINED = {
    "matplotlib": {"report", "core", "demo"},
    "jinja2": {"report"},
    "plotly": {"report"},
    "h5py": {"io", "rig"},
    "pint": set(),
    "control": {"results"},
    "click": {"cli", "commands"},
    "rich": {"commands"},
    "tomlkit": {"core", "rig", "experiment", "studies"},
    "pyarrow": {"io", "studies"},
    "distributed": {"studies"},
}


def name_of(file: str) -> str:
    """Return the dotted name of a module inside the package; "" is the package itself."""
    return ".".join(part for part in file.removesuffix(".py").split("/") if part != "__init__")


@cache
def imports(*, late: bool = True) -> dict[str, set[str]]:
    """Return the dotted names that each module imports, for types only too.

    Without `late` what shows itself is left with what it asks for at import.
    """
    shown = (f for file, f in nodes(ast.FunctionDef) if name_of(file) in SHOWN_LATE)
    inside = set() if late else {node for function in shown for node in ast.walk(function)}
    found: dict[str, set[str]] = {name_of(file): set() for file, _ in nodes(ast.Module)}
    for file, node in nodes(ast.Import, ast.ImportFrom):
        if node in inside:
            continue
        start = ""
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import; write the full name"
            start = f"{node.module}."
        found[name_of(file)] |= {start + alias.name for alias in node.names}
    return found


@cache
def inner() -> dict[str, set[str]]:
    """Return the modules of the package on which each rests."""
    every = imports(late=False)
    return {
        module: {
            name if name in every else name.rpartition(".")[0]
            for name in (
                name.removeprefix("rotorid.") for name in used if name.startswith("rotorid.")
            )
        }
        for module, used in every.items()
    }


@cache
def layer(module: str) -> int:
    """Return the place of a module among the layers: that of its longest prefix listed."""
    prefixes = {name: n for n, names in enumerate(LAYERS) for name in names}
    parts = module.split(".")
    known = [".".join(parts[:k]) for k in range(len(parts), 0, -1)]
    return next((prefixes[name] for name in known if name in prefixes), -1)


def test_every_module_stands_in_a_layer():
    assert not {name for name in imports() if name and layer(name) < 0}


def test_imports_run_one_way():
    assert not {
        (name, other)
        for name, used in inner().items()
        for other in used
        if layer(other) > layer(name) >= 0
    }


def test_outside_packages_stay_in_their_place():
    """h5py: one reader and one writer; a format's package is known to its own module only."""
    used = {(name, other.split(".")[0]) for name, names in imports().items() for other in names}
    assert not {
        (name, package)
        for name, package in used
        if package in CONFINED and name.split(".")[0] not in CONFINED[package]
    }
    users = {name.partition("_")[0] for name, package in used if package == "h5py"}
    assert users == {"io.hdf5", "rig.files"}


def test_modules_form_no_cycle():
    """Packages are left out: they only collect names."""
    packages = {name_of(file) for file, _ in nodes(ast.Module) if file.endswith("__init__.py")}
    graph = {name: used - packages for name, used in inner().items() if name not in packages}
    TopologicalSorter(graph).prepare()


@pytest.mark.slow
def test_only_users_import_the_package_itself():
    """`import rotorid` is for users; modules name the module that they need."""
    assert not {name for name, used in imports().items() if name and "rotorid" in used}


def test_text_is_never_evaluated():
    """Equations come from files: they are read to a tree."""
    evaluating = {"eval", "exec", "compile", "__import__"}
    called = ((file, node.func) for file, node in nodes(ast.Call))
    assert not [f for f, func in called if isinstance(func, ast.Name) and func.id in evaluating]


# What begins quickly loads nothing that it does not need.


HEAVY = {
    *("h5py", "jinja2", "matplotlib", "numba", "numpy", "pandas", "pint", "plotly", "pydantic"),
    *("rich", "scipy", "sympy"),
}
COMPLETION = {"_ROTORID_COMPLETE": "bash_complete", "COMP_WORDS": "rotorid id", "COMP_CWORD": "1"}


def modules(code: str, environment: dict[str, str] | None = None) -> tuple[set[str], str]:
    """Return the modules that a process has loaded when it ends, and what it printed."""
    told = (
        f"import atexit, sys; atexit.register(lambda: print(*sys.modules, file=sys.stderr)); {code}"
    )
    command, env = [sys.executable, "-c", told], {**os.environ, **(environment or {})}
    process = subprocess.run(command, env=env, capture_output=True, text=True, check=True)
    return set(process.stderr.split()), process.stdout


@pytest.mark.parametrize(
    ("code", "environment", "printed"),
    [
        ("import rotorid", {}, ""),
        ("from rotorid.cli import run; run(['--help'])", {}, "identify"),
        ("from rotorid.cli import run; run(['simulate', '-h'])", {}, "RIG"),
        ("from rotorid.cli import run; print(run([]))", COMPLETION, "plain,identify\n0\n"),
    ],
)
def test_what_is_not_needed_is_not_loaded(code, environment, printed):
    names, out = modules(code, environment)
    packages = {name.partition(".")[0] for name in names}
    assert "rotorid" in packages
    assert not packages & HEAVY
    assert printed in out


@pytest.mark.slow
def test_identify_loads_what_a_batch_of_a_shipped_model_needs(tmp_path):
    """No algebra, no formats but the file's own, no other method, no pictures."""
    path = make(tmp_path) / "run.toml"
    names, out = modules(f"from rotorid.cli import run; run(['identify', {str(path)!r}])")
    assert "jeffcott, batch" in out
    packages = {name.partition(".")[0] for name in names}
    assert not packages & (HEAVY - {"numpy", "pydantic", "scipy"})
    parts = ("linalg", "sparse", "special", "stats", "signal", "optimize", "interpolate", "ndimage")
    slow = {"numpy.ma", *(f"scipy.{part}" for part in parts)}
    slow -= modules("import numpy")[0]  # numpy 1 loads its masked arrays by itself
    ours = {"likelihood.estimator", "models.rotor", "rig"}
    tables = {"experiment.table_records"}
    assert names & {*slow, *(f"rotorid.{name}" for name in ours | tables)} == set()


def test_public_names_are_there_and_listed():
    for name in rid.__all__:
        assert getattr(rid, name) is not None
    assert set(rid.__all__) <= set(dir(rid))
    assert rid.__version__
    with pytest.raises(AttributeError, match="nothing"):
        _ = rid.nothing
