"""Force laws of actuators."""
