"""The shipped rig with one axis excited at a time: commands behind the sum, and what was added.

What the loop's sensitivity is exactly comes in closed form from rotor, hold and controller.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg

import rotorid as rid
from rotorid.rig import assembly
from rotorid.rig.file import load_rig
from rotorid.rig.rig import Rig
from rotorid.signals.multisine import Multisine

FUNDAMENTAL = 5.0
LAST = 50
"""Lines of 5 Hz: the peak of the loop lies between them."""


def excited(axis: int, fundamental: float, count: int, amplitude: float) -> Rig:
    """Return the rig with a multisine on one axis."""
    rig = load_rig("three-mass").rig
    harmonics = np.arange(1, count + 1)
    phases = np.exp(1j * np.pi * harmonics * (harmonics - 1) / count)  # Schroeder
    lines = np.zeros((count, len(rig.model.inputs)), dtype=complex)
    lines[:, axis] = amplitude * phases
    played = Multisine(fundamental, harmonics, lines, rig.model.inputs)
    return replace(rig, excitation=played)


def measured(rig: Rig, periods: int, rng: np.random.Generator) -> rid.Record:
    """Return what a logger has: commands behind the sum, and what was added to them."""
    assert rig.excitation is not None
    count = round(rig.logger.sample_rate / rig.excitation.fundamental)
    found = rig.run(periods * count / rig.logger.sample_rate, rng)
    names = list(rig.model.inputs)
    commands = found.samples[:, [found.names.index(name) for name in names]]
    table = assembly.excitation_table(rig)
    added = np.tile(table, (periods, 1))[: len(commands)]
    channels = [*(rid.Channel(f"e_{n}") for n in names), *(rid.Channel(f"r_{n}") for n in names)]
    return rid.Record(
        channels,
        np.column_stack([commands, added]),
        sample_rate=rig.logger.sample_rate,
        speed=found.speed,
    )


def pair(axis: int) -> dict[str, str]:
    """Return the channels of one axis."""
    name = load_rig("three-mass").rig.model.inputs[axis]
    return {f"e_{name}": f"r_{name}"}


def exact_peak(axis: int) -> float:
    """Return the peak of S_jj up to the last line."""
    return float(np.abs(exact(np.arange(FUNDAMENTAL, FUNDAMENTAL * LAST, 0.25), axis)).max())


def exact(frequency: np.ndarray, axis: int) -> np.ndarray:
    """Return S_jj of the sampled loop in closed form: ``(I - C P)^-1`` at exp(i omega T).

    P is the rotor between a command, held from `delay` after the instant of its reading for one
    period, and the next readings.
    """
    rig = load_rig("three-mass").rig
    plant = rid.state_space(rig.model.substitute({}), speed=rig.rotation.speed)
    n, inputs = len(plant.A), len(plant.inputs)
    names = [name for name, _ in plant.states]
    where = [names.index(sensor) for sensor in rig.feedback]
    slope = np.array([part.slopes for part in rig.parts])  # ki and ks of each magnet
    a = plant.A + plant.B @ np.diag(slope[:, 1]) @ np.eye(n)[where]
    b = plant.B @ np.diag(slope[:, 0])
    period, late = rig.controller.period, rig.delay

    def held(time: float) -> tuple[np.ndarray, np.ndarray]:
        whole = scipy.linalg.expm(np.block([[a, b], [np.zeros((inputs, n + inputs))]]) * time)
        return whole[:n, :n], whole[:n, n:]

    (first, old), (second, new) = held(late), held(period - late)
    omega = 2 * np.pi * np.asarray(frequency)
    response = rig.controller.response(omega)
    found = []
    for w, c in zip(omega, response, strict=True):
        z = np.exp(1j * w * period)
        # x+ = Phi x + Gamma u of the last command, held till `late`, and of the new one.
        drive = second @ old / z + new
        p = np.linalg.solve(z * np.eye(n) - second @ first, drive)[where]
        found.append(np.linalg.inv(np.eye(inputs) - c @ p)[axis, axis])
    return np.array(found)
