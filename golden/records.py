"""Records that cases read, written with numpy and h5py alone: nothing of the package makes them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import h5py
import numpy as np

TURN = 2 * np.pi

# ---------------------------------------------------------------------------------------------
# A disc in passive bearings that coasts down: a table of 1x phasors.

COAST_MODEL = """
title = "Jeffcott rotor in passive bearings, with a trial mass"
equations = [
  "m*x'' + c*x' + k*x = Omega^2*((u_x + t_x)*cos(phi) - (u_y + t_y)*sin(phi))",
  "m*y'' + c*y' + k*y = Omega^2*((u_x + t_x)*sin(phi) + (u_y + t_y)*cos(phi))",
]
coordinates = { x = "m", y = "m" }
[parameters]
m = { unit = "kg", nominal = 4.0, positive = true }
c = { unit = "N s/m", nominal = 40.0, positive = true }
k = { unit = "N/m", nominal = 1.3e6, positive = true }
u_x = { unit = "kg m" }
u_y = { unit = "kg m" }
t_x = { unit = "kg m" }
t_y = { unit = "kg m" }
"""
COAST = """
model = "model.toml"
[[records]]
kind = "phasors"
file = "run.csv"
speed = { column = "n", unit = "rpm" }
[channels]
x = { amplitude = "ax", phase = "px", unit = "um", std = "1 um" }
y = { amplitude = "ay", phase = "py", unit = "um", std = "1 um" }
[parameters]
m = { fixed = "5 kg" }
t_x = { fixed = "0 kg m" }
t_y = { fixed = "0 kg m" }
"""
RPM = np.linspace(2000.0, 7000.0, 40)


def coast(rpm: np.ndarray, trial: complex = 0.0) -> np.ndarray:
    """Return the phasors of x and y: X is that of a turning vector, Y lags by a quarter."""
    turning = rpm * np.pi / 30
    stiffness = 1e6 - 5.0 * turning**2 + 1j * 60.0 * turning
    whirl = (1e-4 - 5e-5j + trial) * turning**2 / stiffness
    return np.column_stack([whirl, -1j * whirl])


def noisy(values: np.ndarray, std: float, seed: int) -> np.ndarray:
    """Add circular noise with the deviation `std` in each part."""
    rng = np.random.default_rng(seed)
    return values + std * (rng.standard_normal((*values.shape, 2)) @ np.array([1, 1j]))


def write_phasors(path: Path, rpm: np.ndarray, phasors: np.ndarray) -> None:
    """Write amplitudes in um and phases in degrees."""
    columns = [rpm]
    for one in phasors.T:
        columns += [1e6 * np.abs(one), np.degrees(np.angle(one))]
    write_table(path, "n,ax,px,ay,py", np.column_stack(columns))


def write_table(path: Path, header: str, rows: np.ndarray) -> None:
    """Write a table of numbers under their names."""
    np.savetxt(path, rows, "%.15g", delimiter=",", header=header, comments="")


# ---------------------------------------------------------------------------------------------
# Three masses in a row, tapped: frequency responses with their coherence.

CHAIN_MODEL = """
title = "three masses in a row"
equations = [
  "m1*x1'' + c*(x1' - x2') + k1*(x1 - x2) + k0*x1 = F",
  "m2*x2'' + c*(x2' - x1') + k1*(x2 - x1) + k2*(x2 - x3) = G",
  "m3*x3'' + k2*(x3 - x2) = 0",
]
coordinates = { x1 = "m", x2 = "m", x3 = "m" }
inputs = { F = "N", G = "N" }
[parameters]
m1 = { unit = "kg", nominal = 2.2, positive = true }
m2 = { unit = "kg", nominal = 2.7, positive = true }
m3 = { unit = "kg", nominal = 1.3, positive = true }
k0 = { unit = "N/m", nominal = 4e5, positive = true }
k1 = { unit = "N/m", nominal = 1.2e6, positive = true }
k2 = { unit = "N/m", nominal = 1.8e6, positive = true }
c = { unit = "N s/m", nominal = 30.0 }
"""
CHAIN = """
model = "chain.toml"

[[records]]
kind = "responses"
file = "tap.csv"
averages = 20
frequency = { column = "f", unit = "Hz" }

[channels]
x1 = { input = "F", amplitude = "a1", phase = "p1", unit = "um/N", coherence = "c1" }
a3 = { input = "F", reads = "x3''", real = "re", imag = "im", unit = "m/s^2/N", coherence = "c3" }
"""
HERTZ = np.arange(5.0, 300.0, 5.0)


def chain_response() -> np.ndarray:
    """Return H of all coordinates to F, shape (line, coordinate)."""
    k0, k1, k2, c = 5e5, 1e6, 2e6, 20.0
    mass = np.diag([2.0, 3.0, 1.5])
    stiffness = np.array([[k0 + k1, -k1, 0], [-k1, k1 + k2, -k2], [0, -k2, k2]])
    damping = c * np.array([[1, -1, 0], [-1, 1, 0], [0, 0, 0]])
    s = 1j * TURN * HERTZ[:, None, None]
    return np.linalg.inv(s**2 * mass + s * damping + stiffness)[:, :, 0]


def write_responses(path: Path, seed: int = 1, averages: int = 20) -> None:
    """Write H1 and coherence of x1 and of the acceleration of x3, a force of 1 N at random."""
    rng = np.random.default_rng(seed)
    shape = (averages, len(HERTZ))
    force = rng.standard_normal((*shape, 2)) @ np.array([1, 1j]) / np.sqrt(2)
    noise = 2e-7 * (rng.standard_normal((*shape, 2, 2)) @ np.array([1, 1j])) / np.sqrt(2)
    read = force[:, :, None] * chain_response()[:, [0, 2]] + noise
    auto = (np.abs(force) ** 2).sum(axis=0)[:, None]
    cross = (read * force.conj()[:, :, None]).sum(axis=0)
    found = cross / auto
    coherence = np.abs(cross) ** 2 / (auto * (np.abs(read) ** 2).sum(axis=0))
    driven = -((TURN * HERTZ) ** 2) * found[:, 1]
    polar = [1e6 * np.abs(found[:, 0]), np.degrees(np.angle(found[:, 0])), coherence[:, 0]]
    rows = np.column_stack([HERTZ, *polar, driven.real, driven.imag, coherence[:, 1]])
    write_table(path, "f,a1,p1,c1,re,im,c3", rows)


# ---------------------------------------------------------------------------------------------
# A disc on a shaft, levitated by a sampled controller: a record without periods.

WHOLE_RATE, WHOLE_SPEED = 5000.0, TURN * 61.37
WHOLE = f"""
model = "jeffcott"

