"""Record what every command says, or hold it against the record: see `golden/__init__.py`."""

from __future__ import annotations

import argparse
import fnmatch
import json
import lzma
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

# One thread of BLAS in each process, and a terminal of one width, whatever the caller has.
os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", COLUMNS="100", LINES="40")

from golden.case import Case, Result
from golden.cases import all_cases
from golden.comparison import KINDS, Difference, compare, summary
from golden.running import run_all

RECORD = Path(__file__).parent / "results.json.xz"
Results = dict[str, Result]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line: 0 where nothing moved, 1 where something did."""
    told = _parser().parse_args(arguments)
    cases = chosen(all_cases(), told.only.split(), told.sample)
    if not cases:
        print(f"no case is called {told.only}", file=sys.stderr)
        return 2
    if told.list:
        print("\n".join(case.name for case in cases))
        return 0
    found = _run(cases, told.jobs, told.times)
    if told.what == "record":
        whole = not told.only and told.sample == 1
        return _record(told.file, found, whole)
    kinds = ["values"] if told.values_only else told.kinds.split(",")
    return _compare(told, cases, found, kinds)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("golden", description=__doc__)
    add = parser.add_argument
    add("what", choices=("compare", "record"))
    add("--only", default="", help='patterns of names: "rig/* mistake/*"; a part of one will do')
    add("--sample", type=int, default=1, help="every n-th case")
    add("--jobs", type=int, default=2, help="processes")
    add("--verbose", action="store_true", help="every difference, not a line for many")
    add("--values-only", action="store_true", help="short for --kinds values")
    add("--kinds", default=",".join(KINDS), help="which differences count")
    add("--tolerance", type=float, default=1e-9, help="relative, of numbers in JSON")
    add("--times", type=int, default=0, help="tell the slowest")
    add("--list", action="store_true", help="names alone, nothing is run")
    add("--file", type=Path, default=RECORD, help="another record")
    return parser


def chosen(cases: Sequence[Case], only: Sequence[str], sample: int) -> list[Case]:
    """Return the cases whose names fit a pattern, every n-th of them."""
    fitting = [c for c in cases if not only or any(_fits(c.name, pattern) for pattern in only)]
    return fitting[::sample]


def _fits(name: str, pattern: str) -> bool:
    return fnmatch.fnmatchcase(name, pattern) or pattern in name


def _run(cases: Sequence[Case], jobs: int, slowest: int) -> Results:
    found, times, since = Results(), dict[str, float](), time.monotonic()
    for case, result, seconds in run_all(cases, jobs):
        found[case.name], times[case.name] = result, seconds
        if sys.stderr.isatty():
            print(f"\r{len(found)} of {len(cases)} cases", end="", file=sys.stderr)
    took = time.monotonic() - since
    print(f"{len(cases)} cases in {took:.0f} s, {sum(times.values()):.0f} s of processor")
    for name in sorted(times, key=lambda n: -times[n])[:slowest]:
        print(f"{times[name]:8.1f} s  {name}")
    for name, result in found.items():
        if "skipped" in result:
            print(f"skipped: {name}: {result['skipped']}")
    return found


def _record(file: Path, found: Results, whole: bool) -> int:
    """Write the record anew: of a part, beside what it says of the others."""
    old = load(file) if file.exists() else {}
    absent = {name for name, result in found.items() if "skipped" in result}
    kept = {name: old[name] for name in old if not whole or name in absent}
    results = kept | {name: found[name] for name in found if name not in absent}
    save(file, results)
    print(f"{file.name}: {len(results)} cases, {file.stat().st_size / 1e6:.2f} MB")
    died = [f"died: {name}: {r['died']}" for name, r in found.items() if "died" in r]
    print("\n".join(died), file=sys.stderr, end="\n" if died else "")
    return 1 if died else 0


def load(file: Path) -> Results:
    """Return a record."""
    with lzma.open(file, "rt", encoding="utf-8") as stream:
        results: Results = json.load(stream)
    return results


def save(file: Path, results: Results) -> None:
    """Write a record; the same results give the same bytes."""
    text = json.dumps(results, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    packed = lzma.compress(text.encode(), preset=9 | lzma.PRESET_EXTREME)
    new = file.with_suffix(".new")
    new.write_bytes(packed)
    new.replace(file)


def _compare(told: Any, cases: Sequence[Case], found: Results, kinds: Sequence[str]) -> int:
    old, differences = load(told.file), list[Difference]()
    for name, result in found.items():
        if "skipped" in result:
            continue
        # As it is read from the file: a number is what its digits say.
        result = json.loads(json.dumps(result))
        if name in old:
            differences += compare(name, old[name], result, told.tolerance)
        else:
            differences.append(Difference(name, "status", "case", "not in the record", "new"))
    if not told.only and told.sample == 1:
        gone = sorted(set(old) - {case.name for case in cases})
        differences += [
            Difference(name, "status", "case", "in the record", "gone") for name in gone
        ]
    counted = [one for one in differences if one.kind in kinds]
    for line in summary(counted, told.verbose):
        print(line)
    moved = len({one.case for one in counted})
    print(f"{moved} of {len(found)} cases moved" if moved else "nothing moved")
    return 1 if moved else 0


if __name__ == "__main__":
    sys.exit(main())
