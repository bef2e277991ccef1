"""What may be wrong where the data reject the model: a missing term, a channel, a known value.

A candidate adds columns D to the Jacobian J of the whitened residual r. With what J can explain
taken out of them, D' = (1 - J J^+) D, freeing the candidate lowers the cost by the squared length
of r along D', to first order: no further fit is needed, so that all candidates can be scored. The
best are then freed in earnest, and so are the mistakes that are no small changes: see `leads`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from rotorid.estimate_parts import EXPLAINS, Suspect
from rotorid.estimators.likelihood.bound_leads import held_bounds
from rotorid.estimators.likelihood.candidates import (
    BENDS,
    Structure,
    find_candidates,
    find_structure,
)
from rotorid.estimators.likelihood.drawn import drawn_candidates, drawn_structure, levers
from rotorid.estimators.likelihood.inference import infer, projected_jacobian
from rotorid.estimators.likelihood.leads import (
    GROSS,
    Lead,
    discrete_leads,
    exact_inputs,
    factor_groups,
    factor_name,
    sign,
    snap,
    typical_factors,
    unit,
)
from rotorid.estimators.likelihood.line_leads import line_lead
from rotorid.estimators.likelihood.mirrors import CLOSE
from rotorid.estimators.likelihood.modal import ModalRows
from rotorid.estimators.likelihood.mode_leads import mode_mistakes
from rotorid.estimators.likelihood.nuisances import (
    Bend,
    Constant,
    Delay,
    Factor,
    Knee,
    LawConstant,
    Missing,
    Multiplier,
    Nuisance,
    Reading,
    Response,
    every_nuisance,
)
from rotorid.estimators.likelihood.nuisances.gain import Gain
from rotorid.estimators.likelihood.nuisances.phase import Phase
from rotorid.estimators.likelihood.nuisances.runout import Runout
from rotorid.estimators.likelihood.preparation import Prepared
from rotorid.estimators.likelihood.problem import Point
from rotorid.estimators.likelihood.reduction import moved
from rotorid.estimators.likelihood.refits import Case, assembled, minimized, screened
from rotorid.estimators.likelihood.response_leads import response_leads
from rotorid.estimators.likelihood.shifts import Shift, shifts
from rotorid.estimators.likelihood.shown_speed import shown_lead
from rotorid.estimators.likelihood.solver import HOPELESS
from rotorid.estimators.likelihood.table_leads import is_table, table_leads
from rotorid.estimators.likelihood.thinning import FEW, PLAIN_LINES, thinned
from rotorid.estimators.likelihood.trial_leads import exchanges, moved_masses
from rotorid.estimators.likelihood.unknowns import physical_factors
from rotorid.frozen import frozen
from rotorid.models import Model
from rotorid.models.rotor import RotorModel
from rotorid.models.rotor.elements import PLANES
from rotorid.observation import Observation
from rotorid.record import Floats

KEPT = 12
"""Suspects that an estimate names."""
DISTINCT = 1e-10
"""Least share of a candidate that the parameters of the model cannot take over."""
FIRST = 3
"""Candidates that are freed before mistakes that are no small changes are thought of: where one of
these explains the data, no such mistake was made."""
REFITTED = 8
"""Candidates that are freed in earnest: the score test errs by less than eight ranks where the
misfit is small, and where it is large the screening finds them."""
TURNS = 5
"""Steps towards the share of what a sensor reads besides: Newton's, so that five reach it."""
SCREENED = 5
"""Mistakes that are followed to the minimum after the screening."""
PLAIN = 1.5
"""Cost over its expectation from which on 400 lines of a record tell suspects apart as well as
thousands: of 3200 real equations a half is 20 deviations, and 100 times what `CLOSE` needs."""
EVEN = 1.0
"""Suspects whose costs differ by less stand in the order in which channels and places are listed,
inputs first: so little says nothing (likelihoods alike to a factor of 1.6), and where the minima
are the same by theory it is the rounding of a processor that differs."""
STANDS_OUT = 1e-2
"""A screened cost below this share of that of the records as they are is followed at once: the
right one leaves a hundred thousandth, wrong ones a tenth and more."""
LARGEST = 4e7
"""Lines times the cube of the coordinates with which the whole of a reduced rotor is searched: each
of some hundred refits takes some tenths of a second."""
FEWEST = 20
"""Lines that tell one mistake of a drawing from another, at the least."""
ASKED = 4
"""Records, those that fit worst, of each of which the speed may be wrong by itself: some twenty
mistakes each; the record with the mistake is among them, as the others agree."""
SAME_SPEED = 1e-3
"""Speeds that differ by less are one, as it is stated and as a line shows it."""
LOOK_FOR_THE_SPEED = (
    "give the speed at which the machine ran: look at the checks, and with rotorid inspect at the "
    "lines that the record shows"
)
"""What to do about a speed that is wrong where no line tells the right one."""
INTO_THE_FILE = "add it to the rotor file, as a disc, a support, an unbalance or a damping there"
"""What to do about a term that a drawing lacks."""
BEGINS = 'write phase = "unknown" in that record, or name the column of the mark (keyphasor, angle)'
"""What to do about a record whose rotor angle begins elsewhere."""
MARKED = (
    "count the phases of that table from the mark of the first one: add that angle to them in the "
    "file; or check at which angle its trial mass sat"
)
"""What to do about a table whose phases are counted from elsewhere: no key sets them free."""
BEGINNINGS = tuple(np.deg2rad([-135.0, -90.0, -45.0, 45.0, 90.0, 135.0, 180.0]).tolist())
"""Angles from which that of a further record is looked for: half a right angle leads to it."""


