"""Least squares on the equations of motion: ordinary, weighted, sequential."""
