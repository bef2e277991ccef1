"""A damped rotor in passive bearings that coasts down, solved by a few lines of numpy."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from io_writers import write_table
from model_text import model_text
from scipy import signal
from working_folder import load

import rotorid as rid

MODEL = model_text(
    "Jeffcott rotor in passive bearings, with a trial mass",
    [
        "m*x'' + c*x' + k*x = Omega^2*((u_x + t_x)*cos(phi) - (u_y + t_y)*sin(phi))",
        "m*y'' + c*y' + k*y = Omega^2*((u_x + t_x)*sin(phi) + (u_y + t_y)*cos(phi))",
    ],
    "x m, y m",
    "",
    "m +4.0 kg, c +40.0 N s/m, k +1.3e6 N/m, u_x kg m, u_y kg m, t_x kg m, t_y kg m",
)
RECORD = """
[[records]]
kind = "phasors"
file = "run.csv"
speed = { column = "n", unit = "rpm" }
"""
PROBES = """
x = { amplitude = "ax", phase = "px", unit = "um", std = "1 um" }
y = { amplitude = "ay", phase = "py", unit = "um", std = "1 um" }
"""
EXPERIMENT = f"""
model = "model.toml"
{RECORD}
[channels]{PROBES}[parameters]
m = {{ fixed = "5 kg" }}
t_x = {{ fixed = "0 kg m" }}
t_y = {{ fixed = "0 kg m" }}
"""
WITH_TRIAL = EXPERIMENT.replace('m = { fixed = "5 kg" }\n', "").replace(
    "[channels]",
    """
[records.parameters]
t_x = { fixed = "5e-5 kg m" }
t_y = { fixed = "20 g mm" }
[channels]
""",
)
KNOWN = {"t_x": 0.0, "t_y": 0.0}
TRIAL = 5e-5 + 2e-5j
TRUTH = {"m": 5.0, "c": 60.0, "k": 1e6, "u_x": 1e-4, "u_y": -5e-5}
RPM = np.linspace(2000.0, 7000.0, 40)
Change = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def coast(rpm: np.ndarray, trial: complex = 0.0) -> np.ndarray:
    """Return X of x and y: r = x + i y turns as R exp(i phi), m r'' + c r' + k r = U Omega^2 .."""
    turning = rpm * np.pi / 30
    unbalance = TRUTH["u_x"] + 1j * TRUTH["u_y"] + trial
    stiffness = TRUTH["k"] - TRUTH["m"] * turning**2 + 1j * TRUTH["c"] * turning
    whirl = unbalance * turning**2 / stiffness
    return np.column_stack([whirl, -1j * whirl])


def write(
    path: Path, rpm: np.ndarray, phasors: np.ndarray, size: float = 1e6, turn: float = 180 / np.pi
) -> None:
    """Write a table as a balancing instrument gives it: amplitudes in um, phases in degrees."""
    columns = [rpm]
    for one in phasors.T:
        columns += [size * np.abs(one), turn * np.angle(one)]
    write_table(path, "n,ax,px,ay,py", *columns)


def of_two(second: str = WITH_TRIAL) -> str:
    """Return an experiment whose first record is another one, without a trial mass."""
    return second.replace("[[records]]", RECORD.replace("run", "bare") + "[[records]]", 1)


def write_two(
    folder: Path,
    rpm: np.ndarray = RPM,
    noise: float = 0.0,
    seed: int = 4,
    change: Change = lambda rpm, phasors: (rpm, phasors),
) -> None:
    """Write the model and the tables of a run without and one with a trial mass, changed."""
    rng = np.random.default_rng(seed)
    (folder / "model.toml").write_text(MODEL)
    for name, trial in (("bare", 0.0), ("run", TRIAL)):
        parts = noise * rng.standard_normal((2, len(rpm), 2))
        write(folder / f"{name}.csv", *change(rpm, coast(rpm, trial) + parts[0] + 1j * parts[1]))


def identify(folder: Path, text: str = EXPERIMENT) -> rid.Estimate:
    return load(folder, text).identify()


def run_down(
    rng: np.random.Generator,
    noise: float,
    damping: float = 300.0,
    trial: complex = 0.0,
    seconds: float = 20.0,
    sense: int = 1,
) -> rid.Record:
    """Return samples of the same rotor, other damping, as it slows from 7000 to 2000 rpm.

    ``m r'' + c r' + k r = U (Omega^2 - i Omega') exp(i phi)`` at 2 kHz, exact but for the force,
    which is taken as linear between samples four times as dense.
    """
    rate, dense = 2000.0, 4
    time = np.arange(int(seconds * rate * dense)) / (rate * dense)
    slowing = -5000 * np.pi / 30 / seconds * sense
    turning = sense * 7000 * np.pi / 30 + slowing * time
    angle = sense * 7000 * np.pi / 30 * time + slowing * time**2 / 2
    unbalance = TRUTH["u_x"] + 1j * TRUTH["u_y"] + trial
    force = unbalance * (turning**2 - 1j * slowing) * np.exp(1j * angle)
    m, k = TRUTH["m"], TRUTH["k"]
    motion = np.array([[0.0, 1.0], [-k / m, -damping / m]])
    system = (motion, np.array([[0.0], [1 / m]]), np.array([[1.0, 0.0]]), np.zeros((1, 1)))
    above, below = signal.ss2tf(*signal.cont2discrete(system, time[1], "foh")[:4])
    parts = [signal.lfilter(above[0], below, part) for part in (force.real, force.imag)]
    kept = slice(int(0.5 * rate) * dense, None, dense)  # without the way it starts
    samples = np.column_stack(parts)[kept]
    samples = samples + noise * rng.standard_normal(samples.shape)
    channels = [rid.Channel("x", "m"), rid.Channel("y", "m")]
    return rid.Record(channels, samples, rate, float(turning.mean()), angle[kept])
