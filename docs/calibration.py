"""How often the 95 % intervals of `identify` hold the truth, on the shipped rigs.

    python docs/calibration.py [--runs N] [--jobs N] [--duration S] [CASE ...]

Prints, for each case, how many records were `ok`, how many intervals of one parameter held its true
value, and the root mean square of error over deviation. What is taken by default of the time
between mark and columns (`angle_lag_std`) is left out: here they go the same way.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import re
import tempfile
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from rotorid import load_rig
from rotorid.cli import run

# Case: the shipped rig, what is replaced in its text, and its faults, which are options here.
CASES: Mapping[str, tuple[str, tuple[tuple[str, str], ...], tuple[str, ...]]] = {
    "measured": ("rigid", (), ()),
    "commanded": ("rigid", (('current = "measured"', 'current = "command"'),), ()),
    "flux": (
        "rigid",
        (
            (
                'bandwidth = "1.5 kHz"',
                'bandwidth = "1.5 kHz"\nflux = { area = "4 cm^2", noise = "1 mT" }',
            ),
        ),
        (),
    ),
    "keyphasor 10 kHz": ("three-mass", (), ("keyphasor-logic",)),
    "keyphasor 5 kHz": (
        "three-mass",
        (('sample_rate = "10 kHz"', 'sample_rate = "5 kHz"'),),
        ("keyphasor-logic",),
    ),
    "backward": ("rigid", (), ("backward",)),
    "30,000 rpm": ("rigid", (('"9000 rpm"', '"30000 rpm"'),), ()),
    "three-mass": ("three-mass", (), ()),
}


def errors(
    case: str, seed: int, duration: float, effort: str = "normal"
) -> tuple[str, str, dict[str, float]]:
    """Return the status and, for each parameter, its error in deviations, of one record."""
    name, changes, faults = CASES[case]
    plan = load_rig(name)
    text = plan.text
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    stated = f'duration = "{plan.duration:g} s"'
    assert stated in text
    text = text.replace(stated, f'duration = "{duration:g} s"')
    text = _begun_anywhere(text, seed)
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        rig, out = Path(folder) / "rig.toml", Path(folder) / "run.h5"
        rig.write_text(text, encoding="utf-8")
        more = [word for fault in faults for word in ("--fault", fault)]
        made = ["simulate", str(rig), "--out", str(out), "--seed", str(seed), *more]
        if run(made) != 0:
            return case, "no record", {}
        experiment, result = out.with_suffix(".toml"), rig.with_name("r")
        # The rig's marks go the way of its columns: what nobody knows of a machine is known here.
        told = experiment.read_text(encoding="utf-8")
        marked = "\nangle = " in told or "\nkeyphasor = " in told
        stated = '[[records]]\nangle_lag_std = "0 s"\n' if marked else "[[records]]\n"
        experiment.write_text(told.replace("[[records]]\n", stated), encoding="utf-8")
        run(["identify", str(experiment), "--json", str(result), "--effort", effort])
        if not result.exists():
            return case, "refused", {}
        found = json.loads(result.read_text())
    truth = plan.rig.values
    off = {
        p["name"]: (p["value"] - truth[p["name"]]) / p["std"]
        for p in found["parameters"]
        if not p["fixed"] and p["std"]
    }
    return case, found["status"], off


def _begun_anywhere(text: str, seed: int) -> str:
    """Return a rig whose record begins at a random angle.

    A speed in step with the sample rate has the pulses of all records at the same places between
    the samples otherwise, and what the sampling leaves open is then the same error in each.
    """
    angle = np.random.default_rng(seed).uniform(-180, 180)
    return re.sub(
        r'(\[rotation\][^\[]*?)(phase = "[^"]*"\n|(?=\n\[))',
        lambda found: f'{found[1].rstrip()}\nphase = "{angle:.6f} deg"\n',
        text,
        count=1,
    )


def calibration(
    cases: list[str], runs: int, duration: float, jobs: int, effort: str = "normal"
) -> dict[str, tuple[int, float, float, dict[str, float]]]:
    """Return, by case: records that are ok, cover in %, rms over all, and means by parameter."""
    tasks = [(case, seed, duration, effort) for case in cases for seed in range(1, runs + 1)]
    statuses: dict[str, list[str]] = {case: [] for case in cases}
    off: dict[str, list[dict[str, float]]] = {case: [] for case in cases}
    with ProcessPoolExecutor(jobs) as pool:
        for case, status, found in pool.map(errors, *zip(*tasks, strict=True)):
            statuses[case].append(status)
            off[case].append(found)
    results = {}
    for case in cases:
        values = np.array([v for found in off[case] for v in found.values()])
        names = dict.fromkeys(name for found in off[case] for name in found)
        means = {n: float(np.mean([f[n] for f in off[case] if n in f])) for n in names}
        cover = 100 * float(np.mean(np.abs(values) < 1.96)) if values.size else np.nan
        rms = float(np.sqrt(np.mean(values**2))) if values.size else np.nan
        results[case] = (statuses[case].count("ok"), cover, rms, means)
    return results


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", default=[], metavar="CASE")
    parser.add_argument("--runs", type=int, default=60)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--duration", type=float, default=40.0)
    options = parser.parse_args()
    cases = options.cases or list(CASES)
    for case in cases:
        done = calibration([case], options.runs, options.duration, options.jobs)[case]
        ok, cover, rms, means = done
        worst = max(means, key=lambda name: abs(means[name]), default="")
        bias = f"{means[worst]:+.2f} ({worst})" if worst else ""
        print(
            f"{case:18} {ok:3} of {options.runs} ok, cover {cover:5.1f} %, rms {rms:5.2f}, "
            f"largest mean {bias}",
            flush=True,
        )


if __name__ == "__main__":
    main()
