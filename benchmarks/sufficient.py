"""How long a case of a study takes, its noise drawn on samples and on lines.

    OPENBLAS_NUM_THREADS=1 python benchmarks/sufficient.py [N]

The shipped rig three-mass, 40 s, nothing but the noise varied: medians over N cases of the seconds
until the periods are there, and of those that `identify` takes then, with all that an answer says
and with `effort = "quick"`; the seconds of the first case, which prepares the lines; the ratios.
"""

import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import rotorid as rid
from rotorid.studies.plan import load_study

STUDY = 'rig = "three-mass"\ncases = 1000\n[vary]\nduration = "40 s"\n'


def taken(case) -> list[float]:
    """Return seconds until the periods are there, then of a whole answer and of a quick one."""
    times = [time.perf_counter()]
    with tempfile.TemporaryDirectory() as folder:
        if case.noise == "lines":
            lines = case.lines
            experiment, records = lines.experiment, [lines.draw(np.random.default_rng(case.seed))]
        else:
            experiment = rid.load_experiment(case.write(Path(folder)))
            records = experiment.records()
        times.append(time.perf_counter())
        for effort in ("normal", "quick"):
            rid.identify(experiment.model, records, experiment.estimator(effort=effort))
            times.append(time.perf_counter())
    return np.diff(times).tolist()


def main(count: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        (path := Path(folder) / "study.toml").write_text(STUDY)
        plan, found = load_study(path), {}
    for noise in ("samples", "lines"):
        every = [taken(replace(plan.case(k), noise=noise)) for k in range(count + 1)]
        first, (before, whole, quick) = every[0], np.median(every[1:], axis=0)
        found[noise] = np.array([before, before + whole, before + quick])
        print(
            f"{noise:7s} {1e3 * before:7.1f} ms until the periods are there "
            f"({1e3 * first[0]:.0f} ms in the first case), then {1e3 * whole:.0f} ms, "
            f"quick {1e3 * quick:.0f} ms"
        )
    ratio = found["samples"] / found["lines"]
    print("{:.0f} times as fast until then, {:.1f} a case, {:.1f} a quick one".format(*ratio))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10)
