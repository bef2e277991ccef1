"""The part of a load that turns with the rotor: its line once per revolution of `phi`."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from rotorid.models.evaluation import evaluate
from rotorid.models.expression import FUNCTIONS, Expression, symbol
from rotorid.record import Floats

POINTS = 257
"""Rotor angles per turn: a load of 255 times per revolution is still told from one of once."""
TURNS = 1000
"""Turns over which a load is looked at that no turn repeats, such as that of a geared shaft."""
REPEATS = 1e-9
"""Share of its size by which a load may differ from turn to turn: rounding."""


def rotation_line(signal: Expression, speed: float) -> complex:
    """Return g of the part ``Re(g exp(i phi))`` of a load at a speed in rad/s.

    A load that depends on the time has none: it may turn as fast, but not from the same zero. What
    is no finite number is NaN.
    """
    if symbol("t") in signal.free_symbols:
        return 0j
    angle = 2 * np.pi * np.arange(POINTS) / POINTS
    if _repeats(signal):
        weight = np.full(POINTS, 1 / POINTS)
    else:  # a window whose lines are far narrower than orders are apart
        angle = 2 * np.pi * np.arange(POINTS * TURNS) / POINTS
        weight = np.blackman(len(angle))
        weight /= weight.sum()
    wave = _wave(signal, angle, speed)
    if not np.isfinite(wave).all():
        return complex(np.nan, np.nan)
    return complex(2 * (weight * np.exp(-1j * angle)) @ wave)


def runs_by_time(signal: Expression) -> Expression | None:
    """Return the function of `Omega` times `t` in a load, which is to turn with the rotor."""
    if signal.kind in FUNCTIONS and {symbol("t"), symbol("Omega")} <= signal.free_symbols:
        return signal
    inner = (runs_by_time(part) for part in signal.parts if isinstance(part, Expression))
    return next((found for found in inner if found is not None), None)


@lru_cache(maxsize=1000)
def _repeats(signal: Expression) -> bool:
    """Tell whether a load is the same after each turn."""
    angle = np.linspace(0.1, 6.1, 7)
    first = _wave(signal, angle, 1.0)
    later = [_wave(signal, angle + 2 * np.pi * turns, 1.0) for turns in (1, 2, 3)]
    size = np.abs([first, *later]).max(initial=0.0)
    with np.errstate(invalid="ignore"):  # infinite: not this one's to say
        return not any((np.abs(wave - first) > REPEATS * size).any() for wave in later)


def _wave(signal: Expression, angle: Floats, speed: float) -> Floats:
    """Return a load at rotor angles."""
    return evaluate(signal, {"phi": angle, "Omega": speed}) * np.ones(len(angle))
