"""What the source comes to, in figures: `make census`.

Lines and modules by package, modules that a single other one imports, class names that mean several
things, and tests that look inside.
"""

from __future__ import annotations

import ast
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "rotorid"
FACE = {"rotorid", "rotorid.testing", "rotorid.cli"}  # the package, its machines, the command


def name_of(file: Path) -> str:
    """Return the name by which a module is imported."""
    parts = file.relative_to(SOURCE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(tree: ast.AST, known: set[str]) -> Iterator[str]:
    """Yield the modules of the package that a file imports."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module:
            within = [f"{node.module}.{alias.name}" for alias in node.names]
            inner = [name for name in within if name in known]
            yield from inner
            if len(inner) < len(within) and node.module in known:
                yield node.module


def main() -> None:
    """Print the figures."""
    files = sorted((*SOURCE.rglob("*.py"), *SOURCE.rglob("*.pyi")))
    lines, modules = Counter[str](), Counter[str]()
    trees = {file: ast.parse(file.read_text(encoding="utf-8")) for file in files}
    for file in files:
        inside = file.relative_to(SOURCE).parts
        package = inside[0] if len(inside) > 1 else "rotorid"
        lines[package] += len(file.read_text(encoding="utf-8").splitlines())
        modules[package] += 1
    for package, count in lines.most_common():
        print(f"{package:12} {count:7} lines {modules[package]:4} modules")
    print(f"{'source':12} {lines.total():7} lines {modules.total():4} modules")
    tests = sorted((ROOT / "tests").rglob("*.py"))
    print(f"{'tests':12} {sum(len(t.read_text().splitlines()) for t in tests):7} lines")

    known = {name_of(file) for file in files}
    importers = defaultdict[str, set[str]](set)
    for file, tree in trees.items():
        for name in imported(tree, known):
            importers[name].add(name_of(file))
    alone = [name for name in known if len(importers[name] - {name}) == 1]
    print(f"modules that one other imports: {len(alone)}")

    classes = Counter(
        node.name
        for tree in trees.values()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    print(f"class names of several classes: {sum(n > 1 for n in classes.values())}")
    inner = [
        test
        for test in tests
        if set(imported(ast.parse(test.read_text(encoding="utf-8")), known)) - FACE
    ]
    print(f"test files that import internals: {len(inner)} of {len(tests)}")


if __name__ == "__main__":
    main()
