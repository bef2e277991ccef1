"""How long an answer takes that the data reject, with all that is tried instead.

    OPENBLAS_NUM_THREADS=1 python benchmarks/rejected.py [N]

Every N-th of the deliberate mistakes of `tests/mistakes.py` in the experiment files of the shipped
rigs: seconds of the processor of `identify`, its status and its first suspect; then their median.
"""

import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from mistakes import MISTAKES, experiment_of

import rotorid as rid


def main(step: int) -> None:
    warnings.simplefilter("ignore")  # estimates astray overflow
    taken = []
    with tempfile.TemporaryDirectory() as folder:
        for mistake in (MISTAKES[0], *MISTAKES[::step]):  # the first to warm up
            path = Path(folder) / f"{mistake.rig}-wrong.toml"
            path.write_text(mistake.edit(experiment_of(mistake.rig, Path(folder))), "utf-8")
            try:
                experiment = rid.load_experiment(path)
                begin = time.process_time()
                found = experiment.identify()
            except rid.InputError:
                continue  # refused before anything is tried
            if found.suspects:
                taken.append(time.process_time() - begin)
                said = f"{found.status}, {found.suspects[0].term}"
                print(f"{mistake.rig}: {mistake.what:40s} {taken[-1]:6.2f} s  {said}", flush=True)
    print(f"median of {len(taken) - 1}: {np.median(taken[1:]):.2f} s")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1)
