"""What lags in a rig besides its rotor: coils, eddy currents, sensors, filters, as linear states.

Signals are rows over [q, q', i, h, z]: the rotor's motion, the amplifiers' currents i, the same
after the iron's hysteresis h, and the states z, with z' such rows too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rotorid.core.values import Floats
from rotorid.rig.plant import Plant
from rotorid.rig.rig_machine import RigMachine

# Eddy currents: rates over tau, one to each factor of e. What is slower than the first is left to
# it, what is faster than the last follows at once: right to 5e-4 from omega tau = 1e-3 to 0.3, as
# far as a rig goes; faster ones would make the integration of nonlinear rigs stiff for nothing.
_RATES = np.exp(np.arange(-12.0, 5.0))
_CURRENT_FLOOR, _READING_FLOOR = 1e-3, 1e-6  # A, m: below, errors of a state count absolutely


class Lags(NamedTuple):
    """States z beside the rotor's, and the signals that they make.

    Each signal is a matrix over [q, q'] (motion), [i, h] (current) and z (state).
    """

    rate: tuple[Floats, Floats, Floats]  # triple of array: z'
    # triple of array: currents that the forces follow, in the coils, and as the logger gets them,
    # one per input
    effective: tuple[Floats, Floats, Floats]
    coil: tuple[Floats, Floats, Floats]
    recorded: tuple[Floats, Floats, Floats]
    # triple of array: sensors, as the controller and as the logger get them, before noise
    reading: tuple[Floats, Floats, Floats]
    logged: tuple[Floats, Floats, Floats]
    # (state,): size of a state below which errors of the integration count absolutely
    floor: Floats


class _States:
    """States that are added one after the other; a signal is a row over all there may be."""

    def __init__(self, motion: int, inputs: int, most: int) -> None:
        self.motion, self.inputs = motion, inputs
        self.width = motion + 2 * inputs + most
        self.rates: list[Floats] = []
        self.floors: list[float] = []

    def signal(self, index: int) -> Floats:
        return np.asarray(np.arange(self.width) == index, dtype=float)

    def add(self, floor: float) -> Floats:
        """Return the signal of a new state, whose rate is set later."""
        self.rates.append(np.zeros(self.width))
        self.floors.append(floor)
        return self.signal(self.motion + 2 * self.inputs + len(self.rates) - 1)

    def lagged(self, source: Floats, rate: float, floor: float) -> Floats:
        """Return a signal after a lag of first order, rate in 1/s."""
        state = self.add(floor)
        self.rates[-1] = rate * (source - state)
        return state

    def filtered(self, source: Floats, corner: float, floor: float) -> Floats:
        """Return a signal after Butterworth's filter of second order, corner in Hz."""
        if not np.isfinite(corner):
            return source
        w = 2 * np.pi * corner
        level, slope = self.add(floor), self.add(w * floor)
        self.rates[-2] = slope
        self.rates[-1] = w**2 * (source - level) - np.sqrt(2) * w * slope
        return level

    def split(self, rows: list[Floats]) -> tuple[Floats, Floats, Floats]:
        table = np.array(rows).reshape(len(rows), self.width)
        first, second = self.motion, self.motion + 2 * self.inputs
        parts = (table[:, :first], table[:, first:second], table[:, second:])
        motion, current, state = (np.ascontiguousarray(part) for part in parts)
        return motion, current, np.ascontiguousarray(state[:, : len(self.rates)])


def eddy_weights(tau: float) -> tuple[Floats, Floats, float]:
    """Return rates in 1/s and weights of the lags that make 1 / (1 + sqrt(s tau)), and the rest.

    Across its cut at s = -r it jumps by 2 i sqrt(r tau) / (1 + r tau), so it is the integral of
    r / (s + r) times sqrt(r tau) / (pi (1 + r tau)) over log r: a sum by the trapezoidal rule.
    Below r tau = e^u lies the part 2 / pi atan(e^(u / 2)) of its weight.
    """
    weights = np.sqrt(_RATES) / (np.pi * (1 + _RATES))
    edges = _RATES[[0, -1]] * np.exp([-0.5, 0.5])
    slow, all_but_fast = 2 / np.pi * np.arctan(np.sqrt(edges))
    weights[0] += slow
    fast = 1 - all_but_fast
    return _RATES / tau, weights * (1 - fast) / weights.sum(), float(fast)


def build_lags(rig: RigMachine, plant: Plant, sensors: Floats) -> Lags:
    """Return the lags of a rig; sensors is what they read of the coordinates."""
    n, inputs = plant.force.shape
    eddies = sum(part.eddy > 0 for part in rig.parts)
    most = eddies * len(_RATES) + 4 * inputs + 3 * len(sensors)
    states = _States(2 * n, inputs, most)
    current = [_current(rig, plant, states, j) for j in range(inputs)]
    readings = [_reading(rig, states, row, j) for j, row in enumerate(sensors)]
    effective = [row[0] for row in current]
    corner = rig.logger.filter
    recorded = [states.filtered(row[1], corner, _CURRENT_FLOOR) for row in current]
    logged = [states.filtered(row, corner, _READING_FLOOR) for row in readings]
    split = states.split
    return Lags(
        rate=split(states.rates),
        effective=split(effective),
        coil=split([row[1] for row in current]),
        recorded=split(recorded),
        reading=split(readings),
        logged=split(logged),
        floor=np.array(states.floors),
    )


def _current(rig: RigMachine, plant: Plant, states: _States, j: int) -> tuple[Floats, Floats]:
    """Return the currents that the force of an input follows, and that its coil carries."""
    part, inputs = rig.parts[j], states.inputs
    coil, iron = states.signal(states.motion + j), states.signal(states.motion + inputs + j)
    if part.coil is not None:
        resistance, inductance = part.coil.resistance, part.coil.inductance
        w = 2 * np.pi * part.coil.bandwidth
        command, induced = coil, np.zeros(states.width)
        induced[states.motion // 2 : states.motion] = part.slopes[0] * plant.displacement[j]
        coil, integral = states.add(_CURRENT_FLOOR), states.add(_CURRENT_FLOOR * resistance)
        voltage = w * inductance * (command - coil) + integral
        states.rates[-2] = (voltage - resistance * coil - induced) / inductance
        states.rates[-1] = w * resistance * (command - coil)
        iron = coil
    if part.eddy > 0:
        rates, weights, rest = eddy_weights(part.eddy)
        lagged = [states.lagged(iron, rate, _CURRENT_FLOOR) for rate in rates]
        iron = weights @ lagged + rest * iron
    return iron, coil


def _reading(rig: RigMachine, states: _States, row: Floats, j: int) -> Floats:
    signal = np.zeros(states.width)
    signal[: len(row)] = row
    bandwidth = rig.sensors[j].bandwidth
    if not np.isfinite(bandwidth):
        return signal
    return states.lagged(signal, 2 * np.pi * bandwidth, _READING_FLOOR)
