"""The direction of imports: file or rig -> record -> model and estimator -> estimate -> report."""

import ast
import re
from functools import cache
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "src" / "rotorid"
MODULES = sorted(SOURCE.rglob("*.py"))

# Parts of the package, each with the parts that it must not import. A part is a subpackage, or a
# module at the top.
FORBIDDEN = {
    "frozen": {"*"},
    "screen": {"*"},
    "limits": {"*"},
    "errors": {"*", "!screen"},
    "files": {"*", "!errors"},
    "writing": {"*", "!errors"},
    "unit_text": {"*"},
    "units": {"*", "!errors", "!unit_text"},
    "toml": {"*", "!errors", "!files", "!limits"},
    "record": {"*", "!errors", "!values", "!plots", "!dynamics", "!steady", "!units"},
    "dynamics": {"*", "!errors", "!values"},
    "values": {"*"},
    "steady": {"*"},
    "evidence": {"*"},
    "distributions": {"*", "!record"},
    "tables": {"*", "!screen"},
    "plots": {"*", "!errors"},
    "estimate_parts": {"*", "!errors", "!evidence", "!record", "!values"},
    "estimate_page": {"*", "!estimate_parts", "!tables"},
    "estimate": {
        "*",
        "!errors",
        "!estimate_page",
        "!estimate_parts",
        "!tables",
        "!plots",
        "!writing",
    },
    "result_file": {"*", "!errors", "!estimate", "!files", "!limits"},
    "signals": {"models", "estimators", "rig", "io", "experiment", "report", "cli"},
    "models": {"estimators", "estimate", "estimate_parts", "identify", "rig", "io", "experiment"},
    "actuators": {
        "models",
        "estimators",
        "estimate",
        "estimate_parts",
        "identify",
        "io",
        "experiment",
        "report",
    },
    "estimators": {"io", "experiment", "report", "cli", "rig", "identify"},
    "identify": {"io", "experiment", "report", "cli", "rig"},
    "predict": {"io", "experiment", "report", "cli", "rig"},
    "lines": {"*", "!errors", "!record", "!signals", "!steady", "!values"},
    "spectra": {"*", "!errors", "!record", "!signals", "!lines", "!units"},
    "filtered": {"*", "!errors", "!record", "!signals", "!units", "!values"},
    "linalg": {"*", "!errors", "!record"},
    "observation": {
        "*",
        "!errors",
        "!record",
        "!signals",
        "!lines",
        "!linalg",
        "!models",
        "!filtered",
        "!through_laws",
    },
    "through_laws": {"*", "!record", "!lines"},
    "rig": {"estimators", "estimate", "estimate_parts", "identify", "predict", "report", "cli"},
    "demo": {"io", "experiment", "report", "cli"},
    "io": {
        "models",
        "estimators",
        "estimate",
        "estimate_parts",
        "identify",
        "experiment",
        "report",
        "cli",
    },
    "report": {"io", "experiment", "commands", "cli"},
    "results": {"io", "experiment", "commands", "report", "cli"},
    "commands": {"cli"},
    "cli": {"*", "!errors", "!commands", "!screen"},
    "experiment": {"report", "commands", "cli"},
}

# What every part may import: the decorator of its values.
EVERYWHERE = {"frozen"}

# Packages from outside that only some parts may import.
CONFINED = {
    "matplotlib": {"plots", "report", "estimate", "record"},
    "jinja2": {"report"},
    "plotly": {"report"},
    "h5py": {"io", "rig"},
    "pint": {"unit_text"},
    "click": {"cli", "commands"},
    "rich": {"commands"},
    "lark": {"models"},
    "tomlkit": {"rig", "experiment"},
}


def name_of(path: Path) -> str:
    """Return the dotted name of a module inside the package; "" is the package itself."""
    parts = path.relative_to(SOURCE).with_suffix("").parts
    return ".".join(part for part in parts if part != "__init__")


