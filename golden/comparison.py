"""Two results of a case held against each other, and many differences told in few lines."""

from __future__ import annotations

import difflib
import json
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

KINDS = ("status", "fields", "values", "wording")
STATUS = {"code", "status", "verdict", "skipped", "died"}
LABELS = ("name", "term", "check", "plane", "source")
"""What a row of a list is called by: the first of these keys that it has."""
EXACT = {*LABELS, "channel", "unit", "kind", "command"}
"""Texts that are told exactly, their numbers too."""
ROUNDED = 2e-5
"""Relative difference of norms of evidence, whose numbers are rounded to six digits."""
IN_TEXT = 1e-6
OF_STD = 1e-6
ALIKE = 1e-6
"""Relative difference of the drops of two suspects that may change places."""
NO_DAMPING = 1e-9
"""A ratio below which there is none."""

_NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?(?!\w)")


@dataclass(frozen=True)
class Difference:
    """What differs in a case: of which kind, where, and by how much (relative)."""

    case: str
    kind: str
    place: str
    old: str
    new: str
    size: float = 0.0

    @property
    def group(self) -> tuple[str, str, str, str]:
        """What is told in one line: values by their place alone, others by what became of them."""
        place = re.sub(r"\[[^\]]*\]", "[]", self.place)
        if self.kind == "values":
            return self.kind, place, "", ""
        return self.kind, place, skeleton(self.old), skeleton(self.new)


def skeleton(text: str) -> str:
    """Return a text without its numbers and the width of its gaps."""
    return " ".join(_NUMBER.sub("#", text).split())