HELD = 0.1
"""Amplitude that cos(n phi) leaves on the lines that are used, from which on these hold the n-th
order: one half on a line of it, a third between two lines. What leaks elsewhere is 1e-3 at most,
and a runout of metres would explain any misfit there."""


@frozen
class Option:
    """Something that can be set free: unknowns to add, or a known value to free."""

    term: str
    unit: str
    nuisance: Nuisance | None = None
    prior: str = ""
    mode: ModalRows | None = None
    cure: str = ""

    def value(self, case: Case, point: Point) -> float:
        """Return its size at a point of the case in which it is free."""
        index = case.prepared.layout.index
        if self.mode is not None:
            return self.mode.first_hertz(point.unknowns)
        if self.prior:
            return float(point.unknowns[index[self.prior]])
        assert self.nuisance is not None
        found = np.array([point.unknowns[index[u.name]] for u in self.nuisance.unknowns])
        if isinstance(self.nuisance, Phase):
            found = np.angle(np.exp(1j * found))
        return _size(self, found)

    def free(self, case: Case) -> Case:
        """Return the case in which it is free."""
        return case.freed(self.prior) if self.prior else case.with_unknowns([self._nuisance])

    @property
    def _nuisance(self) -> Nuisance:
        assert self.nuisance is not None
        return self.nuisance


def _term(nuisance: Nuisance) -> str:
    """Return the name of a nuisance; the parts of a vector share one."""
    return nuisance.unknowns[0].name.removesuffix(".cos")


def _apart(nuisance: Nuisance) -> bool:
    """Tell whether a nuisance says what no factor does: k_i is one, and gains are positive."""
    if isinstance(nuisance, Constant):
        return nuisance.role == "ks"
    apart = isinstance(nuisance, Factor | Reading | LawConstant | Bend)
    return apart and not isinstance(nuisance, Gain)


def _harmonic_runout(records: Sequence[Observation]) -> list[Nuisance]:
    """Return runout twice and three times per revolution of each sensor, where lines hold it."""
    found: list[Nuisance] = []
    orders = [n for n in (2, 3) if any(_holds(record, n) for record in records)]
    for once in Runout.every(records):
        for order in orders:
            unknowns = tuple(
                replace(u, name=u.name.replace("]", f", order {order}]")) for u in once.unknowns
            )
            found.append(replace(once, unknowns=unknowns, order=order))
    return found


def _holds(record: Observation, order: int) -> bool:
    """Tell whether a line of a record is a multiple of its rotation, and not what leaks there."""
    wave = record.lines.clock.lines(lambda t, phi, speed: np.cos(order * phi)[..., None])
    return bool(np.abs(wave).max(initial=0.0) > HELD)


def _size(option: Option, values: Floats) -> float:
    """Return the size of what several unknowns say: a gain, or the amplitude of a turning load."""
    if isinstance(option.nuisance, Multiplier):
        return float(1 / values[0]) if values[0] else np.nan
    if isinstance(option.nuisance, Knee):
        return option.nuisance.saturation(float(values[0]))
    one = isinstance(option.nuisance, Missing) and option.nuisance.entries
    if len(values) == 1 or one:  # entries with unknowns of their own have units of their own
        return float(values[0])
    return float(np.linalg.norm(values) / np.sqrt(max(1.0, len(values) / 2)))


@frozen
class Finding:
    """A suspect with the cost that is left, and what to say of it."""

    suspect: Suspect
    left: float
    said: str
    cure: str
    tried: bool = True
    exact: bool = False
    bound: bool | None = None
    """Whether a bound that was set free is likely to be the mistake; None: it is none."""


_Follow = Callable[[], list[Finding]]
_Trial = tuple[Prepared, Sequence[Observation], _Follow]


@frozen
class Suspicion:
    """What is suspected, and the sentence about it."""

    suspects: tuple[Suspect, ...] = ()
    sentence: str = ""


