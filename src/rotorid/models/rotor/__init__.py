"""Rotors from their drawing: sections, discs, supports and places, to a `Model`."""

from rotorid.models.rotor.drawing import Disc, Place, Rotor, Section, Support
from rotorid.models.rotor.model import RotorModel

__all__ = ["Disc", "Place", "Rotor", "RotorModel", "Section", "Support"]
