"""What the intervals of a drawn rotor hold: many records of the shipped one, ten unknowns.

    python benchmarks/rotor_statistics.py [RECORDS [FIRST]]

Line spectra of four sensors and four forces, drawn with a covariance that is known. Printed as they
come: the share of the 95 % intervals that hold the truth, J over its expectation, how many are ok.
"""

import sys
from dataclasses import replace

import numpy as np

import rotorid as rid
from rotorid.rig.lines import line_record

SENSORS = ("x_a", "y_a", "x_b", "y_b")
SPEED = 2 * np.pi * 100
LINES = (3, 6, 9, 10, *range(12, 61, 3))  # the rotation is on the tenth
PERIODS = 60


def drawn(number, model):
    """Return the truth of a record and its lines."""
    rng = np.random.default_rng([2026, number])
    forces = 6 * np.exp(2j * np.pi * rng.random((len(LINES), 4)))
    plan = rid.Plan(
        forces,
        LINES,
        10.0,
        20000.0,
        PERIODS,
        noise={**dict.fromkeys(model.inputs, 0.16), **dict.fromkeys(SENSORS, 0.5e-6)},
        speed=SPEED,
        sensors=SENSORS,
    )
    values = {
        name: value * rng.uniform(0.9, 1.1) if value else value
        for name, value in model.nominal.items()
    }
    values["I_p_w"] = values["I_t_w"] * model.nominal["I_p_w"] / model.nominal["I_t_w"]  # a disc's
    record = line_record(
        model,
        model.values(values),
        forces,
        harmonics=LINES,
        fundamental=10.0,
        sample_rate=20000.0,
        periods=1,
        speed=SPEED,
        sensors=SENSORS,
    )
    lines = plan.lines(model)
    std = np.sqrt(np.einsum("kii->ki", lines.covariance.matrices).real / 2)
    noise = std * (rng.standard_normal(std.shape) + 1j * rng.standard_normal(std.shape))
    return values, replace(lines, mean=record.spectra[0] + noise)


def main(records=1000, first=0):
    """Identify every record."""
    model = rid.load_model("flexible")
    held = np.zeros(len(model.parameters))
    costs, expected, fine = [], [], 0
    for number in range(first, first + records):
        values, lines = drawn(number, model)
        estimate = rid.identify(model, lines, "ml")
        fine += estimate.status == "ok"
        for k, name in enumerate(model.parameter_names):
            held[k] += abs(estimate.value(name) - values[name]) < 1.959964 * estimate.std(name)
        costs.append(estimate.misfit.cost)
        expected.append(estimate.misfit.expected)
        done = number - first + 1
        if done % 25 == 0 or done == records:
            each = ", ".join(
                f"{name} {100 * share / done:.1f}"
                for name, share in zip(model.parameter_names, held, strict=True)
            )
            print(
                f"{done} records, {fine} ok: {100 * held.mean() / done:.2f} % held ({each}); "
                f"J {np.mean(costs) / np.mean(expected):.4f} of its expectation",
                flush=True,
            )


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
