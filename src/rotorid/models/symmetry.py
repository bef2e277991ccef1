"""Changes of sign and of place that leave equations as they are.

Equations are a web: each term links a row, a column (a coordinate, an input, a load), and the
unknowns that multiply it. Nodes may turn their signs where every term keeps its own: a linear
system over GF(2). Nodes may change places where every term comes to lie on another one; signs and
sizes of the coefficients must then be made up for by the nodes, which is the same linear system
with a right side, and one in logarithms. No number is searched for.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import combinations

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.core.values import Floats

ROUNDING = 1e-8
"""Logarithms of coefficients that differ by less are those of one number: ten digits are typed."""
EFFORT = 200
"""Refinements after which two nodes are not said to change places: pairs of wings take three."""

Bits = int
"""A set of nodes, one bit each; with a right side, one bit more."""


@frozen
class Link:
    """``coefficient * product of factors * column`` in a row; all but the coefficient are nodes.

    Only links of the same `kind` (order of the derivative, function of the speed) are alike.
    """

    kind: Hashable
    row: int
    column: int
    factors: tuple[int, ...]
    coefficient: float

    @cached_property
    def powers(self) -> Mapping[int, int]:
        """How often each node stands in the term; dividing by its row makes that -1."""
        found = Counter({self.column: 1})
        found.update(self.factors)
        found.subtract([self.row])
        return {node: power for node, power in found.items() if power}


@frozen
class Web:
    """All links of some nodes, and the nodes that are read: rows, columns and factors are nodes."""

    links: tuple[Link, ...]
    colours: Sequence[Hashable]  # of each node; only those of one colour may change places
    still: frozenset[int] | set[int]  # nodes that keep their signs
    alike: Sequence[frozenset[int]] = ()  # nodes whose signs must multiply to one

    def turns(self, still: Sequence[int] = ()) -> list[Bits]:
        """Return a basis of the sets of nodes that may turn their signs together."""
        kept = [*self.still, *still]
        # The nodes that stand an odd number of times in a link.
        odd = {sum((n % 2) << node for node, n in link.powers.items()) for link in self.links}
        equations = odd | {1 << node for node in kept}
        equations |= {sum(1 << node for node in nodes) for nodes in self.alike}
        return _null_space(equations, len(self.colours))

    def exchanges(self, among: Sequence[int]) -> Iterator[list[int]]:
        """Yield ways to change places, as where each node goes, that move some nodes in pairs."""
        numbers = {colour: i for i, colour in enumerate(dict.fromkeys(self.colours))}
        first = [numbers[colour] for colour in self.colours]
        search = _Search(self.links, len(first))
        first = (search.refined(first * 2) or first)[: len(first)]
        moved: set[tuple[int, int]] = set()
        for a, b in combinations(among, 2):
            if first[a] != first[b] or (a, b) in moved:
                continue
            fresh = max(first) + 1
            one, other = list(first), list(first)
            one[a], one[b], other[b], other[a] = fresh, fresh + 1, fresh, fresh + 1
            search.effort = EFFORT
            found = search.matched(one + other)
            if found is not None:
                moved |= set(enumerate(found))
                yield found

    def followed(self, places: Sequence[int], known: Mapping[int, float]) -> Floats | None:
        """Return by what each node is multiplied on the way to its place; None if by nothing.

        `known` are those that are multiplied by a given number.
        """
        there = {_key(x, range(len(self.colours))): x.coefficient for x in self.links}
        equations, rows, right = set(), [], []
        for link in self.links:
            if (coefficient := there.get(_key(link, places))) is None:
                return None
            ratio, row = link.coefficient / coefficient, np.zeros(len(places))
            bits = 0
            for node, power in link.powers.items():
                if node in known:
                    ratio /= known[node] ** power
                else:
                    row[node] = power
                    bits |= (power % 2) << node
            equations.add(bits | (ratio < 0) << len(places))
            rows.append(row)
            right.append(np.log(abs(ratio)))
        equations |= {1 << node for node in self.still if node not in known}
        signs = _solution(equations, len(places))
        matrix, values = np.array(rows), np.array(right)
        sizes = np.linalg.lstsq(matrix, values, rcond=ROUNDING)[0]
        if signs is None or np.abs(matrix @ sizes - values).max(initial=0.0) > ROUNDING:
            return None
        turned = np.array([-1.0 if signs >> node & 1 else 1.0 for node in range(len(places))])
        found = turned * np.exp(sizes)
        for node, factor in known.items():
            found[node] = factor
        return np.asarray(found)


class _Search:
    """Colour refinement of two copies of a web, and the way back where a guess was wrong."""

    def __init__(self, links: Sequence[Link], count: int) -> None:
        kinds = {kind: i for i, kind in enumerate(dict.fromkeys(x.kind for x in links))}
        self.count, self.effort = count, EFFORT
        self.links = [
            (kinds[x.kind], x.row + copy, x.column + copy, [f + copy for f in x.factors])
            for copy in (0, count)
            for x in links
        ]

    def refined(self, colours: list[int]) -> list[int] | None:
        """Split colours by what nodes are linked with; None where the copies are not alike."""
        self.effort -= 1
        while True:
            inner: dict[Hashable, int] = {}
            outer: dict[Hashable, int] = {}
            beside: list[list[tuple[int, int]]] = [[] for _ in colours]
            for kind, row, column, factors in self.links:
                multiplied = tuple(sorted(colours[f] for f in factors))
                key = (kind, colours[row], colours[column], multiplied)
                seen = inner.setdefault(key, len(inner))
                for place, node in ((0, row), (1, column), *((2, f) for f in factors)):
                    beside[node].append((place, seen))
            pairs = zip(colours, beside, strict=True)
            split = [outer.setdefault((own, *sorted(met)), len(outer)) for own, met in pairs]
            if Counter(split[: self.count]) != Counter(split[self.count :]):
                return None
            if len(outer) == len(set(colours)):
                return split
            colours = split

    def matched(self, colours: list[int]) -> list[int] | None:
        """Return where each node of one copy is in the other, if there is a way."""
        if self.effort <= 0 or (split := self.refined(colours)) is None:
            return None
        one, other = split[: self.count], split[self.count :]
        classes: dict[int, list[int]] = {}
        for node, colour in enumerate(other):
            classes.setdefault(colour, []).append(node)
        several = [nodes for nodes in classes.values() if len(nodes) > 1]
        if not several:
            return [classes[colour][0] for colour in one]
        nodes = min(several, key=len)
        node = one.index(other[nodes[0]])
        for there in sorted(nodes, key=lambda other_node: other_node != node):
            guess = list(split)
            guess[node] = guess[self.count + there] = self.count + max(one)
            found = self.matched(guess)
            if found is not None:
                return found
        return None


def _key(link: Link, places: Sequence[int]) -> Hashable:
    """Return all of a link but its coefficient, with its nodes in other places."""
    factors = tuple(sorted(places[f] for f in link.factors))
    return link.kind, places[link.row], places[link.column], factors


def _eliminated(equations: set[Bits]) -> dict[int, Bits]:
    """Return the equations solved, by the lowest bit of each, which no other one holds."""
    pivots: dict[int, Bits] = {}
    for equation in sorted(equations):
        for pivot, row in pivots.items():
            if equation >> pivot & 1:
                equation ^= row
        if not equation:
            continue
        lowest = (equation & -equation).bit_length() - 1
        for pivot, row in pivots.items():
            if row >> lowest & 1:
                pivots[pivot] = row ^ equation
        pivots[lowest] = equation
    return pivots


def _null_space(equations: set[Bits], count: int) -> list[Bits]:
    """Return a basis of the sets that hold an even number of the nodes of each equation."""
    pivots = _eliminated(equations)
    return [
        1 << free | sum(1 << pivot for pivot, row in pivots.items() if row >> free & 1)
        for free in range(count)
        if free not in pivots
    ]


def _solution(equations: set[Bits], count: int) -> Bits | None:
    """Return a set that holds what the last bit of each equation says, odd or even."""
    pivots = _eliminated(equations)
    if count in pivots:
        return None
    return sum(1 << pivot for pivot, row in pivots.items() if row >> count & 1)