def find_suspects(
    model: Model,
    values: Floats,
    case: Case,
    expected: float,
    tried: frozenset[str] = frozenset(),
) -> Suspicion:
    """Rank what may be wrong, what explains most first, and say what to do about it.

    Parameters
    ----------
    model : Model
    values : array
        Physical parameters at the estimate, not finite where they are not known.
    case : Case
    expected : float
        Cost that noise alone would leave.
    tried : set of str
        Mistakes that are known to explain nothing.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # an estimate astray
        structure = structure_of(model, values, case.records)
        search = _Search(model, case, values, structure, expected, tried)
        findings = search.findings()
    suspects = tuple(finding.suspect for finding in findings[:KEPT])
    which = _which_end(model, findings, expected) if not case.records else ""
    return Suspicion(suspects, sentence(findings, case.point.cost, expected, which))


def on_fewer_lines(case: Case, expected: float) -> tuple[Case, float] | None:
    """Return a case on some of the lines of whole records, and the cost that noise would leave.

    A plain misfit shows on a few hundred lines of each record as well as on thousands, a hopeless
    one on a hundred, and dozens of candidates are tried on them. None where there are no more, or
    the misfit is not plain.
    """
    hopeless = case.point.cost > HOPELESS * max(expected, 1.0)
    fewer = thinned(case.records, PLAIN_LINES if hopeless else FEW)
    if fewer is None or case.point.cost <= PLAIN * max(expected, 1.0):
        return None
    point = minimized(case.prepared, fewer, case.point.unknowns, (0.0,))
    if point is None:
        return None
    mean = infer(point, point.problem.exact).expectation.mean
    found = Case(case.prepared, tuple(fewer), point)
    return (found, mean) if point.cost > PLAIN * max(mean, 1.0) else None


def on_whole_rotor(case: Case, expected: float) -> tuple[Case, float]:
    """Return a case on the whole rotor where it was reduced, as there are places on that alone.

    On as many lines as that bears; a rotor of more coordinates stays as it is.
    """
    model = case.prepared.layout.model
    whole = model.whole if isinstance(model, RotorModel) else None
    if whole is None or (cubed := len(whole.coordinates) ** 3) > LARGEST / FEWEST:
        return case, expected
    records = tuple(moved(record, whole) for record in case.records)
    records = tuple(thinned(records, int(LARGEST / cubed)) or records)
    layout = replace(case.prepared.layout, model=whole, monomial_factors=physical_factors(whole))
    prepared = replace(case.prepared, layout=layout)
    point = minimized(prepared, records, case.point.unknowns, (0.0,))
    if point is None:
        return case, expected
    return Case(prepared, records, point), infer(point, point.problem.exact).expectation.mean


def shown(case: Case, leads: Sequence[Lead]) -> Suspicion | None:
    """Return the suspicion of what the search came upon: a speed that lines show, a mistake.

    None where there is none, or where a misfit is left without it.
    """
    turned = shown_lead(case.records)
    leads = leads if turned is None else (turned,)
    if not leads:
        return None
    records = tuple(thinned(case.records) or case.records)
    here = assembled(case.prepared, records).best_at(case.point.unknowns)
    model = case.prepared.layout.model
    findings, expected = list[Finding](), np.inf
    for lead in leads:
        point = Case(case.prepared, tuple(lead.undo(records)), case.point).near()
        if point is None:
            continue
        mean = infer(point, point.problem.exact).expectation.mean
        search = _Search(model, replace(case, point=here), np.zeros(0), None, mean)
        found = search.undone(lead, point)
        if search.explained(found):
            findings, expected = [*findings, found], min(expected, mean)
    if not findings:
        return None
    findings = _ranked(findings, expected, {})
    told = sentence(findings, here.cost, expected)
    return Suspicion(tuple(f.suspect for f in findings), told + by_lines(records, case.records))


def by_lines(chosen: Sequence[Observation], every: Sequence[Observation]) -> str:
    """Say how many lines of records were looked at."""
    few, all_of_them = (sum(len(r.lines.frequency) for r in records) for records in (chosen, every))
    return "" if few == all_of_them else f" (by {few} of the {all_of_them} lines)"


def _fastest(records: Sequence[Observation]) -> float:
    return max((float(v) for r in records for v in r.lines.speed), key=abs, default=0.0)


def structure_of(model: Model, values: Floats, records: Sequence[Observation]) -> Structure | None:
    """Return the structure of a model at the fastest speed, where all its values are known."""
    if not np.isfinite(values).all():
        return None
    if not isinstance(model, RotorModel):
        return find_structure(model, values, _fastest(records))
    if model.whole is not None:  # its coordinates are no places
        return None
    found = find_structure(model, values, _fastest(records))
    return drawn_structure(found, model) if found else None


@frozen
class _Search:
    """Tries candidates on one estimate, `values` being its physical parameters."""

    model: Model
    case: Case
    values: Floats
    structure: Structure | None
    expected: float
    tried: frozenset[str] = frozenset()

    @property
    def gross(self) -> bool:
        """Whether the misfit is so large that a mistake may be no small change."""
        return self.case.point.cost > GROSS * max(self.expected, 1.0)

    def findings(self) -> list[Finding]:
        """Return what was found, what leaves the least cost first."""
        options = self.options()
        scored = [*self.scored(options), *self.shifted()]
        scored.sort(key=lambda pair: -pair[1].drop)
        # Of a table first: a negative damping may explain as well that phases count backward. Of
        # responses likewise, which are too far off for screening at the values that were found.
        leads = table_leads(self.case, self.gross)
        leads += response_leads(self.case.records) if self.gross else ()
        found = self.without_bounds()
        found += [f for lead in leads for f in self.followed(lead)]
        found += [f for option, _ in scored[:FIRST] for f in self.freed(option)]
        found += [*self.mistaken_modes(), *self.trial_masses()]
        settled = any(self.explained(f) and f.bound is not False for f in found)
        if settled or not self.gross:
            found += [f for option, _ in scored[FIRST:REFITTED] for f in self.freed(option)]
            found += [self.finding(o, s, tried=False) for o, s in scored[REFITTED:]]
        else:
            found += self.mistakes()
            if not any(self.explained(finding) for finding in found):
                found += [self.finding(o, s, tried=False) for o, s in scored[FIRST:]]
        if not any(self.explained(f) and not f.suspect.term.startswith("unit[") for f in found):
            found += self.without_line()
        return _ranked(_one_speed(found, self.expected), self.expected, _places(options))

    def explained(self, finding: Finding) -> bool:
        """Tell whether a finding leaves no more than noise does, or little more."""
        return finding.left < GROSS * max(self.expected, 1.0)

    def without_bounds(self) -> list[Finding]:
        """Set free each bound that holds with equality; all together where none is enough."""
        found: list[Finding] = []
        for held in held_bounds(self.case):
            if len(held.texts) > 1 and any(self.explained(finding) for finding in found):
                break
            point = held.dropped(self.case).near()
            if point is None:
                continue
            value = held.value(self.case, point.unknowns)
            drop, (said, cure) = self.case.point.cost - point.cost, held.told(value)
            one = value if len(held.texts) == 1 else None
            suspect = Suspect(held.term, drop, self.share(drop), one, held.unit)
            found.append(Finding(suspect, point.cost, said, cure, bound=held.close(value)))
        return found

    def trial_masses(self) -> list[Finding]:
        """Try each trial mass at another angle, and the files of two records exchanged."""
        found = []
        for turned in moved_masses(self.case):
            drop = self.case.point.cost - turned.point.cost
            suspect = Suspect(turned.term, drop, self.share(drop), turned.angle, "rad")
            found.append(Finding(suspect, turned.point.cost, turned.said, turned.cure, exact=True))
        return found + [f for lead in exchanges(self.case) for f in self.followed(lead)]

    def options(self) -> list[Option]:
        """Return everything that can be set free by itself."""
        case, records = self.case, self.case.records
        taken = case.prepared.layout.index
        exact = set.intersection(*(set(exact_inputs(r)) for r in records)) if records else set()
        found = self._modes()
        found += [
            Option(_term(n), n.unknowns[0].unit, n)
            for n in (*every_nuisance(records), *_harmonic_runout(records))
            if _apart(n)
            and not {u.name for u in n.unknowns} & taken.keys()
            and not (isinstance(n, Factor) and n.channels <= exact)
        ]
        factors = [
            Option(f"gain[{label}]", "1", Multiplier.of(label, names))
            for label, names in (factor_groups(records[0]) if records else {}).items()
        ]
        found = [*(o for o in factors if o.term not in taken), *found, *self._angles((0.0,))]
        if self.structure is not None:
            found += self._terms(self.structure)
        return [*found, *self._priors()]

    def _terms(self, structure: Structure) -> list[Option]:
        """Return the terms that the equations may lack."""
        model, still = self.model, _fastest(self.case.records) == 0
        terms = find_candidates(structure, [model.units[name] for name in model.coordinates])
        if isinstance(model, RotorModel):
            terms = [replace(term, cure=INTO_THE_FILE) for term in terms]
        found = [
            Option(t.name, t.unit, t.nuisance, cure=t.cure)
            for t in terms
            if not (t.rotating and still)
        ]
        return [*found, *self._drawn()]

    def _drawn(self) -> list[Option]:
        """Return what may be otherwise than a drawing has it."""
        model, structure = self.model, self.structure
        if structure is None or not isinstance(model, RotorModel):
            return []
        found = [
            Option(t.name, t.unit, t.nuisance, cure=t.cure)
            for t in drawn_candidates(structure, model, self.values)
        ]
        for term, name, lever in levers(structure, model):
            cure = f"give {name} in the rotor file the place (at) where it acts"
            found.append(Option(term, "m", lever, cure=cure))
        return found

    def _angles(self, starts: Sequence[float]) -> list[Option]:
        """Return where the rotor angle of a further record may begin."""
        taken = self.case.prepared.layout.index
        return [
            Option(_term(n), "rad", n, cure=self._begins(n.record))
            for n in Phase.later(self.case.records, starts)
            if _term(n) not in taken
        ]

    def _begins(self, number: int) -> str:
        """Return what to do about a record whose angle begins elsewhere: a table has no key."""
        return MARKED if is_table(self.case.records[number]) else BEGINS

    def _priors(self) -> list[Option]:
        layout = self.case.prepared.layout
        return [
            Option(f"prior {u.name}", u.unit, prior=u.name)
            for u in layout.unknowns[: layout.named]
            if u.std is not None and layout.index[u.name] not in layout.idle
        ]

    def _modes(self) -> list[Option]:
        """Return the measured modes, each of which may be wrong by itself."""
        rows = self.case.prepared.known.modes
        return [
            Option(text, "Hz", prior=text, mode=rows.only(text))
            for text in dict.fromkeys(rows.texts)
        ]

    def scored(self, options: Sequence[Option]) -> list[tuple[Option | Shift, Suspect]]:
        """Return the suspects by the score test."""
        case = self.case
        whole, names = _columns(case, options)
        score = _Score.of(case.point)
        found: list[tuple[Option | Shift, Suspect]] = []
        for option in options:
            wanted = [] if option.mode else [option.prior]
            if option.nuisance is not None:
                wanted = [u.name for u in option.nuisance.unknowns]
            columns = whole[:, [names.index(name) for name in wanted]]
            if option.prior:
                columns = np.column_stack([columns, _slack(case, option.prior)])
            drop, change = score.drop(columns)
            if drop > 0:
                value = self._guessed(option, change[: len(wanted)])
                found.append((option, self.suspect(option, drop, value)))
        return found

    def _guessed(self, option: Option, change: Floats) -> float | None:
        if option.mode is not None:
            return None
        if option.nuisance is None:
            at = self.case.prepared.layout.index[option.prior]
            return float(self.case.point.unknowns[at] + change[0])
        return _size(option, np.array([u.start for u in option.nuisance.unknowns]) + change)

    def share(self, drop: float) -> float:
        """Return the share of the excess misfit that a drop is."""
        excess = self.case.point.cost - self.expected
        return float(min(1.0, max(0.0, drop / excess))) if excess > 0 else 0.0

    def refitted(self, option: Option, *, far: bool = False) -> Finding | None:
        """Set an option free and minimize: from the estimate, and from the start if it is far."""
        free = option.free(self.case)
        points = [free.near(), free.far() if far else None]
        point = min((p for p in points if p is not None), key=lambda p: p.cost, default=None)
        if point is None:
            return None
        drop, value = self.case.point.cost - point.cost, option.value(free, point)
        return self.finding(option, self.suspect(option, drop, value))

    def finding(self, option: Option | Shift, suspect: Suspect, *, tried: bool = True) -> Finding:
        """Return what is said of something set free."""
        said, cure = _told(option, suspect.value)
        return Finding(suspect, self.case.point.cost - suspect.drop, said, cure, tried)

    def mistakes(self) -> list[Finding]:
        """Screen mistakes that are no small changes, and follow the best to the minimum.

        Whatever stands out is followed at once, and where it explains the data the search ends with
        those of its kind: a sensor upside down may look like its actuator upside down.
        """
        records, prepared = self.case.records, self.case.prepared
        if not records:
            return []
        found: list[Finding] = []
        level = screened(prepared, records)
        tries: list[tuple[float, _Follow]] = []
        for trials in self._trials():
            for wanted, changed, follow in trials:
                cost = screened(wanted, changed)
                tries.append((cost, follow))
                if cost < STANDS_OUT * level:
                    found += follow()
            if any(self.explained(finding) for finding in found):
                return found
        tries = [pair for pair in tries if not pair[0] < STANDS_OUT * level]
        for _, follow in sorted(tries, key=lambda pair: pair[0])[:SCREENED]:
            found += follow()
        return found

    def mistaken_modes(self) -> list[Finding]:
        """Screen mistakes with measured modes, and follow the best to the minimum."""
        records = self.case.records
        tries = list(mode_mistakes(self.case.prepared))
        if not tries:
            return []
        best = min(tries, key=lambda each: screened(each.prepared, records))
        point = Case(best.prepared, records, self.case.point).far()
        if point is None:
            return []
        drop = self.case.point.cost - point.cost
        suspect = Suspect(best.term, drop, self.share(drop), best.value, best.unit)
        return [Finding(suspect, point.cost, best.said, best.cure, exact=True)]

    def without_line(self) -> list[Finding]:
        """Leave out the line that contradicts all others; nothing where that leaves a misfit.

        Asked last, and not where something else explains the data: with a wrong speed, or without
        its damping, a model fits all lines but one. Another unit may explain anything: it is as if
        there were more noise.
        """
        lead = line_lead(self.case, self.case.point.cost - self.expected)
        if lead is None:
            return []
        found = [replace(finding, exact=False) for finding in self.followed(lead)]
        return [finding for finding in found if self.explained(finding)]

    def _trials(self) -> Iterator[Iterator[_Trial]]:
        """Yield what to screen, kind by kind, the likeliest first, and how to follow it."""
        records, prepared = self.case.records, self.case.prepared
        single, several = discrete_leads(records, self.structure, self.speeds())

        def undone(leads: Iterable[Lead]) -> Iterator[_Trial]:
            for lead in (one for one in leads if one.term not in self.tried):
                yield prepared, lead.undo(records), partial(self.followed, lead)

        def drawn() -> Iterator[_Trial]:
            for option in self._drawn():
                yield (
                    option.free(self.case).prepared,
                    records,
                    partial(self.freed, option, far=True),
                )

        def factors() -> Iterator[_Trial]:
            for name, start in typical_factors(records[0]).items():
                option = Option(f"gain[{name}]", "1", Multiplier.of(name, [name], start))
                if option.term not in prepared.layout.index:
                    follow = partial(self.freed, option, far=True)
                    yield option.free(self.case).prepared, records, follow

        def angles() -> Iterator[_Trial]:
            for option in self._angles(BEGINNINGS):
                follow = partial(self.freed, option, far=True)
                yield option.free(self.case).prepared, records, follow

        yield drawn()
        yield angles()
        yield undone(single)
        yield factors()
        yield undone(several)

    def followed(self, lead: Lead) -> list[Finding]:
        """Undo a mistake and minimize from the start."""
        records = tuple(lead.undo(self.case.records))
        point = Case(self.case.prepared, records, self.case.point).far()
        return [] if point is None else [self.undone(lead, point)]

    def undone(self, lead: Lead, point: Point) -> Finding:
        """Return what is said of a mistake that was undone."""
        drop = self.case.point.cost - point.cost
        suspect = Suspect(lead.term, drop, self.share(drop), lead.value, lead.unit)
        return Finding(suspect, point.cost, lead.said, lead.cure, exact=True)

    def shifted(self) -> list[tuple[Option | Shift, Suspect]]:
        """Return what sensors may read besides, by the score test."""
        score, found = _Score.of(self.case.point), list[tuple[Option | Shift, Suspect]]()
        if not self.case.records:
            return found
        for shift in shifts(self.case.records[0], self.structure):
            drop, change = score.drop(shift.column(self.case))
            if drop > 0:
                value = shift.given + float(change[0])
                found.append((shift, self.suspect(shift, drop, value)))
        return found

    def suspect(self, option: Option | Shift, drop: float, value: float | None) -> Suspect:
        """Return a suspect with its share of the excess misfit."""
        return Suspect(option.term, drop, self.share(drop), value, option.unit)

    def turned(self, shift: Shift) -> list[Finding]:
        """Find the share of what sensors read besides, by steps of the score test."""
        case, share = self.case, 0.0
        for _ in range(TURNS):
            change = float(_Score.of(case.point).drop(shift.column(case))[1][0])
            records = shift.applied(self.case.records, share + change)
            point = minimized(case.prepared, records, case.point.unknowns, (0.0,))
            if point is None or point.cost > case.point.cost:
                break
            case, share = Case(case.prepared, records, point), share + change
        drop = self.case.point.cost - case.point.cost
        found = self.suspect(shift, drop, shift.given + share)
        return [self.finding(shift, found)] if drop > 0 else []

    def freed(self, option: Option | Shift, *, far: bool = False) -> list[Finding]:
        """Free something; where it is a factor near that of a sign or unit, try that exactly."""
        if isinstance(option, Shift):
            return self.turned(option)
        free = self.refitted(option, far=far)
        if free is None:
            return []
        value = free.suspect.value
        if isinstance(option.nuisance, Delay):
            return [free, *self.lagging(option.nuisance, free)]
        exact = snap(value) if isinstance(option.nuisance, Multiplier) and value else None
        if exact is None or exact == 1.0:
            return [free]
        assert isinstance(option.nuisance, Multiplier)
        names = sorted(option.nuisance.channels)
        label = option.term.removeprefix("gain[").removesuffix("]")
        lead = sign(names) if exact == -1.0 else unit(names, label, exact)
        if exact < 0 and exact != -1.0:
            lead = replace(lead, term=option.term)
        return [free, *self.followed(lead)]

    def lagging(self, delay: Delay, free: Finding) -> list[Finding]:
        """Try a bandwidth in place of a delay that leaves a misfit: at first they look alike."""
        value, inputs = free.suspect.value or 0.0, set(self.model.inputs)
        actuator = delay.channels <= inputs
        late = value < 0 if actuator else value > 0 and not delay.channels & inputs
        if not late or free.left < self.expected + CLOSE:
            return []
        label = next(iter(delay.channels))
        if len(delay.channels) > 1:
            label = "force" if actuator else "position"
        lag = Response.undeclared(label, delay.channels, abs(value), actuator=actuator)
        cure = "declare it: dynamics = { bandwidth = .. } of the channels"
        found = self.refitted(Option(_term(lag), "Hz", lag, cure=cure))
        return [found] if found is not None else []

    def speeds(self) -> dict[int, list[float]]:
        """Return the speeds of the nearest line and of the worst, which may be the rotor's own.

        Of the records that fit worst, by their numbers.
        """
        found, pairs = {}, list(zip(self.case.records, self.case.point.records, strict=True))
        misfit = [-float(np.mean(at.line_costs)) for _, at in pairs]
        for number in np.argsort(misfit, kind="stable")[:ASKED].tolist():
            record, at = pairs[number]
            frequency = record.lines.frequency
            given = np.abs(record.lines.speed).mean() / (2 * np.pi)
            nearest = int(np.abs(frequency - given).argmin())
            order = [nearest, *np.argsort(-at.line_costs)[:2].tolist()]
            worst = [2 * np.pi * float(frequency[k]) for k in order if frequency[k] > 0]
            found[number] = list(dict.fromkeys(worst))
        return found


def _columns(case: Case, options: Sequence[Option]) -> tuple[Floats, list[str]]:
    """Return the Jacobian by what is unknown, fixed, or could be set free, and the names.

    A constant of one input and the same of all exclude one another, and take turns.
    """
    added = [o.nuisance for o in options if o.nuisance is not None]
    single = [n for n in added if isinstance(n, Constant) and len(n.inputs) == 1]
    blocks: list[Floats] = []
    names: list[str] = []
    for part in ([n for n in added if n not in single], single):
        wide = case.with_unknowns(part)
        point, layout = wide.point, wide.prepared.layout
        rows = [record.jacobian() for record in point.records]
        rows.append(point.problem.known.jacobian(point.unknowns))
        first = len(case.prepared.layout.unknowns) if names else 0
        blocks.append(np.concatenate(rows)[:, first:])
        names += [u.name for u in layout.unknowns[first:]]
    return np.concatenate(blocks, axis=1), names


def _slack(case: Case, name: str) -> Floats:
    """Return the columns that take a prior's row out of the residual."""
    known = case.point.problem.known
    rows = [i for i, text in enumerate(known.texts) if text == name]
    first = len(case.point.residual) - len(known)
    columns = np.zeros((len(case.point.residual), len(rows)))
    columns[[first + i for i in rows], range(len(rows))] = 1.0
    return columns


