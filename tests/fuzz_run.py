"""Run damaged files of every format, and print what was found.

    python tests/fuzz_run.py --each 1000                 every format
    python tests/fuzz_run.py --each 50 csv mat5          some
    python tests/fuzz_run.py --seed 123 --only mat5:17   one case again
    python tests/fuzz_run.py --seed 123 --only mat5:17 --keep FOLDER    its files, and its command

The exit code is 1 where something was found. Without `--seed`, files are drawn from the commit, so
that every commit draws others, and the same commit the same; where there is none, always the same.
"""

import argparse
import sys
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

from commit import seed_of_commit
from fuzz_files import FORMATS
from fuzz_harness import Build, Outcome, run_cases


def builds_of(names: Iterable[str], seed: int, numbers: Iterable[int]) -> list[Build]:
    """Return what builds the cases of these numbers: of formats that share them, their part."""
    chosen = [FORMATS[name] for name in names]
    return [partial(f.case, seed, n) for n in numbers for f in chosen if n % (1 / f.share) < 1]


def findings(names: Sequence[str], builds: Sequence[Build]) -> str:
    """Run cases, and say what is wrong, one line and what was said for each."""
    warm = [case for name in names for case in FORMATS[name].whole()]
    wrong: list[Outcome] = [o for o in run_cases(builds, warm=warm) if o.faults]
    return "\n".join(f"{o.name}: {'; '.join(o.faults)}\n    {o.told[-600:]}" for o in wrong)


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("formats", nargs="*", help=f"{', '.join(FORMATS)}")
    parser.add_argument("--each", type=int, default=50, help="files of every format")
    parser.add_argument("--seed", type=int, default=seed_of_commit(), help="not of the commit")
    parser.add_argument("--only", metavar="FORMAT:NUMBER", help="one case")
    parser.add_argument("--keep", type=Path, help="a folder for the files of that case")
    asked = parser.parse_args()
    print(f"--seed {asked.seed}")
    names, builds = asked.formats or [*FORMATS], list[Build]()
    if asked.only:
        name, _, number = asked.only.partition(":")
        names, builds = [name], [partial(FORMATS[name].case, asked.seed, int(number))]
    if asked.only and asked.keep:
        asked.keep.mkdir(parents=True, exist_ok=True)
        case = builds[0]()
        case.write(asked.keep)
        print("rotorid", *case.arguments)
        return 0
    found = findings(names, builds or builds_of(names, asked.seed, range(asked.each)))
    print(found or "nothing found")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
