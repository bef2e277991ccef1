"""Which decision constants does no fast test hold?

    python tests/mutants.py [MODULE ...]      such as rotorid.core.units; all without it

Every number in a module's upper-case constants is changed by itself (x 1.5 and x 0.5; a flag is
turned over), and the fast tests that cover the module are run on a copy of the sources. A constant
with a change that no test notices is printed: a decision that anyone could alter unseen. Takes
about half a minute for each constant, so it is run over what has changed, not in CI.
"""

import argparse
import ast
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src"
# Constants that decide nothing about a result, by module: what a picture looks like, how much of
# a long text a message shows, and data (printed figures, units, codes of other programs).
LEFT_OUT = {
    "rotorid.report": {"*"},
    "rotorid.models.polynomials": {"*"},  # beyond them the algebra does the same, but slower
    "rotorid.commands": {"INTERRUPTED"},  # a shell's own number
    "rotorid.commands.files": {"NOISE"},  # starts a generator: one start is as good as another
    "rotorid.demo": {"*"},  # conditions of the paper's example: test_demo pins them
}


@dataclass(frozen=True)
class Mutant:
    """One number of one constant, changed."""

    module: str
    constant: str
    line: int
    column: int
    end: int
    old: str
    new: str

    def __str__(self) -> str:
        return f"{self.module}.{self.constant} (line {self.line}): {self.old} -> {self.new}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("modules", nargs="*", default=["rotorid"])
    parser.add_argument("--list", action="store_true", help="show the mutants, run nothing")
    options = parser.parse_args()
    mutants = [m for name in options.modules for m in mutants_of(name)]
    if options.list:
        print(*mutants, sep="\n")
        return 0
    survivors = []
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "src"
        shutil.copytree(SOURCE, copy)
        for mutant in mutants:
            killed = is_killed(mutant, copy)
            print(f"{'killed  ' if killed else 'SURVIVED'} {mutant}", flush=True)
            survivors += [] if killed else [mutant]
    print(f"{len(survivors)} of {len(mutants)} survived")
    return int(bool(survivors))


def mutants_of(name: str) -> Iterator[Mutant]:
    """Yield every mutant of a module, or of a package and all in it."""
    place = SOURCE / Path(*name.split("."))
    paths = sorted(place.rglob("*.py")) if place.is_dir() else [place.with_suffix(".py")]
    for path in paths:
        parts = path.relative_to(SOURCE).with_suffix("").parts
        module = ".".join(part for part in parts if part != "__init__")
        left_out = {
            constant
            for prefix, constants in LEFT_OUT.items()
            if (module + ".").startswith(prefix + ".")
            for constant in constants
        }
        for constant, value in constants_of(path):
            if not {"*", constant} & left_out:
                yield from changes(module, constant, value)


def constants_of(path: Path) -> Iterator[tuple[str, ast.expr]]:
    """Yield the upper-case names that a module binds at its top, with what they are bound to."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        targets = node.targets if isinstance(node, ast.Assign) else []
        if isinstance(node, ast.AnnAssign) and node.value is not None:
            targets = [node.target]
        for target in targets:
            if isinstance(target, ast.Name) and target.id.strip("_").isupper():
                yield target.id, node.value  # type: ignore[union-attr, misc]


def changes(module: str, constant: str, value: ast.expr) -> Iterator[Mutant]:
    """Yield a mutant for each number in a constant and each way to change it."""
    nodes = list(ast.walk(value))
    if any(isinstance(node, ast.Lambda) for node in nodes):  # a table of functions, no decision
        return
    for node in nodes:
        if not isinstance(node, ast.Constant) or not isinstance(node.value, int | float | bool):
            continue
        for new in changed(node.value):
            yield Mutant(
                module,
                constant,
                node.lineno,
                node.col_offset,
                node.end_col_offset or node.col_offset,
                ast.unparse(node),
                repr(new),
            )


def changed(number: float | bool) -> list[float | int | bool]:
    """Return a number half as large again and half as large; a small whole one, by one."""
    if isinstance(number, bool):
        return [not number]
    if isinstance(number, int) and abs(number) < 4:
        return [number + 1, number - 1]
    if number == 0:  # half of it is the same
        return [1.0]
    more, less = 1.5 * number, 0.5 * number
    return [round(more), round(less)] if isinstance(number, int) else [more, less]


def is_killed(mutant: Mutant, copy: Path) -> bool:
    """Say whether the fast tests of a module fail with a mutant."""
    path = copy / Path(*mutant.module.split("."))
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines(keepends=True)
    row = lines[mutant.line - 1].encode()  # ast counts bytes
    lines[mutant.line - 1] = (
        row[: mutant.column] + mutant.new.encode() + row[mutant.end :]
    ).decode()
    path.write_text("".join(lines), encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-qx", "-m", "not slow", "-p", "no:cacheprovider"]
    try:
        done = subprocess.run(
            [*command, *tests_of(mutant.module)],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(copy)},
            capture_output=True,
            timeout=1200,
        )
    except subprocess.TimeoutExpired:
        return True  # noticed: it never ends
    finally:
        path.write_text(text, encoding="utf-8")
    if done.returncode > 1:  # no test was run: that kills nothing
        print(done.stdout.decode()[-2000:], file=sys.stderr)
        raise SystemExit(f"pytest ended with {done.returncode} on {mutant}")
    return done.returncode == 1


def tests_of(module: str) -> list[str]:
    """Return the fast tests of a module: its own or its folder's, and those that name it."""
    parts = module.split(".")[1:]
    needles = {module, f"from {'.'.join(['rotorid', *parts[:-1]])} import {parts[-1]}"}
    named = [
        str(path.relative_to(ROOT))
        for path in sorted((ROOT / "tests").rglob("test_*.py"))
        if any(needle in path.read_text(encoding="utf-8") for needle in needles)
    ]
    for depth in range(len(parts), 0, -1):
        inside = Path("tests", *parts[:depth])
        own = inside.with_name(f"test_{inside.name}.py")
        found = [str(p) for p in (inside, own) if (ROOT / p).exists()]
        if found:
            return [*dict.fromkeys([*found, *named])]  # the module's own first: they end sooner
    return named or ["tests"]


if __name__ == "__main__":
    sys.exit(main())
