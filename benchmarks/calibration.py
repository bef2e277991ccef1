"""Are the stated deviations of records without periods right? The table of docs, section 11.

    OPENBLAS_NUM_THREADS=1 python benchmarks/calibration.py 100 noise sweep ... [--save FILE]

The rotor of three masses on two controlled bearings, simulated here by numpy and scipy alone: four
bearing sensors (2 um), forces (1 N), 10 kHz, 137.31 Hz, which is on no line; all of 2 to 600 Hz, L1
known. Without names every row is run. `--first` is the seed of the first record. With a file each
record is kept as a line of it, and what is there is not run again. Each row: J / expected with its
scatter, the root mean square of errors over deviations, what 95 % intervals cover, what a test of
5 % rejects, the statuses, and the seconds.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

import rotorid as rid

Floats = NDArray[np.float64]
MODEL = rid.load_model("three-mass")
FORCES, SENSORS = ("F_x1", "F_y1", "F_x3", "F_y3"), ("x1", "y1", "x3", "y3")
REFERENCES = [f"r_{name}" for name in FORCES]
RATE, HZ, BAND, PHASE = 10e3, 137.31, (2.0, 600.0), 0.3
SETTLING, FORCE, NOISE_X, NOISE_F = 0.5, 30.0, 2e-6, 1.0
STIFFNESS, DAMPING, FILTER = 6e5, 600.0, 0.3
TURN = (2 * np.pi * 140) ** 2
ROTOR = {
    "m1": 0.83339,
    "m2": 11.322,
    "m3": 0.83339,
    "I_t": 2.5425e-2,
    "I_p": 4.8275e-2,
    "k1": 8.8357e5,
    "k2": 8.8357e5,
    "L1": 0.3,
    "L2": 0.3,
    "xi": 77.112 / 11.322 / TURN,
    "zeta": 133.56 / 11.322 / TURN,
    "mu": 1.3145 / (4.8275e-2 - 2.5425e-2) / TURN,
    "eta": 2.2767 / (4.8275e-2 - 2.5425e-2) / TURN,
}


def machine(speed: float) -> tuple[Floats, Floats]:
    """Return A and B of s' = A s + B F, with s = q, q', and cosine and sine of the angle."""
    p = ROTOR
    mass = [p[n] for n in ("m1", "m1", "m2", "m2", "I_t", "I_t", "m3", "m3")]
    stiffness, gyroscopic = np.zeros((8, 8)), np.zeros((8, 8))
    gyroscopic[4, 5], gyroscopic[5, 4] = p["I_p"] * speed, -p["I_p"] * speed
    for k, row in (  # of each spring the places and factors of its stretch
        (p["k1"], {0: 1.0, 2: -1.0, 5: p["L1"]}),
        (p["k1"], {1: 1.0, 3: -1.0, 4: -p["L1"]}),
        (p["k2"], {2: 1.0, 6: -1.0, 5: p["L2"]}),
        (p["k2"], {3: 1.0, 7: -1.0, 4: -p["L2"]}),
    ):
        stretch = np.array([row.get(i, 0.0) for i in range(8)])
        stiffness += k * np.outer(stretch, stretch)
    static, dynamic = p["m2"] * speed**2, (p["I_t"] - p["I_p"]) * speed**2
    loads = np.zeros((8, 2))
    loads[2:6] = [
        [static * p["xi"], -static * p["zeta"]],
        [static * p["zeta"], static * p["xi"]],
        [dynamic * p["mu"], -dynamic * p["eta"]],
        [dynamic * p["eta"], dynamic * p["mu"]],
    ]
    a, b = np.zeros((18, 18)), np.zeros((18, 4))
    a[:8, 8:16] = np.eye(8)
    a[8:16] = np.hstack([-stiffness, -gyroscopic, loads]) / np.array(mass)[:, None]
    a[16, 17], a[17, 16] = -speed, speed
    b[[8, 9, 14, 15], range(4)] = 1 / np.array(mass)[[0, 1, 6, 7]]
    return a, b


def closed_loop(speed: float) -> tuple[Floats, Floats]:
    """Return what takes s, the filtered and the last reading and the command one sample on."""
    a, b = machine(speed)
    held = expm(np.block([[a, b], [np.zeros((4, 22))]]) / RATE)
    read, eye, zero = np.zeros((4, 18)), np.eye(4), np.zeros((4, 4))
    read[range(4), [0, 1, 6, 7]] = 1.0
    rise = (1 - FILTER) * RATE
    slope = np.hstack([rise * read, FILTER * eye, -rise * eye, zero])
    here = np.hstack([read, zero, zero, zero])
    step = np.vstack(
        [
            np.hstack([held[:18, :18], np.zeros((18, 8)), held[:18, 18:]]),
            slope,
            here,
            -(STIFFNESS * here + DAMPING * slope),
        ]
    )
    drive = np.vstack(  # of the excitation, and of the noise of the readings
        [
            np.zeros((18, 8)),
            np.hstack([zero, rise * eye]),
            np.hstack([zero, eye]),
            np.hstack([eye, -(STIFFNESS + DAMPING * rise) * eye]),
        ]
    )
    return step, drive


def excitation(kind: str, seconds: float, axes: Sequence[int], rng: np.random.Generator) -> Floats:
    """Return what is added to the commands, in N, the settling before it included."""
    before = int(SETTLING * RATE)
    count = round(seconds * RATE) + before
    added = np.zeros((count, 4))
    if kind == "noise":
        added[:, list(axes)] = FORCE * rng.standard_normal((count, len(axes)))
    elif kind == "steps":
        added[:] = FORCE * np.repeat(rng.choice([-1, 1], (count // 25 + 1, 4)), 25, axis=0)[:count]
    elif kind == "sweep":  # one axis after the other, 5 to 600 Hz
        part = (count - before) // 4
        t = np.arange(part) / RATE
        wave = np.sin(2 * np.pi * (5 * t + (600 - 5) / (2 * part / RATE) * t**2))
        for axis in axes:
            added[before + axis * part : before + (axis + 1) * part, axis] = FORCE * wave
    return added


def record(
    seed: int, kind: str = "noise", seconds: float = 6.0, axes: Sequence[int] = range(4)
) -> rid.Record:
    """Simulate a record: commands as they act, sensors, and what was added to the commands."""
    rng, speed = np.random.default_rng(seed), 2 * np.pi * HZ
    added = excitation(kind, seconds, axes, rng)
    noise = NOISE_X * rng.standard_normal((len(added), 4))
    step, drive = closed_loop(speed)
    before = int(SETTLING * RATE)
    begin = PHASE - speed * before / RATE
    state = np.zeros(30)
    state[16], state[17], state[22:26] = np.cos(begin), np.sin(begin), noise[0]
    pushed, states = np.hstack([added, noise]) @ drive.T, np.empty((len(added), 30))
    for k, push in enumerate(pushed):
        states[k] = state
        state = step @ state + push
    forces = states[:, 26:] + NOISE_F * rng.standard_normal((len(added), 4))
    columns = np.hstack([forces, states[:, [0, 1, 6, 7]] + noise, added])[before:]
    channels = [rid.Channel(name, "N", hold=True) for name in FORCES]
    channels += [rid.Channel(name, "m") for name in SENSORS]
    channels += [rid.Channel(name, "N") for name in REFERENCES]
    angle = speed * np.arange(len(columns)) / RATE + PHASE
    return rid.Record(channels, columns, RATE, speed=speed, angle=angle)


def part(whole: rid.Record, names: Sequence[str]) -> rid.Record:
    """Return a record with some of its channels."""
    kept = [i for i, name in enumerate(whole.names) if name in names]
    channels = [whole.channels[i] for i in kept]
    return rid.Record(channels, whole.samples[:, kept], RATE, speed=whole.speed, angle=whole.angle)


def by_references(kind: str, seconds: float) -> Callable[[int], list[rid.Lines]]:
    return lambda seed: [rid.spectra(record(seed, kind, seconds), BAND, references=REFERENCES)]


def by_quiet(kind: str, seconds: float) -> Callable[[int], list[rid.Lines]]:
    def lines(seed: int) -> list[rid.Lines]:
        quiet = record(seed + 10_000, "quiet", seconds)
        driven = record(seed, kind, seconds)
        return [rid.spectra(driven, BAND, references=REFERENCES, quiet=quiet)]

    return lines


def by_axes(seed: int) -> list[rid.Lines]:
    """Return the lines of four records, each with one axis excited."""
    return [
        rid.spectra(
            part(
                record(10 * seed + axis, "noise", 4.0, [axis]),
                (*FORCES, *SENSORS, REFERENCES[axis]),
            ),
            BAND,
            references=[REFERENCES[axis]],
        )
        for axis in range(4)
    ]


def by_inputs(seed: int) -> list[rid.Lines]:
    return [rid.spectra(part(record(seed), (*FORCES, *SENSORS)), BAND, inputs=FORCES)]


ROWS: dict[str, Callable[[int], list[rid.Lines]]] = {
    "noise": by_references("noise", 6.0),
    "steps": by_references("steps", 6.0),
    "sweep": by_references("sweep", 13.0),
    "axes": by_axes,
    "quiet-noise": by_quiet("noise", 6.0),
    "quiet-sweep": by_quiet("sweep", 13.0),
    "inputs": by_inputs,
}


def one(row: str, seed: int) -> dict[str, object]:
    """Return what is found of a record: errors over deviations, p, J over what is expected."""
    lines, rng = ROWS[row](seed), np.random.default_rng(seed)
    told = {"L1", "xi", "zeta", "mu", "eta"}
    start = {n: v * (1 + 0.1 * rng.uniform(-1, 1)) for n, v in ROTOR.items() if n not in told}
    begin = time.process_time()
    found = rid.identify(MODEL, lines, rid.MaximumLikelihood(fixed={"L1": 0.3}, start=start))
    assert found.misfit is not None
    free = [p.name for p in found.parameters if not p.fixed]
    return {
        "row": row,
        "seed": seed,
        "status": found.status,
        "p": found.misfit.p_value,
        "ratio": found.misfit.cost / found.misfit.expected,
        "z": [(found.value(name) - ROTOR[name]) / found.std(name) for name in free],
        "seconds": time.process_time() - begin,
    }


def show(row: str, kept: list[dict[str, object]]) -> None:
    """Print a row of the table."""
    z, p, ratio, seconds = (
        np.array([k[name] for k in kept], float) for name in ("z", "p", "ratio", "seconds")
    )
    statuses = ", ".join(f"{n} {s}" for s, n in Counter(str(k["status"]) for k in kept).items())
    print(
        f"{row:12s} {len(kept):4d} records  J/expected {ratio.mean():.4f} ({ratio.std():.4f})  "
        f"rms {np.sqrt((z**2).mean()):.2f}  covers {100 * (abs(z) < 1.96).mean():.1f} %  "
        f"5 % test rejects {100 * (p < 0.05).mean():.1f} %  {statuses}  {seconds.mean():.1f} s",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("records", type=int)
    parser.add_argument("rows", nargs="*", choices=[*ROWS, []])
    parser.add_argument("--first", type=int, default=0, help="seed of the first record")
    parser.add_argument("--save", type=Path)
    said = parser.parse_args()
    there = []
    if said.save is not None and said.save.exists():
        there = [json.loads(line) for line in said.save.read_text("utf-8").splitlines()]
    seeds = range(said.first, said.first + said.records)
    for row in said.rows or ROWS:
        kept = {k["seed"]: k for k in there if k["row"] == row and k["seed"] in seeds}
        for seed in seeds:
            if seed in kept:
                continue
            kept[seed] = one(row, seed)
            if said.save is not None:
                with said.save.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(kept[seed]) + "\n")
        show(row, list(kept.values()))


if __name__ == "__main__":
    main()
