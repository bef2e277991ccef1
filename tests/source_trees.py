"""The source of the package as trees, parsed once for all tests; and scripts of its pages."""

import ast
import importlib.util
import sys
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import rotorid

SOURCE = Path(rotorid.__file__).parent
FILES = sorted(SOURCE.rglob("*.py"))
DOCS = Path(__file__).parents[1] / "docs"


def script(name: str) -> ModuleType:
    """Return a script that makes a part of the documentation, as a module."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


@cache
def _nodes() -> dict[type, list[tuple[str, Any]]]:
    found = defaultdict(list)
    for path in FILES:
        name = path.relative_to(SOURCE).as_posix()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            found[type(node)].append((name, node))
    return found


def nodes(*kinds: type[ast.AST]) -> Iterator[tuple[str, Any]]:
    """Yield every node of some kinds, and the file in which it stands."""
    return (found for kind in kinds for found in _nodes()[kind])
