"""A run-up or coast-down cut into a table of 1x phasors, by the rotor angle (docs/signals.md)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rotorid.core.errors import InputError, naming, require_type
from rotorid.core.units import quantity
from rotorid.core.values import Complexes, Floats, Integers, frozen
from rotorid.data.lines import Lines
from rotorid.data.record import Record, part_of, samples_between
from rotorid.data.table_lines import lines_at_speeds
from rotorid.signals.covariance import LineCovariance

LENGTHS = (64, 32, 16, 8, 4)
"""Revolutions of a segment that are tried, the longest first."""
LEAST_SEGMENTS = 20
"""Segments below which shorter ones are tried: a table of fewer speeds tells little."""
FREEDOM = 5
"""Degrees of freedom per channel of a covariance, at least: as many as for references."""
SAMPLES = 8
"""Samples per revolution at least: fewer hardly tell the third multiple from the first."""
ORDERS = 3
"""Multiples of the rotation that are fitted beside it."""
NEIGHBOURS = 5
"""Segments over which bending is averaged: fewer are noise, more pass over a resonance."""
BENT = 3.0
"""Bending over that of noise from which on a segment is too long: chance reaches 2 in a hundred."""
BEHIND = 1.0
"""Deviations by which phasors may lag behind a changing speed before it is told."""


@frozen
class _Cut:
    speed: Floats  # (segment,): rad/s, in the middle
    # (segment, channel): X, and by how much a term of second order would move it
    phasors: Complexes
    bending: Complexes
    covariance: Complexes  # (segment, channel, channel): of X
    # complex degrees of freedom of a covariance, and how many segments share one
    dof: int
    group: int
    rate: Floats  # change of the speed in rad/s^2, on average

    @property
    def bend(self) -> float:
        """Mean square of the bending where it is largest, over what noise makes of it."""
        channels = self.phasors.shape[1]
        solved = np.linalg.solve(self.covariance, self.bending[:, :, None])[:, :, 0]
        square = (self.bending.conj() * solved).sum(axis=1).real
        # The second order costs 9/4 of the variance, all of it in what it moves: 9/4 - 1.
        expected = 1.25 * channels * self.dof / (self.dof - channels)
        window = np.ones(min(NEIGHBOURS, len(square))) / min(NEIGHBOURS, len(square))
        return float(np.convolve(square, window, mode="valid").max() / expected)


def phasors(record: Record, revolutions: int | None = None, *, skip: float | str = 0.0) -> Lines:
    r"""Return a record cut into a table of 1x phasors: order tracking by the rotor angle.

    The record is cut at whole revolutions; each segment is a line at its own speed, its phasor that
    of the middle, with a covariance from the scatter between revolutions, cross terms between
    channels kept. The machine is taken to have settled at each speed: where the speed changes too
    fast for that, `warnings` says by how much the phasors lag behind.

    Parameters
    ----------
    record : Record
        With an angle (`read_record`, an encoder or a keyphasor), or a constant speed.
    revolutions : int, optional
        Of a segment, 4 or more. Without it the longest of 64, 32, 16, 8 and 4 within which no
        phasor bends by more than noise hides, and which leaves 20 segments.
    skip : float or str
        What is left out before, in s from the first sample of the file.

    Returns
    -------
    Lines
        Inputs without a channel are taken as zero, as in passive bearings.

    Raises
    ------
    InputError
        For a record without rotation, one that turns back, too few revolutions, or too few samples
        in one.

    Examples
    --------
    >>> import rotorid as rid
    >>> rng = np.random.default_rng(1)
    >>> t = np.arange(100_000) / 5000.0
    >>> angle = 2 * np.pi * (20.0 * t + 0.5 * t**2)  # 20 to 40 revolutions per second
    >>> x = 1e-5 * np.cos(angle - 0.5) + 1e-6 * rng.standard_normal(len(t))
    >>> record = rid.Record([rid.Channel("x", "m")], x[:, None], 5000.0, 1.0, angle)
    >>> table = rid.phasors(record)
    >>> len(table.speed) > 20, round(float(np.angle(table.mean).mean()), 2)
    (True, -0.5)
    """
    require_type(record, Record, place="record")
    if revolutions is not None and revolutions < LENGTHS[-1]:
        raise InputError(
            f"{revolutions} revolutions", f"{LENGTHS[-1]} or more", "take longer segments"
        )
    begin = quantity(skip, "s", place="skip")
    with naming(record.source):
        first, after = samples_between(record, begin)
        if first >= after:
            raise InputError(f"skip = {begin:g} s", "less than the record lasts", "skip less")
        record = part_of(record, first, after)
        angle = _rotation(record)
        found: _Cut | None = None
        for length in LENGTHS if revolutions is None else (revolutions,):
            tried = _cut(record, angle, length)
            if tried is None or (len(tried.speed) < LEAST_SEGMENTS and revolutions is None):
                found = tried or found
                continue
            found = tried
            if found.bend < BENT:
                break
        if found is None:
            channels = len(record.channels)
            raise InputError(
                f"{abs(angle[-1] - angle[0]) / (2 * np.pi):.3g} revolutions without a gap",
                f"{min(length * _group(channels, length) for length in LENGTHS)} or more",
                "record longer, or leave channels out",
            )
    return _lines(record, found)


def _rotation(record: Record) -> Floats:
    """Return the rotor angle, checked that it goes on and is sampled often enough."""
    if record.angle is None and not record.speed:
        cure = "name the column of the rotor angle or of the once-per-revolution pulse"
        raise InputError("a record without rotation", "an angle, a keyphasor or a speed", cure)
    angle = record.rotor_angle()
    sense = np.sign(angle[-1] - angle[0])
    steps = np.diff(angle) * sense
    if not sense or (steps <= 0).any():
        where = record.start + float((steps <= 0).argmax()) / record.sample_rate
        found = f"a rotor angle that stands or turns back at {where:.6g} s"
        cure = "cut the record to the run-up or the coast-down"
        raise InputError(found, "a rotor that turns one way", cure)
    if np.median(steps) > 2 * np.pi / SAMPLES:
        found = f"{2 * np.pi / np.median(steps):.3g} samples per revolution"
        raise InputError(found, f"{SAMPLES} or more", "record faster, or cut the fast part off")
    return np.asarray(angle, dtype=np.float64)


def _cut(record: Record, angle: Floats, length: int) -> _Cut | None:
    turned = np.abs(angle - angle[0]) / (2 * np.pi)
    whole, fits = int(turned[-1] // length) * length, []
    starts = np.searchsorted(turned, np.arange(whole + 1) - 1e-9)
    for begin in range(0, whole, length):
        # The first samples of the revolutions of a segment, and that after the last.
        edges = np.asarray(starts[begin : begin + length + 1], dtype=np.int64)
        gap = record.valid is not None and not record.valid[edges[0] : edges[-1]].all()
        if not gap and np.diff(edges).min() >= SAMPLES:
            fits.append(_segment(record, angle, edges))
    group = _group(len(record.channels), length)
    if len(fits) < group:
        return None
    speed, rate, phasors, bending, scatter, samples = map(np.array, zip(*fits, strict=True))
    pooled = np.empty_like(scatter)
    ends = [*range(0, len(fits) - group + 1, group)]
    for first, last in zip(ends, [*ends[1:], len(fits)], strict=True):
        # White noise in the samples weighs less the more of them a revolution has.
        weighed = scatter[first:last] * samples[first:last, None, None]
        pooled[first:last] = weighed.sum(axis=0) / ((length - 2) * (last - first))
    covariance = np.asarray(pooled / (samples * length)[:, None, None], dtype=np.complex128)
    return _Cut(speed, phasors, bending, covariance, group * (length - 2), group, rate)


def _group(channels: int, length: int) -> int:
    return int(np.ceil(FREEDOM * channels / (length - 2)))


def _segment(
    record: Record, angle: Floats, edges: Integers
) -> tuple[float, float, Complexes, Complexes, Complexes, float]:
    """Return speed, its rate, phasor, bending, scatter of revolutions, samples in one of them."""
    part = slice(int(edges[0]), int(edges[-1]))
    phi, samples = angle[part], record.samples[part]
    tau = np.linspace(-1, 1, len(phi) + 1)[:-1] + 1 / len(phi)
    half = len(phi) / record.sample_rate / 2  # s from the middle to either end
    turning = np.polynomial.Polynomial.fit(tau, phi, 3, domain=(-1, 1)).deriv()
    waves = np.column_stack([np.cos(phi), np.sin(phi)])
    others = [wave(n * phi) for wave in (np.cos, np.sin) for n in range(2, ORDERS + 1)]
    smooth = [np.ones_like(tau), tau, tau**2]
    design = np.column_stack([waves, waves * tau[:, None], *others, *smooth])
    found = np.linalg.lstsq(design, samples, rcond=None)[0]
    wider = np.column_stack([design, waves * tau[:, None] ** 2])
    bent = np.linalg.lstsq(wider, samples, rcond=None)[0]
    left = (samples - design @ found) * np.exp(-1j * phi)[:, None]
    count = np.diff(edges)
    each = 2 * np.add.reduceat(left, edges[:-1] - edges[0]) / count[:, None]
    phasor = found[0] - 1j * found[1]
    return (
        float(turning(0.0)) / half,
        float(turning.deriv()(0.0)) / half**2,
        phasor,
        bent[0] - 1j * bent[1] - phasor,
        np.asarray(each.T @ each.conj()),
        float(count.mean()),
    )


def _lines(record: Record, cut: _Cut) -> Lines:
    order = np.argsort(cut.speed, kind="stable")
    forward = cut.speed[0] > 0
    lines = cut.phasors if forward else cut.phasors.conj()
    matrices = (cut.covariance if forward else cut.covariance.conj()) / 4
    covariance = LineCovariance(matrices[order], cut.dof, "repeated", shared=cut.group)
    return lines_at_speeds(
        record.channels,
        cut.speed[order],
        lines[order] / 2,
        covariance,
        record.sample_rate,
        phase_known=record.phase_known,
        phase_std=record.phase_std,
        source=record.source,
        warnings=(*record.warnings, *_told(cut)),
    )


def _told(cut: _Cut) -> Iterator[str]:
    if cut.bend >= BENT:
        yield (
            f"phasors bend within their segments, {np.sqrt(cut.bend):.2g} times as much as noise "
            "hides: take fewer revolutions, or let the speed change more slowly"
        )
    behind, where = _behind(cut)
    if behind > BEHIND:
        yield (
            f"the speed changes by {np.abs(cut.rate).max():.3g} rad/s^2, too fast to settle: near "
            f"{abs(where) * 30 / np.pi:.4g} rpm phasors lag behind by {behind:.2g} of their "
            "deviations: let it change more slowly there or, where a column holds its excitation "
            "(references), take the record as a whole (band), whose loads follow the angle at any "
            "rate; a rotor that only its unbalance drives has none"
        )


def _behind(cut: _Cut) -> tuple[float, float]:
    """Return by how many deviations phasors lag behind the speed at most, and at which speed."""
    speed, count = cut.speed, len(cut.speed)
    if count < NEIGHBOURS or np.ptp(speed) < 1e-3 * np.abs(speed).max():
        return 0.0, float(speed[0])
    worst, where = 0.0, float(speed[0])
    std = np.sqrt(np.diagonal(cut.covariance, axis1=1, axis2=2).real.mean(axis=1))
    for first in range(count - NEIGHBOURS + 1):
        part = slice(first, first + NEIGHBOURS)
        across = speed[part] - speed[part].mean()
        size = np.abs(across).max()
        if not size:
            continue
        powers = np.vander(across / size, 3)
        second = 2 * np.linalg.lstsq(powers, cut.phasors[part], rcond=None)[0][0] / size**2
        noise = 2 * np.linalg.norm(np.linalg.pinv(powers)[0]) * std[first] / size**2
        lag = abs(cut.rate[first]) / 2 * np.maximum(np.abs(second).max() - 3 * noise, 0.0)
        if lag > worst * std[first]:
            worst, where = float(lag / std[first]), float(speed[part].mean())
    return worst, where
