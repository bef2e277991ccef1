"""From recorded currents and positions to forces, sample by sample.

A current that a sampled controller commands is held: it is constant for one sample period while
the displacement goes on. Its line is that of its samples times sinc(f T) exp(-i pi f T), the line
of the displacement is not, so that neither the samples of the force nor those of a held force
give the right line. Here each column is first taken to the quantity's own time:

- Linear law: F = k_i (current, through hold and delay) + k_s (position, through its delay).
- Other laws: within each period of the hold the law is evaluated at Gauss points, with the held
  current and the displacement there, and every point is carried back to the sample:
  ``F = sum_j w_j S(-c_j) law(i, S(c_j) x)``, S(c) a shift by c, whose line is that of the true
  force, ``1/T int law(i_k, x(t)) exp(-i omega t) dt``, summed over the periods of the hold.

The shifts are interpolations by 16 samples, right in phase and size to 1e-9 below a tenth of the
sample rate. The result is a channel without hold and delay.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import signal

from rotorid.actuators.flux import Flux
from rotorid.actuators.laws import CurrentLaw, Linear
from rotorid.errors import InputError
from rotorid.record import Channel, Floats, Record

_TAPS = 16
_NODES, _WEIGHTS = (part / 2 for part in np.polynomial.legendre.leggauss(4))
_NODES = _NODES + 0.5


@dataclass(frozen=True)
class ForceReading:
    """How the force of one input follows from channels of a record.

    Parameters
    ----------
    law : CurrentLaw or Flux
    channels : sequence of str
        The channel of the current; of the flux densities B1 and B2 for `Flux`.
    position : mapping of str to float
        Displacement in the actuator as a combination of channels, in m; empty for `Flux`.
    """

    law: CurrentLaw | Flux
    channels: tuple[str, ...]
    position: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", tuple(self.channels))
        wanted = 2 if isinstance(self.law, Flux) else 1
        if len(self.channels) != wanted:
            raise InputError(
                f"{len(self.channels)} channels",
                "two flux densities" if wanted == 2 else "one current",
                "name the channels of the law",
            )


def forces(
    record: Record, readings: Mapping[str, ForceReading] | None = None, *, drives: bool = True
) -> Record:
    """Return a record whose currents, or flux densities, have become forces.

    Parameters
    ----------
    record : Record
    readings : mapping of str to ForceReading, optional
        Input to how its force is read.
    drives : bool
        Turn the currents of channels with a `Drive` into forces too.

    Returns
    -------
    Record
        With a channel of each input's force in place of the first channel it came from; the
        others that were used up, and are no positions, are dropped. The deviations of a law's
        constants are in the channel's `gain_std`.

    Raises
    ------
    InputError
        For channels that the record does not have, and currents or positions that the law cannot
        take, with the sample.

    Examples
    --------
    >>> channels = [Channel("i", "A"), Channel("x", "m")]
    >>> record = Record(channels, np.full((40, 2), [0.5, 1e-4]), 1000.0)
    >>> law = ForceReading(Linear(ki=120.0, ks=2e5), ("i",), {"x": 1.0})
    >>> forces(record, {"F": law}).column("F")[:2].round(9)
    array([80., 80.])
    """
    wanted = {**(drive_readings(record) if drives else {}), **(readings or {})}
    found = {name: _force(record, name, reading) for name, reading in wanted.items()}
    place = {reading.channels[0]: name for name, reading in wanted.items()}
    spent = {channel for reading in wanted.values() for channel in reading.channels[1:]}
    channels, columns = [], []
    for channel, column in zip(record.channels, record.samples.T, strict=True):
        if channel.name in place:
            channel, column = found[place[channel.name]]
        elif channel.name in spent:
            continue
        channels.append(channel)
        columns.append(column)
    # As `replace`, for subclasses too: a record of forces is a plain one.
    return Record(
        channels=tuple(channels),
        samples=np.stack(columns, axis=1),
        sample_rate=record.sample_rate,
        speed=record.speed,
        angle=record.angle,
        phase_known=record.phase_known,
        source=record.source,
    )


def drive_readings(record: Record) -> dict[str, ForceReading]:
    """Return how the forces of channels with a `Drive` are read.

    Raises
    ------
    InputError
        Where the displacement in an actuator is no combination of what is measured.
    """
    positions = [channel for channel in record.channels if channel.drive is None]
    return {
        channel.name: ForceReading(
            Linear(channel.drive.ki, channel.drive.ks),
            (channel.name,),
            as_channels(positions, channel.drive.position) if channel.drive.ks else {},
        )
        for channel in record.channels
        if channel.drive is not None
    }


def as_channels(sensors: Sequence[Channel], position: Mapping[str, float]) -> dict[str, float]:
    """Write a combination of coordinates as one of position channels.

    Parameters
    ----------
    sensors : sequence of Channel
    position : mapping of str to float
        ``{coordinate: coefficient}``.

    Returns
    -------
    dict of str to float
        ``{channel: coefficient}``.

    Raises
    ------
    InputError
        Where no combination of the channels gives it.

    Examples
    --------
    >>> planes = [Channel("a", reads={"x": 1.0, "th": 0.2}), Channel("b", reads={"x": 1.0})]
    >>> as_channels(planes, {"x": 1.0, "th": 0.1})
    {'a': 0.5, 'b': 0.5}
    """
    for sensor in sensors:
        if dict(sensor.combination) == dict(position):
            return {sensor.name: 1.0}
    names = sorted({name for s in sensors for name in s.combination} | set(position))
    reads = np.array([[s.combination.get(name, 0.0) for s in sensors] for name in names])
    target = np.array([position.get(name, 0.0) for name in names])
    weights = np.linalg.lstsq(reads, target, rcond=None)[0] if sensors else np.zeros(0)
    if not sensors or np.abs(reads @ weights - target).max() > 1e-9 * np.abs(target).max():
        raise InputError(
            "no sensors that give the displacement "
            + " + ".join(f"{value:g}*{name}" for name, value in position.items()),
            "a position channel in the plane of the actuator, or a combination of some",
            "add the channel, or use ml, which needs no such sensor",
        )
    weights[np.abs(weights) < 1e-9 * np.abs(weights).max()] = 0.0
    named = zip(sensors, weights, strict=True)
    return {sensor.name: float(f"{weight:.12g}") for sensor, weight in named if weight}


def _force(record: Record, name: str, reading: ForceReading) -> tuple[Channel, Floats]:
    sources = [record.channels[record.names.index(c)] for c in _present(record, reading)]
    try:
        if isinstance(reading.law, Flux):
            return _from_flux(record, name, reading, sources)
        return _from_current(record, name, reading, sources[0])
    except InputError as error:
        raise error.at(file=record.source, place=name) from None


def _present(record: Record, reading: ForceReading) -> tuple[str, ...]:
    for channel in (*reading.channels, *reading.position):
        record.column(channel)  # raises where there is none
    return reading.channels


def _from_flux(
    record: Record, name: str, reading: ForceReading, sources: list[Channel]
) -> tuple[Channel, Floats]:
    columns = [shifted(record.column(c.name), c.delay * record.sample_rate) for c in sources]
    law = reading.law
    force = law.force(*columns)
    return _channel(name, force, law.force_std(*columns), sources[0]), force


def _from_current(
    record: Record, name: str, reading: ForceReading, source: Channel
) -> tuple[Channel, Floats]:
    rate, current = record.sample_rate, record.column(source.name)
    lead = -source.delay * rate  # samples from a reading to the instant that it is true of
    points = zip(_NODES, _WEIGHTS, strict=True) if source.hold else ((0.0, 1.0),)
    force = np.zeros_like(current)
    for node, weight in points:
        displacement = _displacement(record, reading.position, lead + node)
        force += weight * shifted(reading.law.force(current, displacement), -lead - node)
    deviation = reading.law.force_std(current, _displacement(record, reading.position, 0.0))
    return _channel(name, force, deviation, source), force


def _displacement(record: Record, position: Mapping[str, float], steps: float) -> Floats:
    total = np.zeros(len(record.samples))
    for name, factor in position.items():
        channel = record.channels[record.names.index(name)]
        late = channel.delay * record.sample_rate
        total += factor * shifted(record.column(name), steps + late)
    return total


def _channel(name: str, force: Floats, deviation: Floats, source: Channel) -> Channel:
    size = float(np.sqrt(np.mean(force**2)))
    spread = float(np.sqrt(np.mean(np.broadcast_to(deviation, force.shape) ** 2)))
    relative = spread / size if size > 0 else 0.0
    return Channel(
        name,
        "N",
        delay_std=source.delay_std,
        gain_std=float(np.hypot(source.gain_std, relative)),
    )


def shifted(samples: Floats, steps: float) -> Floats:
    """Return samples of a signal `steps` sample periods later, by local interpolation.

    Parameters
    ----------
    samples : array, shape (sample,)
    steps : float
        Positive looks ahead.

    Returns
    -------
    array, shape (sample,)
        Within half the interpolation's width of the ends it is the nearest that there is.

    Examples
    --------
    >>> shifted(np.arange(40.0) ** 2, 0.5)[20:22].round(9)
    array([420.25, 462.25])
    """
    whole = int(np.floor(steps + 1e-9))
    part = steps - whole
    if abs(part) < 1e-9:
        moved = samples
    else:
        half = min(_TAPS // 2, len(samples) - 1)
        offsets = np.arange(-half + 1, half + 1)
        weights = [np.prod([(part - o) / (k - o) for o in offsets if o != k]) for k in offsets]
        padded = _extended(samples, half)
        moved = signal.correlate(padded, weights, mode="valid")[1:][: len(samples)]
    index = np.clip(np.arange(len(samples)) + whole, 0, len(samples) - 1)
    return np.asarray(moved[index])


def _extended(samples: Floats, width: int) -> Floats:
    """Continue a signal at both ends by its point reflection, which keeps value and slope."""
    head = 2 * samples[0] - samples[width:0:-1]
    tail = 2 * samples[-1] - samples[-2 : -width - 2 : -1]
    return np.concatenate([head, samples, tail])
