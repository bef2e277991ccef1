"""Compiled: forces, amplifiers, rotor, and their integration between events.

The embedded pair of Dormand and Prince, 5(4), with error control; the amplifiers' currents have a
closed form, as their commands are held. Arguments are the tables of `rotorid.simulation.tables`;
y = [q, q'].
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from rotorid.actuators.laws import differential_force

_differential = njit(differential_force, error_model="numpy")

# Dormand and Prince 1980: nodes, stages, weights of order 5, and 5 less 4.
_C = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0])
_A = np.array(
    [
        [0, 0, 0, 0, 0],
        [1 / 5, 0, 0, 0, 0],
        [3 / 40, 9 / 40, 0, 0, 0],
        [44 / 45, -56 / 15, 32 / 9, 0, 0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656],
    ]
)
_B = np.array([35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84])
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


@njit(cache=True, error_model="numpy")
def forces(bearings: Any, position: Any, current: Any, out: Any) -> None:
    """Compute the forces; past the poles the gap stays at a thousandth of itself."""
    for j in range(len(out)):
        x = 0.0
        for k in range(bearings.displacement.shape[1]):
            x += bearings.displacement[j, k] * position[k]
        law = bearings.law[j]
        if bearings.kind[j] == 0:
            out[j] = law[0] * current[j] + law[1] * x
        else:
            most = 0.999 * law[2] / law[3]
            x = min(max(x, -most), most)
            out[j] = _differential(current[j], x, law[0], law[1], law[2], law[3])


@njit(cache=True, error_model="numpy")
def derivative(
    rotor: Any, bearings: Any, steady: Any, time: float, y: Any, current: Any, force: Any, out: Any
) -> None:
    """Compute the derivative of y = [q, q']; steady holds the accelerations that are held."""
    n = rotor.force.shape[1]
    angle, omega = angle_and_speed(rotor.rotation, time)
    forces(bearings, y, current, force)
    for r in range(n):
        out[r] = y[n + r]
        out[n + r] = steady[r]
    acceleration = out[n:]
    for j in range(len(force)):
        for r in range(n):
            acceleration[r] += rotor.force[j, r] * force[j]
    power = 1.0
    for d in range(rotor.motion.shape[0]):
        for k in range(2 * n):
            factor = power * y[k]
            for r in range(n):
                acceleration[r] += rotor.motion[d, k, r] * factor
        power *= (omega - rotor.centre) / rotor.width
    for h in range(len(rotor.harmonics)):
        turn = rotor.harmonics[h] * angle
        c, s = math.cos(turn), math.sin(turn)
        for d in range(rotor.load.shape[0]):
            for r in range(n):
                acceleration[r] += rotor.load[d, h, 0, r] * c + rotor.load[d, h, 1, r] * s
            c, s = (
                c * (omega - rotor.centre) / rotor.width,
                s * (omega - rotor.centre) / rotor.width,
            )


@njit(cache=True, error_model="numpy")
def currents(bearings: Any, start: Any, held: Any, time: float, out: Any) -> None:
    """Compute the currents, some time after they were start and the commands held began."""
    for j in range(len(out)):
        out[j] = coil_current(start[j], held[j], bearings.time_constant[j], bearings.slew[j], time)


@njit(cache=True, error_model="numpy")
def _trial(
    rotor: Any,
    bearings: Any,
    steady: Any,
    held: Any,
    clock: tuple[float, float, float],
    coil: Any,
    y: Any,
    peak: Any,
    stages: Any,
    current: Any,
    force: Any,
) -> float:
    """Take one step from y[0] to y[1]; return its error over the tolerance.

    clock holds the time at which the interval began, what of it is done, and the step.
    """
    begin, done, h = clock
    for stage in range(1, 7):
        c = _C[stage] if stage < 6 else 1.0
        y[1] = y[0]
        for m in range(stage):
            weight = h * (_A[stage, m] if stage < 6 else _B[m])
            for r in range(y.shape[1]):
                y[1, r] += weight * stages[m, r]
        currents(bearings, coil, held, done + c * h, current)
        derivative(
            rotor, bearings, steady, begin + done + c * h, y[1], current, force, stages[stage]
        )
    worst = 0.0
    for r in range(y.shape[1]):
        error = 0.0
        for m in range(7):
            error += _E[m] * stages[m, r]
        size = max(abs(y[1, r]), peak[r])
        peak[r] = size
        worst = max(worst, abs(h * error) / size)
    return float(worst / rotor.tolerance)


@njit(cache=True, error_model="numpy")
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
    largest size of each state so far, to which errors are relative.
    """
    done, h = 0.0, length
    currents(bearings, coil, held, 0.0, current)
    derivative(rotor, bearings, steady, begin, y[0], current, force, stages[0])
    while done < length:
        last = h >= length - done
        h = length - done if last else h
        error = _trial(
            rotor, bearings, steady, held, (begin, done, h), coil, y, peak, stages, current, force
        )
        if error <= 1.0:
            done = length if last else done + h
            y[0] = y[1]
            stages[0] = stages[6]
            h *= min(5.0, 0.9 * max(error, 1e-10) ** -0.2)
        else:  # NaN too
            h *= max(0.1, 0.9 * error**-0.2) if error < np.inf else 0.1
            if h < 1e-9 * length:
                return False
    currents(bearings, coil, held, length, current)
    coil[:] = current
    return True
