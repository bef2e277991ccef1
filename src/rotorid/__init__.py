"""Physical parameters of magnetically levitated rotors, each with an error bar that holds."""

from importlib.metadata import version as _version

__version__ = _version("rotorid")

from rotorid.errors import (
    InputError,
    ModelError,
    NotConvergedError,
    NotIdentifiableError,
    ReadError,
)
from rotorid.estimate import Estimate, load_estimate
from rotorid.estimators import (
    Batch,
    Constraint,
    Estimator,
    LeastSquares,
    MaximumLikelihood,
    Plan,
    Sequential,
    predict_accuracy,
)
from rotorid.experiment import Experiment, load_experiment
from rotorid.identify import identify
from rotorid.io import read_record
from rotorid.models import Model, load_model, parse_model, shipped_models
from rotorid.record import Channel, Drive, PeriodicRecord, Record
from rotorid.rig import simulate, steady_state
from rotorid.signals import average

__all__ = [
    "Batch",
    "Channel",
    "Constraint",
    "Drive",
    "Estimate",
    "Estimator",
    "Experiment",
    "InputError",
    "LeastSquares",
    "MaximumLikelihood",
    "Model",
    "ModelError",
    "NotConvergedError",
    "NotIdentifiableError",
    "PeriodicRecord",
    "Plan",
    "ReadError",
    "Record",
    "Sequential",
    "average",
    "identify",
    "load_estimate",
    "load_experiment",
    "load_model",
    "parse_model",
    "predict_accuracy",
    "read_record",
    "shipped_models",
    "simulate",
    "steady_state",
]
