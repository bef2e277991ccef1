"""The compiled loop of a rig: controller, amplifiers, rotor, logger, event by event.

Between events the inputs are constant. A linear rig takes exact steps (matrix exponential); a
nonlinear one, or one whose speed changes, is integrated by the embedded pair of Dormand and Prince,
5(4), with error control; the amplifiers' currents have a closed form, as their commands are held.
What the loop works on are the tables below, plain arrays and numbers.
x = [q, q', lagging currents], y = [q, q'].
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from rotorid.actuators.laws import differential_force
from rotorid.record import Floats, Integers
from rotorid.rig.schedule import Schedule


class Events(NamedTuple):
    """The pattern of events, how often it is repeated, and how often before the record begins."""

    pattern: Schedule
    repeats: int
    settling: int


class Steps(NamedTuple):
    """Exact steps of a linear rig, as `plant.Transitions`; (event, state, ...)."""

    linear: bool
    state: Floats
    command: Floats
    noise: Floats
    load: Floats


class Bearings(NamedTuple):
    """Actuators, one entry per input.

    kind is 0 for F = ki i + ks x, 1 for two opposed magnets; law holds the constants. Commands
    are limited to +-limit; current beyond bias is a fault. lagging holds the inputs whose
    amplifier lags. pair is the other axis of the same auxiliary bearing, or -1.
    """

    kind: Integers
    law: Floats
    limit: Floats
    bias: Floats
    time_constant: Floats
    lagging: Integers
    slew: Floats
    displacement: Floats
    clearance: Floats
    pair: Integers


class Rotor(NamedTuple):
    """Accelerations as `plant.Plant`, and the rotation as `speed.Rotation`."""

    motion: Floats
    load: Floats
    harmonics: Integers
    force: Floats
    noise: Floats
    centre: float
    width: float
    rotation: Floats
    tolerance: float
    floor: Floats


class Loop(NamedTuple):
    """Controller, sensors and what is known of them beforehand.

    error_at_control and error_at_log hold noise, bias and runout of each sensor, drawn and
    computed beforehand; where both clocks tick, the logger sees what the controller saw.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    reads: Integers
    sensors: Floats
    quantum: Floats
    error_at_control: Floats
    error_at_log: Floats
    excitation: Floats
    process: Floats


class Log(NamedTuple):
    """What is recorded, one row per sample; filled by `run`."""

    state: Floats
    reading: Floats
    command: Floats
    current: Floats
    force: Floats


_differential = njit(differential_force, error_model="numpy")

