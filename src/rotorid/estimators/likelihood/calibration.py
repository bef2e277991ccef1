"""Calibration of a record's channels as functions of the unknowns: gain, delay, runout, phase."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from rotorid.record import Complexes, Floats, Integers

if TYPE_CHECKING:
    from rotorid.estimators.likelihood.cost import Evaluation


def _none() -> Integers:
    return np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class CalibrationState:
    """The calibration at one point.

    Parameters
    ----------
    factors : complex array, shape (line, channel)
        E: true line = E times measured line.
    runout : complex array, shape (line, sensor)
        Runout on each line, in the unit of the sensor.
    phase : complex array, shape (order,)
        exp(i order delta) for each order of the rotor angle.
    """

    factors: Complexes
    runout: Complexes
    phase: Complexes


@dataclass(frozen=True)
class Calibration:
    """How the channels of one record depend on nuisance unknowns.

    A channel reads ``gain * quantity`` late by ``delay``; a position sensor moreover reads the
    runout, ``y = C q + cos * cos(phi) + sin * sin(phi)``.

    Parameters
    ----------
    omega : array, shape (line,)
        rad/s.
    channels, sensors : int
        Sizes; the sensors are the last channels.
    gain_channel, gain_unknown : int array, shape (gain,)
        Channel and unknown of each gain.
    delay_channels : array, shape (channel, delay)
        Ones where a delay acts.
    delay_unknown : int array, shape (delay,)
    delay_known : array, shape (delay,)
        s; what the lines are corrected for already.
    rotation : complex array, shape (line, 2)
        Lines of exp(i phi) and exp(-i phi).
    runout_sensor, runout_cos, runout_sin : int array, shape (runout,)
        Sensor and unknowns of each runout.
    phase_unknown : int or None
        The unknown that adds to phi.
    phase_orders : array, shape (order,)
        Orders n of exp(i n phi) into which the loads are split; (0,) where the phase is known.
    """

    omega: Floats
    channels: int
    sensors: int
    gain_channel: Integers = field(default_factory=_none)
    gain_unknown: Integers = field(default_factory=_none)
    delay_channels: Floats | None = None
    delay_unknown: Integers = field(default_factory=_none)
    delay_known: Floats = field(default_factory=lambda: np.zeros(0))
    rotation: Complexes | None = None
    runout_sensor: Integers = field(default_factory=_none)
    runout_cos: Integers = field(default_factory=_none)
    runout_sin: Integers = field(default_factory=_none)
    phase_unknown: int | None = None
    phase_orders: Floats = field(default_factory=lambda: np.zeros(1))

    def at(self, unknowns: Floats) -> CalibrationState:
        """Evaluate at the unknowns."""
        shape = (len(self.omega), self.channels)
        factors = np.ones(shape, dtype=np.complex128)
        if self.delay_channels is not None:
            late = self.delay_channels @ (unknowns[self.delay_unknown] - self.delay_known)
            factors *= np.exp(1j * self.omega[:, None] * late)
        if len(self.gain_channel):
            factors[:, self.gain_channel] /= unknowns[self.gain_unknown]
        runout = np.zeros((len(self.omega), self.sensors), dtype=np.complex128)
        if len(self.runout_sensor):
            cos, sin = self.cosine_sine(unknowns)
            runout[:, self.runout_sensor] = np.multiply.outer(cos, unknowns[self.runout_cos])
            runout[:, self.runout_sensor] += np.multiply.outer(sin, unknowns[self.runout_sin])
        return CalibrationState(
            factors, runout, np.exp(1j * self.phase_orders * self.phase(unknowns))
        )

    def phase(self, unknowns: Floats) -> float:
        """Return what adds to phi."""
        return 0.0 if self.phase_unknown is None else float(unknowns[self.phase_unknown])

    def cosine_sine(self, unknowns: Floats) -> tuple[Complexes, Complexes]:
        """Return the lines of cos(phi) and sin(phi), each of shape (line,)."""
        assert self.rotation is not None
        turn = np.exp(1j * self.phase(unknowns))
        forward, backward = self.rotation[:, 0] * turn, self.rotation[:, 1] / turn
        return (forward + backward) / 2, (forward - backward) / 2j

    def add_directions(self, jacobian: Complexes, at: Evaluation, data: Complexes) -> None:
        """Add the columns of the nuisance unknowns to `jacobian`, (line, row, unknown)."""
        unknowns, columns = at.unknowns, at.columns
        if len(self.gain_channel):
            gain = unknowns[self.gain_unknown]
            scaled = (
                columns[:, :, self.gain_channel] * (data[:, self.gain_channel] / -gain)[:, None]
            )
            for j, unknown in enumerate(self.gain_unknown):  # one unknown may serve two channels
                jacobian[:, :, unknown] += scaled[:, :, j]
        if self.delay_channels is not None:
            scaled = (columns * data[:, None, :]) @ self.delay_channels
            jacobian[:, :, self.delay_unknown] += 1j * self.omega[:, None, None] * scaled
        self.add_runout(jacobian, at, np.arange(len(unknowns)))
        if self.phase_unknown is not None:
            self._add_phase(jacobian, at)

    def add_runout(self, jacobian: Complexes, at: Evaluation, among: Integers) -> None:
        """Add the columns of the runout to those of some unknowns."""
        if not len(self.runout_sensor):
            return
        cos, sin = self.cosine_sine(at.unknowns)
        acted = at.sensors[:, :, self.runout_sensor]
        for unknown, line in ((self.runout_cos, cos), (self.runout_sin, sin)):
            there, where = np.nonzero(unknown[:, None] == among)
            jacobian[:, :, where] -= acted[:, :, there] * line[:, None, None]

    def _add_phase(self, jacobian: Complexes, at: Evaluation) -> None:
        assert self.phase_unknown is not None
        turned = np.tensordot(1j * self.phase_orders * at.state.phase, at.problem.load, 1)
        rows = at.problem.rows
        jacobian[:, :rows, self.phase_unknown] += turned @ at.mu
        if len(self.runout_sensor):
            cos, sin = self.cosine_sine(at.unknowns)
            moved = np.multiply.outer(cos, at.unknowns[self.runout_sin])
            moved -= np.multiply.outer(sin, at.unknowns[self.runout_cos])
            acted = at.sensors[:, :, self.runout_sensor] @ moved[:, :, None]
            jacobian[:, :, self.phase_unknown] -= acted[:, :, 0]
