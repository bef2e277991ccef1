"""The compiled loop of a rig: controller, amplifiers, rotor, logger, event by event.

Between events the inputs are constant. A linear rig takes exact steps (matrix exponential); a
nonlinear one, or one whose speed changes, is integrated by the embedded pair of Dormand and Prince,
5(4), with error control; the amplifiers' currents have a closed form, as their commands are held.
What the loop works on are the tables below, plain arrays and numbers.
x = [q, q', lagging currents, z], y = [q, q', z], z the states of `rotorid.rig.plant`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from scipy.integrate import RK45

from rotorid.core.values import Floats, Integers
from rotorid.force.laws import magnet_fluxes
from rotorid.rig.machine import Schedule
from rotorid.rig.parts import angle_and_speed
from rotorid.rig.plant import Lags, Plant


class Events(NamedTuple):
    """The pattern of events, how often it is repeated, and how often before the record begins."""

    pattern: Schedule
    repeats: int
    settling: int


class Steps(NamedTuple):
    """Exact steps of a linear rig from each event of the pattern to the next, (event, state, ..).

    ``x[+] = state x + command c + noise w + load e`` with c the held commands, w the held random
    forces, e = [cos h phi, sin h phi, ...] at the event.
    """

    linear: bool
    state: Floats
    command: Floats
    noise: Floats
    load: Floats


class Bearings(NamedTuple):
    """Actuators, one entry per input.

    kind is 0 for F = ki i + ks x, 1 for two opposed magnets, 2 for such without bias; law holds
    the constants, which change by heating in a second. Commands are limited to +-limit; current
    beyond bias is a fault.
    lagging holds the inputs whose amplifier lags; hysteresis is half the width of the iron's loop.
    pair is the other axis of the same auxiliary bearing, or -1; contact and friction are what the
    bearing answers a touch with, in N/m and N per N, and what ends the run where contact is 0.
    """

    kind: Integers
    law: Floats
    heating: Floats
    limit: Floats
    bias: Floats
    time_constant: Floats
    lagging: Integers
    slew: Floats
    hysteresis: Floats
    displacement: Floats
    clearance: Floats
    pair: Integers
    contact: float
    friction: float


class RotorTable(NamedTuple):
    plant: Plant
    noise: Floats
    rotation: Floats
    tolerance: float
    floor: Floats


class Loop(NamedTuple):
    """Controller, sensors and what is known of them beforehand.

    error_at_control and error_at_log hold noise, bias and runout of each sensor, drawn and
    computed beforehand; where both clocks tick, the logger sees what the controller saw, unless
    it has a filter. cubic and heating bend and drift the readings; gain multiplies the
    controller's answer at each step. B and D are over all sensors, fed back or not.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    quantum: Floats
    cubic: Floats
    heating: Floats
    filtered: bool
    error_at_control: Floats
    error_at_log: Floats
    excitation: Floats
    process: Floats
    gain: Floats


class Tables(NamedTuple):
    """All that a run is made of; loads holds the harmonics' cosines and sines at each event."""

    events: Events
    steps: Steps
    bearings: Bearings
    rotor: RotorTable
    lags: Lags
    loop: Loop
    loads: Floats


class Log(NamedTuple):
    """What is recorded, one row per sample; filled by `run`.

    recorded and effective, the currents as the logger gets them and as the forces follow them,
    have `every` rows per sample.
    """

    state: Floats
    reading: Floats
    command: Floats
    current: Floats
    force: Floats
    recorded: Floats
    effective: Floats
    every: int


_fluxes = njit(magnet_fluxes, error_model="numpy")
_angle_and_speed = njit(angle_and_speed, error_model="numpy")

# Dormand and Prince 1980: nodes; stages, the last the step of order 5; its difference to order 4.
_C = np.append(RK45.C, 1.0)
_A = np.vstack([np.pad(RK45.A, ((0, 0), (0, 1))), RK45.B])
_E = RK45.E


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


@njit(cache=True, error_model="numpy")
def _copy(values: Any, out: Any) -> None:
    """Copy: an assignment of arrays brings the text of its refusal, 10 s of compiling in all."""
    for r in range(len(out)):
        out[r] = values[r]


@njit(cache=True, error_model="numpy", inline="always")
def _displacement(displacement: Any, j: int, position: Any) -> float:
    x = 0.0
    for k in range(displacement.shape[1]):
        x += displacement[j, k] * position[k]
    return x