@dataclass(frozen=True)
class Comparer:
    """Collects the differences of one case; `tolerance` is relative."""

    case: str
    tolerance: float = 1e-9
    found: list[Difference] = field(default_factory=list)

    def add(self, kind: str, place: str, old: Any, new: Any, size: float = 0.0) -> None:
        """Note a difference."""
        texts = (one if isinstance(one, str) else json.dumps(one)[:200] for one in (old, new))
        self.found.append(Difference(self.case, kind, place, *texts, size))

    def value(self, place: str, key: str, old: Any, new: Any, std: float = 0.0) -> None:
        """Compare two values; `std` is that of the row which holds them."""
        if isinstance(old, dict) and isinstance(new, dict):
            self.table(place, old, new)
        elif isinstance(old, list) and isinstance(new, list):
            self.row(place, key, old, new, std)
        elif _is_number(old) and _is_number(new) and key not in STATUS:
            self.number(place, key, old, new, std)
        elif isinstance(old, str) and isinstance(new, str) and key not in STATUS | EXACT:
            self.text(place, old.splitlines(), new.splitlines())
        elif old != new:
            self.add("status" if key in STATUS else "fields", place, old, new)

    def table(self, place: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> None:
        """Compare two tables, key by key."""
        std = old.get("std")
        for key in [*old, *(key for key in new if key not in old)]:
            here = f"{place}.{key}" if place else key
            if key not in new:
                self.add("fields", here, "there", "gone")
            elif key not in old:
                self.add("fields", here, "none", "new")
            else:
                self.value(here, key, old[key], new[key], std if _is_number(std) else 0.0)

    def row(self, place: str, key: str, old: list[Any], new: list[Any], std: float) -> None:
        """Compare two lists: of texts, of rows with labels, or of values."""
        if _are(str, old, new) and key not in EXACT:
            self.text(place, old, new)
        elif _are(dict, old, new):
            self.rows(place, _in_order(old), _in_order(new))
        elif len(old) != len(new):
            self.add("fields", f"{place}: count", len(old), len(new))
        else:
            largest = max((abs(v) for v in old if _is_number(v)), default=0.0)
            for k, pair in enumerate(zip(old, new, strict=True)):
                self.value(f"{place}[{k}]", key, *pair, std=std or largest * 1e3 * IN_TEXT)

    def rows(self, place: str, old: list[Any], new: list[Any]) -> None:
        """Compare rows by their labels, and the order of these."""
        before, after = _labelled(old), _labelled(new)
        for label in before:
            if label not in after:
                self.add("fields", f"{place}: row", label, "gone")
        for label in after:
            if label not in before:
                self.add("fields", f"{place}: row", "none", label)
        both = [label for label in before if label in after]
        if both != [label for label in after if label in before]:
            self.add("fields", f"{place}: order", both, list(after))
        for label in both:
            self.value(f"{place}[{label}]", "", before[label], after[label])

    def number(self, place: str, key: str, old: float, new: float, std: float) -> None:
        """Compare two numbers: relative, or as a part of the deviation."""
        if isinstance(old, int) and isinstance(new, int) and not isinstance(old, bool):
            if old != new:
                self.add("fields", place, old, new)
            return
        allowed = ROUNDED if key == "about" else IN_TEXT if key == "correlated" else self.tolerance
        bound = max(allowed * max(abs(old), abs(new)), OF_STD * abs(std))
        if "damping" in key:
            bound = max(bound, NO_DAMPING)
        if not abs(new - old) <= bound:
            self.add("values", place, old, new, _relative(old, new))

    def text(self, place: str, old: Sequence[str], new: Sequence[str]) -> None:
        """Compare texts line by line: words exactly, numbers in lines of the same words."""
        words = [[skeleton(line) for line in lines if line.strip()] for lines in (old, new)]
        lines = [[line for line in lines if line.strip()] for lines in (old, new)]
        match = difflib.SequenceMatcher(None, *words, autojunk=False)
        for kind, i, to_i, j, to_j in match.get_opcodes():
            if kind == "equal":
                for one, other in zip(lines[0][i:to_i], lines[1][j:to_j], strict=True):
                    self.numbers_in(place, one, other)
            else:
                self.changed(place, lines[0][i:to_i], lines[1][j:to_j])

    def changed(self, place: str, old: Sequence[str], new: Sequence[str]) -> None:
        """Note lines of other words, side by side."""
        for k in range(max(len(old), len(new))):
            pair = (lines[k] if k < len(lines) else "" for lines in (old, new))
            self.add("wording", place, *pair)

    def numbers_in(self, place: str, old: str, new: str) -> None:
        """Compare the numbers in two lines of the same words."""
        worst = 0.0
        for one, other in zip(_NUMBER.findall(old), _NUMBER.findall(new), strict=True):
            worst = max(worst, _relative(float(one), float(other)))
        if worst > max(IN_TEXT, self.tolerance):
            self.add("values", f"{place} text", old, new, worst)


def compare(case: str, old: Any, new: Any, tolerance: float = 1e-9) -> list[Difference]:
    """Return the differences between two results of a case."""
    comparer = Comparer(case, tolerance)
    if set(old) != {"steps"} or set(new) != {"steps"}:
        comparer.table("", old, new)
        return comparer.found
    before, after = old["steps"], new["steps"]
    if [step["command"] for step in before] != [step["command"] for step in after]:
        comparer.add(
            "fields", "steps", [s["command"] for s in before], [s["command"] for s in after]
        )
        return comparer.found
    for number, (one, other) in enumerate(zip(before, after, strict=True), start=1):
        comparer.table(f"{number} {one['command'].split()[0]}", one, other)
    return comparer.found


def summary(differences: Sequence[Difference], verbose: bool = False) -> Iterator[str]:
    """Yield lines that say what moved: a line per group, or per difference."""
    groups = defaultdict[tuple[str, ...], list[Difference]](list)
    for one in differences:
        groups[one.group].append(one)
    order = sorted(groups, key=lambda g: (KINDS.index(g[0]), -len(groups[g]), g))
    for group in order:
        members = groups[group]
        worst = max(members, key=lambda one: one.size)
        cases = sorted({one.case for one in members})
        said = f"{group[0]}: {_counted(cases)}: {group[1]}: "
        if group[0] == "values":
            said += f"by up to {worst.size:.2g}, {worst.case}: {worst.old} -> {worst.new}"
        else:
            said += f'"{worst.old}" -> "{worst.new}"'
        yield said
        if verbose:
            yield from (f"    {m.case}: {m.place}: {m.old} -> {m.new}" for m in members)
    counts = {kind: sum(g[0] == kind for g in groups) for kind in KINDS}
    if groups:
        yield "different things: " + ", ".join(f"{n} {kind}" for kind, n in counts.items())


def _counted(cases: Sequence[str]) -> str:
    return cases[0] if len(cases) == 1 else f"{len(cases)} cases ({cases[0]} ..)"


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _are(kind: type, *lists: list[Any]) -> bool:
    return any(lists) and all(isinstance(v, kind) for values in lists for v in values)


def _relative(old: float, new: float) -> float:
    size = max(abs(old), abs(new))
    return abs(new - old) / size if size else 0.0


def _labelled(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return rows by what they are called, a number behind what is called so before."""
    found: dict[str, Any] = {}
    for row in rows:
        parts = [str(row[key]) for key in (*LABELS, "channel") if key in row]
        label = name = " ".join(parts)
        count = 1
        while label in found:
            count += 1
            label = f"{name} {count}".strip()
        found[label] = row
    return found


def _in_order(rows: list[Any]) -> list[Any]:
    """Return suspects with those that fall alike by name: their order says nothing."""
    if not all("drop" in row and "term" in row for row in rows):
        return rows
    groups: list[list[Any]] = []
    for row in rows:
        if groups and _same_drop(groups[-1][-1]["drop"], row["drop"]):
            groups[-1].append(row)
        else:
            groups.append([row])
    return [row for group in groups for row in sorted(group, key=lambda row: str(row["term"]))]


def _same_drop(one: Any, other: Any) -> bool:
    return _is_number(one) and _is_number(other) and _relative(one, other) <= ALIKE
