"""Answers that fit as well because the machine has a symmetry that no record tells.

Signs are taken from the start, which says how the machine was drawn; nothing says which of two
hidden parts is which, so both answers stand. What else is known, bounds, priors, measured modes, is
asked by what the other answer costs (docs/maximum-likelihood.md, section 7).
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, reduce
from itertools import combinations
from operator import xor
from typing import Any

import numpy as np

from rotorid.core.notes import Note
from rotorid.core.values import Floats, fact, frozen, grouped
from rotorid.data.observation import Observation, Records
from rotorid.likelihood.assembly import Terms, every_load, other_terms, profile
from rotorid.likelihood.inference import Inference
from rotorid.likelihood.layout import Layout
from rotorid.likelihood.problem import Problem, outside
from rotorid.likelihood.relations import Relations
from rotorid.likelihood.solver import Solution, settle
from rotorid.models import Model

CLOSE = 15.0
"""What costs more by no more than this fits as well, other minima and other suspects: 15 has a
chance of 1e-4."""
APART = 5.0  # minima further apart than this many deviations are different answers
SAME = 1e-9  # share of its cost by which a mirror image may miss it by rounding
MOST = 6  # independent changes of sign that are combined: 64 answers; more are tried one by one
LARGE = 3000
"""Links up to which exchanges are looked for, in the first records that have no more: a second or
two. Matrices from a drawing, whose shapes have no names that could change places, have more."""
MOVING = {"row", "coordinate"}
"""Nodes that may turn and change places, beside parameters; inputs, loads and sensors stay."""
Place = tuple[str, Hashable]  # what a node is, and which of its kind
Entry = tuple[Hashable, Place, Place, tuple[int, ...]]
"""A kind of term, its row, its column, and the unknowns that multiply it."""


@frozen
class Symmetry:
    """Where unknowns go, each multiplied, and the coordinates that go with them.

    A turn leaves them in place, and multiplies some by -1. Without coordinates that turn with these
    every term of the equations stays what it is: a lever in squares.
    """

    places: tuple[int, ...]
    factors: Floats
    coordinates: tuple[tuple[str, ...], ...] = ()  # that turn, or change places

    def of(self, values: Floats) -> Floats:
        moved = values.copy()
        moved[list(self.places)] = values * self.factors
        return moved

    @property
    def pairs(self) -> list[tuple[int, int]]:
        return [(i, j) for i, j in enumerate(self.places) if j > i]

    @property
    def turned(self) -> list[int]:
        return np.flatnonzero(self.factors < 0).tolist()


@frozen
class Mirrors:
    layout: Layout
    turns: tuple[Symmetry, ...] = ()
    exchanges: tuple[Symmetry, ...] = ()

    @classmethod
    def of(
        cls, problem: Problem, records: Records, unknowns: Floats, *, as_free: bool = False
    ) -> Mirrors:
        """Find the symmetries of a machine at an answer; `as_free`: as if nothing were fixed."""
        layout = problem.layout
        if as_free:
            loose = (replace(u, std=None) if u.fixed else u for u in layout.unknowns)
            layout = replace(layout, unknowns=tuple(loose))
        web = _web(problem, layout, records, unknowns)
        turns = _turns(layout.model, web, len(layout.unknowns))
        if len(web.links) > LARGE:  # what some records do not tell, all are asked by the cost
            web = _web(problem, layout, records, unknowns, LARGE)
        free = [int(i) for i in layout.free if i < layout.named]
        fixed = {i: float(unknowns[i]) for i, u in enumerate(layout.unknowns) if u.fixed}
        return cls(layout, turns, _exchanges(layout.model, web, free, fixed))

    def as_started(self, solution: Solution) -> Solution:
        """Return the one of its mirror images whose signs are those of the start."""
        if not self.turns:
            return solution
        score = self._agreement(solution.point.unknowns)
        for turn in sorted(self._every_turn(), key=lambda turn: -score(turn)):
            if score(turn) <= 0:
                break
            if (image := self._image(solution, turn)) is not None:
                return image
        return solution

    def best(self, solution: Solution) -> Solution:
        """Return the lowest of its mirror images, where a prior tells them, with these signs."""
        images = (self._image(solution, exchange) for exchange in self.exchanges)
        lowest = min([solution, *filter(None, images)], key=lambda image: image.point.cost)
        told = lowest.point.cost < solution.point.cost * (1 - SAME) - SAME
        return self.as_started(lowest if told else solution)

    def images(self, solution: Solution) -> list[tuple[Solution, Symmetry]]:
        """Return the answers that fit as well and between which no start decides."""
        score = self._agreement(solution.point.unknowns)
        turns = [turn for turn in self.turns if turn.coordinates and score(turn) == 0]
        images = [(self._image(solution, each), each) for each in (*turns, *self.exchanges)]
        return [(self.as_started(x) if each.pairs else x, each) for x, each in images if x]

    def notes(self, solution: Solution, inference: Inference) -> Iterator[Note]:
        free, x = self.layout.free, solution.point.unknowns
        std = np.zeros(len(x))
        std[free] = inference.std
        std[free[inference.linear.undetermined]] = np.inf
        for turn in self.turns:
            where = turn.turned
            apart = (2 * np.abs(x[where]) > APART * std[where]).all()
            if not turn.coordinates or not apart or self._image(solution, turn) is None:
                continue
            names = tuple(self.layout.unknowns[i].name for i in where)
            text = f"sign of {names[0]}: that of its start is taken"
            if len(names) > 1:
                text = (
                    f"signs of {_listed(names)}, which turn together: those of their starts are "
                    "taken"
                )
            sensors = [q for q in self.layout.model.measurable if q in turn.coordinates[0]]
            cure = f"a sensor of {' or '.join(sensors)} would tell; " if sensors else ""
            cure += "where physics tells, positive = true in the model says so"
            yield Note("sign", "doubts", f"no record tells the {text}", cure, on=names)

    def _agreement(self, values: Floats) -> Callable[[Symmetry], float]:
        """Return by how many signs more than as it stands each turn has those of the start."""
        agree = np.sign(self.layout.start) * np.sign(values)
        return lambda turn: float(agree @ (turn.factors - 1))

    def _every_turn(self) -> Iterator[Symmetry]:
        most = len(self.turns) if len(self.turns) <= MOST else 1
        for count in range(1, most + 1):
            for chosen in combinations(self.turns, count):
                factors = np.prod([turn.factors for turn in chosen], axis=0)
                yield replace(chosen[0], factors=factors)

    def _image(self, solution: Solution, change: Symmetry) -> Solution | None:
        """Return the mirror image of an answer, where what else is known allows it."""
        point = solution.point
        problem, x = point.problem, change.of(point.unknowns)
        broken = np.abs(problem.exact.values(x)) > SAME * problem.exact.sizes(x)
        if len(outside(problem.bounds, x)) or broken.any():
            return None
        image = problem.at(x)
        above = image.cost - point.cost
        if not np.isfinite(above) or above > 10 * CLOSE:
            return None
        trail = tuple(change.of(at) for at in solution.trail)
        if abs(above) <= SAME * point.cost + SAME:
            return replace(solution, point=image, trail=trail)
        try:  # a prior draws the others after it
            settled = settle(problem, x)
        except np.linalg.LinAlgError:
            return None
        return replace(settled, trail=trail) if settled.point.cost <= point.cost + CLOSE else None


def _links(
    layout: Layout, records: Records, unknowns: Floats, most: float
) -> tuple[list[Place], list[Link]]:
    """Return nodes and terms of records that differ, the first that have no more than `most`."""
    nodes: dict[Place, int] = {("unknown", i): i for i in range(len(layout.unknowns))}
    gone = {i for i, u in enumerate(layout.unknowns) if u.fixed and not unknowns[i]}
    links: list[Link] = []
    every = [_terms_of(layout.of_record(k), record) for k, record in enumerate(records)]
    distinct = dict.fromkeys(tuple(x.items()) for x in every or [_terms_of(layout, None)])
    for number, terms in enumerate(distinct):
        if len(links) + len(terms) > most:
            break
        for (kind, row, column, factors), coefficient in terms:
            if coefficient == 0 or gone & set(factors):
                continue
            one, other = (
                nodes.setdefault((what, (number, name)), len(nodes)) for what, name in (row, column)
            )
            links.append(Link(kind, one, other, factors, coefficient))
    return list(nodes), links


def _terms_of(layout: Layout, record: Observation | None) -> dict[Entry, float]:
    """Return the coefficient of each kind, row, column and product; no `record`: of modes alone."""
    n, rows, still = len(layout.model.coordinates), len(layout.model.texts), set[int]()
    found: dict[Entry, float] = defaultdict(float)
    observed = None if record is None else layout.observed(record)
    terms = Terms.of(layout, [] if observed is None else other_terms(layout, observed))
    sizes = {k: profile(k, observed.lines)[0] if observed else 1.0 for k in terms.table.kinds}
    if observed is not None:
        moving = observed.lines.mean[:, list(observed.input_columns)].any(axis=0)
        still = {n + k for k in np.flatnonzero(~moving).tolist()}
    products = list(terms.where)
    for t in (t for t in terms.table if t.column not in still):
        row = ("row" if t.row < rows else "sensor row", t.row)
        column = ("coordinate" if t.column < n else "input", t.column)
        found[t.kind, row, column, products[t.monomial]] += sizes[t.kind] * t.coefficient
    if observed is None:
        return found
    for load in every_load(layout):
        found["load", ("row", load.row), ("load", load.signal), load.factors] += load.coefficient
    reads = observed.reads
    for number, k in np.argwhere(reads).tolist():
        found["reads", ("sensor", number), ("coordinate", k), ()] = float(reads[number, k])
    return found


def _web(
    problem: Problem, layout: Layout, records: Records, unknowns: Floats, most: float = np.inf
) -> Web:
    names, links = _links(layout, records, unknowns, most)
    used = {f for link in links for f in link.factors}
    movable = {i for i in used if i < layout.named} - layout.idle
    colours: list[Hashable] = []
    still = set()
    for node, (what, name) in enumerate(names):
        if what in MOVING:
            assert isinstance(name, tuple)
            colours.append((what, name[0]))
            continue
        unknown = layout.unknowns[node] if node in movable else None
        colours.append((what, unknown.unit, unknown.fixed) if unknown else ("alone", node))
        if not unknown or unknown.fixed or unknown.positive:
            still.add(node)
        elif unknown.std and 4 * unknowns[node] * unknown.prior / unknown.std**2 > CLOSE:
            still.add(node)  # its sign alone would raise the cost of its prior too far
    priors = [u.name for u in layout.unknowns]
    alike = [*_alike(problem.exact, ()), *_alike(problem.known.relations, priors)]
    return Web(tuple(links), tuple(colours), still, alike, names)


def _alike(relations: Relations, priors: Sequence[str]) -> Iterator[Bits]:
    """Yield sets of unknowns whose signs must multiply to one for relations to hold."""
    for row in relations.rows:
        if row.stated not in priors:
            odd = [_odd(product) for product, size in row.polynomial.items() if size]
            yield from (odd[0] ^ nodes for nodes in odd[1:])


@fact
def _turns(model: Model, web: Web, unknowns: int) -> tuple[Symmetry, ...]:
    """Return independent changes of sign: those of unknowns alone, then those with coordinates."""
    ends = [node for node, (what, _) in enumerate(web.names) if what in MOVING]
    own, found = (1 << unknowns) - 1, list[Symmetry]()
    pivots: dict[int, Bits] = {}
    for still in (ends, ()):
        for turned in web.turns(still):
            turned = _reduced(turned, pivots)
            if turned & own:
                pivots[_lowest(turned & own)] = turned
                signs = _signs(turned, len(web.names))
                turning = () if still else _coordinates(model, web, np.flatnonzero(signs < 0))
                same, moved = tuple(range(unknowns)), (turning,) if turning else ()
                found.append(Symmetry(same, signs[:unknowns], moved))
    return tuple(found)


def _coordinates(model: Model, web: Web, nodes: Iterable[int]) -> tuple[str, ...]:
    named = (web.names[node] for node in nodes)
    found: Any = [name for what, name in named if what == "coordinate"]
    return tuple(dict.fromkeys(model.coordinates[column] for _, column in found))


@fact
def _exchanges(
    model: Model, web: Web, free: Sequence[int], fixed: Mapping[int, float]
) -> tuple[Symmetry, ...]:
    names = web.names
    count, found = sum(what == "unknown" for what, _ in names), list[Symmetry]()
    used = {factor for link in web.links for factor in link.factors}
    free = [i for i in free if i in used]
    for places in web.exchanges(free):
        known = {i: 1.0 for i, (what, _) in enumerate(names) if what not in MOVING}
        for i in free:
            del known[i]
        for i, value in fixed.items():
            if places[i] != i:
                known[i] = fixed[places[i]] / value
        if (factors := web.followed(places, known)) is None:
            continue
        pairs = [
            _coordinates(model, web, [node, place])
            for node, place in enumerate(places)
            if place > node and names[node][0] == "coordinate"
        ]
        found.append(Symmetry(tuple(places[:count]), factors[:count], tuple(dict.fromkeys(pairs))))
    return tuple(found)


def _listed(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def exchanged(layout: Layout, exchange: Symmetry, values: Floats) -> str:
    pairs = [(i, j) for i, j in exchange.pairs if not layout.unknowns[i].fixed]
    names = [[layout.unknowns[k].name for k in side] for side in zip(*pairs, strict=True)]

    def unlike(pair: tuple[int, int]) -> float:
        one, other = values[pair[0]], exchange.factors[pair[1]] * values[pair[1]]
        return round(float(abs(one - other) / max(abs(one), abs(other), 1e-300)), 3)

    i, j = max(pairs, key=unlike)
    factor = "" if np.isclose(exchange.factors[j], 1) else f"{exchange.factors[j]:.6g}*"
    difference = f"{layout.unknowns[i].name} - {factor}{layout.unknowns[j].name}"
    zero = f"0 {layout.unknowns[i].unit}".removesuffix(" 1")
    ways = [f"a bound ([[constraints]] expression = '{difference}', min or max = '{zero}')"]
    sensors = " or ".join(dict.fromkeys(name for pair in exchange.coordinates for name in pair))
    ways += [f"a sensor of {sensors}"] if sensors else []
    return (
        f"{_listed(names[0])} may change places with {_listed(names[1])}: tell which is which, by "
        f"a value of one with its deviation, or {', or '.join(ways)}"
    )


ROUNDING = 1e-8  # coefficients whose logarithms differ by less are one number: ten digits are typed
EFFORT = 200  # refinements after which nodes are not said to change places: pairs of wings take 3
Bits = int  # a set of nodes, one bit each; with a right side, one bit more


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
    alike: Sequence[Bits] = ()  # nodes whose signs must multiply to one
    names: Sequence[Place] = ()  # what each node is

    def turns(self, still: Sequence[int] = ()) -> list[Bits]:
        """Return a basis of the sets of nodes that may turn their signs together."""
        odd = {_odd((link.row, link.column, *link.factors)) for link in self.links}
        kept = {1 << node for node in (*self.still, *still)}
        return _null_space({*odd, *kept, *self.alike}, len(self.colours))

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
            if (found := search.matched(one + other)) is not None:
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
        # What holds the last bit as well is a solution with its right side.
        signs = [0, *_null_space(equations, len(places) + 1)][-1]
        matrix, values = np.array(rows), np.array(right)
        sizes = np.linalg.lstsq(matrix, values, rcond=ROUNDING)[0]
        if not signs >> len(places) or np.abs(matrix @ sizes - values).max(initial=0.0) > ROUNDING:
            return None
        found = _signs(signs, len(places)) * np.exp(sizes)
        found[list(known)] = list(known.values())
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
            beside: list[list[tuple[int, int]]] = [[] for _ in colours]
            for kind, row, column, factors in self.links:
                multiplied = sorted(colours[f] for f in factors)
                seen = hash((kind, colours[row], colours[column], *multiplied))
                for place, node in ((0, row), (1, column), *((2, f) for f in factors)):
                    beside[node].append((place, seen))
            split = [hash((own, *sorted(met))) for own, met in zip(colours, beside, strict=True)]
            if Counter(split[: self.count]) != Counter(split[self.count :]):
                return None
            if len(set(split)) == len(set(colours)):
                return split
            colours = split

    def matched(self, colours: list[int]) -> list[int] | None:
        if self.effort <= 0 or (split := self.refined(colours)) is None:
            return None
        one, other = split[: self.count], split[self.count :]
        classes = grouped((colour, node) for node, colour in enumerate(other))
        several = [nodes for nodes in classes.values() if len(nodes) > 1]
        if not several:
            return [classes[colour][0] for colour in one]
        nodes = min(several, key=len)
        node = one.index(other[nodes[0]])
        for there in sorted(nodes, key=lambda other_node: other_node != node):
            guess = list(split)
            guess[node] = guess[self.count + there] = self.count + max(one)
            if (found := self.matched(guess)) is not None:
                return found
        return None


def _key(link: Link, places: Sequence[int]) -> Hashable:
    """Return all of a link but its coefficient, with its nodes in other places."""
    factors = tuple(sorted(places[f] for f in link.factors))
    return link.kind, places[link.row], places[link.column], factors


def _signs(turned: Bits, count: int) -> Floats:
    return np.array([-1.0 if turned >> node & 1 else 1.0 for node in range(count)])


def _odd(nodes: Iterable[int]) -> Bits:
    """Return the nodes that stand an odd number of times among some."""
    return reduce(xor, (1 << node for node in nodes), 0)


def _lowest(bits: Bits) -> int:
    return (bits & -bits).bit_length() - 1


def _reduced(bits: Bits, pivots: Mapping[int, Bits]) -> Bits:
    """Return a set less the rows of the pivots that it holds."""
    for pivot, row in pivots.items():
        if bits >> pivot & 1:
            bits ^= row
    return bits


def _null_space(equations: set[Bits], count: int) -> list[Bits]:
    """Return a basis of the sets that hold an even number of the nodes of each equation.

    Each free node is in one of them, the last in the last.
    """
    pivots: dict[int, Bits] = {}  # the equations by the lowest bit of each, which no other holds
    held = 0  # all pivots
    for equation in sorted(equations):
        while at := equation & held:
            equation ^= pivots[_lowest(at)]
        if equation:
            lowest = equation & -equation
            for pivot, row in pivots.items():
                if row & lowest:
                    pivots[pivot] = row ^ equation
            pivots[_lowest(lowest)], held = equation, held | lowest
    return [
        1 << free | sum(1 << pivot for pivot, row in pivots.items() if row >> free & 1)
        for free in range(count)
        if free not in pivots
    ]
