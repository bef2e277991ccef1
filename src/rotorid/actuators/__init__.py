"""Force laws, used by the levitated rig and by the reader of records alike."""

from rotorid.actuators.constants import MU0, with_std
from rotorid.actuators.flux import Flux
from rotorid.actuators.laws import CurrentLaw, Differential, Linear
from rotorid.actuators.reading import ForceReading, forces

__all__ = [
    "MU0",
    "CurrentLaw",
    "Differential",
    "Flux",
    "ForceReading",
    "Linear",
    "forces",
    "with_std",
]
