"""Checks of a record before any model."""
