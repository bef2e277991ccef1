"""Compiled: forces, amplifiers, rotor, and their integration between events.

The embedded pair of Dormand and Prince, 5(4), with error control; the amplifiers' currents have a
closed form, as their commands are held. Arguments are the tables of `rotorid.rig.tables`;
y = [q, q'].
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from rotorid.actuators.laws import differential_force

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
