"""Signals: excitation, periods, lines and their covariance, rotor angle, checks of a record."""
