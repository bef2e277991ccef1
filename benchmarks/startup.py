"""How long it takes to begin: ratios to what cannot be spared, all in one run.

    python benchmarks/startup.py [rounds]

Prints `rotorid --help` and a completion over `python -c pass` (at most 12), and `import rotorid`
over importing numpy and scipy.linalg (at most 1.3). The fastest of the rounds counts: what else
the machine does only adds.
"""

import os
import subprocess
import sys
import time

COMPLETION = {"_ROTORID_COMPLETE": "bash_complete", "COMP_WORDS": "rotorid id", "COMP_CWORD": "1"}
RUNS = {
    "pass": (["-c", "pass"], {}),
    "help": (["-m", "rotorid", "--help"], {}),
    "completion": (["-m", "rotorid"], COMPLETION),
    "numpy": (["-c", "import numpy, scipy.linalg"], {}),
    "import": (["-c", "import rotorid"], {}),
}
LIMITS = {
    ("help", "pass"): 12.0,
    ("completion", "pass"): 12.0,
    ("import", "numpy"): 1.3,
}


def seconds(arguments: list[str], environment: dict[str, str]) -> float:
    start = time.perf_counter()
    subprocess.run(
        [sys.executable, *arguments],
        env={**os.environ, **environment},
        check=True,
        capture_output=True,
    )
    return time.perf_counter() - start


def main(rounds: int) -> int:
    found = {name: float("inf") for name in RUNS}
    for _ in range(rounds):  # in turn, so that a slow spell meets them all
        for name, run in RUNS.items():
            found[name] = min(found[name], seconds(*run))
    for name, time_taken in found.items():
        print(f"{name:12} {1e3 * time_taken:7.1f} ms")
    missed = 0
    for (name, base), limit in LIMITS.items():
        ratio = found[name] / found[base]
        missed += ratio > limit
        print(f"{name} / {base}: {ratio:.2f} (at most {limit:g})")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 10))