@njit(cache=True, error_model="numpy", inline="always")
def _forces(displacement: Any, kind: Any, laws: Any, position: Any, current: Any, out: Any) -> None:
    """Compute the forces; past the poles the gap stays at a thousandth of itself."""
    for j in range(len(out)):
        x = _displacement(displacement, j, position)
        law = laws[j]
        if kind[j] == 0:
            out[j] = law[0] * current[j] + law[1] * x
        else:
            most = 0.999 * law[2] / law[3]
            x = min(max(x, -most), most)
            ahead, behind = _fluxes(current[j], x, (law[1], law[2], law[3], law[4], law[5], law[6]))
            out[j] = law[0] * law[3] * (ahead * ahead - behind * behind)


@njit(cache=True, error_model="numpy", inline="always")
def _played(held: float, width: float, current: float) -> float:
    """Return where a play operator of half a width stands after its input has gone to a current.

    The input was inside the play and went there without turning: as a held command makes it go.
    """
    return min(max(held, current - width), current + width)


@njit(cache=True, error_model="numpy", inline="always")
def _signal(table: Any, y: Any, first: int, current: Any, iron: Any, z: int, out: Any) -> None:
    motion, electric, state = table
    inputs = len(current)
    for r in range(motion.shape[0]):
        total = 0.0
        for k in range(motion.shape[1]):
            total += motion[r, k] * y[k]
        for k in range(inputs):
            total += electric[r, k] * current[k] + electric[r, inputs + k] * iron[k]
        for k in range(state.shape[1]):
            total += state[r, k] * y[z + k]
        out[first + r] = total


@njit(cache=True, error_model="numpy", inline="always")
def _contact(bearings: Any, position: Any, forward: float, force: Any) -> None:
    """Add what the auxiliary bearings push back with, and the friction on the turning shaft."""
    for j in range(len(force)):
        other = bearings.pair[j]
        if other >= 0 and other < j:
            continue
        x = _displacement(bearings.displacement, j, position)
        y = _displacement(bearings.displacement, other, position) if other >= 0 else 0.0
        radius = math.sqrt(x * x + y * y)
        over = radius - bearings.clearance[j]
        if over <= 0.0:
            continue
        normal = bearings.contact * over / radius
        drag = forward * bearings.friction * normal
        force[j] += drag * y - normal * x
        if other >= 0:
            force[other] += -drag * x - normal * y


@njit(cache=True, error_model="numpy", inline="always")
def _currents(time_constant: Any, slew: Any, start: Any, held: Any, time: float, out: Any) -> None:
    for j in range(len(out)):
        out[j] = coil_current(start[j], held[j], time_constant[j], slew[j], time)


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
    """Compute the derivative of [q, q'] from forces, rotor angle and speed s."""
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


@njit(cache=True, error_model="numpy", inline="always")
def _stage_point(y: Any, stages: Any, stage: int, h: float) -> None:
    """Set y[1] to where a stage of the step is evaluated."""
    for r in range(y.shape[1]):
        y[1, r] = y[0, r]
    for m in range(stage):
        weight = h * _A[stage, m]
        for r in range(y.shape[1]):
            y[1, r] += weight * stages[m, r]


@njit(cache=True, error_model="numpy", inline="always")
def _step_error(y: Any, stages: Any, peak: Any, h: float) -> float:
    """Return the error of a step, relative to the largest size of each state."""
    error = 0.0
    for r in range(y.shape[1]):
        part = 0.0
        for m in range(7):
            part += _E[m] * stages[m, r]
        relative = abs(h * part) / max(abs(y[1, r]), peak[r])
        error = error if relative <= error else relative  # NaN stays
    return error


@njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract"})
def integrate(
    rotor: Any,
    bearings: Any,
    lags: Any,
    laws: Any,
    steady: Any,
    held: Any,
    begin: float,
    length: float,
    coil: Any,
    iron: Any,
    y: Any,
    peak: Any,
    stages: Any,
    room: Any,
) -> bool:
    """Carry y[0] over an interval of constant inputs; False where no step is small enough.

    coil and iron hold the amplifiers' currents, and those after hysteresis, at the beginning and,
    on return, at the end; laws the constants of the forces; peak the largest size of each state so
    far, to which errors are relative; steady the accelerations that are held; y[1], stages and
    room are room to work in.
    """
    # The arrays are taken out of their tables once: each access, or call, would count references.
    plant = rotor.plant
    motion, load, harmonics, per_force = plant.motion, plant.load, plant.harmonics, plant.force
    displacement, kind, width = bearings.displacement, bearings.kind, bearings.hysteresis
    lag, slew, rotation = bearings.time_constant, bearings.slew, rotor.rotation
    current, played, effective, force = room[0], room[1], room[2], room[3]
    n, states, done, h, first = 2 * len(steady), y.shape[1], 0.0, length, True
    while done < length:
        last = h >= length - done
        h = length - done if last else h
        for stage in range(0 if first else 1, 7):
            c = _C[stage]
            _stage_point(y, stages, stage, h)
            angle, omega = _angle_and_speed(rotation, begin + done + c * h)
            s = (omega - plant.centre) / plant.width
            _currents(lag, slew, coil, held, done + c * h, current)
            for j in range(len(current)):
                played[j] = _played(iron[j], width[j], current[j])
            _signal(lags.effective, y[1], 0, current, played, n, effective)
            _forces(displacement, kind, laws, y[1], effective, force)
            if bearings.contact > 0.0:
                _contact(bearings, y[1], 1.0 if omega >= 0.0 else -1.0, force)
            _accelerations(
                motion, load, harmonics, per_force, angle, s, y[1], force, steady, stages[stage]
            )
            _signal(lags.rate, y[1], n, current, played, n, stages[stage])
        first = False
        error = _step_error(y, stages, peak, h) / rotor.tolerance
        if error <= 1.0:
            for r in range(states):
                peak[r] = max(abs(y[1, r]), peak[r])
            done = length if last else done + h
            _copy(y[1], y[0])
            _copy(stages[6], stages[0])
            h *= min(5.0, 0.9 * max(error, 1e-10) ** -0.2)
        else:  # NaN too
            h *= max(0.1, 0.9 * error**-0.2) if error < np.inf else 0.1
            if h < 1e-9 * length:
                return False
    _currents(lag, slew, coil, held, length, current)
    _copy(current, coil)
    for j in range(len(coil)):
        iron[j] = _played(iron[j], width[j], coil[j])
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
    for j in range(len(bearings.clearance)):
        square = _displacement(bearings.displacement, j, position) ** 2
        if bearings.pair[j] >= 0:
            square += _displacement(bearings.displacement, bearings.pair[j], position) ** 2
        if not square <= bearings.clearance[j] ** 2:
            return j
    return -1


@njit(cache=True, error_model="numpy")
def _read(loop: Any, time: float, error: Any, out: Any) -> None:
    """Turn what the sensors stand before into what they say."""
    for r in range(len(out)):
        total, quantum = out[r], loop.quantum[r]
        total *= 1.0 + loop.cubic[r] * total * total
        total = total * (1.0 + loop.heating[r] * max(time, 0.0)) + error[r]
        out[r] = np.rint(total / quantum) * quantum if quantum > 0 else total


@njit(cache=True, error_model="numpy")
def _control(loop: Any, step: int, reading: Any, memory: Any, scratch: Any, command: Any) -> None:
    """Turn reading into command, move the state on; step counts from the first sample recorded."""
    command[:] = 0.0
    scratch[:] = 0.0
    _add_product(loop.C, memory, command)
    _add_product(loop.D, reading, command)
    gain = loop.gain[min(max(step, 0), len(loop.gain) - 1)]
    played = loop.excitation[step % len(loop.excitation)]
    for j in range(len(command)):
        command[j] = gain * command[j] + played[j]
    _add_product(loop.A, memory, scratch)
    _add_product(loop.B, reading, scratch)
    _copy(scratch, memory)


@njit(cache=True, error_model="numpy")
def _limit(bearings: Any, command: Any) -> int:
    """Limit the commands; return the first axis whose command is beyond the bias, or -1.

    Without bias a command is a force, which is turned into the current that gives it at the centre.
    """
    for j in range(len(command)):
        if bearings.kind[j] == 2:
            law = bearings.law[j]
            size = (law[2] + law[5]) * math.sqrt(abs(command[j]) / (law[0] * law[3]))
            command[j] = size if command[j] > 0 else -size
        command[j] = min(max(command[j], -bearings.limit[j]), bearings.limit[j])
        if not abs(command[j]) <= bearings.bias[j]:
            return j
    return -1


@njit(cache=True, error_model="numpy", inline="always")
def _heat(law: Any, heating: Any, time: float, laws: Any) -> None:
    for j in range(laws.shape[0]):
        for k in range(laws.shape[1]):
            laws[j, k] = law[j, k] + heating[j, k] * max(time, 0.0)


@njit(cache=True, error_model="numpy", inline="always")
def _step(exact: Any, e: int, held: Any, noise: Any, load: Any, moved: Any, x: Any) -> None:
    """Take the exact step from an event to the next."""
    moved[:] = 0.0
    _add_product(exact.state[e], x, moved)
    _add_product(exact.command[e], held, moved)
    _add_product(exact.noise[e], noise, moved)
    _add_product(exact.load[e], load, moved)
    _copy(moved, x)