[[records]]
file = "run.csv"
sample_rate = "5 kHz"
speed = "{WHOLE_SPEED * 30 / np.pi!r} rpm"
band = ["2 Hz", "200 Hz"]

[channels]
F_x = {{ column = "fx", unit = "N", hold = "zero-order" }}
F_y = {{ column = "fy", unit = "N", hold = "zero-order" }}
x = {{ column = "px", unit = "um" }}
y = {{ column = "py", unit = "um" }}

[parameters]
m = {{ start = "5.5 kg" }}
c = {{ start = "450 N s/m" }}
k = {{ start = "4.3e5 N/m" }}
"""


def levitated(
    seed: int, excitation: float = 20.0, seconds: float = 5.0, hold: bool = True
) -> np.ndarray:
    """Return forces in N, positions in um, and what was added to the command, step by step."""
    rng = np.random.default_rng(seed)
    m, c, k, speed, dt = 5.0, 500.0, 4e5, WHOLE_SPEED, 1 / WHOLE_RATE
    plant = np.zeros((8, 8))  # x, y, their rates, cos phi, sin phi, held forces
    plant[:2, 2:4] = np.eye(2)
    plant[2:4, :2], plant[2:4, 2:4] = -k / m * np.eye(2), -c / m * np.eye(2)
    xi, zeta = 2e-5 * speed**2, -1e-5 * speed**2
    plant[2:4, 4:6] = [[xi, -zeta], [zeta, xi]]
    plant[4, 5], plant[5, 4] = -speed, speed
    plant[2:4, 6:8] = np.eye(2) / m
    step = _exponential(plant * dt)
    count = int(seconds * WHOLE_RATE)
    added = excitation * rng.standard_normal((count, 2))
    noise = 1e-6 * rng.standard_normal((count, 2))
    state = np.array([0.0, 0, 0, 0, 1, 0, 0, 0])
    position, force, last = np.empty((count, 2)), np.empty((count, 2)), np.zeros(2)
    for n in range(count):
        position[n], force[n] = state[:2] + noise[n], state[6:8]
        command = -2e5 * position[n] - 100.0 * (position[n] - last) * WHOLE_RATE * 0.2 + added[n]
        last = position[n]
        state = step @ state
        state[6:8] = command
    force += 0.5 * rng.standard_normal((count, 2))
    return np.column_stack([force, 1e6 * position, added])


def _exponential(matrix: np.ndarray) -> np.ndarray:
    """Return exp of a small matrix: scaled, a series, squared."""
    part = matrix / 2**10
    whole, term = np.eye(len(part)), np.eye(len(part))
    for n in range(1, 20):
        term = term @ part / n
        whole = whole + term
    for _ in range(10):
        whole = whole @ whole
    return whole


# ---------------------------------------------------------------------------------------------
# Samples with whole periods.

DISC = """
model = "jeffcott"

[[records]]
file = "run.csv"
sample_rate = "2 kHz"
speed = "30 Hz"
fundamental = "10 Hz"
harmonics = [1, 2, 3, 5]

[channels]
F_x = { column = "fx", unit = "N" }
F_y = { column = "fy", unit = "N" }
x = { column = "x", unit = "m" }
y = { column = "y", unit = "m" }
"""
DISC_HEADER = "fx,fy,x,y"


def disc(seed: int = 5, scale: float = 1.0) -> np.ndarray:
    """Return 20 periods of forces and positions of a disc, the forces on 10, 20 and 50 Hz."""
    rng = np.random.default_rng(seed)
    lines = np.arange(101)
    omega = TURN * 10 * lines
    stiffness = 9e5 - 4.0 * omega**2 + 75j * omega
    time = np.arange(200) / 2000
    angle = TURN * 10 * np.outer(time, [1, 2, 5])
    force = np.column_stack([np.cos(angle).sum(axis=1), np.sin(angle).sum(axis=1)])
    load = 4.0 * (TURN * 30) ** 2 * (1.5e-5 - 2.5e-5j)
    turning = load * np.exp(1j * TURN * 30 * time)
    spectrum = np.fft.rfft(force + np.column_stack([turning.real, turning.imag]), axis=0)
    motion = np.fft.irfft(spectrum / stiffness[:, None], n=200, axis=0)
    samples = np.tile(np.column_stack([force, motion]), (20, 1))
    return scale * (samples + rng.standard_normal(samples.shape) * [0.01, 0.01, 1e-9, 1e-9])


def write_columns(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write an HDF5 file of columns."""
    with h5py.File(path, "w") as data:
        for name, values in columns.items():
            data[name] = values
