"""The size and structure of the source in figures, each beside its budget: `make census`."""

import ast
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "rotorid"
ESTIMATION = (  # what estimates, and what says whether the estimate can be a machine
    *("linear", "likelihood", "answer/derived", "answer/judge", "answer/machine_checks"),
    "models/knowledge",
)
FACE = {"rotorid", "rotorid.testing", "rotorid.cli"}  # the package, its machines, the command


def name_of(file: Path) -> str:
    parts = file.relative_to(SOURCE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(tree: ast.AST, known: set[str]) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module:
            within = [f"{node.module}.{alias.name}" for alias in node.names]
            inner = [name for name in within if name in known]
            yield from inner
            if len(inner) < len(within) and node.module in known:
                yield node.module


def packages(trees: Mapping[Path, ast.AST], lengths: Mapping[Path, int]) -> None:
    lines, modules = Counter[str](), Counter[str]()
    for file in trees:
        inside = file.relative_to(SOURCE).parts
        package = inside[0] if len(inside) > 1 else "rotorid"
        lines[package] += lengths[file]
        modules[package] += 1
    for package, count in lines.most_common():
        print(f"{package:12} {count:7} lines {modules[package]:4} modules")


def single_importers(trees: Mapping[Path, ast.AST], known: set[str]) -> int:
    importers = defaultdict[str, set[str]](set)
    for file, tree in trees.items():
        for name in imported(tree, known):
            importers[name].add(name_of(file))
    return sum(len(importers[name] - {name}) == 1 for name in known)


def repeated(names: Iterable[str]) -> int:
    return sum(count > 1 for count in Counter(names).values())


def main() -> None:
    files = sorted((*SOURCE.rglob("*.py"), *SOURCE.rglob("*.pyi")))
    tests = sorted((ROOT / "tests").rglob("*.py"))
    texts = {file: file.read_text(encoding="utf-8") for file in (*files, *tests)}
    lengths = {file: len(text.splitlines()) for file, text in texts.items()}
    trees = {file: ast.parse(texts[file]) for file in files}
    known = {name_of(file) for file in files}
    packages(trees, lengths)
    nodes = [node for tree in trees.values() for node in ast.walk(tree)]
    public = [n.name for n in nodes if isinstance(n, ast.ClassDef) and n.name[0] != "_"]
    stems = [file.stem for file in files if file.stem != "__init__"]
    estimating = [f for f in files if f.relative_to(SOURCE).as_posix().startswith(ESTIMATION)]
    inner = [t for t in tests if set(imported(ast.parse(texts[t]), known)) - FACE]
    rows = [
        ("lines of source", sum(lengths[file] for file in files), 42_000),
        ("lines that estimate", sum(lengths[f] for f in estimating), 12_500),
        ("modules that estimate", len(estimating), 55),
        ("modules", len(files), 165),
        ("lines of tests", sum(lengths[test] for test in tests), 30_000),
        ("modules with exactly one importer", single_importers(trees, known), 35),
        ("class names of several classes", repeated(public), 0),
        ("file names used twice", repeated(stems), 5),
        (f"test files that import internals, of {len(tests)}", len(inner), 60),
    ]
    for what, count, budget in rows:
        print(f"{what:45} {count:7} (budget {budget})")


if __name__ == "__main__":
    main()
