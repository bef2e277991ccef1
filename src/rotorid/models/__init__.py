"""Equations of motion as text or from a drawing, and what follows from them."""

from rotorid.models.base import BaseParameters
from rotorid.models.linear_form import LinearForm, Matrices
from rotorid.models.loader import load_model, parse_model, shipped_models
from rotorid.models.model import Model, Motion, Parameter

__all__ = [
    "BaseParameters",
    "LinearForm",
    "Matrices",
    "Model",
    "Motion",
    "Parameter",
    "load_model",
    "parse_model",
    "shipped_models",
]
