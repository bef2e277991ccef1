"""What is no factor of a line: laws with other constants, sensors that bend, hysteresis.

A constant such as the gap is no factor of a line. The samples behind the lines, mean period or
whole record, go through the law again; what changes is added to the lines as they were read. The
samples carry the noise of their mean only, and only the change is taken from them. A channel that
bends is corrected by the lines of what its samples, cubed for instance, make.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from rotorid.estimators.likelihood.nuisances import Bend, Factor, LawConstant, Nuisance
from rotorid.estimators.likelihood.passage import BoundPassage, Reread, passages
from rotorid.frozen import frozen
from rotorid.lines import Samples
from rotorid.observation import Observation
from rotorid.record import Channel, Complexes, Floats, ForceLaw, Integers
from rotorid.signals.spectrum import transfer_of_recording
from rotorid.through_laws import Passed

STEP = 1e-30
"""A complex step: the derivative of what is computed with it is exact to rounding."""


@frozen
class BoundLaw:
    """A force law of which constants are unknown, with the samples that went through it.

    Parameters
    ----------
    channel : int
    law : ForceLaw
    constants : sequence of (LawConstant, int)
        With the place of their unknown.
    samples : Samples
    flowing, position, force : array, shape (sample,)
        What goes through the law, and the force with the constants as they are stated.
    """

    channel: int
    law: ForceLaw
    constants: tuple[tuple[LawConstant, int], ...]
    samples: Samples
    flowing: Floats
    position: Floats
    force: Floats

    @classmethod
    def of(
        cls,
        observation: Observation,
        number: int,
        law: ForceLaw,
        constants: tuple[tuple[LawConstant, int], ...],
    ) -> BoundLaw:
        """Find what went through the law of an input."""
        samples = observation.lines.samples
        assert samples is not None
        column = observation.input_columns[number]
        passed = observation.passed.get(number) or Passed.of(observation.lines, column, law)
        return cls(number, law, constants, samples, passed.flowing, passed.position, passed.force)

    def _moved(self, unknowns: Floats, step: int | None = None) -> Floats | Complexes:
        """Return the force at the unknowns, one of them moved by a complex step."""
        changes: dict[str, complex] = {}
        for nuisance, at in self.constants:
            value = unknowns[at] + (STEP * 1j if at == step else 0.0)
            for name, change in nuisance.changes(value).items():
                changes[name] = changes.get(name, 0.0) + change
        return self.law.force(self.flowing, self.position, changes)

    def _split(self, change: Floats) -> Reread:
        """Return a change of the force as a share of the force itself, and the rest."""
        about = self.force - self.force.mean()
        size = float(about @ about)
        gain = float(about @ change) / size if size > 0 else 0.0
        return Reread(gain, self.samples.lines((change - gain * self.force)[:, None])[:, 0])

    def at(self, unknowns: Floats) -> Reread:
        """Return what becomes of the lines of the force."""
        change = self._split(self._moved(unknowns).real - self.force)
        return Reread(1 + change.gain, change.rest)

    def slopes(self, unknowns: Floats) -> Iterator[tuple[int, Reread]]:
        """Yield the derivative of `at` by each unknown."""
        for _, at in self.constants:
            yield at, self._split(self._moved(unknowns, at).imag / STEP)


@frozen
class BoundBend:
    """A channel that reads too much by an unknown times what its samples are bent into.

    Parameters
    ----------
    channel, unknown : int
    lines : complex array, shape (line,)
        Of the bent samples, for an unknown of one.
    """

    channel: int
    unknown: int
    lines: Complexes

    def at(self, unknowns: Floats) -> Reread:
        """Return what becomes of the lines of the channel."""
        return Reread(1.0, -unknowns[self.unknown] * self.lines)

    def slopes(self, unknowns: Floats) -> Iterator[tuple[int, Reread]]:
        """Yield the derivative of `at`."""
        yield self.unknown, Reread(0.0, -self.lines)


Bound = BoundLaw | BoundBend | BoundPassage
"""A channel that is read otherwise, as some unknowns say."""


def reread(
    observation: Observation, places: Iterable[tuple[Nuisance, Integers]]
) -> tuple[Bound, ...]:
    """Return what is to be read otherwise, as the nuisances say."""
    places = list(places)
    factors = [(n, at) for n, at in places if isinstance(n, Factor)]
    passed = (each for n, at in factors for each in passages(observation, n, at))
    return (*_laws(observation, places), *_bends(observation, places), *passed)


def _bends(
    observation: Observation, places: Iterable[tuple[Nuisance, Integers]]
) -> Iterator[BoundBend]:
    """Yield the channels that bend."""
    lines, samples = observation.lines, observation.lines.samples
    if samples is None:
        return
    for nuisance, at in places:
        if not isinstance(nuisance, Bend):
            continue
        for number, (channel, column) in enumerate(
            zip(observation.channels, observation.order, strict=True)
        ):
            if channel.name in nuisance.channels:
                bent = samples.lines(nuisance.shape(samples.values[:, column])[:, None])
                # Lines of samples become those of the quantity as the channel's own do.
                corrected = transfer_of_recording([channel], lines.frequency, samples.sample_rate)
                yield BoundBend(number, int(at[0]), (bent * corrected)[:, 0])


def _laws(
    observation: Observation, places: Iterable[tuple[Nuisance, Integers]]
) -> tuple[BoundLaw, ...]:
    """Return the laws of a record's inputs of which a nuisance is a constant."""
    unknown = [(n, int(at[0])) for n, at in places if isinstance(n, LawConstant)]
    if not unknown or observation.lines.samples is None:
        return ()

    def acting(channel: Channel) -> tuple[tuple[LawConstant, int], ...]:
        return tuple((n, at) for n, at in unknown if channel.name in n.inputs)

    return tuple(
        BoundLaw.of(observation, number, channel.law, acting(channel))
        for number, channel in enumerate(observation.inputs)
        if channel.law is not None and acting(channel)
    )
