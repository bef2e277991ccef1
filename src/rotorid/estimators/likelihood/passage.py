"""What a sensor reads wrong where a force is read with it: the law takes its displacement.

The force of a magnet is computed from a current and a displacement. A gain, a lag, a runout or a
sign of the sensor is therefore in the force as well, k_s times as large, and so in every mistake
that is undone on the lines of a record.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rotorid.estimators.likelihood.nuisances import Factor
from rotorid.frozen import frozen
from rotorid.lines import Lines
from rotorid.observation import Observation
from rotorid.record import Complexes, Floats, Integers
from rotorid.through_laws import Passed, displacement


@frozen
class Reread:
    """A channel read otherwise: ``gain * line + rest`` in place of the line.

    Parameters
    ----------
    gain : float
        Of the whole force, so that its noise follows too.
    rest : complex array, shape (line,)
    """

    gain: float
    rest: Complexes


def position_slopes(observation: Observation, sensor: str) -> dict[int, Floats]:
    """Return by how much each input's force is read too large per metre that a sensor is.

    In N/m at each sample, for the inputs whose law takes the displacement from that sensor. Exact
    to first order: what is read wrong is small against the gap.
    """
    return {
        number: passed.law.position[sensor] * passed.slope
        for number, passed in observation.passed.items()
        if passed.law.position.get(sensor)
    }


@frozen
class BoundPassage:
    """A factor of a sensor, as it acts on a force that was read with that sensor.

    Parameters
    ----------
    channel : int
        The input.
    nuisance : Factor
    unknowns : int array
        Where those of the factor stand.
    omega : array, shape (line,)
    lines : complex array, shape (line,)
        Of the slope of the law times what the sensor reads.
    """

    channel: int
    nuisance: Factor
    unknowns: Integers
    omega: Floats
    lines: Complexes

    def at(self, unknowns: Floats) -> Reread:
        """Return what becomes of the lines of the force."""
        factor = self.nuisance.factor(unknowns[self.unknowns], self.omega)
        return Reread(1.0, (factor - 1) * self.lines)

    def slopes(self, unknowns: Floats) -> Iterator[tuple[int, Reread]]:
        """Yield the derivative of `at` by each unknown."""
        values = unknowns[self.unknowns]
        change = self.nuisance.factor(values, self.omega) * self.lines
        for unknown, slope in zip(
            self.unknowns, self.nuisance.slopes(values, self.omega).T, strict=True
        ):
            yield int(unknown), Reread(0.0, change * slope)


def passages(
    observation: Observation, nuisance: Factor, unknowns: Integers
) -> Iterator[BoundPassage]:
    """Yield what a factor of sensors does to the forces that were read with them."""
    lines = observation.lines
    if lines.samples is None or not nuisance.channels:
        return
    acting = np.array([name in nuisance.channels for name in lines.names])
    for number, passed in observation.passed.items():
        shares = np.where(acting, passed.shares, 0.0)
        if shares.any():
            moved = passed.slope * displacement(lines, lines.samples, shares)
            found = lines.samples.lines(moved[:, None])[:, 0]
            yield BoundPassage(number, nuisance, unknowns, lines.omega, found)


def with_columns(observation: Observation, matrix: Floats) -> Observation:
    """Return the record whose columns are ``matrix @ columns``, as if logged so.

    A column of a force that was read by a law is that of its current; the law reads it again, with
    the displacement that the other columns give now. A positive factor of one that keeps both is
    one of the force itself. The covariance follows by the slopes.
    """
    lines, samples = observation.lines, observation.lines.samples
    whole, moved = matrix.astype(float), np.zeros_like(lines.mean)
    values = None if samples is None else samples.values @ matrix.T
    every = {passed.column: passed for passed in observation.passed.values()}
    for column, passed in every.items():
        sources = np.flatnonzero(matrix[column]).tolist()
        same = np.array_equal(passed.shares @ matrix, passed.shares)
        if (same and np.array_equal(sources, [column]) and matrix[column, column] > 0) or not all(
            source in every for source in sources
        ):
            continue
        again = _again(lines, passed, [(matrix[column, k], every[k]) for k in sources], matrix)
        if again is None:
            continue
        whole[column] = passed.shares @ matrix * again.slope.mean()
        for source in sources:
            other = every[source]
            whole[column, source] += matrix[column, source]
            whole[column] -= matrix[column, source] * other.slope.mean() * other.shares
        if samples is not None and values is not None:
            # The lines are those of the force as it was corrected; only the change is added.
            change = again.force - displacement(lines, samples, whole[column])
            moved[:, column] = samples.lines(change[:, None])[:, 0]
            values[:, column] = again.force
    return observation.with_lines(_transformed(lines, whole, moved, values))


def _again(
    lines: Lines, passed: Passed, sources: list[tuple[float, Passed]], matrix: Floats
) -> Passed | None:
    """Return what goes through a law with other columns; None where that is beyond its gap."""
    flowing = np.sum([factor * source.flowing for factor, source in sources], axis=0)
    position = passed.position
    if lines.samples is not None:
        position = displacement(lines, lines.samples, passed.shares @ matrix)
    found = replace(passed, flowing=flowing, position=position)
    with np.errstate(all="ignore"):
        sound = np.isfinite(found.force).all() and np.isfinite(found.slope).all()
    return found if sound else None


def _transformed(lines: Lines, matrix: Floats, moved: Complexes, values: Floats | None) -> Lines:
    """Return lines whose channels are ``matrix @ channels + moved``."""
    covariance = matrix @ lines.covariance.matrices @ matrix.T
    scatter, samples, beside = lines.scatter, lines.samples, lines.beside
    if beside is not None and beside.noise is not None:
        beside = replace(beside, noise=beside.noise @ matrix.T)
    return replace(
        lines,
        mean=lines.mean @ matrix.T + moved,
        covariance=replace(lines.covariance, matrices=covariance),
        scatter=None if scatter is None else scatter @ matrix.T + moved,
        samples=samples if samples is None or values is None else replace(samples, values=values),
        beside=beside,
    )