@frozen
class _Score:
    """The residual, and what the unknowns can explain of any column."""

    left: Floats
    residual: Floats

    @classmethod
    def of(cls, point: Point) -> _Score:
        left, values, _ = np.linalg.svd(projected_jacobian(point), full_matrices=False)
        return cls(left[:, values > 1e-9 * values.max(initial=0.0)], point.residual)

    def drop(self, columns: Floats) -> tuple[float, Floats]:
        """Return the drop of the cost with further columns, and the change of their unknowns."""
        size = np.sqrt((columns**2).sum(axis=0))
        scaled = columns / np.where(size > 0, size, 1.0)
        for _ in range(2):  # once more, against rounding
            scaled = scaled - self.left @ (self.left.T @ scaled)
        basis, values, right = np.linalg.svd(scaled, full_matrices=False)
        kept = values**2 > DISTINCT
        along = basis[:, kept].T @ self.residual
        change = -right[kept].T @ (along / values[kept])
        return float(along @ along), change / np.where(size > 0, size, 1.0)


def _places(options: Sequence[Option]) -> dict[str, int]:
    """Return where in the list of options what they act on stands first."""
    found: dict[str, int] = {}
    for number, option in enumerate(options):
        found.setdefault(_acted_on(option.term), number)
    return found


def _ranked(
    findings: Sequence[Finding], expected: float, places: Mapping[str, int]
) -> list[Finding]:
    """Order findings by the cost that is left, one for each term.

    Those that were tried come first, and of those that the data cannot tell apart a bound that is
    a little too narrow, then the ones that need no further unknown, then known values, which are no
    new terms.
    """
    best: dict[str, Finding] = {}
    for finding in _in_order(findings, expected, places):
        if finding.suspect.drop > 0:
            best.setdefault(finding.suspect.term, finding)
    ordered = list(best.values())
    group = alike(ordered, expected)
    channels = {_acted_on(f.suspect.term) for f in group if f.exact}
    told = [f for f in group if f.bound]
    told += [f for f in group if f.exact]
    rest = [f for f in group if f not in told and _acted_on(f.suspect.term) not in channels]
    told += sorted(rest, key=_standing)
    return [*told, *(f for f in ordered if f not in group)]


