"""Signals: excitation, period averaging, line spectra and their covariance, rotor angle."""
