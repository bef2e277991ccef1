"""Detection lines: what is found where nothing was excited, odd, even and noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.errors import InputError
from rotorid.frozen import frozen
from rotorid.record import Floats, Integers, PeriodicRecord, Record
from rotorid.signals.average import average


@frozen
class Distortion:
    """What the lines of a run hold, one entry per channel in each array.

    All levels are root mean squares over lines of the amplitude |X| of the mean over periods, so
    that they compare with one another and with the excited lines.

    Parameters
    ----------
    channels : sequence of str
    excited, odd, even : int array, shape (line,)
        Harmonics that were excited; odd and even ones that were not.
    level : array, shape (channel,)
        On the excited lines.
    odd_level, even_level : array, shape (channel,)
        Distortion on the odd and even lines left out, the part that noise explains taken off;
        nan where there are no such lines.
    noise : array, shape (channel,)
        What noise alone leaves on a line of the mean.
    odd_excess, even_excess : array, shape (channel,)
        Level over noise; about 1 where there is no distortion.
    """

    channels: tuple[str, ...]
    excited: Integers
    odd: Integers
    even: Integers
    level: Floats
    odd_level: Floats
    even_level: Floats
    noise: Floats
    odd_excess: Floats
    even_excess: Floats

    def relative(self, channel: str) -> tuple[float, float, float]:
        """Return odd and even distortion and noise of a channel, over its excited lines.

        Raises
        ------
        InputError
            Where there is no such channel.
        """
        if channel not in self.channels:
            raise InputError(
                f"no channel {channel!r}",
                f"one of {', '.join(self.channels)}",
                "take a name from there",
            )
        j = self.channels.index(channel)
        odd, even, noise = (
            float(part[j] / self.level[j]) for part in (self.odd_level, self.even_level, self.noise)
        )
        return odd, even, noise


def detect_distortion(
    record: Record,
    fundamental: float,
    excited: Sequence[int],
    *,
    highest: int | None = None,
    apart: Sequence[int] = (),
    skip: float = 0.0,
) -> Distortion:
    """Tell even and odd distortion and noise from the lines that were not excited.

    Parameters
    ----------
    record : Record
    fundamental : float
        Hz.
    excited : sequence of int
        Harmonics that were excited.
    highest : int, optional
        Highest harmonic to look at; without it the highest excited one.
    apart : sequence of int
        Harmonics to leave aside, as that of the rotation and its multiples, where unbalance and
        runout are. Where the speed is a whole multiple of the fundamental they are left aside in
        any case.
    skip : float
        Settling to drop, in s.

    Returns
    -------
    Distortion

    Raises
    ------
    InputError
        For fewer than two periods, or where no line was left out.

    Examples
    --------
    >>> from rotorid.record import Channel
    >>> wave = np.cos(2 * np.pi * np.arange(400) / 100)
    >>> record = Record([Channel("F")], (wave + 0.1 * wave**2)[:, None], 1000.0)
    >>> found = detect_distortion(record, 10.0, [1], highest=4)
    >>> [round(part, 6) for part in found.relative("F")]
    [0.0, 0.035355, 0.0]
    """
    top = int(max(excited)) if highest is None else highest
    aside = {*excited, *apart, *_rotation(record, fundamental, top)}
    out = np.array([k for k in range(1, top + 1) if k not in aside], dtype=np.int64)
    if not out.size:
        raise InputError(
            f"every harmonic up to {top} excited",
            "lines left out",
            "excite odd harmonics, or leave some out",
            file=record.source,
        )
    periods = average(record, fundamental, harmonics=range(1, top + 1), skip=skip)
    power = np.abs(periods.mean_spectrum) ** 2
    noise = _noise(periods)
    lines = {"odd": out[out % 2 == 1], "even": out[out % 2 == 0]}
    mean = {name: _mean(power, chosen) for name, chosen in lines.items()}
    floor = {name: _mean(noise, chosen) for name, chosen in lines.items()}
    quiet = np.maximum(_mean(noise, out), 1e-300)
    return Distortion(
        channels=periods.names,
        excited=np.array(sorted(excited), dtype=np.int64),
        odd=lines["odd"],
        even=lines["even"],
        level=np.sqrt(_mean(power, np.array(sorted(excited)))),
        odd_level=np.sqrt(np.maximum(mean["odd"] - floor["odd"], 0.0)),
        even_level=np.sqrt(np.maximum(mean["even"] - floor["even"], 0.0)),
        noise=np.sqrt(_mean(noise, out)),
        odd_excess=np.sqrt(mean["odd"] / quiet),
        even_excess=np.sqrt(mean["even"] / quiet),
    )


def _rotation(record: Record, fundamental: float, highest: int) -> list[int]:
    turns = abs(record.speed) / (2 * np.pi * fundamental)
    first = round(turns)
    if first < 1 or abs(turns - first) > 0.01:
        return []
    return list(range(first, highest + 1, first))


def _noise(periods: PeriodicRecord) -> Floats:
    """Return the variance of the mean of each line, shape (line, channel).

    From differences of successive periods, which a slow drift does not enter.
    """
    steps = np.abs(np.diff(periods.spectra, axis=0)) ** 2
    return np.asarray(steps.mean(axis=0) / 2 / periods.periods)


def _mean(power: Floats, harmonics: Integers) -> Floats:
    """Return the mean over some harmonics of a table that starts at the first."""
    if not harmonics.size:
        return np.full(power.shape[1], np.nan)
    return np.asarray(power[harmonics - 1].mean(axis=0))
