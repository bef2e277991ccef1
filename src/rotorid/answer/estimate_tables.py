"""What is shown of an estimate: tables of its values and of what may be wrong, notes on both."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rotorid.answer.estimate import Estimate, Prediction, Value
from rotorid.answer.judge import SUSPECTS, ordered
from rotorid.core.distributions import HALF_WIDTH as HALF_WIDTH
from rotorid.core.linalg import coupled
from rotorid.core.notes import Note
from rotorid.core.tables import Page, Table, table

NOTICED = 0.01  # p-value below which the tables say where the misfit lies
WORST = 8  # lines, equations, suspects or pairs that they list: what a screen holds
SPOILT = 0.3  # relative error of an accepted prediction from which on its reason is told
FAR = 10.0  # deviations in a value, from which on it is not shown in percent
ROUNDING = 0.005  # deviations below which a value is zero: half the last digit of two
ANYWHERE = 90.0  # deg, deviation of an angle from which on it may be any
NAMED_ASSUMPTIONS = 3  # of what is assumed: what moves the answer most
_GRAVE = ("refuses", "warns", "says")
NAMED = 1e-3  # share of the misfit below which a suspect explains nothing, and is not listed
MANY = 4  # pairs of one group of parameters, from which on its names are told once
TOGETHER = 0.95  # correlation from which two parameters are named as known together
_BY_HAND = {"kg m": ("g mm", 1e6), "kg m^2": ("g mm^2", 1e9)}  # units in which one balances


def page(estimate: Estimate, *, intervals: bool = False) -> Page:
    head = f"{estimate.model}, {estimate.method}: {verdict(estimate)}"
    return [head, *tables(estimate, intervals=intervals), *sentences(estimate)]


def verdict(estimate: Estimate) -> str:
    """Return the verdict, and what it rests on."""
    if estimate.doubt:
        return f"{estimate.status}, but doubtful ({estimate.doubt})"
    if lead := next((n for n in ordered(estimate.notes) if n.severity == "rejects"), None):
        suspected = lead.about == SUSPECTS and estimate.suspects
        cause = estimate.suspects[0].term if suspected else ", ".join((lead.about, *lead.on))
        return f"{estimate.status} ({cause})"
    if estimate.verdict == estimate.status:
        return estimate.status
    first = estimate.assumptions[0]
    more = f"{first.assumed}: {first.size} would shift {first.parameter} by {first.moves:.2g} std"
    return f"{estimate.verdict} ({more})"


def value_tables(estimate: Estimate, *, intervals: bool = False) -> dict[str, Table]:
    return {
        kind: _table(kind, values, intervals=intervals)
        for kind, values in estimate.quantities.items()
        if values
    }


def tables(estimate: Estimate, *, intervals: bool = False) -> list[Table]:
    values = value_tables(estimate, intervals=intervals)
    derived = values.pop("derived", None)
    late = estimate.method == "ml"  # products of the parameters, which few want to read
    found = [
        values.pop("parameters", None),
        None if late else derived,
        _unbalance_table(estimate, intervals=intervals),
        *values.values(),
        _mode_table(estimate),
        _alternative_table(estimate),
        _suspect_table(estimate),
        _misfit_table(estimate),
        derived if late else None,
    ]
    return [one for one in found if one is not None and one.rows]


def sentences(estimate: Estimate) -> list[str]:
    return [
        *on_fit(estimate),
        *(
            f"{c.verdict}, {on_data(c)}"
            for c in estimate.checks
            if c.severity in _GRAVE and not any(str(c) in told for told in estimate.warnings)
        ),
        *_assumed(estimate),
        *(f"warning: {warning}" for warning in estimate.warnings),
    ]


def _assumed(estimate: Estimate) -> list[str]:
    notes = [check for check in estimate.checks if check.severity == "assumes"]
    told = [f"note, {note.about}: {note.text}" for note in notes[:NAMED_ASSUMPTIONS]]
    more = len(notes) - len(told)
    return [*told, f"note, {more} more assumptions shift something by less"] if more else told


def on_data(check: Note) -> str:
    names = f" of {', '.join(check.on)}" if check.on else ""
    return f"{check.about}{names}: {check.text}"


def on_fit(estimate: Estimate) -> list[str]:
    told = []
    if estimate.misfit is not None:
        m = estimate.misfit
        judged = (
            f"; {m.expected:.4g} expected from noise ({m.dof} degrees of freedom), "
            f"p = {m.p_value:.2g}"
        )
        told.append(f"misfit {m.cost:.4g}{judged if m.dof else ', no degrees of freedom'}")
    errors = {n: "zero" if p is None else _percent(p) for n, p in estimate.prediction.items()}
    if errors:
        shown = ", ".join(f"{name} {error}" for name, error in errors.items())
        told.append(f"relative prediction error{_by_noise(estimate)}: {shown}")
    if estimate.lines_hz:
        low, high = min(estimate.lines_hz), max(estimate.lines_hz)
        whole = f"{estimate.periods} periods" if estimate.periods > 1 else "no periods"
        told.append(f"{whole}, {len(estimate.lines_hz)} lines from {low:g} to {high:g} Hz")
    if estimate.condition_number is not None:
        told.append(f"condition number {estimate.condition_number:.4g}")
    if _inflated((*estimate.parameters, *estimate.nuisance)):
        told.append("inflated: std as if all of the misfit were noise")
    if any(v.interval for v in estimate.parameters):
        told.append("95 %: interval by the profile of the misfit, which std does not describe")
    if _assuming(estimate.parameters):
        told.append("if assumptions err: std of what errors of the assumptions below may shift")
    return [*told, *_together(estimate)]


def _together(estimate: Estimate) -> list[str]:
    names = [value.name for value in estimate.free]
    if len(names) < 2 or len(names) != len(estimate.covariance):
        return []
    found = np.abs(np.triu(estimate.correlation, 1))
    pairs = [(found[i, j], i, j) for i, j in zip(*np.nonzero(found > TOGETHER), strict=True)]
    pairs.sort(key=lambda pair: (-round(float(pair[0]), 6), pair[1], pair[2]))
    if not pairs:
        return []
    said = []
    groups = [set(group.tolist()) for group in coupled(found > TOGETHER)]
    for group in sorted(groups, key=lambda of: next(k for k, p in enumerate(pairs) if p[1] in of)):
        own = [(r, i, j) for r, i, j in pairs if i in group]
        if len(own) > MANY:
            said.append(f"{', '.join(names[i] for i in sorted(group))}, up to {own[0][0]:.3f}")
        else:
            told = ((names[i], names[j], estimate.correlation[i, j]) for _, i, j in own)
            said += [f"{one} with {other} {r:+.3f}" for one, other, r in told]
    more = f" and {len(said) - WORST} more" if len(said) > WORST else ""
    shown = (", " if len(said) == len(pairs) else "; ").join(said[:WORST])
    return [f"strongly correlated; known better in combination: {shown}{more}"]


def _by_noise(estimate: Estimate) -> str:
    worst = max((p.relative_error for p in estimate.prediction.values() if p), default=0.0)
    if worst < SPOILT or estimate.status != "ok" or estimate.misfit is None:
        return ""
    return (
        " (of little meaning here: noise of the readings or, near a lightly damped resonance, of "
        "the measured forces is as large as the motion; see the misfit)"
    )


def _table(title: str, values: Sequence[Value], *, intervals: bool = False) -> Table:
    if intervals:
        ends = [(value.name, *_ends(value), row_of(value)[-1]) for value in values]
        return table((title, "value", "95 % from", "to", "unit"), ends)
    shown = ["value", "std", "std %", *(["inflated"] if _inflated(values) else [])]
    shown += ["if assumptions err"] if _assuming(values) else []
    shown += ["95 %"] if any(v.interval for v in values) else []
    shown += ["unit"]
    places = [0, *map(_COLUMNS.index, shown)]
    return table((title, *shown), [[cells[k] for k in places] for cells in map(row_of, values)])


def _alternative_table(estimate: Estimate) -> Table | None:
    if not estimate.alternatives:
        return None
    others = [dict(alternative.parameters) for alternative in estimate.alternatives]
    names = dict.fromkeys(name for other in others for name in other)
    own = {value.name: value.value for value in estimate.parameters}
    cost = [estimate.misfit and estimate.misfit.cost, *(a.cost for a in estimate.alternatives)]
    headings = ("other answers", "this", *(f"no. {i + 1}" for i in range(len(others))))
    every = own, *others
    rows = [(n, *("" if n not in each else f"{each[n]:.6g}" for each in every)) for n in names]
    costs = ("misfit", *("" if c is None else f"{c:.4g}" for c in cost))
    return table(headings, [*rows, costs])


def _mode_table(estimate: Estimate) -> Table:
    rows = []
    for m in estimate.modes:
        turning = f" at {m.speed_rad_s / (2 * math.pi):g} rev/s" if m.speed_rad_s else ""
        name = f"mode {m.mode}{turning}" + "".join(f", {n} = {v:g}" for n, v in m.parameters)
        pairs = [(name, m.frequency_hz, m.std_hz, m.fitted_hz, "Hz")]
        if m.damping_ratio is not None and m.damping_std and m.fitted_damping_ratio is not None:
            ratio = m.damping_ratio, m.damping_std, m.fitted_damping_ratio
            pairs.append((f"{name}, damping ratio", *ratio, ""))
        for label, value, std, fitted, unit in pairs:
            away = f"{(fitted - value) / std:+.2f}"
            rows.append((label, f"{value:.6g}", two_digits(std), f"{fitted:.6g}", away, unit))
    return table(("natural frequencies", "measured", "std", "fitted", "off by std", "unit"), rows)


def _unbalance_table(estimate: Estimate, *, intervals: bool) -> Table:
    rows: list[tuple[str, ...]] = []
    for plane in estimate.unbalance:
        unit, factor = _BY_HAND.get(plane.unit, (plane.unit, 1.0))
        sizes = (factor * plane.amount, None if plane.std is None else factor * plane.std)
        turned = plane.angle_rad, plane.angle_std_rad
        angles = [None if angle is None else math.degrees(angle) for angle in turned]
        both = Value("", "", *sizes), Value("", "", angles[0] or 0.0, angles[1])
        first, second = (_ends(x) if intervals else row_of(x)[1:3] for x in both)
        if angles[1] is not None and angles[1] > ANYWHERE:
            second = ("any", *("" for _ in second[1:]))
        rows.append((plane.plane, *first, unit, *second))
    spread = ("95 % from", "to") if intervals else ("std",)
    return table(("unbalance", "amount", *spread, "unit", "at deg", *spread), rows)


def _suspect_table(estimate: Estimate) -> Table | None:
    if estimate.status == "ok":
        return None
    rows = [
        (
            s.term,
            _plain(f"{s.drop:.3g}"),
            "" if s.share is None else f"{100 * s.share:.3g}",
            "" if s.value is None else f"{s.value:.4g}",
            "" if s.unit == "1" else s.unit,
        )
        for s in [s for s in estimate.suspects if s.share is None or s.share >= NAMED][:WORST]
    ]
    headings = ("suspect", "misfit reduction", "% of the excess", "fitted value", "unit")
    known = 5 if any(row[2] for row in rows) else 2  # results of version 1 hold the drop alone
    return table(headings[:known], (row[:known] for row in rows))


def _misfit_table(estimate: Estimate) -> Table | None:
    rows = sorted(estimate.line_misfit, key=lambda row: row.cost - row.expected, reverse=True)
    if estimate.misfit is None or estimate.misfit.p_value > NOTICED:
        return None
    several = len({row.record for row in rows}) > 1
    cells = [
        (
            f"{row.frequency_hz:.6g} Hz" + f", record {row.record + 1}" * several,
            _plain(f"{row.cost:.4g}"),
            _plain(f"{row.expected:.4g}"),
        )
        for row in rows[:WORST]
    ]
    return table(("misfit by line", "found", "by noise"), cells)


def _inflated(values: Sequence[Value]) -> bool:
    return any(v.std and v.std_inflated and v.std_inflated > 1.05 * v.std for v in values)


def _assuming(values: Sequence[Value]) -> bool:
    return any(v.std and v.std_assumed and v.std_assumed > 0.1 * v.std for v in values)


_COLUMNS = ("", "value", "std", "std %", "inflated", "if assumptions err", "95 %", "unit")


def row_of(value: Value) -> tuple[str, ...]:
    """Return the cells of `_COLUMNS`."""
    unit = "" if value.unit == "1" else value.unit
    inflated = "" if value.std_inflated is None else two_digits(value.std_inflated)
    assumed = "" if value.std_assumed is None else two_digits(value.std_assumed)
    rest = inflated, assumed, interval_text(value), unit
    if value.std and abs(value.value) < ROUNDING * value.std:
        return value.name, "0", two_digits(value.std), "", *rest
    if value.fixed or value.std is None or not value.std > 0:
        std = "fixed" if value.fixed else "-" if value.std is None else f"{value.std:g}"
        return value.name, f"{value.value:.6g}", std, *[""] * 4, unit
    far = value.std > FAR * abs(value.value)  # a percentage of what may as well be zero
    percent = "" if far else two_digits(100 * value.std / abs(value.value))
    return value.name, figures(value.value, value.std), two_digits(value.std), percent, *rest


def _ends(value: Value) -> tuple[str, ...]:
    """Return a value and the ends of its 95 % interval, all to the same digit."""
    std = value.std_inflated or value.std
    if value.fixed or not std or not np.isfinite([value.value, std]).all():
        _, number, told = row_of(value)[:3]
        return number, told if told == "fixed" else "-", "" if told == "fixed" else "-"
    even = (value.value - HALF_WIDTH * std, value.value + HALF_WIDTH * std)
    low, high = value.interval or even
    last = int(np.floor(np.log10(std))) - 1
    largest = max(abs(end) for end in (*even, low, high) if math.isfinite(end))
    digits = max(int(np.floor(np.log10(largest))) - last + 1, 1)
    if last < 0 and largest < 1e6 and last > -9:
        return f"{value.value:.{-last}f}", f"{low:.{-last}f}", f"{high:.{-last}f}"
    return tuple(_plain(f"{number:#.{min(digits, 12)}g}") for number in (value.value, low, high))


def interval_text(value: Value) -> str:
    """Return the interval of a value that has one of its own, empty of others."""
    if value.interval is None:
        return ""
    (_, low, high), (below, above) = _ends(value), map(math.isinf, value.interval)
    if below or above:
        return "any" if below and above else f"below {high}" if below else f"above {low}"
    return f"{low} to {high}"


def figures(value: float, spread: float) -> str:
    """Return a value to the second digit of its spread."""
    if value == 0 or not (math.isfinite(value) and 0 < spread < math.inf):
        return f"{value:.6g}"
    digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(spread)) + 2
    return _plain(f"{value:#.{min(max(digits, 2), 12)}g}")


def two_digits(number: float) -> str:
    return _plain(f"{number:#.2g}") if math.isfinite(number) else ""


def _plain(text: str) -> str:
    """Return a number without a power of ten where it has less than eight digits."""
    mantissa, _, power = text.partition("e")
    if power.startswith("+") and int(power) < 7:
        return f"{float(text):.0f}"
    return text.rstrip(".") if not power else f"{mantissa.rstrip('.')}e{power}"


def _percent(prediction: Prediction) -> str:
    if prediction.relative_error > FAR:  # of a rotor that floats forces alone tell no motion
        return f"more than {100 * FAR:.0f} %"
    return f"{100 * prediction.relative_error:.3g} %"
