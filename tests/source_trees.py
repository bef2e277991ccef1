"""The source of the package as trees, parsed once for all tests that look at it."""

import ast
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import rotorid

SOURCE = Path(rotorid.__file__).parent
FILES = sorted(SOURCE.rglob("*.py"))


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