def _one_speed(findings: Sequence[Finding], expected: float) -> list[Finding]:
    """Return findings with the speeds of a record that fit alike as one of no value.

    Without a line at the right speed, any speed between the lines explains the data.
    """
    found = list(findings)
    for term in {f.suspect.term for f in findings if f.suspect.term.startswith("speed")}:
        group = alike([f for f in found if f.suspect.term == term], expected)
        values = np.array([f.suspect.value for f in group], dtype=float)
        if np.ptp(values) > SAME_SPEED * np.abs(values).max():
            number = term.partition("[")[2].rstrip("]")
            where = f" of record {int(number) + 1}" if number else ""
            suspect = replace(group[0].suspect, value=None, unit="")
            said = f"another speed{where} than the one given, which one no line tells"
            told = replace(group[0], suspect=suspect, said=said, cure=LOOK_FOR_THE_SPEED)
            found = [told, *(f for f in found if f.suspect.term != term)]
    return found


def _in_order(
    findings: Sequence[Finding], expected: float, places: Mapping[str, int]
) -> list[Finding]:
    """Order findings by the cost that is left, and where it is even by what they act on.

    There a channel that reads too little, as dead ones do, comes before too much.
    """

    def even(finding: Finding) -> tuple[bool, int, str]:
        term = finding.suspect.term
        return _too_much(finding), places.get(_acted_on(term), len(places)), term

    found: list[Finding] = []
    for tried in (True, False):
        rest = sorted((f for f in findings if f.tried == tried), key=lambda f: f.left)
        while rest:
            least = rest[0].left
            margin = EVEN * max(1.0, least / max(expected, 1.0))
            count = sum(f.left - least < margin for f in rest)
            found += sorted(rest[:count], key=even)
            rest = rest[count:]
    return found


