"""Values: equal by content, arrays read-only."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from rotorid.core.values import ByContent, read_only, same


@dataclass(frozen=True, eq=False)
class Sample(ByContent):
    """A value with an array and a note that does not count."""

    data: Any
    note: str = field(default="", compare=False)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (1.0, 1.0),
        (float("nan"), float("nan")),
        (np.array([1.0, np.nan]), np.array([1.0, np.nan])),
        (np.array([1j, np.nan]), np.array([1j, np.nan])),
        (np.array([1, 2]), np.array([1, 2])),
        (np.array(["a"]), np.array(["a"])),
        ({"a": np.zeros(2)}, {"a": np.zeros(2)}),
        ((1, [np.ones(1)]), (1, [np.ones(1)])),
        (Sample(np.ones(3)), Sample(np.ones(3))),
        (None, None),
    ],
)
def test_alike(first, second):
    assert same(first, second)
    assert Sample(first) == Sample(second)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (1.0, 2.0),
        (1.0, float("nan")),
        (float("nan"), 1.0),
        (np.array([1.0, 2.0]), np.array([1.0, 3.0])),
        (np.zeros((2, 1)), np.zeros(2)),
        (np.zeros(2), np.zeros(3)),
        ({"a": 1}, {"b": 1}),
        ({"a": 1}, {"a": 1, "b": 1}),
        ((1, 2), (1,)),
        (np.array([1.0]), np.array(["a"])),
        (Sample(np.ones(3)), Sample(np.zeros(3))),
        (None, 0.0),
    ],
)
def test_different(first, second):
    assert not same(first, second)
    assert Sample(first) != Sample(second)


def test_what_does_not_count_is_not_compared():
    assert Sample(1, "a") == Sample(1, "b")
    assert Sample(1) != 1
    with pytest.raises(TypeError, match="unhashable"):
        hash(Sample(1))


def test_a_read_only_view_leaves_its_source_writeable():
    source = np.zeros(2)
    view = read_only(source)
    with pytest.raises(ValueError, match="read-only"):
        view[0] = 1
    source[0] = 2
    assert view[0] == 2
