"""Ratios of reading and averaging to what numpy alone takes for the same.

    python benchmarks/files.py [folder]

Writes files of 1 GB in all into the folder (a temporary one), and removes them.

- a gigabyte of HDF5, twelve channels: `Experiment.records` against a script that reads it in blocks
  and sums mean and squares; and the memory that it takes;
- 25 MB in memory: `average` with its covariance against one mean pass;
- `identify` on a CSV of 14 MB against a script that reads, averages and transforms it;
- `identify` on an HDF5 file of 33 MB against a process that does the same with numpy, scipy, h5py.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

import rotorid as rid
from rotorid.signals.covariance import white_covariance

MODEL = rid.load_model("three-mass")
FORCES = [f"F_{a}{i}" for i in (1, 3) for a in "xy"]
SAMPLES, RATE, LINES = 520, 10400.0, [1, 3, 5, 7, 9, 11]
EXPERIMENT = """
model = "three-mass"

[[records]]
file = "{file}"
sample_rate = "{rate} Hz"
speed = "140 Hz"
fundamental = "20 Hz"
harmonics = [1, 3, 5, 7, 9, 11]
skip = "0 s"

[channels]
{channels}

[parameters]
L1 = {{ fixed = "0.3 m" }}

[estimator]
method = "batch"
"""
BLOCKS = """
import h5py, numpy as np
total, squares, count = 0.0, 0.0, 0
with h5py.File({file!r}) as data:
    names = list(data)
    for begin in range(0, len(data[names[0]]), 520 * 126):
        block = np.stack([data[n][begin : begin + 520 * 126] for n in names])
        block = block.reshape(len(names), -1, 520)
        total, squares, count = total + block.sum(1), squares + (block**2).sum(1), count + 1
print(total.sum(), squares.sum())
"""
TEXT = """
import numpy as np
table = np.loadtxt({file!r}, delimiter=",", skiprows=1)
periods = table.reshape(-1, 520, table.shape[1])
lines = np.fft.rfft(periods, axis=1)
print(periods.mean(axis=0).sum(), periods.var(axis=0).sum(), abs(lines).sum())
"""
ARRAYS = """
import h5py, numpy as np, scipy.linalg
with h5py.File({file!r}) as data:
    table = np.stack([data[n][()] for n in data], axis=1)
periods = table.reshape(-1, 520, table.shape[1])
lines = np.fft.rfft(periods, axis=1)
print(periods.mean(axis=0).sum(), periods.var(axis=0).sum(), abs(lines).sum())
"""
RECORDS = """
import resource, rotorid as rid
periods = rid.load_experiment({file!r}).records()
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3)
"""


def simulated(periods: int) -> rid.Record:
    """Return a record of the three-mass rotor with noise on every channel."""
    angle = 2 * np.pi * np.outer(np.arange(SAMPLES) / SAMPLES, LINES)
    wave = 10 * (np.sin(angle) + np.cos(angle)).sum(axis=1)
    return rid.simulate(
        MODEL,
        MODEL.values(MODEL.nominal),
        wave[:, None] * np.array([0.5, 1.0, 1.0, -0.5]),
        sample_rate=RATE,
        periods=periods,
        speed=2 * np.pi * 140,
        noise={name: 1.0 if name in FORCES else 1e-6 for name in (*FORCES, *MODEL.coordinates)},
        rng=np.random.default_rng(1),
    )


def write_hdf5(path: Path, record: rid.Record, times: int) -> None:
    """Write a record a number of times over."""
    with h5py.File(path, "w") as data:
        for name in record.names:
            column, count = record.column(name), len(record.samples)
            data.create_dataset(name, shape=(count * times,), dtype="f8")
            for part in range(times):
                data[name][part * count : (part + 1) * count] = column


def write_experiment(path: Path, file: Path, names: tuple[str, ...]) -> None:
    units = {name: MODEL.units[name] for name in names}
    lines = [f'{name} = {{ column = "{name}", unit = "{unit}" }}' for name, unit in units.items()]
    text = EXPERIMENT.format(file=file.name, rate=RATE, channels="\n".join(lines))
    path.write_text(text, encoding="utf-8")


def best(
    work: Callable[[], object],
    repeats: int = 5,
    clock: Callable[[], float] = time.perf_counter,
) -> float:
    """Return the least time of several in s."""
    found = []
    for _ in range(repeats):
        started = clock()
        work()
        found.append(clock() - started)
    return min(found)


def run(*arguments: str) -> str:
    """Run Python and return what it prints; bytecode is kept, as where pip installs a package."""
    kept = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    command = [sys.executable, *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True, env=kept).stdout


def script(code: str, **values: str) -> Callable[[], str]:
    return lambda: run("-c", code.format(**values))


def identify(experiment: Path) -> Callable[[], object]:
    return lambda: run("-m", "rotorid", "identify", str(experiment))


def processes() -> float:
    """Return the processor time of the processes that were started, in s."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def show(what: str, ours: float, theirs: float, most: float) -> None:
    print(
        f"{what:60s} {ours:8.3f} s {theirs:8.3f} s  ratio {ours / theirs:6.2f} (at most {most:g})"
    )


