"""Run damaged files of every format, or the corpus, and print what was found.

    python tests/fuzz_run.py --each 1000                 every format
    python tests/fuzz_run.py --each 900 --seed 1 --own 100    a hundred of them of the commit
    python tests/fuzz_run.py --each 50 csv mat5          some
    python tests/fuzz_run.py --seed 123 --only mat5:17   one case again
    python tests/fuzz_run.py --corpus out.json --case "mat: an object"      cases of the corpus

With `--keep FOLDER` that case's files are written there instead, and its command is printed.

The exit code is 1 where something was found. Without `--seed`, files are drawn from the commit, so
that every commit draws others, and the same commit the same; where there is none, always the same.
"""

import argparse
import collections
import json
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

from corpus import CASES
from fuzz_files import FORMATS
from fuzz_harness import Build, Case, Outcome, run_cases

ROOT = Path(__file__).resolve().parent.parent


SEED = 2128108498
"""Of files that are the same in every run of CI, and where nothing tells the commit."""


def seed_of_commit() -> tuple[int, str]:
    """Return a number that follows from the commit, and where it is from."""
    asked = ["git", "-C", str(ROOT), "rev-parse", "HEAD"]
    try:
        commit = subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return SEED, "no commit: the fixed one"
    return int(commit[:8], 16), f"of the commit {commit[:12]}"


def _group(outcome: Outcome) -> str:
    name, _, number = outcome.name.partition(":")
    return name if number.isdigit() else "corpus"


def findings(outcomes: Iterable[Outcome], most: int = 40) -> str:
    groups: dict[tuple[str, tuple[str, ...], str], list[Outcome]] = collections.defaultdict(list)
    for outcome in outcomes:
        if outcome.faults:
            last = outcome.told.strip().rpartition("\n")[2]
            groups[_group(outcome), outcome.faults, last[:40]].append(outcome)
    rows = []
    for (_, faults, _), group in list(groups.items())[:most]:
        first = group[0]
        names = ", ".join(o.name for o in group[:4])
        rows.append(f"{len(group)} x {'; '.join(faults)}: {names}\n    {first.told.strip()[-600:]}")
    return "\n".join(rows)


def run(builds: Sequence[Build], workers: int, warm: Sequence[Case] = ()) -> list[Outcome]:
    started = time.monotonic()
    outcomes = list(run_cases(builds, workers=workers, warm=warm))
    order = {name: number for number, name in enumerate(FORMATS)}
    outcomes.sort(key=lambda o: order.get(_group(o), -1))
    print(findings(outcomes) or "nothing found")
    print(f"{len(outcomes)} files in {time.monotonic() - started:.0f} s")
    return outcomes


def run_corpus(target: Path, cases: Sequence[str], workers: int) -> int:
    """Run these cases, or all, and write what came of each."""
    outcomes = run([partial(_named, name, CASES[name]) for name in cases or CASES], workers)
    target.write_text(json.dumps([asdict(outcome) for outcome in outcomes]))
    return any(o.faults for o in outcomes)


def _named(name: str, make: Build) -> Case:
    return replace(make(), name=name)


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("formats", nargs="*", help=f"{', '.join(FORMATS)}")
    parser.add_argument("--each", type=int, default=50, help="files of every format")
    parser.add_argument("--seed", type=int, help="in place of that of the commit")
    parser.add_argument("--own", type=int, default=0, help="so many more, of the commit's seed")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", metavar="FORMAT:NUMBER", help="one case")
    parser.add_argument("--corpus", type=Path, help="run the corpus, and write its outcomes there")
    parser.add_argument("--case", action="append", default=[], help="one of the corpus, by name")
    parser.add_argument("--keep", type=Path, help="a folder for the files of that case")
    asked = parser.parse_args()
    if asked.corpus:
        return run_corpus(asked.corpus, asked.case, asked.workers)
    own, origin = seed_of_commit()
    seed = own if asked.seed is None else asked.seed
    print(f"--seed {own} ({origin})" if seed == own else f"--seed {seed} (as asked)")
    if asked.own:
        print(f"--seed {own} ({origin}) from number {asked.each} on")
    if asked.only:
        name, _, number = asked.only.partition(":")
        case = FORMATS[name].case(seed, int(number))
        print("rotorid", *case.arguments)
        if asked.keep:
            asked.keep.mkdir(parents=True, exist_ok=True)
            for file, content in case.files.items():
                (asked.keep / file).write_bytes(content)
            return 0
        return any(o.faults for o in run([lambda: case], 1))
    chosen = [FORMATS[name] for name in asked.formats or FORMATS]
    builds = [
        partial(f.case, seed if n < asked.each else own, n)
        for n in range(asked.each + asked.own)
        for f in chosen
        if n % (1 / f.share) < 1
    ]
    warm = [case for f in chosen for case in f.whole()]
    return any(o.faults for o in run(builds, asked.workers, warm))


if __name__ == "__main__":
    sys.exit(main())
