"""How long a record without periods takes: 13 s of 8 channels at 10 kHz, 3000 lines, four sensors.

    OPENBLAS_NUM_THREADS=1 python benchmarks/whole.py

The three-mass rotor at a speed that fits no line, on bearings with a PID each, under random forces
on four axes: lines of the whole record with the noise from a quiet record, from references, and
from the measured inputs; maximum likelihood with the physical parameters from there. In seconds of
the processor, the least of three runs.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np

import rotorid as rid
from rotorid.rig.file import load_rig, parse_rig

MODEL = rid.load_model("three-mass")
BAND, AXES = (2.0, 232.7), ("F_x1", "F_y1", "F_x3", "F_y3")
HIDDEN = ("x2", "y2", "theta_x", "theta_y")
T = TypeVar("T")


def run(amplitude: float, seed: int) -> rid.Record:
    """Return a record of the shipped rig, its forces random waves 2 Hz apart."""
    harmonics = ", ".join(map(str, range(1, 116)))
    text = load_rig("three-mass").text.replace('"8400 rpm"', '"8238.6 rpm"')
    text = text.replace("[1, 3, 5, 7, 9, 11]", f"[{harmonics}]").replace('"20 Hz"', '"2 Hz"')
    head = text.replace('"zero"', '"random"').partition("[excitation.signals]")[0]
    tail = "[process_noise]" + text.partition("[process_noise]")[2]
    signals = "\n".join(f'{name} = {{ amplitude = "{amplitude:g} N" }}' for name in AXES)
    rig = parse_rig(f"{head}[excitation.signals]\n{signals}\n\n{tail}").rig
    record = rig.run(13.0, np.random.default_rng(seed))
    kept = [k for k, name in enumerate(record.names) if name not in HIDDEN]
    channels = tuple(record.channels[k] for k in kept)
    return rid.Record(channels, record.samples[:, kept], record.sample_rate, record.speed)


def with_references(quiet: rid.Record) -> rid.Record:
    """Return a record with four references: it takes as long as a true one, and is none."""
    rng = np.random.default_rng(2)
    added = rng.standard_normal((len(quiet.samples), len(AXES)))
    samples = quiet.samples.copy()
    samples[:, : len(AXES)] += 0.02 * added
    channels = (*quiet.channels, *(rid.Channel(f"r_{name}") for name in AXES))
    return rid.Record(channels, np.column_stack([samples, added]), quiet.sample_rate, quiet.speed)


def least(what: str, work: Callable[[], T]) -> T:
    """Print the least processor time of three runs."""
    found, result = [], work()
    for _ in range(3):
        started = time.process_time()
        result = work()
        found.append(time.process_time() - started)
    print(f"{what:44s} {min(found):6.2f} s")
    return result


def main() -> None:
    record, quiet = run(2.0, 0), run(1e-9, 1)
    driven, references = with_references(quiet), [f"r_{name}" for name in AXES]
    least("lines, noise from references", lambda: rid.spectra(driven, BAND, references=references))
    least("lines, noise from the inputs", lambda: rid.spectra(record, BAND, inputs=AXES))
    lines = least(
        "lines, noise from a quiet record", lambda: rid.spectra(record, BAND, quiet=quiet)
    )
    known = rid.MaximumLikelihood(fixed={"L1": 0.3})
    what = f"maximum likelihood of {len(lines.frequency)} lines"
    estimate = least(what, lambda: rid.identify(MODEL, lines, known))
    print(f"{estimate.status}; to be: lines and likelihood together in 1.5 s")


if __name__ == "__main__":
    main()
