"""Records computed instead of measured."""

from rotorid.rig.steady_state import simulate, steady_state

__all__ = ["simulate", "steady_state"]
