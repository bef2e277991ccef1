"""Signals: excitation, period averaging, line spectra and their covariance, rotor angle."""

from rotorid.signals.average import average

__all__ = ["average"]
