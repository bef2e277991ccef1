"""Calibration of a record's channels as functions of the unknowns: what its nuisances do to it."""

from __future__ import annotations

from dataclasses import field
from typing import Protocol

import numpy as np

from rotorid.estimators.likelihood.nuisances import Factor
from rotorid.estimators.likelihood.reread import Bound
from rotorid.frozen import frozen
from rotorid.record import Complexes, Floats, Integers


def _none() -> Integers:
    return np.zeros(0, dtype=np.int64)


@frozen
class CalibrationState:
    """The calibration at one point.

    Parameters
    ----------
    factors : complex array, shape (line, channel)
        E: true line = E times measured line.
    readings : complex array, shape (line, channel)
        What adds to the readings on each line, in the unit of the channel.
    phase : complex array, shape (order,)
        exp(i order delta) for each order of the rotor angle.
    """

    factors: Complexes
    readings: Complexes
    phase: Complexes


class Acting(Protocol):
    """What a point of the cost says of channels and loads; `cost.Evaluation` says it.

    `columns`, shape (line, row, channel), act on the measured lines, `plain` on what adds to them.
    """

    unknowns: Floats
    state: CalibrationState
    plain: Complexes
    columns: Complexes

    @property
    def load_factors(self) -> Floats:
        """The monomials that the loads are multiplied by, shape (load,)."""


@frozen
class BoundFactor:
    """A factor, where its unknowns stand, and on which channels it acts."""

    nuisance: Factor
    unknowns: Integers
    channels: Integers


@frozen
class Readings:
    """What adds to readings, ``w (cos * cos(n phi) + sin * sin(n phi))`` each.

    The weight w is 1 for the sensor itself, and a function of time for a force that is read with
    the displacement of that sensor.

    Parameters
    ----------
    channel, cos, sin : int array, shape (reading,)
        The channel and the two unknowns.
    order : array, shape (reading,)
        n.
    rotation : complex array, shape (line, reading, 2)
        Lines of w exp(i n phi) and w exp(-i n phi).
    """

    channel: Integers
    cos: Integers
    sin: Integers
    order: Floats
    rotation: Complexes

    def cosine_sine(self, phase: float) -> tuple[Complexes, Complexes]:
        """Return the lines of w cos(n phi) and w sin(n phi), each of shape (line, reading)."""
        turn = np.exp(1j * self.order * phase)
        forward, backward = self.rotation[:, :, 0] * turn, self.rotation[:, :, 1] / turn
        return (forward + backward) / 2, (forward - backward) / 2j


@frozen
class Calibration:
    """How the channels of one record depend on nuisance unknowns.

    Parameters
    ----------
    omega : array, shape (line,)
        rad/s.
    channels : int
    factors : sequence of BoundFactor
    readings : Readings or None
    phase_unknown : int or None
        The unknown that adds to phi.
    phase_orders : array, shape (order,)
        Orders n of exp(i n phi) into which the loads are split; (0,) where the phase is known.
    reread : sequence of BoundLaw, BoundBend or BoundPassage
    """

    omega: Floats
    channels: int
    factors: tuple[BoundFactor, ...] = ()
    readings: Readings | None = None
    phase_unknown: int | None = None
    phase_orders: Floats = field(default_factory=lambda: np.zeros(1))
    reread: tuple[Bound, ...] = ()

    @property
    def affine(self) -> Integers:
        """Unknowns on which the equation error depends linearly, whitening not at all."""
        if self.readings is None:
            return _none()
        return np.unique([self.readings.cos, self.readings.sin])

    def at(self, unknowns: Floats) -> CalibrationState:
        """Evaluate at the unknowns."""
        shape = (len(self.omega), self.channels)
        factors = np.ones(shape, dtype=np.complex128)
        for bound in self.factors:
            factor = bound.nuisance.factor(unknowns[bound.unknowns], self.omega)
            factors[:, bound.channels] *= factor[:, None]
        added = np.zeros(shape, dtype=np.complex128)
        if self.readings is not None:
            cos, sin = self.readings.cosine_sine(self.phase(unknowns))
            parts = cos * unknowns[self.readings.cos] + sin * unknowns[self.readings.sin]
            for j, channel in enumerate(self.readings.channel):  # several may act on one
                added[:, channel] += parts[:, j]
        for law in self.reread:
            read = law.at(unknowns)
            factors[:, law.channel] *= read.gain
            added[:, law.channel] -= read.rest
        return CalibrationState(
            factors, added, np.exp(1j * self.phase_orders * self.phase(unknowns))
        )

    def phase(self, unknowns: Floats) -> float:
        """Return what adds to phi."""
        return 0.0 if self.phase_unknown is None else float(unknowns[self.phase_unknown])

    def add_directions(
        self, jacobian: Complexes, at: Acting, data: Complexes, load: Complexes
    ) -> None:
        """Add the columns of the nuisance unknowns to `jacobian`, (line, row, unknown).

        `data` are the corrected lines, `load` the columns of g for each order of the rotor angle.
        """
        for bound in self.factors:
            acted = (at.columns[:, :, bound.channels] @ data[:, bound.channels, None])[:, :, 0]
            slopes = bound.nuisance.slopes(at.unknowns[bound.unknowns], self.omega)
            jacobian[:, :, bound.unknowns] += acted[:, :, None] * slopes[:, None, :]
        for law in self.reread:
            line = at.columns[:, :, law.channel] * data[:, law.channel, None]
            gain = law.at(at.unknowns).gain or 1e-300  # a law astray has none: so has its line
            for unknown, slope in law.slopes(at.unknowns):
                jacobian[:, :, unknown] += slope.gain / gain * line
                jacobian[:, :, unknown] += at.plain[:, :, law.channel] * slope.rest[:, None]
        self.add_readings(jacobian, at, np.arange(len(at.unknowns)))
        if self.phase_unknown is not None:
            self._add_phase(jacobian, at, load, self.phase_unknown)

    def add_readings(self, jacobian: Complexes, at: Acting, among: Integers) -> None:
        """Add the columns of what adds to readings to those of some unknowns."""
        if self.readings is None:
            return
        cos, sin = self.readings.cosine_sine(self.phase(at.unknowns))
        acted = at.plain[:, :, self.readings.channel]
        for unknown, line in ((self.readings.cos, cos), (self.readings.sin, sin)):
            for there, where in np.argwhere(unknown[:, None] == among):  # several share one
                jacobian[:, :, where] -= acted[:, :, there] * line[:, None, there]

    def _add_phase(self, jacobian: Complexes, at: Acting, load: Complexes, unknown: int) -> None:
        turned = np.tensordot(1j * self.phase_orders * at.state.phase, load, 1)
        jacobian[:, : turned.shape[1], unknown] += turned @ at.load_factors
        if self.readings is not None:
            cos, sin = self.readings.cosine_sine(self.phase(at.unknowns))
            moved = cos * at.unknowns[self.readings.sin] - sin * at.unknowns[self.readings.cos]
            moved = moved * self.readings.order
            acted = at.plain[:, :, self.readings.channel] @ moved[:, :, None]
            jacobian[:, :, unknown] -= acted[:, :, 0]