def _standing(finding: Finding) -> int:
    """Return 0 for a known value, 1 for a term, 3 for data left out, which explains nothing.

    A bandwidth, 2, comes after the delay that it looks like; a bound that would be far off likewise
    after what may have led there, a sign or a unit.
    """
    kinds = {"prior ": 0, "bound ": 2, "bandwidth[": 2, "line ": 3}
    return next((n for kind, n in kinds.items() if finding.suspect.term.startswith(kind)), 1)


def _too_much(finding: Finding) -> bool:
    """Tell whether a suspect is a channel that reads more than there is."""
    value = finding.suspect.value
    return finding.suspect.term.startswith("gain[") and value is not None and abs(value) > 1


def _acted_on(term: str) -> str:
    """Return what a term acts on: a sign and a gain of one channel say the same."""
    return term.partition("[")[2] or term


def alike(findings: Sequence[Finding], expected: float) -> list[Finding]:
    """Return the best finding and those that the data cannot tell from it.

    Their costs differ by no more than those of alternatives do (theory, 7), times the cost over its
    expectation where even the best leaves a misfit.
    """
    tried = [f for f in findings if f.tried]
    if not tried:
        return list(findings[:1])
    least = min(f.left for f in tried)
    margin = CLOSE * max(1.0, least / max(expected, 1.0))
    return [f for f in tried if f.left - least < margin]


