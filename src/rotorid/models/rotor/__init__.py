"""Rotors from their drawing: sections, discs, supports and places, to a `Model`."""

from rotorid.models.rotor.rotor_model import RotorModel

__all__ = ["RotorModel"]
