"""A levitated rotor from its coil currents: what hold, delay and the force law are worth.

    python examples/levitated_rig.py [seeds]

Runs the shipped three-mass rig (8400 rpm, PID at 10 kHz, noise on sensors, currents and rotor) and
identifies it by batch least squares: as its logger describes it; without the hold and the delay
of the commands; and, on opposed magnets without noise, through the right and the linear law.
docs/rig.md shows what it prints.
"""

import sys
from dataclasses import replace

import numpy as np

import rotorid as rid
from rotorid.force.reading import forces
from rotorid.rig.file import load_rig, parse_rig
from rotorid.signals.inspection import detect_distortion

LINES, PERIOD = [1, 3, 5, 7, 9, 11], 500
MAGNETS = """[actuators.all]
law = "differential"
K = "4e-6 N m^2/A^2"
bias = "2 A"
gap = "0.4 mm"
limit = "2 A"

[sensors]"""


def errors(record: rid.Record) -> np.ndarray:
    """Return the errors of the base parameters in per cent."""
    model = rid.load_model("three-mass")
    periods = rid.average(forces(record, period=PERIOD), 20.0, harmonics=LINES)
    estimate = rid.identify(model, periods, rid.Batch())
    truth = model.base_values(model.values(model.nominal))
    return 100 * (np.array([p.value for p in estimate.parameters]) / truth - 1)


def described(record: rid.Record, *, hold: bool, delay: bool) -> rid.Record:
    """Return a record that forgets the hold or the delay of its commands."""
    channels = [replace(c, hold=hold and c.hold, delay=delay * c.delay) for c in record.channels]
    return replace(record, channels=tuple(channels))


def on_magnets() -> np.ndarray:
    """Return errors through the right law, through the linear one, and print the distortion."""
    head, rest = load_rig("three-mass").text.split("[actuators.all]")
    rig = parse_rig(head + MAGNETS + rest.split("[sensors]")[1]).rig
    sensors = tuple(replace(sensor, noise=0.0) for sensor in rig.sensors)
    rig = replace(rig, sensors=sensors, process_noise={})
    record = rig.run(3.0, np.random.default_rng(0))
    found = detect_distortion(record, 20.0, LINES, highest=22)
    odd, even, noise = found.relative("F_x1")
    print(f"\nmagnets, F_x1: odd distortion {100 * odd:.2g} %, even {100 * even:.1g} %, "
          f"noise {100 * noise:.1g} % of the excited lines")  # fmt: skip
    slopes = rig.parts[0].law.linearize()
    force = np.abs(record.truth.force).max(axis=0)
    B = rig.model.input_matrix
    linear = slopes.force(record.truth.current, record.truth.position @ B)
    print("error of the linear law, % of the peak force:",
          (100 * np.abs(linear - record.truth.force).max(axis=0) / force).round(1))  # fmt: skip
    names, columns = list(record.names), record.samples.copy()
    for name, column in zip(rig.model.inputs, record.columns[:4], strict=True):
        position = record.column("xyxy"[rig.model.inputs.index(name)] + name[-1])
        held = np.concatenate([column.samples[:1], column.samples[:-1]])  # flowing at the sample
        columns[:, names.index(name)] = slopes.force((held + column.samples) / 2, position)
    return np.stack([errors(record), errors(replace(record, samples=columns))], axis=1)


def main(seeds: int) -> None:
    """Print both tables."""
    plan, names = load_rig("three-mass"), rid.load_model("three-mass").base.names
    cases = {
        "as described": {"hold": True, "delay": True},
        "no delay": {"hold": True, "delay": False},
        "no hold": {"hold": False, "delay": True},
        "neither": {"hold": False, "delay": False},
    }
    found = np.zeros((seeds, len(cases), len(names)))
    for seed in range(seeds):
        record = plan.run(seed)
        for i, case in enumerate(cases.values()):
            found[seed, i] = errors(described(record, **case))
    largest = np.abs(found[:, 0]).max(axis=0)
    print(f"error in %, mean of {seeds} runs; as described: the largest of any run")
    print(f"{'':20s}" + "".join(f"{name:>14s}" for name in cases))
    for j, name in enumerate(names):
        row = [largest[j], *found[:, 1:, j].mean(axis=0)]
        print(f"{name:20s}" + "".join(f"{value:14.2f}" for value in row))
    laws = on_magnets()
    print(f"\nwithout noise, error in %\n{'':20s}{'law':>14s}{'linear law':>14s}")
    for name, row in zip(names, laws, strict=True):
        print(f"{name:20s}{row[0]:14.4f}{row[1]:14.2f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10)
