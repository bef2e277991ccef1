"""Rival hypotheses where the data reject the model: tried, ranked, told (docs/rejected.md).

With a gross mistake nothing fits, and thousands of lines would be gone through from a dozen starts,
for minutes, to say so. Where a hundred lines of each record show one, single mistakes are tried on
these before the search, and the speed that the lines themselves show before all others; where none
explains the records and the cost is hopeless, the ways from other starts are gone on them too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import field, replace

import numpy as np

from rotorid.answer.judge import SUSPECTS
from rotorid.answer.parts import EXPLAINS
from rotorid.core.frozen import frozen
from rotorid.core.notes import Note
from rotorid.core.values import grouped
from rotorid.data.observation import Records
from rotorid.likelihood import rivals_model, rivals_read
from rotorid.likelihood.case import CATALOGUE, GROSS, Case, Rival, Way, not_asked
from rotorid.likelihood.effects import Entry, Reads, of_kind
from rotorid.likelihood.inference import infer
from rotorid.likelihood.problem import Point, Problem
from rotorid.likelihood.rivals_model import BENDING
from rotorid.likelihood.rivals_read import shown_speed
from rotorid.likelihood.solver import HOPELESS, Solution, solve
from rotorid.likelihood.starts import FEW, PLAIN_LINES, searched
from rotorid.likelihood.symmetric_answers import CLOSE
from rotorid.models.rotor import RotorModel
from rotorid.models.rotor.drawing import PLANES

ENTRIES = (rivals_read, rivals_model)  # the modules that fill the catalogue
SMALL = ("gain", "mode", "channel", "angle", "term", "drawn", "known", "reads")
"""Stages of small changes, in the order in which they stand where the data cannot tell them."""
LARGE = ("drawn far", "angle far", "single", "factor", "several")
"""Stages of changes that are screened, the likeliest first."""
KEPT = 12  # rivals that an estimate names
FIRST = 3
"""Small changes that are freed before mistakes that are none are thought of: where one of these
explains the data, no such mistake was made."""
REFITTED = 8
"""Small changes that are freed in earnest: the score test errs by less than eight ranks where the
misfit is small, and where it is large the screening finds them."""
SCREENED = 5  # mistakes that are followed to the minimum after the screening
STANDS_OUT = 1e-2
"""A screened cost below this share of that of the records as they are is followed at once: the
right one leaves a hundred thousandth, wrong ones a tenth and more."""
LIKELY = 2.0
"""Factor of the lowest screened cost within which mistakes are followed before the search."""
FOLLOWED = 4  # of these the first; a wrong one takes seconds, the right one tenths
PLAIN = 1.5
"""Cost over its expectation from which on 400 lines of a record tell rivals apart as well as
thousands: of 3200 real equations a half is 20 deviations, and 100 times what `CLOSE` needs."""
EVEN = 1.0
"""Rivals whose costs differ by less stand in the order in which channels and places are listed,
inputs first: so little says nothing (likelihoods alike to a factor of 1.6), and where the minima
are the same by theory it is the rounding of a processor that differs."""
LARGEST = 4e7
"""Lines times the cube of the coordinates with which the whole of a reduced rotor is searched: each
of some hundred refits takes some tenths of a second."""
FEWEST = 20  # lines that tell one mistake of a drawing from another, at the least
SAME_SPEED = 1e-3  # speeds that differ by less are one, as it is stated and as a line shows it
STANDING = {"known": 0, "bound": 2, "lag": 2, "omission": 3, "errors": 4}
"""Order of kinds that the data cannot tell apart, 1 for all others: known values are no new terms;
a bandwidth comes after the delay that it looks like, a bound that would be far off after what may
have led there, a sign or a unit; data left out explain nothing; one error is likelier than many."""


@frozen
class Finding:
    """A rival that was tried, or scored: what it leaves of the cost."""

    rival: Rival
    left: float
    drop: float
    share: float  # of the excess misfit
    value: float | None
    tried: bool = True
    likely: bool | None = None  # of a bound: whether it is a little too narrow

    @property
    def exact(self) -> bool:
        """Whether it needs no further unknown."""
        return self.rival.kind in ("mistake", "unit", "speed")


@frozen
class Tried:
    done: int = 0
    of: int = 0
    notes: tuple[Note, ...] = ()
    speed: bool = False  # whether a speed is suspected


Tries = Iterator[Tried]
Places = Mapping[tuple[str, ...], int]  # where channels and places that rivals act on stand
NOWHERE: Places = {}
# Of an estimate astray numbers may overflow; whoever takes the trials has his own way with them.
quiet = np.errstate(over="ignore", invalid="ignore", divide="ignore")


@frozen
class RivalSearch:
    case: Case
    known: frozenset[str] = frozenset()  # terms of mistakes that are known to explain nothing
    besides: str = ""  # said behind everything else
    # many errors together, each of a plausible size, and the drop of the cost with them
    errors: Callable[[Case], Iterable[tuple[Rival, float]]] = lambda case: ()
    found: list[Finding] = field(default_factory=list)  # what was tried

    def trials(self) -> Tries:
        """Try rivals one by one; the last trial has what is suspected after all."""
        small = self.entered(*SMALL)
        scored, refitted = self.scored(small), REFITTED * self.case.prepared.effort
        yield from self.at("bound")
        if not self.explained():
            yield from self.at("bounds")
        # Of a table first: a negative damping may explain as well that phases count backward. Of
        # responses likewise, which are too far off for screening at the values that were found.
        yield from self.at("table")
        yield from self.one_by_one([each.rival for each in scored[:FIRST]])
        yield from self.likeliest("modes")
        yield from self.at("trial")
        if not self.case.gross or self.explained(lambda f: f.likely is not False):
            yield from self.one_by_one([each.rival for each in scored[FIRST:refitted]])
            rest = scored[refitted:]
        else:
            yield from self.screened()
            rest = [] if self.explained() else scored[FIRST:]
        # Another unit may explain anything: it is as if there were more noise.
        if not self.explained(lambda f: f.rival.kind != "unit", rest):
            yield from self.at("line")
        kept = [f for f in self.found if f.rival.kind != "omission" or self.explains(f)]
        kept += self.together()
        expected, places = self.case.expected, dict[tuple[str, ...], int]()
        for number, rival in enumerate(small):
            places.setdefault(rival.place, number)
        yield self.told(_one_speed([*kept, *rest], expected), places=places)

    def told(
        self, found: Sequence[Finding], done: int = 0, of: int = 0, places: Places = NOWHERE
    ) -> Tried:
        found = ranked(found, self.case.expected, places)
        kept = [(finding.rival, finding) for finding in found[:KEPT]]
        notes = (
            Note(r.term, "doubts", value=f.value, unit=r.unit, drop=f.drop, share=f.share)
            for r, f in kept
        )
        said = Note(SUSPECTS, "rejects", sentence(self.case, found) + self.besides)
        return Tried(done, of, (said, *notes), any(r.kind == "speed" for r, _ in kept))

    @quiet
    def entered(self, *stages: str) -> list[Rival]:
        every = (r for stage in stages for entry in CATALOGUE[stage] for r in entry(self.case))
        return [r for r in every if r.added is None or not_asked(self.case, [r.added])]

    def explains(self, finding: Finding) -> bool:
        return finding.left < GROSS * max(self.case.expected, 1.0)

    def explained(
        self, among: Callable[[Finding], bool] = lambda _: True, rest: Sequence[Finding] = ()
    ) -> bool:
        return any(self.explains(f) for f in (*self.found, *rest) if among(f))

    @quiet
    def scored(self, small: Sequence[Rival]) -> list[Finding]:
        """Score rivals at the estimate with all unknowns that they add, evaluated once.

        What excludes others has a turn of its own, and what changes how sensors read: with these
        the same residual is whitened in other rows.
        """

        def turn(rival: Rival) -> tuple[bool, bool]:
            effects = rival.added.effects if rival.added else ()
            return bool(rival.added and rival.added.alternative_to), any(of_kind(Reads, effects))

        found = []
        for among in grouped((turn(rival), rival) for rival in small).values():
            point = self.case.beside(rival.added for rival in among if rival.added)
            for rival in among:
                drop, value = rival.score(point)
                left = self.case.point.cost - drop
                found.append(Finding(rival, left, drop, self.share(drop), value, tried=False))
        return sorted((f for f in found if f.drop > 0), key=lambda f: -f.drop)

    @quiet
    def together(self) -> list[Finding]:
        """Return errors that explain the data together: the rest of a misfit has another cause."""
        alone, cost = {f.rival.term for f in self.found}, self.case.point.cost
        with suppress(np.linalg.LinAlgError):  # of an estimate astray
            every = [
                Finding(rival, cost - drop, drop, self.share(drop), None)
                for rival, drop in self.errors(self.case)
                if len(rival.on) > 1 or not alone & {*rival.on}
            ]
            return [finding for finding in every if self.explains(finding)]
        return []

    def at(self, stage: str) -> Tries:
        return self.one_by_one(self.entered(stage))

    def one_by_one(self, rivals: Sequence[Rival]) -> Tries:
        for number, rival in enumerate(rivals, 1):
            self.follow(rival)
            yield self.told(self.found, number, len(rivals))

    @quiet
    def follow(self, rival: Rival) -> None:
        waiting = [rival]
        while waiting:
            rival = waiting.pop(0)
            if (point := rival.change(self.case).minimized(rival.way)) is not None:
                self.found.append(self.finding(rival, point))
                waiting += rival.sharper(self.case, point)

    def finding(self, rival: Rival, point: Point) -> Finding:
        drop, value = self.case.point.cost - point.cost, rival.value_at(point)
        likely = rival.likely and rival.likely(point)
        return Finding(rival, point.cost, drop, self.share(drop), value, likely=likely)

    def share(self, drop: float) -> float:
        excess = self.case.point.cost - self.case.expected
        return float(min(1.0, max(0.0, drop / excess))) if excess > 0 else 0.0

    @quiet
    def screen(self, rival: Rival, most: float = np.inf) -> float:
        return rival.change(self.case).screened(most)

    def screened(self) -> Tries:
        """Screen mistakes that are no small changes; follow what stands out at once, then the best.

        Where one explains the data the search ends with those of its kind: a sensor upside down
        may look like its actuator upside down.
        """
        if not self.case.records:
            return
        before, level, most = len(self.found), self.case.screened(), np.inf
        waiting: list[tuple[float, Rival]] = []
        for stage in LARGE:
            stages = [r for r in self.entered(stage) if r.term not in self.known]
            for number, rival in enumerate(stages, 1):
                cost = self.screen(rival, most)
                if cost < STANDS_OUT * level:
                    self.follow(rival)
                    if any(map(self.explains, self.found[before:])):
                        most = STANDS_OUT * level  # what costs more is not asked for any more
                else:
                    waiting.append((cost, rival))
                yield self.told(self.found, number, len(stages))
            if any(map(self.explains, self.found[before:])):
                return
        likeliest = sorted(waiting, key=lambda pair: pair[0])
        likeliest = likeliest[: SCREENED * self.case.prepared.effort]
        yield from self.one_by_one([rival for _, rival in likeliest])

    def likeliest(self, stage: str) -> Tries:
        """Screen the rivals of a stage, and follow the best where it beats the case as it is."""
        entered, costs = self.entered(stage), list[float]()
        for rival in entered:
            costs.append(self.screen(rival))
            yield self.told(self.found, len(costs), len(entered))
        if entered and (least := min(costs)) < self.case.screened(least):
            self.follow(entered[costs.index(least)])


def ranked(found: Sequence[Finding], expected: float, places: Places) -> list[Finding]:
    """Order findings by the cost that is left, one for each term, those that were tried first.

    Of those that the data cannot tell apart a bound that is a little too narrow comes first, then
    what needs no further unknown: a sign and a gain of one channel say the same.
    """
    best: dict[str, Finding] = {}
    for finding in _in_order(found, expected, places):
        if finding.drop > 0:
            best.setdefault(finding.rival.term, finding)
    ordered = list(best.values())
    group = alike(ordered, expected)
    exact = {f.rival.place for f in group if f.exact}
    told = [f for f in group if f.likely or f.exact or f.rival.place not in exact]
    told.sort(key=lambda f: (not f.likely, not f.exact, STANDING.get(f.rival.kind, 1)))
    return [*told, *(f for f in ordered if f not in group)]


def _in_order(found: Sequence[Finding], expected: float, places: Places) -> list[Finding]:
    """Order findings by the cost that is left, and where it is even by what they act on.

    There a channel that reads too little, as dead ones do, comes before too much.
    """

    def even(finding: Finding) -> tuple[bool, int, str]:
        rival, value = finding.rival, finding.value
        too_much = rival.kind == "gain" and value is not None and abs(value) > 1
        return too_much, places.get(rival.place, len(places)), rival.term

    ordered: list[Finding] = []
    rest = sorted(found, key=lambda f: (not f.tried, f.left))
    while rest:
        least, tried = rest[0].left, rest[0].tried
        margin = EVEN * max(1.0, least / max(expected, 1.0))
        count = sum(f.tried == tried and f.left - least < margin for f in rest)
        ordered += sorted(rest[:count], key=even)
        rest = rest[count:]
    return ordered


def _one_speed(found: Sequence[Finding], expected: float) -> list[Finding]:
    """Return findings with the speeds of a record that fit alike as one of no value.

    Without a line at the right speed, any speed between the lines explains the data.
    """
    kept = list(found)
    for term in {f.rival.term: None for f in found if f.rival.kind == "speed"}:
        group = alike([f for f in kept if f.rival.term == term], expected)
        values = np.array([f.value for f in group], dtype=float)
        if np.ptp(values) > SAME_SPEED * np.abs(values).max():
            where = "".join(f" of {record}" for record in group[0].rival.on)
            said = f"another speed{where} than the one given, whose true value no line shows"
            cure = (
                "give the speed at which the machine ran: look at the checks, and with rotorid "
                "inspect at the lines that the record shows"
            )
            any_speed = replace(group[0].rival, says=said, cure=cure, unit="")
            one = replace(group[0], rival=any_speed, value=None)
            kept = [one, *(f for f in kept if f.rival.term != term)]
    return kept


def alike(found: Sequence[Finding], expected: float) -> list[Finding]:
    """Return the best finding and those that the data cannot tell from it.

    Their costs differ by no more than those of alternatives do (theory, 7), times the cost over its
    expectation where even the best leaves a misfit.
    """
    if not (tried := [f for f in found if f.tried]):
        return list(found[:1])
    least = min(f.left for f in tried)
    margin = CLOSE * max(1.0, least / max(expected, 1.0))
    return [f for f in tried if f.left - least < margin]


def _which_end(case: Case, found: Sequence[Finding]) -> str:
    if case.records or not isinstance(case.model, RotorModel):
        return ""
    last = len(case.model.coordinates) - PLANES
    across = {k: last + k for k in range(PLANES)} | {last + k: k for k in range(PLANES)}
    first, *others = (_entries(f.rival) for f in found)
    mirrored = {
        replace(e, row=across.get(e.row, e.row), column=across.get(e.column, e.column))
        for e in first
    }
    if mirrored != first and mirrored in others:
        return "; which end carries it is not determined by these frequencies"
    return ""


def _entries(rival: Rival) -> set[Entry]:
    return {*of_kind(Entry, rival.added.effects)} if rival.added else set()


def sentence(case: Case, found: Sequence[Finding]) -> str:
    if not found or found[0].share < EXPLAINS:
        best = f"; the best, {found[0].rival.term}, {100 * found[0].share:.2g} %" if found else ""
        return (
            f"the data reject the model, and none of the {len(found)} suspects explains "
            f"more than a fifth of it{best}: look at the misfit by line, or for two mistakes"
        )
    first, said, cure = found[0], found[0].rival.says, found[0].rival.cure
    said = said if isinstance(said, str) else said(first.value)
    equal = alike(found, case.expected)
    others, which = ", ".join(f.rival.term for f in equal[1:5]), _which_end(case, equal)
    group = f" (the data cannot tell it from {others}{which})" if others else ""
    rest = ""
    # Far from its first bending frequency alone is a shaft that bends all that it is taken for.
    bends = any(entry.order == BENDING for entry in _entries(first.rival))
    if first.left >= GROSS * max(case.expected, 1.0) and not bends:
        rest = (
            "; by itself it is not enough, so there is a second mistake or another one in its place"
        )
    return (
        f"the data reject the model; first suspect: {said}, with which the misfit falls from "
        f"{case.point.cost:.4g} to {first.left:.4g} where {case.expected:.4g} is expected{group}: "
        f"{cure}{rest}"
    )


def suspected(
    case: Case, plain: Plain | None, errors: Callable[[Case], Iterable[tuple[Rival, float]]]
) -> Iterator[Tried]:
    shown = _shown(case, plain)
    if shown.notes:
        yield shown
        return
    few = _affordable(case)
    besides = _by_lines(few, case)
    if any(record.lines.covariance.kind == "inputs" for record in case.records):
        besides += (
            "; but the inputs were taken as free of noise, and in closed loop that alone gives "
            "such a misfit: give references or a quiet record first"
        )
    known = plain.tried if plain else frozenset()
    yield from RivalSearch(few, known, besides, errors).trials()


def _affordable(case: Case) -> Case:
    """Return a case that some hundred refits bear: on fewer lines where the misfit is as plain.

    And on the whole rotor where it was reduced, on as many lines as that bears.
    """
    few = case.on_lines(PLAIN_LINES if case.costs(HOPELESS) else FEW)
    there = few.settled() if few is not case and case.costs(PLAIN) else None
    case = there if there is not None and there.costs(PLAIN) else case
    whole = case.model.whole if isinstance(case.model, RotorModel) else None
    if whole is None or (cubed := len(whole.coordinates) ** 3) > LARGEST / FEWEST:
        return case
    return case.on_model(whole).on_lines(int(LARGEST / cubed)).settled() or case


def _shown(case: Case, plain: Plain | None) -> Tried:
    """Return what the search came upon, as far as noise alone is left without it."""
    speed = shown_speed(case.records)
    few = case.on_lines(FEW)
    ends = _explaining(few, (plain.rivals if plain else ()) if speed is None else (speed,))
    if not ends:
        return Tried()
    # The best here is that of the search, with the unbalance at its best for these lines.
    here = replace(few, found=few.problem.best_at(case.unknowns))
    found = [
        RivalSearch(replace(here, expected=there.expected)).finding(rival, there.point)
        for rival, there in ends
    ]
    expected = min(there.expected for _, there in ends)
    search = RivalSearch(replace(here, expected=expected), besides=_by_lines(here, case))
    return search.told(found)


def _explaining(case: Case, rivals: Sequence[Rival], way: Way = "near") -> list[tuple[Rival, Case]]:
    """Return the rivals with which noise explains the records, and where, the best first."""
    ends = [(rival, rival.change(case).settled(way)) for rival in rivals]
    found = [(rival, there) for rival, there in ends if there is not None and not there.gross]
    return sorted(found, key=lambda pair: pair[1].point.cost)


def _by_lines(few: Case, every: Case) -> str:
    some, whole = (sum(len(r.lines.frequency) for r in c.records) for c in (few, every))
    return "" if some == whole else f" (by {some} of the {whole} lines)"


@frozen
class Plain:
    """Where the search ended on few lines, what explains the records, and what does not."""

    solution: Solution
    rivals: tuple[Rival, ...] = ()
    tried: frozenset[str] = frozenset()


def plainly(prepared: Problem, records: Records, problem: Problem) -> Plain | None:
    """Return what is plainly wrong; None where nothing is.

    By the speed that the records show: at the one stated the rotor is that which they show at
    their own. Of records of many lines by a mistake with some of them.
    """
    every, speed = Case(prepared, tuple(records), prepared.layout.start), shown_speed(records)
    if speed is not None:
        there = speed.change(every.on_lines(FEW)).settled("start")
        if there is not None and infer(there.point).explained:
            found = _on_all_lines(problem, there.point, (speed,))
            if found is not None:
                return found
    if problem.sketch is None:
        return None
    few = every.on_lines(PLAIN_LINES)
    there = few.settled("start")
    if there is None or not there.gross:
        return None
    mistakes = RivalSearch(few).entered("single")
    if right := _without_a_mistake(few, mistakes):
        # The start may have been bad, and nothing else: from there the records as they are.
        near = replace(few, unknowns=right[0][1].unknowns).settled()
        if near is not None and not near.gross:
            return None
        return _on_all_lines(problem, right[0][1].point, tuple(rival for rival, _ in right))
    ended = _searched(few, problem) if there.costs(HOPELESS) else None
    plain = None if ended is None else _on_all_lines(problem, ended)
    return plain and replace(plain, tried=frozenset(rival.term for rival in mistakes))


def _without_a_mistake(case: Case, mistakes: Sequence[Rival]) -> list[tuple[Rival, Case]]:
    """Return the mistakes that explain the records, of those that do it best after screening."""
    costs = [rival.change(case).screened() for rival in mistakes]
    order = np.argsort(costs, kind="stable")[:FOLLOWED]
    likely = [mistakes[k] for k in order if costs[k] <= LIKELY * costs[order[0]]]
    return _explaining(case, likely, "start")


def _searched(few: Case, problem: Problem) -> Point | None:
    """Return where the best of all ways on few lines leads on more; None where one is not bad."""
    found = searched(few.problem, few.prepared.layout.start)
    there = few.at(found.point) if found is not None and found.converged else None
    if there is None or not there.costs(HOPELESS):
        return None
    with suppress(np.linalg.LinAlgError):
        return solve(problem, there.unknowns, (0.0,)).point
    return None


def _on_all_lines(problem: Problem, point: Point, rivals: tuple[Rival, ...] = ()) -> Plain | None:
    """Return what a minimum on few lines is on all; None where noise explains it there."""
    with suppress(np.linalg.LinAlgError):
        found = Solution(problem.best_at(point.unknowns), converged=True, iterations=0)
        return None if found.inference.explained else Plain(found, rivals)
    return None
