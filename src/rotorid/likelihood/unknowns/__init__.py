"""Unknowns of the measurement, one class per kind; `KINDS` is their order in results."""

from __future__ import annotations

from collections.abc import Sequence

from rotorid.data.observation import Observation
from rotorid.likelihood.unknowns.channel_factors import (
    CommonDelay,
    Cubic,
    Delay,
    Gain,
    Hysteresis,
    Multiplier,
    Response,
)
from rotorid.likelihood.unknowns.force_constants import (
    CurrentGain,
    DisplacementGain,
    Knee,
    MagnetConstant,
    Scale,
)
from rotorid.likelihood.unknowns.kinds import Nuisances, Plausible, Scalar, Unknown
from rotorid.likelihood.unknowns.rotor_angle import Phase, Runout
from rotorid.likelihood.unknowns.terms import Lever, Missing, Own, Share

__all__ = [
    "TAKEN_AS_EXACT",
    "Lever",
    "Missing",
    "Multiplier",
    "Nuisances",
    "Own",
    "Phase",
    "Plausible",
    "Runout",
    "Scalar",
    "Share",
    "Unknown",
    "asked_unknowns",
    "every_unknown",
]

KINDS: tuple[type[Unknown], ...] = (
    Own,  # parameters of the model: they stand before what is unknown of the measurement
    CurrentGain,
    DisplacementGain,
    Scale,
    MagnetConstant,
    Knee,
    Cubic,
    Hysteresis,
    Runout,
    Gain,
    CommonDelay,
    Delay,
    Response,
    Phase,
)


def asked_unknowns(records: Sequence[Observation], wanted: Nuisances) -> tuple[Unknown, ...]:
    return tuple(n for kind in KINDS for n in kind.asked(records, wanted))


def every_unknown(records: Sequence[Observation]) -> tuple[Unknown, ...]:
    return tuple(n for kind in KINDS for n in kind.every(records))


TAKEN_AS_EXACT: tuple[type[Unknown], ...] = (Runout, Phase, Gain, Delay)
"""Kinds that are taken as exact where nobody asks for them, in the order in which they are told."""
