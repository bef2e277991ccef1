"""Shares below which something is rounding, or said to follow: each with its reason beside it."""

from rotorid.answer import derived
from rotorid.answer import machine_checks as gate
from rotorid.likelihood import doubts as exact
from rotorid.linear import solve as weighted


def test_what_is_rounding_and_what_is_not() -> None:
    """No record tells these from their neighbours: double precision holds 1e-16."""
    assert derived.RANK_TOLERANCE == 1e-9
    assert weighted.RANK_TOLERANCE == 1e-11
    assert gate.ROUNDING == 1e-9
    assert exact.TAKEN_OVER == 1e-6


def test_a_parameter_that_moves_half_as_much_as_the_scale_follows_it() -> None:
    assert exact.FOLLOWS == 0.5
