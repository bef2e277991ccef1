"""The rotor of a rig, and what lags beside it: coils, eddy currents, sensors, filters.

The rotor's accelerations follow from positions, velocities, forces and loads. Signals of what lags
are rows over [q, q', i, h, z]: the rotor's motion, the amplifiers' currents i, the same after the
iron's hysteresis h, and linear states z, with z' such rows too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial
from numpy.polynomial.chebyshev import chebpts1

from rotorid.core.errors import ModelError
from rotorid.core.values import Floats, Integers
from rotorid.models.linear_form import LinearForm
from rotorid.models.model import Model
from rotorid.rig.parts import Actuator, PositionSensor, Rotation

_DEGREE = 4
_ANGLES = 64


class Plant(NamedTuple):
    """A linear rotor whose matrices are polynomials of the speed.

    ``q'' = sum_d s^d (motion[d] [q; q'] + sum_h load[d, h] [cos h phi; sin h phi]) + force F``
    with ``s = (Omega - centre) / width``; at constant speed d = 0 alone.
    """

    motion: Floats  # (degree, coordinate, 2 coordinate)
    # (degree, harmonic, coordinate, 2): acceleration by the loads: cosine and sine of the harmonics
    # of the rotor angle
    load: Floats
    harmonics: Integers  # (harmonic,)
    force: Floats  # (coordinate, input): acceleration per force
    mass: Floats  # (row, coordinate)
    displacement: Floats  # (input, coordinate): what each actuator's displacement is made of
    # rad/s
    centre: float
    width: float

    def at(self, speed: float) -> Plant:
        powers = ((speed - self.centre) / self.width) ** np.arange(len(self.motion))
        load_powers = ((speed - self.centre) / self.width) ** np.arange(len(self.load))
        return self._replace(
            motion=np.tensordot(powers, self.motion, 1)[None],
            load=np.tensordot(load_powers, self.load, 1)[None],
        )


def rotor_plant(
    model: Model, values: Floats, rotation: Rotation, end: float, work: Floats | None = None
) -> Plant:
    """Return the plant; `work` is B as it really is, where it is not the model's."""
    linear = model.require_linear()
    low, high = rotation.range_until(end)
    centre, width = (low + high) / 2, (high - low) / 2 or 1.0
    nodes = [centre] if rotation.constant else list(centre + width * chebpts1(_DEGREE + 1))
    mass = _mass(linear, values, nodes)
    B = linear.matrices(values, centre).B if work is None else work
    if np.abs(mass - mass.T).max() > 1e-9 * np.abs(mass).max():
        expected = "each equation the balance of the forces that do work on its coordinate"
        cure = "order and scale the equations so"
        raise ModelError("a mass matrix that is not symmetric", expected, cure)
    harmonics, loads = _load_harmonics(linear, values, nodes)
    plant = Plant(
        motion=_in_speed(np.array([_motion(linear, values, mass, speed) for speed in nodes])),
        load=_in_speed(np.asarray(np.linalg.solve(mass, loads), dtype=float)),
        harmonics=harmonics,
        force=np.asarray(np.linalg.solve(mass, B), dtype=float),
        mass=mass,
        displacement=np.ascontiguousarray(B.T),
        centre=centre,
        width=width,
    )
    between = centre if rotation.constant else centre + 0.31 * width
    exact = _motion(linear, values, mass, between)
    if np.abs(plant.at(between).motion[0] - exact).max() > 1e-9 * np.abs(exact).max(initial=0.0):
        found = "a matrix that is no polynomial of Omega of degree 4"
        raise ModelError(found, "one, where the speed changes", "run at constant speed")
    return plant


def _motion(linear: LinearForm, values: Floats, mass: Floats, speed: float) -> Floats:
    m = linear.matrices(values, speed)
    return np.asarray(-np.linalg.solve(mass, np.hstack([m.K, m.D + speed * m.G])))


def _in_speed(values: Floats) -> Floats:
    """Turn values at the Chebyshev nodes into coefficients of a polynomial."""
    count = len(values)
    if count == 1:
        return values
    flat = values.reshape(count, -1)
    coefficients = polynomial.polyfit(chebpts1(count), flat, count - 1)
    coefficients[np.abs(coefficients) < 1e-11 * np.abs(flat).max(initial=0.0)] = 0.0
    used = np.flatnonzero(coefficients.any(axis=1))
    degree = int(used[-1]) + 1 if used.size else 1
    return np.asarray(coefficients[:degree].reshape(degree, *values.shape[1:]))


def _mass(linear: LinearForm, values: Floats, nodes: Sequence[float]) -> Floats:
    linear.require_square()
    masses = [linear.matrices(values, speed).M for speed in nodes]
    first = masses[0]
    scale = np.abs(first).max(initial=0.0)
    if any(np.abs(mass - first).max(initial=0.0) > 1e-12 * scale for mass in masses):
        expected = "constant masses where the speed changes"
        raise ModelError("a mass that depends on the speed", expected, "run at constant speed")
    diagonal = np.sqrt(np.abs(first).max(axis=1, initial=0.0))
    balanced = first / np.where(diagonal > 0, diagonal, 1)[:, None]
    balanced = balanced / np.where(diagonal > 0, diagonal, 1)
    if not np.isfinite(first).all() or np.linalg.cond(balanced) > 1e12:
        cure = "give every coordinate a mass, or eliminate it"
        raise ModelError("a coordinate without mass", "a mass matrix that can be inverted", cure)
    return first


def _load_harmonics(
    linear: LinearForm, values: Floats, nodes: Sequence[float]
) -> tuple[Integers, Floats]:
    """Return the harmonics of the rotor angle in g, and g, shape (node, harmonic, row, 2)."""
    mu = linear.monomial_values(values)
    angle = 2 * np.pi * np.arange(_ANGLES) / _ANGLES
    spectra = []
    for speed in nodes:
        load = linear.load_columns(np.zeros(_ANGLES), angle, speed) @ mu
        again = linear.load_columns(np.full(_ANGLES, 1.2345), angle + 6 * np.pi, speed) @ mu
        spectrum = np.fft.rfft(load, axis=0, norm="forward")
        largest = np.abs(load).max(initial=0.0)
        rough = np.abs(spectrum[_ANGLES // 4 :]).max(initial=0.0) > 1e-9 * largest
        if rough or np.abs(load - again).max(initial=0.0) > 1e-9 * largest:
            found = "a load that is no smooth function of the rotor angle and the speed alone"
            cure = "leave the load out; give it to the rig as excitation"
            raise ModelError(found, "loads such as m*xi*Omega^2*cos(phi), or constants", cure)
        spectrum[np.abs(spectrum) < 1e-13 * largest] = 0.0
        spectra.append(spectrum)
    stacked = np.array(spectra)
    harmonics = np.flatnonzero(np.abs(stacked).max(axis=(0, 2), initial=0.0) > 0)
    weight = np.where(harmonics == 0, 1.0, 2.0)[:, None]
    kept = stacked[:, harmonics] * weight
    return harmonics.astype(np.int64), np.stack([kept.real, -kept.imag], axis=-1)


def other_axis(name: str) -> str:
    return name.translate(str.maketrans("xy", "yx"))


def pairs(inputs: Sequence[str]) -> Integers:
    """Return the other axis of each auxiliary bearing: F_x1 and F_y1; -1 where there is none."""
    swapped = [other_axis(name) for name in inputs]
    others = [n if n != name else "" for n, name in zip(swapped, inputs, strict=True)]
    return np.array([inputs.index(n) if n in inputs else -1 for n in others])


def quarter_turn(inputs: Sequence[str]) -> Floats:
    """Return the matrix that takes the force on y from the motion along x, and -x from y."""
    turn = np.zeros((len(inputs), len(inputs)))
    for j, other in enumerate(pairs(inputs)):
        if other >= 0:
            turn[j, other] = 1.0 if "x" in inputs[j] else -1.0
    return turn


# Eddy currents: rates over tau, one to each factor of e. What is slower than the first is left to
# it, what is faster than the last follows at once: right to 5e-4 from omega tau = 1e-3 to 0.3, as
# far as a rig goes; faster ones would make the integration of nonlinear rigs stiff for nothing.
_RATES = np.exp(np.arange(-12.0, 5.0))
_CURRENT_FLOOR, _READING_FLOOR = 1e-3, 1e-6  # A, m: below, errors of a state count absolutely


Rows = tuple[Floats, Floats, Floats]
"""Signals: a matrix over [q, q'], one over [i, h] and one over z."""


class Lags(NamedTuple):
    """States z beside the rotor's, and the signals that they make."""

    rate: Rows  # z'
    # currents that the forces follow, in the coils, and as the logger gets them, one per input
    effective: Rows
    coil: Rows
    recorded: Rows
    # sensors, as the controller and as the logger get them, before noise
    reading: Rows
    logged: Rows
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

    def split(self, rows: Sequence[Floats]) -> Rows:
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


def build_lags(
    plant: Plant,
    actuators: Sequence[Actuator],
    sensors: Sequence[PositionSensor],
    reads: Floats,
    corner: float,
) -> Lags:
    """Return what lags; `reads` is what the sensors read, `corner` that of the logger's filter."""
    inputs = len(actuators)
    eddies = sum(part.eddy > 0 for part in actuators)
    most = eddies * len(_RATES) + 4 * inputs + 3 * len(sensors)
    states = _States(2 * len(plant.mass), inputs, most)
    effective, coil = zip(
        *(_current(part, plant, states, j) for j, part in enumerate(actuators)), strict=True
    )
    reading = []
    for sensor, row in zip(sensors, reads, strict=True):
        signal = np.pad(row, (0, states.width - len(row)))
        if np.isfinite(sensor.bandwidth):
            signal = states.lagged(signal, 2 * np.pi * sensor.bandwidth, _READING_FLOOR)
        reading.append(signal)
    recorded = [states.filtered(row, corner, _CURRENT_FLOOR) for row in coil]
    logged = [states.filtered(row, corner, _READING_FLOOR) for row in reading]
    return Lags(
        rate=states.split(states.rates),
        effective=states.split(effective),
        coil=states.split(coil),
        recorded=states.split(recorded),
        reading=states.split(reading),
        logged=states.split(logged),
        floor=np.array(states.floors),
    )


def _current(part: Actuator, plant: Plant, states: _States, j: int) -> tuple[Floats, Floats]:
    """Return the currents that the force of an input follows, and that its coil carries."""
    coil = states.signal(states.motion + j)
    iron = states.signal(states.motion + states.inputs + j)
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
