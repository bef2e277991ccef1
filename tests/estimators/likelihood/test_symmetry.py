"""Signs and places in webs small enough to try them all."""

from itertools import permutations, product

import numpy as np
import pytest

from rotorid.likelihood import symmetric_answers as symmetry
from rotorid.likelihood.symmetric_answers import Link, Web


def brute_turns(web, count):
    """Return every set of nodes whose signs may turn together, tried one by one."""
    found = set()
    for signs in product((1, -1), repeat=count):
        kept = all(signs[node] == 1 for node in web.still)
        kept &= all(np.prod([signs[n] for n in nodes]) == 1 for nodes in web.alike)
        for x in web.links:
            kept &= signs[x.row] * signs[x.column] * np.prod([signs[f] for f in x.factors]) == 1
        if kept:
            found.add(sum(1 << node for node, sign in enumerate(signs) if sign < 0))
    return found


def spanned(basis):
    """Return every sum of some sets."""
    found = {0}
    for bits in basis:
        found |= {bits ^ other for other in found}
    return found


@pytest.mark.parametrize("seed", range(20))
def test_turns_are_all_that_there_are(seed):
    rng = np.random.default_rng(seed)
    count = 8
    links = tuple(
        Link(0, *rng.integers(0, 4, 2).tolist(), tuple(rng.integers(4, 8, k).tolist()), 1.0)
        for k in rng.integers(0, 3, rng.integers(2, 8))
    )
    still = set(rng.integers(0, count, 1).tolist())
    alike = [frozenset(rng.choice(count, 2, replace=False).tolist())]
    web = Web(links, range(count), still, alike)
    basis = web.turns()
    assert len(spanned(basis)) == 2 ** len(basis)
    assert spanned(basis) == brute_turns(web, count)


def wings(second=1.0, extra=()):
    """Return two wings of a body: masses 0 and 1, springs 2 and 3, rows 4 to 6, columns 7 to 9.

    Node 10 is the sensor of the body. The coefficient of the second spring is given.
    """
    links = [Link("sensor", 10, 9, (), 1.0)]
    for wing, size in ((0, 1.0), (1, second)):
        row, column, mass, spring = 4 + wing, 7 + wing, wing, 2 + wing
        links += [
            Link(2, row, column, (mass,), -1.0),
            Link(0, row, column, (spring,), size),
            Link(0, row, 9, (spring,), -size),
            Link(0, 6, column, (spring,), -size),
            Link(0, 6, 9, (spring,), size),
        ]
    colours = ["m", "m", "k", "k", "row", "row", "row", "q", "q", "q", "alone"]
    return Web((*links, *extra), colours, {10})


def test_wings_change_places_and_nothing_else_does():
    web = wings()
    assert list(web.exchanges([0, 1, 2, 3])) == [[1, 0, 3, 2, 5, 4, 6, 8, 7, 9, 10]]
    for places in permutations(range(4)):
        whole = [*places, 5, 4, 6, 8, 7, 9, 10]
        followed = web.followed(whole, {9: 1.0, 10: 1.0, 6: 1.0})
        assert (followed is not None) == (places == (1, 0, 3, 2))


def test_numbers_that_differ_are_made_up_for():
    web = wings(second=-2.0)
    (places,) = web.exchanges([0, 1, 2, 3])
    assert places[:4] == [1, 0, 3, 2]
    factors = web.followed(places, {6: 1.0, 9: 1.0, 10: 1.0})
    # k0 = -2 k1: each takes the other's number with it.
    np.testing.assert_allclose(factors[2:4], [-0.5, -2.0], rtol=1e-12)
    assert web.followed(places, {6: 1.0, 9: 1.0, 10: 1.0, 2: 1.0}) is None
    np.testing.assert_allclose(factors[:2], 1.0, rtol=1e-12)


def test_a_force_on_one_wing_tells_it():
    web = wings(extra=[Link("force", 4, 10, (), 1.0)])
    assert list(web.exchanges([0, 1, 2, 3])) == []


def test_what_takes_too_long_is_left(monkeypatch):
    monkeypatch.setattr(symmetry, "EFFORT", 0)
    assert list(wings().exchanges([0, 1, 2, 3])) == []


def test_coefficients_are_one_number_to_ten_digits():
    for off, same in ((0.9e-8, True), (1.2e-8, False)):
        web = wings(second=1 + off)
        (places,) = web.exchanges([0, 1, 2, 3])
        known = dict.fromkeys(range(11), 1.0)
        assert (web.followed(places, known) is not None) == same
