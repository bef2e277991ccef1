"""Make cases: a folder of records that entrants read, and one of what they may not see.

    python benchmarks/peers/cases.py OUT COUNT [--seed N] [--sensors 8|4] [--spread 0.1]
                                     [--simulator FILE]

Each machine is the paper's rotor with every value times exp(spread * normal); the start is the
paper's rotor, its unbalance 0. OUT/cases/NNNN has record.npy (samples, shape (sample, channel)) and
case.json (units, lines, start, what is known), OUT/sealed/NNNN.json the seed, the truth and the
Cramer-Rao bound. With four sensors L1 is known: forces and positions at the ends do not determine
the scale of the lengths. FILE is a simulator of one's own: a Python file with `random_rotor`,
`three` (the matrices) and `lines_response`.
"""

from __future__ import annotations

import argparse
import json
import runpy
import secrets
from pathlib import Path
from typing import Any

import numpy as np
from common import NAMES

import rotorid as rid
from rotorid.testing import line_record

MODEL = rid.load_model("three-mass")
SENSORS = {8: MODEL.coordinates, 4: ("x1", "y1", "x3", "y3")}
RATE, SAMPLES, PERIODS = 1000.0, 100, 40
FUNDAMENTAL = RATE / SAMPLES
HARMONICS = tuple(range(1, 31))
ROTATION = 14  # of the harmonics
SPEED = 2 * np.pi * ROTATION * FUNDAMENTAL
FORCE = 7.0  # N, amplitude on each line
NOISE = {"N": 0.2, "m": 5e-6, "rad": 5e-6}


def own_machine(rng: np.random.Generator, spread: float) -> dict[str, float]:
    """Return the values of a machine; a body's I_p is below 2 I_t."""
    p = {name: MODEL.nominal[name] * np.exp(spread * rng.standard_normal()) for name in NAMES}
    return p | {"I_p": min(p["I_p"], 1.95 * p["I_t"])}


def motion(simulator: dict[str, Any] | None, p: dict[str, float], forces: np.ndarray) -> np.ndarray:
    """Return all coordinates on the lines, shape (line, coordinate)."""
    if simulator is not None:
        omega, rotation = 2 * np.pi * FUNDAMENTAL * np.array(HARMONICS), HARMONICS.index(ROTATION)
        respond, three = simulator["lines_response"], simulator["three"]
        return respond(p, three, SPEED, omega, forces, np.eye(8), rot=rotation)
    lines = {"harmonics": HARMONICS, "fundamental": FUNDAMENTAL, "sample_rate": RATE}
    record = line_record(MODEL, MODEL.values(p), forces, **lines, periods=1, speed=SPEED)
    return record.spectra[0][:, len(MODEL.inputs) :]


def write(out: Path, seed: list[int], sensors: tuple, spread: float, simulator: Any) -> None:
    rng, number = np.random.default_rng(seed), f"{seed[1]:04d}"
    forces = FORCE / 2 * np.exp(2j * np.pi * rng.random((len(HARMONICS), len(MODEL.inputs))))
    p = simulator["random_rotor"](rng, spread) if simulator else own_machine(rng, spread)
    read = motion(simulator, p, forces)[:, [MODEL.coordinates.index(name) for name in sensors]]
    units = {name: MODEL.units[name] for name in (*MODEL.inputs, *sensors)}
    noise = {name: NOISE[unit] for name, unit in units.items()}
    spectrum = np.zeros((SAMPLES // 2 + 1, len(units)), dtype=complex)
    spectrum[list(HARMONICS)] = SAMPLES * np.hstack([forces, read])
    samples = np.tile(np.fft.irfft(spectrum, SAMPLES, axis=0), (PERIODS, 1))
    samples += rng.standard_normal(samples.shape) * list(noise.values())
    p = {name: float(p[name]) for name in NAMES}
    start = MODEL.nominal | dict.fromkeys(("xi", "zeta", "mu", "eta"), 0.0)
    known = {} if len(sensors) == 8 else {"L1": p["L1"]}
    told = {
        "sample_rate_hz": RATE,
        "period_samples": SAMPLES,
        "harmonics": HARMONICS,
        "speed_rad_s": SPEED,
        "channels": units,
        "start": {name: start[name] for name in NAMES} | known,
        "known": known,
    }
    plan = rid.Plan(forces, HARMONICS, FUNDAMENTAL, RATE, PERIODS, noise, SPEED, sensors)
    bound = rid.predict_accuracy(MODEL, plan, rid.MaximumLikelihood(fixed=known), p)
    sealed = {
        "seed": seed,
        "speed_rad_s": SPEED,
        "truth": p,
        "bound": {name: bound.std(name) for name in NAMES if name not in known},
    }
    folder = out / "cases" / number
    folder.mkdir(parents=True)
    np.save(folder / "record.npy", samples)
    (folder / "case.json").write_text(json.dumps(told, indent=1), "utf-8")
    (out / "sealed" / f"{number}.json").write_text(json.dumps(sealed, indent=1), "utf-8")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("out", type=Path)
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, default=secrets.randbits(48))
    parser.add_argument("--sensors", type=int, choices=SENSORS, default=8)
    parser.add_argument("--spread", type=float, default=0.1)
    parser.add_argument("--simulator", type=Path)
    chosen = parser.parse_args()
    simulator = runpy.run_path(str(chosen.simulator)) if chosen.simulator else None
    (chosen.out / "sealed").mkdir(parents=True)
    for number in range(chosen.count):
        seed = [chosen.seed, number]
        write(chosen.out, seed, SENSORS[chosen.sensors], chosen.spread, simulator)


if __name__ == "__main__":
    main()