# Dormand and Prince 1980: nodes; stages, the last the step of order 5; its difference to order 4.
_C = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
_A = np.array(
    [
        [0, 0, 0, 0, 0, 0],
        [1 / 5, 0, 0, 0, 0, 0],
        [3 / 40, 9 / 40, 0, 0, 0, 0],
        [44 / 45, -56 / 15, 32 / 9, 0, 0, 0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0, 0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0],
        [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
_E = np.array([71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])


@njit(cache=True, error_model="numpy")
def angle_and_speed(rotation: Any, time: float) -> tuple[float, float]:
    """Return phi and Omega as `Rotation.angle_at` and `Rotation.speed_at`."""
    speed, acceleration, drift, period, phase = rotation
    t = max(time, 0.0)
    rate = 2 * np.pi / period
    angle = phase + speed * time + acceleration * t * t / 2
    omega = speed + acceleration * t
    if drift != 0.0:
        angle += drift / rate * (1 - np.cos(rate * t))
        omega += drift * np.sin(rate * t)
    return angle, omega


@njit(cache=True, error_model="numpy")
def coil_current(start: float, command: float, lag: float, slew: float, time: float) -> float:
    """Return the current of an amplifier of first order with limited slope, in closed form."""
    if lag == 0.0:
        return command
    gap = command - start
    side = 1.0 if gap > 0 else -1.0
    excess = abs(gap) - slew * lag  # at full slope until the rest is slew * lag
    if excess > 0:
        ramp = excess / slew
        if time <= ramp:
            return start + side * slew * time
        return command - side * slew * lag * math.exp(-(time - ramp) / lag)
    return command - gap * math.exp(-time / lag)


@njit(cache=True, error_model="numpy", inline="always")
def _forces(displacement: Any, kind: Any, laws: Any, position: Any, current: Any, out: Any) -> None:
    """Compute the forces; past the poles the gap stays at a thousandth of itself."""
    for j in range(len(out)):
        x = 0.0
        for k in range(displacement.shape[1]):
            x += displacement[j, k] * position[k]
        if kind[j] == 0:
            out[j] = laws[j, 0] * current[j] + laws[j, 1] * x
        else:
            most = 0.999 * laws[j, 2] / laws[j, 3]
            x = min(max(x, -most), most)
            out[j] = _differential(current[j], x, laws[j, 0], laws[j, 1], laws[j, 2], laws[j, 3])


@njit(cache=True, error_model="numpy")
def forces(bearings: Any, position: Any, current: Any, out: Any) -> None:
    """Compute the forces of the actuators."""
    _forces(bearings.displacement, bearings.kind, bearings.law, position, current, out)


@njit(cache=True, error_model="numpy", inline="always")
def _currents(time_constant: Any, slew: Any, start: Any, held: Any, time: float, out: Any) -> None:
    for j in range(len(out)):
        out[j] = coil_current(start[j], held[j], time_constant[j], slew[j], time)


@njit(cache=True, error_model="numpy")
def currents(bearings: Any, start: Any, held: Any, time: float, out: Any) -> None:
    """Compute the currents, some time after they were start and the commands held began."""
    _currents(bearings.time_constant, bearings.slew, start, held, time, out)


@njit(cache=True, error_model="numpy", inline="always")
def _accelerations(
    motion: Any,
    load: Any,
    harmonics: Any,
    per_force: Any,
    angle: float,
    s: float,
    y: Any,
    force: Any,
    steady: Any,
    out: Any,
) -> None:
    """Compute the derivative of y = [q, q'] from forces, rotor angle and speed s."""
    n = len(steady)
    for r in range(n):
        out[r] = y[n + r]
        total = steady[r]
        for j in range(len(force)):
            total += per_force[r, j] * force[j]
        out[n + r] = total
    power = 1.0
    for d in range(motion.shape[0]):
        for r in range(n):
            total = 0.0
            for k in range(2 * n):
                total += motion[d, r, k] * y[k]
            out[n + r] += power * total
        power *= s
    for h in range(len(harmonics)):
        turn = harmonics[h] * angle
        cosine, sine = math.cos(turn), math.sin(turn)
        for d in range(load.shape[0]):
            for r in range(n):
                out[n + r] += load[d, h, r, 0] * cosine + load[d, h, r, 1] * sine
            cosine, sine = cosine * s, sine * s


@njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract"})
def integrate(
    rotor: Any,
    bearings: Any,
    steady: Any,
    held: Any,
    begin: float,
    length: float,
    coil: Any,
    y: Any,
    peak: Any,
    stages: Any,
    current: Any,
    force: Any,
) -> bool:
    """Carry y[0] over an interval of constant inputs; False where no step is small enough.

    coil holds the amplifiers' currents at the beginning and, on return, at the end; peak the
    largest size of each state so far, to which errors are relative; steady the accelerations that
    are held; y[1], stages, current and force are room to work in.
    """
    # The arrays are taken out of their tables once: each access, or call, would count references.
    motion, load, harmonics, per_force = rotor.motion, rotor.load, rotor.harmonics, rotor.force
    displacement, kind, laws = bearings.displacement, bearings.kind, bearings.law
    lag, slew, rotation = bearings.time_constant, bearings.slew, rotor.rotation
    states, done, h, first = y.shape[1], 0.0, length, True
    while done < length:
        last = h >= length - done
        h = length - done if last else h
        for stage in range(0 if first else 1, 7):
            c = _C[stage]
            for r in range(states):
                y[1, r] = y[0, r]
            for m in range(stage):
                weight = h * _A[stage, m]
                for r in range(states):
                    y[1, r] += weight * stages[m, r]
            angle, omega = angle_and_speed(rotation, begin + done + c * h)
            s = (omega - rotor.centre) / rotor.width
            _currents(lag, slew, coil, held, done + c * h, current)
            _forces(displacement, kind, laws, y[1], current, force)
            _accelerations(
                motion, load, harmonics, per_force, angle, s, y[1], force, steady, stages[stage]
            )
        first = False
        error = 0.0
        for r in range(states):
            part = 0.0
            for m in range(7):
                part += _E[m] * stages[m, r]
            peak[r] = max(abs(y[1, r]), peak[r])
            error = max(error, abs(h * part) / peak[r])
        error /= rotor.tolerance
        if error <= 1.0:
            done = length if last else done + h
            y[0] = y[1]
            stages[0] = stages[6]
            h *= min(5.0, 0.9 * max(error, 1e-10) ** -0.2)
        else:  # NaN too
            h *= max(0.1, 0.9 * error**-0.2) if error < np.inf else 0.1
            if h < 1e-9 * length:
                return False
    _currents(lag, slew, coil, held, length, current)
    coil[:] = current
    return True


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
