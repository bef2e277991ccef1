"""Unknowns of the measurement, one kind per file; `KINDS` is their order in results."""

from collections.abc import Sequence

from rotorid.estimators.likelihood.nuisances.base import (
    Constant,
    Factor,
    Nuisance,
    Nuisances,
    Reading,
    Turn,
    Unknown,
)
from rotorid.estimators.likelihood.nuisances.bend import Bend, Cubic, Loop
from rotorid.estimators.likelihood.nuisances.delay import CommonDelay, Delay
from rotorid.estimators.likelihood.nuisances.force_law import CurrentGain, DisplacementGain
from rotorid.estimators.likelihood.nuisances.gain import Gain
from rotorid.estimators.likelihood.nuisances.law_constant import Knee, LawConstant
from rotorid.estimators.likelihood.nuisances.missing import (
    Lever,
    Missing,
    MissingEntry,
    MissingLoad,
)
from rotorid.estimators.likelihood.nuisances.multiplier import Multiplier
from rotorid.estimators.likelihood.nuisances.own import Own
from rotorid.estimators.likelihood.nuisances.phase import Phase
from rotorid.estimators.likelihood.nuisances.response import Response
from rotorid.estimators.likelihood.nuisances.runout import Runout
from rotorid.estimators.likelihood.nuisances.scale import Scale
from rotorid.observation import Observation

__all__ = [
    "Bend",
    "Constant",
    "Delay",
    "Factor",
    "Knee",
    "LawConstant",
    "Lever",
    "Missing",
    "MissingEntry",
    "MissingLoad",
    "Multiplier",
    "Nuisance",
    "Nuisances",
    "Own",
    "Reading",
    "Response",
    "Scale",
    "Turn",
    "Unknown",
    "asked_nuisances",
    "every_nuisance",
]

KINDS: tuple[type[Nuisance], ...] = (
    Own,  # parameters of the model: they stand before what is unknown of the measurement
    CurrentGain,
    DisplacementGain,
    Scale,
    LawConstant,
    Knee,
    Cubic,
    Loop,
    Runout,
    Gain,
    CommonDelay,
    Delay,
    Response,
    Phase,
)


def asked_nuisances(records: Sequence[Observation], wanted: Nuisances) -> tuple[Nuisance, ...]:
    """Return the nuisances that settings and channels ask for."""
    return tuple(n for kind in KINDS for n in kind.asked(records, wanted))


def every_nuisance(records: Sequence[Observation]) -> tuple[Nuisance, ...]:
    """Return all nuisances that these records could have."""
    return tuple(n for kind in KINDS for n in kind.every(records))
