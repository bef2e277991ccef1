"""Tails of distributions and where they end."""

import pytest

from rotorid.core.distributions import f_limit, f_tail


@pytest.mark.parametrize(("first", "second"), [(1, 7), (2, 9), (2, 518), (8, 30)])
@pytest.mark.parametrize("chance", [0.4, 1e-3, 1e-9])
def test_a_limit_is_exceeded_with_its_chance(first: int, second: int, chance: float) -> None:
    assert f_tail(f_limit(chance, first, second), first, second) == pytest.approx(chance, rel=1e-9)
