"""Dynamics of a channel: what an amplifier, a filter or a sensor does to each line.

A sensor's column is what its dynamics make of the quantity; an actuator's quantity is what its
dynamics make of the column. Constants are known, known with a deviation, or unknown.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property

import numpy as np

from rotorid.core.errors import InputError
from rotorid.core.values import Array, frozen, read_only

UNKNOWN = float("inf")
"""The deviation of a constant that nothing is known of; its value is where the search starts."""


@frozen
class Constant:
    """A constant of a channel or of a force law: value and deviation (0: exact, or `UNKNOWN`)."""

    name: str
    unit: str
    # SI
    value: float
    std: float = 0.0
    positive: bool = True  # a search keeps it above 0
    shared: str = ""  # name under which channels share it


@frozen(kw_only=True)
class Dynamics(ABC):
    actuator: bool = False  # the quantity follows the column, rather than the column the quantity
    # name under which several channels share the constants; empty: the channel's own
    shared: str = ""

    @abstractmethod
    def response(self, omega: Array, values: Array) -> Array:
        """Return H on each line, shape (line,), at values of the constants."""

    @abstractmethod
    def slopes(self, omega: Array, values: Array) -> Array:
        """Return d ln H by the constants, shape (line, constant)."""

    @cached_property
    def constants(self) -> tuple[Constant, ...]:
        """The constants, in the order of `response`: that of the fields."""
        held = (getattr(self, name) for name in self.__dataclass_fields__)
        return tuple(each for each in held if isinstance(each, Constant))

    @property
    def values(self) -> Array:
        return np.array([constant.value for constant in self.constants])

    @property
    def band(self) -> tuple[float, float]:
        """Least and greatest frequency in Hz at which the response is known."""
        return 0.0, np.inf

    def correction(self, omega: Array) -> Array:
        """Return quantity over column on each line, at the values that are given."""
        response = self.response(omega, self.values)
        return response if self.actuator else 1 / response


@frozen(kw_only=True)
class FirstOrder(Dynamics):
    """``H = 1 / (1 + i omega / omega_b)``, omega_b = 2 pi bandwidth."""

    bandwidth: Constant  # Hz

    def response(self, omega: Array, values: Array) -> Array:
        return np.asarray(1 / (1 + 1j * omega / (2 * np.pi * values[0])))

    def slopes(self, omega: Array, values: Array) -> Array:
        return np.asarray((1 - self.response(omega, values)) / values[0])[:, None]


@frozen(kw_only=True)
class SecondOrder(Dynamics):
    """``H = 1 / (1 + 2 i zeta s - s^2)``, s = omega / omega_b."""

    bandwidth: Constant  # Hz; the natural frequency
    damping: Constant  # zeta

    def response(self, omega: Array, values: Array) -> Array:
        s = omega / (2 * np.pi * values[0])
        return np.asarray(1 / (1 + 2j * values[1] * s - s**2))

    def slopes(self, omega: Array, values: Array) -> Array:
        s, response = omega / (2 * np.pi * values[0]), self.response(omega, values)
        by_bandwidth = response * (2j * values[1] * s - 2 * s**2) / values[0]
        return np.stack([by_bandwidth, -2j * s * response], axis=1)


@frozen(kw_only=True)
class EddyCurrents(Dynamics):
    """``H = 1 / (1 + sqrt(i omega tau))``: eddy currents in solid iron."""

    eddy: Constant  # tau in s

    def response(self, omega: Array, values: Array) -> Array:
        return np.asarray(1 / (1 + np.sqrt(1j * omega * values[0])))

    def slopes(self, omega: Array, values: Array) -> Array:
        return np.asarray(-(1 - self.response(omega, values)) / (2 * values[0]))[:, None]


@frozen(kw_only=True)
class Measured(Dynamics):
    """A measured response, taken as exact, linear between its points in amplitude and phase."""

    frequency: Array  # (point,): hz, increasing
    measured: Array  # (point,)

    def __post_init__(self) -> None:
        frequency, measured = np.asarray(self.frequency), np.asarray(self.measured)
        if frequency.ndim != 1 or len(frequency) < 2 or not (np.diff(frequency) > 0).all():
            found = f"{np.size(frequency)} frequencies of a response"
            expected = "two or more, increasing"
            raise InputError(found, expected, "sort the table by frequency", place="table")
        if measured.shape != frequency.shape or not (np.isfinite(measured) & (measured != 0)).all():
            found = "a response that is zero, not finite, or not as long as its frequencies"
            expected = "a finite complex number other than 0 for each frequency"
            raise InputError(found, expected, "leave such points out of the table", place="table")
        object.__setattr__(self, "frequency", read_only(frequency.astype(float)))
        object.__setattr__(self, "measured", read_only(measured.astype(np.complex128)))

    @property
    def band(self) -> tuple[float, float]:
        return float(self.frequency[0]), float(self.frequency[-1])

    def response(self, omega: Array, values: Array) -> Array:
        hertz = np.asarray(omega) / (2 * np.pi)
        low, high = self.frequency[0], self.frequency[-1]
        outside = hertz[(hertz < low * (1 - 1e-9)) | (hertz > high * (1 + 1e-9))]
        if outside.size:
            expected = f"lines within the table, {low:g} to {high:g} Hz"
            cure = "measure the response there too, or leave the line out"
            raise InputError(f"a line at {outside[0]:g} Hz", expected, cure, place="table")
        size = np.interp(hertz, self.frequency, np.abs(self.measured))
        phase = np.interp(hertz, self.frequency, np.unwrap(np.angle(self.measured)))
        return np.asarray(size * np.exp(1j * phase))

    def slopes(self, omega: Array, values: Array) -> Array:
        return np.zeros((len(omega), 0), dtype=np.complex128)
