"""Records computed instead of measured."""
