"""Force laws, used by the levitated rig and by the reader of records alike."""

from rotorid.actuators.laws import MU0, CurrentLaw, Differential, Flux, Linear, with_std

__all__ = ["MU0", "CurrentLaw", "Differential", "Flux", "Linear", "with_std"]
