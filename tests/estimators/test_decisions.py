"""Shares below which something is rounding, or said to follow: each with its reason beside it."""
