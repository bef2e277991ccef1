"""The rotor of a rig: accelerations from positions, velocities, forces and loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.polynomial import polynomial

from rotorid.core.errors import ModelError
from rotorid.core.frozen import frozen
from rotorid.core.values import Floats, Integers
from rotorid.models.linear_form import LinearForm
from rotorid.models.model import Model
from rotorid.rig.marks import Rotation

_DEGREE = 4
_ANGLES = 64


@frozen
class Plant:
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
        return replace(
            self,
            motion=np.tensordot(powers, self.motion, 1)[None],
            load=np.tensordot(load_powers, self.load, 1)[None],
        )

    def with_work(self, work: Floats) -> Plant:
        """Return the plant with other actuators: B, whose transpose is their displacement."""
        force = np.asarray(np.linalg.solve(self.mass, work), dtype=float)
        return replace(self, force=force, displacement=np.ascontiguousarray(work.T))

    def with_stiffness(self, at_actuators: Floats) -> Plant:
        """Return the plant with a stiffness more, shape (input, input), at the actuators."""
        motion = self.motion.copy()
        motion[0, :, : len(self.mass)] -= self.force @ at_actuators @ self.displacement
        return replace(self, motion=motion)


def rotor_plant(model: Model, values: Floats, rotation: Rotation, end: float) -> Plant:
    linear = model.require_linear()
    low, high = rotation.range_until(end)
    centre, width = (low + high) / 2, (high - low) / 2 or 1.0
    nodes = [centre] if rotation.constant else list(centre + width * _chebyshev(_DEGREE + 1))
    mass = _mass(linear, values, nodes)
    B = linear.matrices(values, centre).B
    harmonics, loads = _load_harmonics(linear, values, nodes)
    plant = Plant(
        motion=_in_speed(np.array([_motion(linear, values, mass, speed) for speed in nodes])),
        load=_in_speed(np.asarray(np.linalg.solve(mass, loads), dtype=float)),
        harmonics=harmonics,
        force=np.asarray(np.linalg.solve(mass, B), dtype=float),
        mass=mass,
        displacement=_work_displacement(mass, B),
        centre=centre,
        width=width,
    )
    between = centre if rotation.constant else centre + 0.31 * width
    exact = _motion(linear, values, mass, between)
    if np.abs(plant.at(between).motion[0] - exact).max() > 1e-9 * np.abs(exact).max(initial=0.0):
        raise ModelError(
            "a matrix that is no polynomial of Omega of degree 4",
            "one, where the speed changes",
            "run at constant speed",
        )
    return plant


def _motion(linear: LinearForm, values: Floats, mass: Floats, speed: float) -> Floats:
    m = linear.matrices(values, speed)
    return np.asarray(-np.linalg.solve(mass, np.hstack([m.K, m.D + speed * m.G])))


def _chebyshev(count: int) -> Floats:
    return np.asarray(np.cos(np.pi * (np.arange(count) + 0.5) / count))


def _in_speed(values: Floats) -> Floats:
    """Turn values at the Chebyshev nodes into coefficients of a polynomial."""
    count = len(values)
    if count == 1:
        return values
    flat = values.reshape(count, -1)
    coefficients = polynomial.polyfit(_chebyshev(count), flat, count - 1)
    coefficients[np.abs(coefficients) < 1e-11 * np.abs(flat).max(initial=0.0)] = 0.0
    used = np.flatnonzero(coefficients.any(axis=1))
    degree = int(used[-1]) + 1 if used.size else 1
    return np.asarray(coefficients[:degree].reshape(degree, *values.shape[1:]))


def _mass(linear: LinearForm, values: Floats, nodes: Sequence[float]) -> Floats:
    masses = [linear.matrices(values, speed).M for speed in nodes]
    first = masses[0]
    if first.shape[0] != first.shape[1]:
        raise ModelError(
            f"{first.shape[0]} equations of {first.shape[1]} coordinates",
            "as many equations as coordinates",
            "complete the model",
        )
    scale = np.abs(first).max(initial=0.0)
    if any(np.abs(mass - first).max(initial=0.0) > 1e-12 * scale for mass in masses):
        raise ModelError(
            "a mass that depends on the speed",
            "constant masses where the speed changes",
            "run at constant speed",
        )
    diagonal = np.sqrt(np.abs(first).max(axis=1, initial=0.0))
    balanced = first / np.where(diagonal > 0, diagonal, 1)[:, None]
    balanced = balanced / np.where(diagonal > 0, diagonal, 1)
    if not np.isfinite(first).all() or np.linalg.cond(balanced) > 1e12:
        raise ModelError(
            "a coordinate without mass",
            "a mass matrix that can be inverted",
            "give every coordinate a mass, or eliminate it",
        )
    return first


def _work_displacement(mass: Floats, B: Floats) -> Floats:
    if np.abs(mass - mass.T).max() > 1e-9 * np.abs(mass).max():
        raise ModelError(
            "a mass matrix that is not symmetric",
            "each equation the balance of the forces that do work on its coordinate",
            "order and scale the equations so",
        )
    return B.T


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
            raise ModelError(
                "a load that is no smooth function of the rotor angle and the speed alone",
                "loads such as m*xi*Omega^2*cos(phi), or constants",
                "leave the load out; give it to the rig as excitation",
            )
        spectrum[np.abs(spectrum) < 1e-13 * largest] = 0.0
        spectra.append(spectrum)
    stacked = np.array(spectra)
    harmonics = np.flatnonzero(np.abs(stacked).max(axis=(0, 2), initial=0.0) > 0)
    weight = np.where(harmonics == 0, 1.0, 2.0)[:, None]
    kept = stacked[:, harmonics] * weight
    return harmonics.astype(np.int64), np.stack([kept.real, -kept.imag], axis=-1)


def pairs(inputs: tuple[str, ...]) -> Integers:
    """Return the other axis of each auxiliary bearing: F_x1 and F_y1; -1 where there is none."""
    swapped = [name.translate(str.maketrans("xy", "yx")) for name in inputs]
    return np.array(
        [
            inputs.index(other) if other != name and other in inputs else -1
            for name, other in zip(inputs, swapped, strict=True)
        ]
    )


def quarter_turn(inputs: tuple[str, ...]) -> Floats:
    """Return the matrix that takes the force on y from the motion along x, and -x from y."""
    turn = np.zeros((len(inputs), len(inputs)))
    for j, other in enumerate(pairs(inputs)):
        if other >= 0:
            turn[j, other] = 1.0 if "x" in inputs[j] else -1.0
    return turn
