"""How long a large rotor takes: 200 coordinates, 60 lines or 3000, twenty unknowns.

    python benchmarks/rotor_size.py [LINES ...]

Writes the seconds of computing (user and system time of this process, one thread) of `identify`,
and how many times as much they are as scipy takes to factor the whole rotor once on every line.
"""

import sys
import time

import numpy as np
import scipy

import rotorid as rid
from rotorid.testing import add_noise, line_record

SECTIONS = (20, 30, 16, 40, 20, 34, 18, 24, 36, 20, 16, 30, 22, 28)
SHRUNK = (1, 3, 5, 8, 10, 11)


def rotor():
    """Return a rotor of 50 nodes: six stiffness factors, two wheels, a seal, four unbalances."""
    sections = "\n".join(
        f'{{ length = "60 mm", outer = "{outer} mm", material = "steel", elements = 3'
        + (f', stiffness = "s_{k}"' if k in SHRUNK else "")
        + " },"
        for k, outer in enumerate(SECTIONS)
    )
    factors = "\n".join(f's_{k} = {{ unit = "1", nominal = 1.0, positive = true }}' for k in SHRUNK)
    return rid.parse_model(f"""
sections = [
{sections}
]
[materials]
steel = {{ E = "210 GPa", G = "81 GPa", density = "7850 kg/m^3" }}
[discs]
one = {{ at = "270 mm", mass = "m_1", I_t = "I_1", I_p = "J_1" }}
two = {{ at = "580 mm", mass = "m_2", I_t = "I_2", I_p = "J_2" }}
[actuators]
A = {{ at = "100 mm" }}
B = {{ at = "760 mm" }}
[sensors]
a = {{ at = "135 mm" }}
b = {{ at = "725 mm" }}
[supports]
seal = {{ at = "450 mm", k = "k", c = "c" }}
[unbalance]
one = {{ at = "270 mm", x = "u_1", y = "v_1" }}
two = {{ at = "580 mm", x = "u_2", y = "v_2" }}
[damping]
internal = "c_i"
structural = "eta"
[parameters]
{factors}
m_1 = {{ unit = "kg", nominal = 3.0, positive = true }}
I_1 = {{ unit = "kg m^2", nominal = 4e-3, positive = true }}
J_1 = {{ unit = "kg m^2", nominal = 7e-3, positive = true }}
m_2 = {{ unit = "kg", nominal = 2.0, positive = true }}
I_2 = {{ unit = "kg m^2", nominal = 3e-3, positive = true }}
J_2 = {{ unit = "kg m^2", nominal = 5e-3, positive = true }}
k = {{ unit = "N/m", nominal = 1e6, positive = true }}
c = {{ unit = "N s/m", nominal = 100.0, positive = true }}
c_i = {{ unit = "s", nominal = 2e-6, positive = true }}
eta = {{ unit = "1", nominal = 4e-3, positive = true }}
u_1 = {{ unit = "kg m", nominal = 1e-5 }}
v_1 = {{ unit = "kg m", nominal = 1e-5 }}
u_2 = {{ unit = "kg m", nominal = 1e-5 }}
v_2 = {{ unit = "kg m", nominal = 1e-5 }}
""")


def main(counts):
    """Time each number of lines."""
    model = rotor()
    sensors = ["x_a", "y_a", "x_b", "y_b"]
    for count in counts:
        rng = np.random.default_rng(1)
        lines = np.arange(1, count + 1) * (1 if count > 600 else 10)
        fundamental = 600.0 / lines[-1]
        forces = 30 / np.sqrt(count / 60) * np.exp(2j * np.pi * rng.random((count, 4)))
        speed = 2 * np.pi * fundamental * lines[count // 5]
        record = line_record(
            model,
            model.values(model.nominal),
            forces,
            harmonics=lines,
            fundamental=fundamental,
            sample_rate=fundamental * lines[-1] * 4,
            periods=20,
            speed=speed,
            sensors=sensors,
        )
        noise = dict.fromkeys(model.inputs, 0.5) | dict.fromkeys(sensors, 1e-6)
        noisy = add_noise(record, noise, rng)
        start = {n: 1.15 * v for n, v in model.nominal.items() if not n.startswith(("u", "v"))}
        rid.identify(rid.load_model("jeffcott"), _small(rng), "ml")  # imports are not computing
        before = time.process_time()
        estimate = rid.identify(model, noisy, rid.MaximumLikelihood(start=start))
        took = time.process_time() - before
        off = max(
            abs(estimate.value(n) - v) / (estimate.std(n) or np.inf)
            for n, v in model.nominal.items()
        )
        print(
            f"{len(model.coordinates)} coordinates, {count} lines, {len(model.parameters)} "
            f"unknowns: {took:.2f} s, {took / _factored(model, record):.1f} times a factorization "
            f"on each line, {estimate.status}, {off:.1f} deviations off at most"
        )


def _factored(model, record):
    """Return the seconds that it takes to factor the whole dynamic stiffness on every line."""
    matrices = model.require_linear().matrices(model.values(model.nominal), record.speed)
    omega = 2 * np.pi * record.harmonics * record.sample_rate / record.samples
    before = time.process_time()
    for s in 1j * omega:
        damped = matrices.D + record.speed * matrices.G
        scipy.linalg.lu_factor(s**2 * matrices.M + s * damped + matrices.K + 1j * matrices.H)
    return time.process_time() - before


def _small(rng):
    model = rid.load_model("jeffcott")
    record = line_record(
        model,
        model.values(model.nominal),
        np.ones((4, 2)),
        harmonics=[1, 2, 3, 4],
        fundamental=10.0,
        sample_rate=1000.0,
        periods=5,
    )
    return add_noise(record, dict.fromkeys(model.coordinates, 1e-7), rng)


if __name__ == "__main__":
    main([int(count) for count in sys.argv[1:]] or [60, 3000])