def gigabyte(folder: Path, record: rid.Record) -> None:
    file, experiment = folder / "large.h5", folder / "large.toml"
    write_hdf5(file, record, 77)
    write_experiment(experiment, file, record.names)
    memory = script(RECORDS, file=str(experiment))
    theirs = best(script(BLOCKS, file=str(file)), 3)
    show(f"{file.stat().st_size / 1e9:.2f} GB of HDF5: records()", best(memory, 3), theirs, 4)
    print(f"{'':60s} {float(memory()):8.0f} MB resident (at most 500)")
    file.unlink()


def in_memory(record: rid.Record) -> None:
    count = 25_000_000 // (8 * SAMPLES * len(record.names)) * SAMPLES
    part = rid.Record(record.channels, record.samples[:count], RATE, record.speed)
    stacked = part.samples.reshape(-1, SAMPLES, len(record.names))

    def part_mean() -> object:
        return part.samples.mean(axis=0)

    def work() -> None:
        white_covariance(rid.average(part, 20.0, harmonics=LINES).spectra)

    ours = best(work, 20, time.process_time)
    for how, mean in (("over periods", lambda: stacked.mean(axis=0)), ("over samples", part_mean)):
        theirs = best(mean, 20, time.process_time)
        show(f"25 MB in memory: average with covariance, mean {how}", ours, theirs, 5)


def small_files(folder: Path, record: rid.Record) -> None:
    names = record.names
    text, arrays = folder / "run.csv", folder / "run.h5"
    count = 14_000_000 // (12 * 12) // SAMPLES * SAMPLES
    np.savetxt(
        text, record.samples[:count], fmt="%.5e", delimiter=",", header=",".join(names), comments=""
    )
    whole = 33_000_000 // (8 * 12) // SAMPLES * SAMPLES
    write_hdf5(arrays, rid.Record(record.channels, np.resize(record.samples, (whole, 12)), RATE), 1)
    for file, code, most in ((text, TEXT, 3.0), (arrays, ARRAYS, 1.5)):
        experiment = folder / f"{file.stem}-{file.suffix[1:]}.toml"
        write_experiment(experiment, file, names)
        label = f"{file.stat().st_size / 1e6:.0f} MB of {file.suffix[1:]}: identify"
        for kind, clock in (("", time.perf_counter), (", processor time", processes)):
            theirs = best(script(code, file=str(file)), clock=clock)
            show(label + kind, best(identify(experiment), clock=clock), theirs, most)


def main(folder: Path) -> None:
    record = simulated(260)
    print(f"{'':60s} {'rotorid':>10s} {'numpy':>10s}")
    in_memory(simulated(510))
    small_files(folder, record)
    gigabyte(folder, record)


if __name__ == "__main__":
    if sys.argv[1:]:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))
