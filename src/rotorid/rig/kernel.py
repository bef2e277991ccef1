"""The compiled loop of a rig: controller, amplifiers, rotor, logger, event by event.

Between events the inputs are constant. A linear rig takes exact steps (matrix exponential); a
nonlinear one, or one whose speed changes, is integrated with error control. Arguments are the
tables of `rotorid.rig.tables`; x = [q, q', lagging currents].
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from rotorid.rig.dynamics import currents, forces, integrate

FINE, TOUCH, BEYOND_BIAS, STUCK = 0, 1, 2, 3


@njit(cache=True, error_model="numpy")
def _add_product(matrix: Any, vector: Any, out: Any) -> None:
    for r in range(matrix.shape[0]):
        total = 0.0
        for k in range(matrix.shape[1]):
            total += matrix[r, k] * vector[k]
        out[r] += total


@njit(cache=True, error_model="numpy")
def _touch(bearings: Any, position: Any) -> int:
    """Return the first axis whose displacement is over the clearance, or -1."""
    n = bearings.displacement.shape[1]
    for j in range(len(bearings.clearance)):
        square = 0.0
        for axis in (j, bearings.pair[j]):
            x = 0.0
            if axis >= 0:
                for k in range(n):
                    x += bearings.displacement[axis, k] * position[k]
            square += x * x
        if not square <= bearings.clearance[j] ** 2:
            return j
    return -1


@njit(cache=True, error_model="numpy")
def _read(loop: Any, position: Any, error: Any, out: Any) -> None:
    for r in range(len(out)):
        total, quantum = error[r], loop.quantum[r]
        for k in range(loop.sensors.shape[1]):
            total += loop.sensors[r, k] * position[k]
        out[r] = np.rint(total / quantum) * quantum if quantum > 0 else total


@njit(cache=True, error_model="numpy")
def _control(loop: Any, step: int, reading: Any, memory: Any, scratch: Any, command: Any) -> None:
    """One step of the controller: command from reading, the state moved on."""
    command[:] = loop.excitation[step % len(loop.excitation)]
    scratch[:] = 0.0
    for j in range(len(command)):
        for k in range(loop.C.shape[1]):
            command[j] += loop.C[j, k] * memory[k]
        for k in range(loop.D.shape[1]):
            command[j] += loop.D[j, k] * reading[loop.reads[k]]
    for r in range(len(memory)):
        for k in range(len(memory)):
            scratch[r] += loop.A[r, k] * memory[k]
        for k in range(loop.B.shape[1]):
            scratch[r] += loop.B[r, k] * reading[loop.reads[k]]
    memory[:] = scratch


@njit(cache=True, error_model="numpy")
def _limit(bearings: Any, command: Any) -> int:
    """Limit the commands; return the first axis whose command is beyond the bias, or -1."""
    for j in range(len(command)):
        command[j] = min(max(command[j], -bearings.limit[j]), bearings.limit[j])
        if not abs(command[j]) <= bearings.bias[j]:
            return j
    return -1


@njit(cache=True, error_model="numpy")
def _exact_step(
    steps: Any, event: int, held: Any, random: Any, load: Any, x: Any, moved: Any
) -> None:
    moved[:] = 0.0
    _add_product(steps.state[event], x, moved)
    _add_product(steps.command[event], held, moved)
    _add_product(steps.noise[event], random, moved)
    _add_product(steps.load[event], load, moved)
    x[:] = moved


@njit(cache=True, error_model="numpy", inline="always")
def _record(
    log: Any, sample: int, x: Any, reading: Any, command: Any, current: Any, force: Any
) -> None:
    log.state[sample] = x[: log.state.shape[1]]
    log.reading[sample] = reading
    log.command[sample] = command
    log.current[sample] = current
    log.force[sample] = force


@njit(cache=True, error_model="numpy")
def run(
    events: Any, steps: Any, bearings: Any, rotor: Any, loop: Any, loads: Any, log: Any
) -> tuple[int, int, float, float]:
    """Run the rig and fill the log; return a fault (or FINE), its axis, time and size.

    loads holds the cosines and sines of the rotor angle at each event of a linear rig.
    """
    plan = events.pattern
    n, inputs = rotor.force.shape
    x, moved = np.zeros(steps.state.shape[1]), np.zeros(steps.state.shape[1])
    y, stages = np.zeros((2, 2 * n)), np.zeros((7, 2 * n))
    peak = rotor.floor.copy()
    steady, held, newest = np.zeros(n), np.zeros(inputs), np.zeros(inputs)
    coil, current, force = np.zeros(inputs), np.zeros(inputs), np.zeros(inputs)
    memory, scratch = np.zeros(loop.A.shape[0]), np.zeros(loop.A.shape[0])
    waiting = np.zeros((plan.lag + 2, inputs))
    reading = np.zeros(loop.sensors.shape[0])
    tick = 0
    for pattern in range(events.repeats):
        since = pattern - events.settling
        for e in range(len(plan.offset)):
            time = since * plan.duration + plan.offset[e]
            if plan.control[e] >= 0:
                tick = pattern * plan.controls + plan.control[e]
                _read(loop, x, loop.error_at_control[tick], reading)
                step = since * plan.controls + plan.control[e]
                _control(loop, step, reading, memory, scratch, newest)
                axis = _limit(bearings, newest)
                if axis >= 0:
                    return BEYOND_BIAS, axis, time, newest[axis]
                waiting[tick % len(waiting)] = newest
                steady[:] = 0.0
                _add_product(rotor.noise, loop.process[tick], steady)
            due = pattern * plan.controls + plan.apply[e] - plan.lag
            if plan.apply[e] >= 0 and due >= 0:
                held[:] = waiting[due % len(waiting)]
            sample = since * plan.logs + plan.log[e]
            if plan.log[e] >= 0 and 0 <= sample < len(log.state):
                if plan.control[e] < 0:
                    _read(loop, x, loop.error_at_log[sample], reading)
                currents(bearings, coil, held, 0.0, current)
                forces(bearings, x, current, force)
                _record(log, sample, x, reading, newest, current, force)
            axis = _touch(bearings, x)
            if axis >= 0:
                return TOUCH, axis, time, 0.0
            if steps.linear:
                load = loads[pattern * len(plan.offset) + e]
                _exact_step(steps, e, held, loop.process[tick], load, x, moved)
                coil[bearings.lagging] = x[2 * n :]
            else:
                y[0] = x[: 2 * n]
                if not integrate(
                    rotor, bearings, steady, held, time, plan.length[e],
                    coil, y, peak, stages, current, force,
                ):  # fmt: skip
                    return STUCK, 0, time, 0.0
                x[: 2 * n] = y[0]
    return FINE, 0, 0.0, 0.0
