"""Equations of motion as text or from a drawing, and what follows from them."""

from rotorid.models.linear_form import LinearForm
from rotorid.models.loader import load_model, parse_model, shipped_models
from rotorid.models.model import Model, Motion

__all__ = ["LinearForm", "Model", "Motion", "load_model", "parse_model", "shipped_models"]