def room_of(tables: Tables) -> tuple[Floats, ...]:
    """Return what `run` works on, in its order: a rig at rest, in the middle, without currents."""
    plant, floor = tables.rotor.plant, tables.lags.floor
    n, inputs = plant.force.shape
    states = 2 * n + len(floor)
    x, moved = np.zeros((2, tables.steps.state.shape[1]))
    held, newest, coil, iron = np.zeros((4, inputs))
    memory, scratch = np.zeros((2, len(tables.loop.A)))
    reading, shown = np.zeros((2, len(tables.loop.quantum)))
    peak = np.concatenate((tables.rotor.floor, floor))
    y, stages, room = np.zeros((2, states)), np.zeros((7, states)), np.zeros((4, inputs))
    laws, waiting = tables.bearings.law.copy(), np.zeros((tables.events.pattern.lag + 2, inputs))
    return (x, moved, y, stages, peak, np.zeros(n), held, newest, coil, iron, room, laws, memory,
            scratch, waiting, reading, shown)  # fmt: skip


@njit(cache=True, error_model="numpy", nogil=True)  # others look how far it is
def run(tables: Any, working: Any, log: Any) -> tuple[int, int, float, float]:
    """Run the rig and fill the log; return a fault (or FINE), its axis, time and size.

    What works on many tables stands here: handed to another function, they would count references
    at each event, which takes half as long again.
    """
    events, steps, bearings, rotor, lags, loop, loads = tables
    (x, moved, y, stages, peak, steady, held, newest, coil, iron, room, laws, memory, scratch,
     waiting, reading, shown) = working  # fmt: skip
    plan, current, played = events.pattern, room[0], room[1]
    displacement, kind = bearings.displacement, bearings.kind
    lag, slew = bearings.time_constant, bearings.slew
    n, z, tick = 2 * len(steady), len(x) - len(lags.floor), 0
    for event in range(events.repeats * len(plan.offset)):
        pattern, e = event // len(plan.offset), event % len(plan.offset)
        since, reads = pattern - events.settling, plan.control[e] >= 0
        time = since * plan.duration + plan.offset[e]
        _heat(bearings.law, bearings.heating, time, laws)
        if reads:
            tick = pattern * plan.controls + plan.control[e]
            _signal(lags.reading, x, 0, coil, iron, z, reading)
            _read(loop, time, loop.error_at_control[tick], reading)
            step = since * plan.controls + plan.control[e]
            _control(loop, step, reading, memory, scratch, newest)
            axis = _limit(bearings, newest)
            if axis >= 0:
                return BEYOND_BIAS, axis, time, newest[axis]
            _copy(newest, waiting[tick % len(waiting)])
            steady[:] = 0.0
            _add_product(rotor.noise, loop.process[tick], steady)
        due = pattern * plan.controls + plan.apply[e] - plan.lag
        if plan.apply[e] >= 0 and due >= 0:
            _copy(waiting[due % len(waiting)], held)
        fine = since * plan.logs + plan.log[e]
        if plan.log[e] >= 0 and 0 <= fine < len(log.recorded):
            _currents(lag, slew, coil, held, 0.0, current)
            for j in range(len(held)):
                played[j] = _played(iron[j], bearings.hysteresis[j], current[j])
            _signal(lags.effective, x, 0, current, played, z, log.effective[fine])
            _signal(lags.recorded, x, 0, current, played, z, log.recorded[fine])
            if fine % log.every == 0:
                sample = fine // log.every
                _copy(x, log.state[sample])
                _copy(newest, log.command[sample])
                _copy(reading, shown)
                if not reads or loop.filtered:
                    error = loop.error_at_control[tick] if reads else loop.error_at_log[sample]
                    _signal(lags.logged, x, 0, current, played, z, shown)
                    _read(loop, time, error, shown)
                _copy(shown, log.reading[sample])
                _signal(lags.coil, x, 0, current, played, z, log.current[sample])
                _forces(displacement, kind, laws, x, log.effective[fine], log.force[sample])
        axis = _touch(bearings, x) if bearings.contact == 0.0 else -1
        if axis >= 0:
            return TOUCH, axis, time, 0.0
        if steps.linear:
            _step(steps, e, held, loop.process[tick], loads[event], moved, x)
            _copy(held, coil)
            for j in range(z - n):
                coil[bearings.lagging[j]] = x[n + j]
            continue
        _copy(x[:n], y[0, :n])
        _copy(x[z:], y[0, n:])
        if not integrate(
            rotor, bearings, lags, laws, steady, held, time, plan.length[e], coil, iron, y, peak,
            stages, room,
        ):  # fmt: skip
            return STUCK, 0, time, 0.0
        _copy(y[0, :n], x[:n])
        _copy(y[0, n:], x[z:])
    return FINE, 0, 0.0, 0.0
