"""Experiment files: what was measured, what is known, how to estimate."""

from rotorid.experiment.experiment import Experiment, load_experiment

__all__ = ["Experiment", "load_experiment"]
