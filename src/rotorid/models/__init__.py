"""Equations of motion as text, and what follows from them."""
