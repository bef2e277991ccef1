"""A disc on a magnetic bearing under control: forces, positions and what was added to them."""

import functools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import expm

import rotorid as rid
from rotorid import Channel, Lines, MaximumLikelihood, Record

MODEL = rid.load_model("jeffcott")
TRUTH = {"m": 5.0, "c": 500.0, "k": 4e5, "xi": 2e-5, "zeta": -1e-5}
RATE, SPEED = 5000.0, 2 * np.pi * 61.37
KNOWN = MaximumLikelihood(start={"m": 5.5, "c": 450.0, "k": 4.3e5})
QUICK = replace(KNOWN, effort="quick")


@functools.cache
def levitated(seed: int, seconds: float = 5.0, **more: float) -> Record:
    return levitated_together([seed], seconds, **more)[0]


def levitated_together(
    seeds: Sequence[int], seconds: float = 5.0, excitation: float = 20.0, noise_std: float = 1e-6
) -> list[Record]:
    """Return forces (held), positions, and the excitation that was added, of a record a seed."""
    m, c, k = TRUTH["m"], TRUTH["c"], TRUTH["k"]
    plant = np.zeros((8, 8))  # x, y, their rates, cos phi, sin phi, held forces
    plant[:2, 2:4] = np.eye(2)
    plant[2:4, :2], plant[2:4, 2:4] = -k / m * np.eye(2), -c / m * np.eye(2)
    xi, zeta = TRUTH["xi"] * SPEED**2, TRUTH["zeta"] * SPEED**2
    plant[2:4, 4:6] = [[xi, -zeta], [zeta, xi]]
    plant[4, 5], plant[5, 4] = -SPEED, SPEED
    plant[2:4, 6:8] = np.eye(2) / m
    step = expm(plant / RATE)
    count = int(seconds * RATE)
    rngs = [np.random.default_rng(seed) for seed in seeds]
    drawn = np.stack([rng.standard_normal((2, count, 2)) for rng in rngs], axis=-1)
    added, position, force = excitation * drawn[0], noise_std * drawn[1], np.empty(drawn[0].shape)
    state, last = np.zeros((8, len(seeds))), np.zeros((2, len(seeds)))
    state[4] = 1.0
    for n in range(count):
        position[n] += state[:2]
        force[n] = state[6:8]
        command = -2e5 * position[n] - 100.0 * (position[n] - last) * RATE * 0.2 + added[n]
        last = position[n]
        state = step @ state
        state[6:8] = command
    channels = [Channel(name, "N", hold=True) for name in ("F_x", "F_y")]
    channels += [Channel(name, "m") for name in ("x", "y")]
    channels += [Channel(name) for name in ("r_x", "r_y")]
    noisy = [force[..., k] + 0.5 * rng.standard_normal((count, 2)) for k, rng in enumerate(rngs)]
    parts = [np.column_stack([f, position[..., k], added[..., k]]) for k, f in enumerate(noisy)]
    return [Record(channels, samples, RATE, speed=SPEED) for samples in parts]


def lines_of(record: Record, band: tuple[float, float] = (2.0, 200.0), **more: object) -> Lines:
    return rid.spectra(record, band, references=["r_x", "r_y"], **more)