def _which_end(model: Model, findings: Sequence[Finding], expected: float) -> str:
    """Say that either end of the shaft may carry what the first finding is, where that is so."""
    if not isinstance(model, RotorModel) or not findings:
        return ""
    left, right = model.coordinates[:PLANES], model.coordinates[-PLANES:]
    first, *others = (finding.suspect.term for finding in alike(findings, expected))
    for here, there in ((left, right), (right, left)):
        swapped = first
        for one, other in zip(here, there, strict=True):
            swapped = re.sub(rf"\b{one}\b", other, swapped)
        if swapped != first and swapped in others:
            return "; which end carries it is not determined by these frequencies"
    return ""


def _told(option: Option | Shift, value: float | None) -> tuple[str, str]:
    """Say what something set free would be, and what to do about it."""
    size = (
        "" if value is None else f" = {value:.4g}{'' if option.unit == '1' else f' {option.unit}'}"
    )
    if isinstance(option, Shift):
        return f"{option.said}{size}", "correct reads in [channels], or turn the sensor"
    if option.mode is not None:
        told = "" if value is None else f", which is {value:.6g} Hz by everything else"
        return f"{option.term} as measured{told}", "check that frequency, and which mode it is"
    if option.prior:
        return f"{option.prior}{size} instead of what was given", f"check {option.prior}"
    if isinstance(option.nuisance, Multiplier) and value is not None:
        told = f"{option.term}{size}{factor_name(value)}"
        return told, "check the unit, the sign and the calibration of the channel"
    if isinstance(option.nuisance, LawConstant):
        told = f"{option.term} of the force laws{size}"
        return told, f"give its value, or have it estimated: {option.term} = {{ start = ... }}"
    if isinstance(option.nuisance, Bend):
        return f"{option.term}{size}", "calibrate what bends over its range, or excite less"
    if isinstance(option.nuisance, Delay):
        label = option.term.partition("[")[2].rstrip("]")
        cure = f'give delay or hold of the channels, or have it estimated: delays = ["{label}"]'
        return f"{option.term}{size}", option.cure or cure
    if isinstance(option.nuisance, Factor):
        return f"{option.term}{size}", option.cure or "check the channel, or declare it unknown"
    return f"{option.term}{size}", option.cure or "add the term to the model"


def sentence(findings: Sequence[Finding], cost: float, expected: float, which: str = "") -> str:
    """Say which lead is best, and what to do about it; `which` of a group it may be not told."""
    first = findings[0] if findings else None
    share = None if first is None else first.suspect.share
    if first is None or share is None or share < EXPLAINS:
        best = (
            "" if first is None else f"; the best, {first.suspect.term}, {100 * (share or 0):.2g} %"
        )
        return (
            f"the data reject the model, and none of the {len(findings)} suspects explains "
            f"more than a fifth of it{best}: look at the misfit by line, or for two mistakes"
        )
    others = [f.suspect.term for f in alike(findings, expected)[1:]]
    group = f" (the data cannot tell it from {', '.join(others[:4])}{which})" if others else ""
    rest = ""
    # Far from its first bending frequency alone is a shaft that bends all that it is taken for.
    if first.left >= GROSS * max(expected, 1.0) and first.suspect.term != BENDS:
        rest = (
            "; by itself it is not enough, so there is a second mistake or another one in its place"
        )
    return (
        f"the data reject the model; first suspect: {first.said}, with which the misfit falls from "
        f"{cost:.4g} to {first.left:.4g} where {expected:.4g} is expected{group}: "
        f"{first.cure}{rest}"
    )
