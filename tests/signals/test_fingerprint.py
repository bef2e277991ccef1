"""Prints of records: the same samples are found wherever they begin, and nothing else is."""

import numpy as np
import pytest

from rotorid.experiment.duplicates import MOST, Printer, Shared, candidates, shared


def prints(*blocks):
    printer = Printer()
    for block in blocks:
        printer.add(block)
    return printer.prints()


def noise(count=3000, channels=2, state=0):
    return np.random.default_rng(state).standard_normal((count, channels))


@pytest.mark.parametrize(("begin", "end"), [(0, 3000), (70, 3000), (133, 2900), (1500, 1900)])
def test_an_excerpt_is_found_where_it_is(begin, end):
    whole = noise()
    found = shared(prints(whole), prints(whole[begin:end]))
    assert found == Shared(end - begin, begin, 0)
    assert candidates([prints(noise(state=1)), prints(whole), prints(whole[begin:end])]) == [(1, 2)]


def test_two_that_overlap_and_blocks_of_any_size():
    whole = noise(20000)
    one = prints(whole[:3], whole[3:17], whole[17:4000], whole[4000:12000])
    assert np.array_equal(one.values, prints(whole[:12000]).values)
    assert shared(one, prints(whole[8000:])) == Shared(4000, 8000, 0)
    assert shared(prints(whole[8000:]), one) == Shared(4000, 0, 8000)


def test_many_samples_leave_few_prints_and_are_found_still():
    whole = noise(2_500_000, 1)
    one = prints(*np.array_split(whole, 30))
    assert MOST / 4 < len(one.values) <= MOST
    assert shared(one, prints(whole[1_000_003:1_300_000])) == Shared(299_997, 1_000_003, 0)


def test_a_few_samples_alike_are_not_told():
    whole = noise(20000)
    assert shared(prints(whole), prints(np.concatenate([whole[:100], noise(900, 2, 1)]))) is None


def sweep(count=8000, lag=0.0):
    t = (np.arange(count) + lag) / 5000.0
    return np.stack([np.sin(300 * t**2), np.cos(300 * t**2)], axis=1)


ALIKE = {
    "steady": lambda rng: np.full((5000, 2), 0.5),
    "zeros": lambda rng: np.zeros((5000, 2)),
    "steps": lambda rng: np.repeat(rng.integers(0, 2, (25, 2)), 200, axis=0).astype(float),
    "coarse sines": lambda rng: np.round(4 * sines() + 0.02 * rng.standard_normal((5000, 2))),
    "coarse sweep": lambda rng: np.round(100 * sweep() + 0.2 * rng.standard_normal((8000, 2))),
    "one coarse channel": lambda rng: rng.integers(0, 3, (20000, 1)).astype(float),
}


def sines():
    t = np.arange(5000) / 250
    return np.stack([np.sin(2 * np.pi * t), np.cos(6 * np.pi * t)], axis=1)


@pytest.mark.parametrize("name", ALIKE)
def test_two_measurements_that_are_alike_are_two(name):
    rng = np.random.default_rng(3)
    one, other = (ALIKE[name](rng) for _ in range(2))
    assert shared(prints(one), prints(other)) is None


def test_one_that_repeats_itself_is_found_where_it_is_the_same_to_its_end():
    """Whose prints stand nowhere once: without noise every period is like the others."""
    exact = np.tile(sines()[:250], (20, 1))
    assert shared(prints(exact), prints(exact.copy())) == Shared(5000, 0, 0)
    assert shared(prints(exact), prints(exact[:4999])) is None
    assert candidates([prints(exact), prints(noise(5000)), prints(exact)]) == [(0, 2)]
