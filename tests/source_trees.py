"""The source of the package as trees, parsed once for all tests that look at it."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import rotorid

SOURCE = Path(rotorid.__file__).parent
FILES = sorted(SOURCE.rglob("*.py"))


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def _every_node() -> list[tuple[str, ast.AST]]:
    names = {path: path.relative_to(SOURCE).as_posix() for path in FILES}
    return [(name, node) for path, name in names.items() for node in ast.walk(tree_of(path))]


def nodes(kind: type[ast.AST]) -> Iterator[tuple[str, Any]]:
    """Yield every node of a kind, and the file in which it stands."""
    return ((file, node) for file, node in _every_node() if isinstance(node, kind))