def part_of(module: str) -> str:
    return module.split(".")[0]


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def imports(path: Path) -> set[str]:
    """Return every dotted name that a module imports: inside functions, and for types only, too."""
    found: set[str] = set()
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import; write the full name"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def inner(path: Path) -> set[str]:
    """Return the parts of the package that a module imports, other than its own."""
    names = {name.removeprefix("rotorid.") for name in imports(path) if name.startswith("rotorid.")}
    return {part_of(name) for name in names} - {part_of(name_of(path)), "__version__"}


def label(path: Path) -> str:
    return name_of(path) or "rotorid"


def calls(path: Path) -> set[str]:
    """Return what a module calls, as it is written."""
    nodes = ast.walk(tree_of(path))
    return {ast.unparse(node.func) for node in nodes if isinstance(node, ast.Call)}


def test_imports_run_one_way() -> None:
    strayed = {}
    for path in MODULES:
        rule = FORBIDDEN.get(part_of(name_of(path)), set())
        allowed = {name[1:] for name in rule if name.startswith("!")}
        used = inner(path) - EVERYWHERE
        strayed[label(path)] = used - allowed if "*" in rule else used & rule
    assert not {name: parts for name, parts in strayed.items() if parts}


def test_outside_packages_stay_in_their_place() -> None:
    strayed = {}
    for path in MODULES:
        used = {name.split(".")[0] for name in imports(path)} & CONFINED.keys()
        part = part_of(name_of(path))
        strayed[label(path)] = {name for name in used if part not in CONFINED[name]}
    assert not {name: packages for name, packages in strayed.items() if packages}


def test_h5py_is_imported_by_single_modules() -> None:
    """One reader and one writer: a format's package is known to its own module only."""
    users = [path for path in MODULES if any(name.startswith("h5py") for name in imports(path))]
    parts = {label(path).partition("_")[0] for path in users}
    assert parts == {"io.hdf5", "rig.export"}, [label(path) for path in users]


def test_nothing_imports_the_command_line() -> None:
    assert {label(path) for path in MODULES if "cli" in inner(path)} <= {"__main__"}


def test_parts_form_no_cycle() -> None:
    graph: dict[str, set[str]] = {}
    for path in MODULES:
        if part := part_of(name_of(path)):  # the package itself only collects names
            graph.setdefault(part, set()).update(inner(path))
    assert not cyclic(graph)


def test_modules_form_no_cycle() -> None:
    names = {name_of(path): path for path in MODULES}
    graph: dict[str, set[str]] = {}
    for name, path in names.items():
        dotted = [i.removeprefix("rotorid.") for i in imports(path) if i.startswith("rotorid.")]
        found = {part for i in dotted for part in (i, i.rpartition(".")[0]) if part in names}
        if not path.name.startswith("__init__"):  # packages only collect names
            graph[name] = {part for part in found if not names[part].name.startswith("__init__")}
    assert not cyclic(graph)


def cyclic(graph: dict[str, set[str]]) -> set[str]:
    """Return the nodes from which a way leads back to themselves."""
    return {node for node in graph if node in reached(graph, node)}


def reached(graph: dict[str, set[str]], start: str) -> set[str]:
    found: set[str] = set()
    ahead = [start]
    while ahead:
        new = graph.get(ahead.pop(), set()) - found
        found |= new
        ahead += new
    return found


def test_only_users_import_the_package_itself() -> None:
    """`import rotorid` is for users; modules name the module that they need."""
    users = {label(path) for path in MODULES if name_of(path) and "rotorid" in imports(path)}
    assert not users


def test_library_never_prints() -> None:
    library = [path for path in MODULES if part_of(name_of(path)) not in ("cli", "commands")]
    assert not {label(path) for path in library if "print" in calls(path)}


def test_text_is_never_evaluated() -> None:
    """Equations come from files: they are parsed by a grammar."""
    evaluating = {"eval", "exec", "compile", "__import__", "sympify", "sp.sympify", "sympy.sympify"}
    found = {label(path): calls(path) & evaluating for path in MODULES}
    assert not {name: used for name, used in found.items() if used}


def test_randomness_comes_from_generators() -> None:
    pattern = re.compile(r"np\.random\.(?!Generator|default_rng|SeedSequence|BitGenerator)\w+")
    found = {label(path): pattern.findall(path.read_text("utf-8")) for path in MODULES}
    assert not {name: used for name, used in found.items() if used}
