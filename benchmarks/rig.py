"""How fast the levitated rig runs: exact steps, its integrator, and scipy's at equal accuracy.

    python benchmarks/rig.py

A closed-loop run of the shipped three-mass rig (8 degrees of freedom, 10 kHz, 13 s), linear and
on opposed magnets; then a short run of the magnets by `scipy.integrate.solve_ivp`, restarted
whenever a command takes effect, with the tolerance that reaches the accuracy of the rig. scipy
gets the right-hand side compiled, so that what is compared is the integration.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numba import njit
from scipy.integrate import solve_ivp

from rotorid.rig.file import load_rig, parse_rig
from rotorid.rig.kernel import _forces
from rotorid.rig.rig import Rig, bearing_table, excitation_table

DURATION, SHORT = 13.0, 0.1
MAGNETS = """[actuators.all]
law = "differential"
K = "5e-6 N m^2/A^2"
bias = "1.5 A"
gap = "0.5 mm"
limit = "1.5 A"
noise = "8 mA"

[sensors]"""


def on_magnets() -> Rig:
    head, rest = load_rig("three-mass").text.split("[actuators.all]")
    return parse_rig(head + MAGNETS + rest.split("[sensors]")[1]).rig


def quiet(rig: Rig) -> Rig:
    sensors = tuple(replace(sensor, noise=0.0) for sensor in rig.sensors)
    return replace(rig, sensors=sensors, process_noise={}, settling=0.0)


def seconds(work: Callable[[], object], repeats: int = 3) -> float:
    found = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        found.append(time.perf_counter() - start)
    return min(found)


@njit(error_model="numpy")
def derivative(motion, load, harmonics, per_force, angle, y, force):
    """The right-hand side that scipy gets, compiled too."""
    n = len(per_force)
    out = np.empty(2 * n)
    out[:n] = y[n:]
    out[n:] = motion @ y + per_force @ force
    for h in range(len(harmonics)):
        turn = harmonics[h] * angle
        out[n:] += load[h, :, 0] * np.cos(turn) + load[h, :, 1] * np.sin(turn)
    return out


def by_scipy(rig: Rig, duration: float, method: str, rtol: float) -> np.ndarray:
    """Positions at the samples of a quiet rig, each interval of constant inputs by solve_ivp."""
    plant = rig.plant(duration)
    bearings, table, controller = bearing_table(rig, plant), excitation_table(rig), rig.controller
    reads = rig.reads[rig.fed_back]
    n, inputs = plant.force.shape
    force, floor = np.zeros(inputs), np.repeat([1e-6, 1e-3], n)
    speed, phase = rig.rotation.speed, rig.rotation.phase
    motion, load = plant.motion[0], plant.load[0]

    def slope(t: float, y: np.ndarray, held: np.ndarray) -> np.ndarray:
        _forces(bearings.displacement, bearings.kind, bearings.law, y, held, force)
        angle = phase + speed * t
        return derivative(motion, load, plant.harmonics, plant.force, angle, y, force)

    y, memory, held = np.zeros(2 * n), np.zeros(controller.states), np.zeros(inputs)
    period, samples = controller.period, round(duration / controller.period)
    found = np.zeros((samples, n))
    for k in range(samples):
        found[k] = y[:n]
        reading = reads @ y[:n]
        command = controller.C @ memory + controller.D @ reading + table[k % len(table)]
        memory = controller.A @ memory + controller.B @ reading
        begin = k * period
        for start, end, current in (
            (begin, begin + rig.delay, held),
            (begin + rig.delay, begin + period, command),
        ):
            y = solve_ivp(
                slope, (start, end), y, method, rtol=rtol, atol=rtol * floor, args=(current,)
            ).y[:, -1]
        held = command
    return found


def error(found: np.ndarray, exact: np.ndarray) -> float:
    return float(np.abs(found - exact).max() / np.abs(exact).max())


def main() -> None:
    linear, magnets = load_rig("three-mass").rig, on_magnets()
    start = time.perf_counter()
    for rig in (linear, magnets):
        rig.run(0.01, np.random.default_rng(0))
    print(f"compiling, or loading what is compiled: {time.perf_counter() - start:.1f} s")
    print(
        f"\n{DURATION:g} s at 10 kHz, closed loop, noise, after {linear.settling:g} s of settling"
    )
    for name, rig in (("linear, exact steps", linear), ("magnets, 5(4) pair", magnets)):
        took = seconds(lambda rig=rig: rig.run(DURATION, np.random.default_rng(0)))
        print(f"  {name:22s} {took:7.2f} s")

    still = quiet(magnets)
    exact = by_scipy(still, SHORT, "DOP853", 1e-12)
    print(f"\n{SHORT:g} s on magnets without noise, error relative to the peak of the motion")
    print("  method        tolerance     error    time s   for 13 s")
    for tolerance in (1e-6, 1e-8, 1e-10):
        rig = replace(still, tolerance=tolerance)
        found = rig.run(SHORT, np.random.default_rng(0)).truth.position
        took = seconds(lambda rig=rig: rig.run(DURATION, np.random.default_rng(0)))
        print(f"  rotorid       {tolerance:8.0e}  {error(found, exact):8.1e} {'':9s} {took:9.2f}")
    for method, rtol in (("RK45", 1e-8), ("DOP853", 1e-7), ("LSODA", 1e-10), ("LSODA", 1e-12)):
        start = time.perf_counter()
        found = by_scipy(still, SHORT, method, rtol)
        took = time.perf_counter() - start
        print(
            f"  {method:12s}  {rtol:8.0e}  {error(found, exact):8.1e}  {took:8.2f} "
            f"{took * DURATION / SHORT:10.0f}"
        )


if __name__ == "__main__":
    main()
