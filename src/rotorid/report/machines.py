"""Modes, balancing and sensitivity: their sentences, tables and pages."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rotorid.answer.estimate import ERR, NAMED_ASSUMPTIONS, Estimate, assuming_table, two_digits
from rotorid.answer.parts import UNDER, under
from rotorid.core.errors import InputError
from rotorid.core.notes import Note
from rotorid.core.tables import Page, Table, by_hand, table
from rotorid.core.values import Floats
from rotorid.models import Model
from rotorid.models.rotor import RotorModel
from rotorid.report import drawn
from rotorid.report.drawn import GMM, NODE, RPM
from rotorid.report.html import Mood, Passage, page_of
from rotorid.report.records import cell
from rotorid.results.balancing import MOUNTED, POOR, WEIGHED, Balance, Feedforward
from rotorid.results.loops import LoopSensitivity
from rotorid.results.machine import Machine, machine_of
from rotorid.results.modes import (
    Campbell,
    Modes,
    UnbalanceResponse,
    campbell,
    modes,
    partners,
    response_of,
)
from rotorid.results.sensitivity import LIMITS, AxisSensitivity, worst_of

DEGREES = 180 / np.pi


def _told(value: float | None, factor: float = 1.0, form: str = "") -> str:
    """Return a number, a deviation if no form is given; a dash where there is none."""
    if form or value is None or not np.isfinite(value):
        return cell(value, form, factor, none="-")
    return two_digits(value * factor)


def _assumed(notes: Iterable[Note]) -> list[str]:
    """Return what the results rest on most, each thing once: with what it may move most."""
    falling, told = sorted(notes, key=lambda note: -(note.value or 0.0)), dict[str, str]()
    for note in falling:
        told.setdefault(note.about, f"note, {note.about}: {note.text}")
    return [*told.values()][:NAMED_ASSUMPTIONS]


def assumed_by(*found: Modes | Campbell | UnbalanceResponse | Balance | None) -> list[Note]:
    """Return the notes on what results assume."""
    return [note for each in found if each is not None for note in each.notes]


def balance_page(found: Balance, centred: Sequence[Feedforward] = ()) -> Page:
    tables = [part.table for part in _balance_parts(found, centred) if part.table is not None]
    return [
        f"{found.model} at {_speeds(found)} rpm: add in each plane, angles in the rotor from x to "
        "y, counted from what stands along x at the rotor angle 0",
        *tables,
        *_said_of(found),
    ]


def balance_report(
    found: Balance, centred: Sequence[Feedforward], model: Model, done: Sequence[str] = ()
) -> str:
    said = _said_of(found)
    planes = Passage(
        "The planes, seen along the shaft",
        "The correction in each plane, as a vector; the right one lies within the circle about its "
        "end with 95 %. Masses stand on the rim at their angles.",
        panels=tuple(drawn.corrections(found)),
    )
    besides = tuple(each for each in said if not each.startswith("warning: "))
    page = Passage(
        f"Balance at {_speeds(found)} rpm",
        lead=f"Of the rotor {model.title or model.name}",
        verdict=_balance_sentence(found),
        mood="doubt" if found.share > POOR or found.verdict not in ("ok", UNDER) else "good",
        steps=tuple(text.removeprefix("warning: ") for text in said if text not in besides),
        numbers=tuple(
            (
                f"{GMM * c.unbalance_kg_m:.4g} g mm",
                f"at {np.degrees(c.angle_rad):.1f} deg, {c.plane}",
            )
            for c in found.corrections[:3]
        ),
        picture=planes,
        parts=(*_balance_parts(found, centred), planes, Passage("Notes", items=besides)),
    )
    return page_of(page, model=model, done=done)


def _speeds(found: Balance) -> str:
    rpm = [speed * RPM for speed in found.speeds]
    several = f"{len(rpm)} speeds from {min(rpm):.5g} to {max(rpm):.5g}"
    return several if len(rpm) > 8 else ", ".join(f"{each:.6g}" for each in rpm)


def _balance_parts(found: Balance, centred: Sequence[Feedforward]) -> Iterator[Passage]:
    rows = [
        (
            each.plane,
            f"{each.unbalance_kg_m * GMM:.5g}",
            _told(each.std_kg_m, GMM),
            _told(each.std_assumed_kg_m, GMM),
            f"{np.degrees(each.angle_rad):.1f}",
            _told(each.angle_std_rad, DEGREES),
        )
        for each in found.corrections
    ]
    yield Passage(
        "Corrections",
        "Angles count in the rotor, from x to y, from what stands along x where the rotor "
        "angle is 0: at its mark. Taking away is adding on the other side.",
        assuming_table(("correction", "g mm", "std", ERR, "at deg", "std"), rows),
    )
    masses = [
        (each.plane, f"{1e3 * mass:.4g}", f"{np.degrees(angle):.1f}")
        for each in found.corrections
        for mass, angle in each.masses
    ]
    if masses:
        told = "The masses that come nearest to it, all planes together."
        yield Passage("Masses to mount", told, table(("mount in plane", "g", "at deg"), masses))
    left = [
        (
            each.plane,
            _told(each.unbalance_kg_m, GMM, ".4g"),
            _told(each.std_kg_m, GMM),
            _told(each.grade_mm_s, form=".3g"),
        )
        for each in found.residual
    ]
    yield Passage(
        "Residual unbalance",
        "The true unbalance is not the identified one: with 95 % less than this is left.",
        table(("left, with 95 %", "less than g mm", "std", "grade in mm/s"), left),
    )
    if centred:
        yield Passage(
            "Inertial centring",
            "The other way to a quiet machine: the rotor turns about its own axis of inertia if "
            "these currents, a cos(phi + angle), are fed forward.",
            _centring_table(centred, found.speeds[0]),
        )


def _balance_sentence(found: Balance) -> str:
    if found.share > POOR:
        left = f"{100 * found.share:.2g} % of the response is left"
        return f"These planes cannot balance this rotor: {left}."
    if found.covariance is None:
        return "What to add is computed; the result states no deviations, so what is left is open."
    if found.grade_mm_s is not None and found.rotor_mass is not None:
        grade = _grade(found.grade_mm_s)
        return f"Balanced with this to below {grade}, ISO 21940-11, all planes together, with 95 %."
    most = max(each.unbalance_kg_m or 0.0 for each in found.residual)
    return f"With this less than {GMM * most:.2g} g mm is left in any plane, with 95 %."


def _said_of(found: Balance) -> list[str]:
    told = [] if found.verdict == found.status else [f"{found.model}: {found.verdict}"]
    said = [*told, *found.remarks]
    said += _assumed(found.notes)
    if found.rotor_mass is not None and found.grade_before_mm_s is not None:
        after = "" if found.grade_mm_s is None else f", after below {_grade(found.grade_mm_s)}"
        said.append(
            f"all planes together: before {_grade(found.grade_before_mm_s)}{after} "
            f"(rotor of {found.rotor_mass:.4g} kg, ISO 21940-11)"
        )
        said.append(
            f"masses to {100 * WEIGHED:g} % and angles to {np.degrees(MOUNTED):g} deg leave up to "
            f"{found.grade_mounted_mm_s:.2g} mm/s more"
        )
    if found.covariance is None:
        said.append("the result states no deviations: what is left beyond the masses is not known")
    said.append(f"{100 * found.share:.2g} % predicted residual response")
    if found.share > POOR:
        said.append(
            "warning: this does not remove the unbalance; allow other masses or holes, add a "
            "plane, or choose with --at what to minimize"
        )
    return said


GRADES = (0.4, 1.0, 2.5, 6.3, 16.0, 40.0, 100.0, 250.0, 630.0, 1600.0, 4000.0)
"""Balance quality grades of ISO 21940-11, mm/s."""


def _grade(size: float) -> str:
    """Return ``e Omega`` with the grade that it meets; there is none above the last."""
    met = next((f"G {grade:g}" for grade in GRADES if size <= grade), "no grade")
    return f"{size:.2g} mm/s ({met})"


def _centring_table(found: Sequence[Feedforward], speed: float) -> Table:
    known = any(each.amplitude_ampere is not None for each in found)
    rows = []
    for each in found:
        row = [each.input, f"{1e6 * each.motion_m:.4g}", _told(each.motion_std_m, 1e6)]
        if known:
            row += [_told(each.amplitude_ampere, 1e3, ".4g"), _told(each.std_ampere, 1e3)]
            row += [_told(each.angle_rad, DEGREES, ".1f"), _told(each.angle_std_rad, DEGREES)]
        rows.append(tuple(row))
    headings = [f"inertial centring at {speed * RPM:.6g} rpm", "motion in um", "std"]
    if known:
        headings += ["feed forward mA", "std", "at deg", "std"]
    return table(tuple(headings), rows)


NAMED = 5
"""Frequencies that a sentence names: the lowest."""
SHOWN = 11
"""Speeds of the table of a diagram."""
MOST_MODES = 16
"""Modes of the table: what a screen holds; those above are seldom the machine's."""
MOST_ROWS = 16
"""Coordinates of the table of a response."""
REACH = 2.0
"""Curves of the table of a diagram begin below this many times the last speed."""
FEWEST, MOST_CURVES = 2, 8
"""Curves of that table at the least, and at the most."""
NOTHING = 1e-9
"""Damping ratios below this are rounding."""
JUMP = 10.0
"""No natural frequency changes by this factor from one speed of a diagram to the next: where a
curve does, as one that begins at zero, it is two, and a gap is drawn."""
RESONANT = 0.5**0.5
"""Damping ratio from which on no response has a peak, so that nobody measures such a mode."""


BEYOND = 1.5  # a diagram goes to this many times the highest speed of the records
SPEEDS = 121  # speeds of a response that is drawn


def modes_page(
    found: Modes, diagram: Campbell | None = None, response: UnbalanceResponse | None = None
) -> Page:
    free = ", ".join(found.machine.model.inputs)
    whose = f"without forces at its inputs ({free})" if free else "without inputs"
    page: list[str | Table] = [
        modes_sentence(found, diagram),
        f"{found.model} at {found.speed * RPM:.6g} rpm, as its equations have it, {whose}: what a "
        "controller or magnets add is excluded",
    ]
    if ringing(found).modes:
        page.append(mode_table(found))
    page += summary(found)
    page += _assumed(assumed_by(found, diagram, response))
    page += [] if diagram is None else _diagram_tables(diagram)
    page += [] if response is None else [response_table(response)]
    return page


def _diagram_tables(found: Campbell) -> Page:
    none = f"no critical speed up to {found.speed[-1] * RPM:.6g} rpm"
    return [critical_table(found) if found.critical else none, campbell_table(found)]


def campbell_page(found: Campbell) -> Page:
    lead = f"{found.model} up to {found.speed[-1] * RPM:.6g} rpm"
    return [lead, *_diagram_tables(found), *found.remarks, *_assumed(found.notes)]


def shape_panels(found: Modes) -> list[drawn.Panel]:
    model = found.machine.model
    places = _places(model)
    return drawn.shapes(ringing(found), places, _positions(model, places))


def response_page(found: UnbalanceResponse) -> Page:
    chosen = np.unique(np.linspace(0, len(found.speed) - 1, SHOWN).round().astype(int))
    tables = [response_table(found, k) for k in chosen.tolist()]
    return [f"{found.model}: motion that its unbalance makes", *tables, *_assumed(found.notes)]


def ringing(found: Modes) -> Modes:
    """Return the modes that a response shows as peaks: those that are not overdamped."""
    return replace(found, modes=tuple(m for m in found.modes if m.damping_ratio < RESONANT))


def ringing_curves(found: Campbell) -> Campbell:
    with np.errstate(invalid="ignore"):
        heard = np.isfinite(found.frequency_hz) & (found.damping_ratio < RESONANT)
        steps = found.frequency_hz[1:] / found.frequency_hz[:-1]
        heard[:-1] &= ~((steps > JUMP) | (steps < 1 / JUMP))
    some = np.flatnonzero(heard.any(axis=0))

    def kept(values: Floats) -> Floats:
        return np.where(heard, values, np.nan)[:, some]

    return replace(
        found,
        frequency_hz=kept(found.frequency_hz),
        std_hz=kept(found.std_hz),
        damping_ratio=kept(found.damping_ratio),
        whirl=tuple(found.whirl[i] for i in some),
    )


def modes_sentence(found: Modes, diagram: Campbell | None) -> str:
    rpm = RPM * found.speed
    where = f"At {rpm:.5g} rpm" if found.speed else "At standstill"
    growing = [mode for mode in found.modes if mode.damping_ratio < -NOTHING]
    heard = ringing(found).modes
    told = f"{where} no mode oscillates"
    if heard:
        first = [f"{mode.frequency_hz:.4g}" for mode in heard[:NAMED]]
        listed = " and ".join(filter(None, [", ".join(first[:-1]), first[-1]]))
        more = f", and at {len(heard) - NAMED} higher frequencies" if len(heard) > NAMED else ""
        bare = found.rigid and found.machine.model.inputs
        whose = "the free rotor, without its bearings, has" if bare else "the machine has"
        told = f"{where} {whose} natural frequencies of {listed} Hz{more}"
    if growing:
        told += (
            f"; {len(growing)} of them grow{'s' if len(growing) == 1 else ''} (negative damping)"
        )
    told += "" if diagram is None else f"; {_nearest(rpm, diagram)}"
    verdict = under(found.verdict, assumed_by(found, diagram))
    return f"{told}." if verdict == found.status else f"{verdict}: {told}."


def _nearest(rpm: float, diagram: Campbell) -> str:
    if not diagram.critical:
        return f"no critical speed up to {RPM * abs(diagram.speed[-1]):.5g} rpm"
    speeds = [RPM * abs(each.speed_rad_s) for each in diagram.critical]
    if not rpm:
        return f"the first critical speed is {min(speeds):.5g} rpm"
    near = min(speeds, key=lambda speed: abs(speed - abs(rpm)))
    away = near / abs(rpm) - 1
    side = "above" if away > 0 else "below"
    return f"the nearest critical speed, {near:.5g} rpm, lies {100 * abs(away):.3g} % {side} it"


def mode_table(found: Modes) -> Table:
    rows = [
        (
            f"{number}{'~' if mode.close else ''}",
            f"{mode.frequency_hz:.6g}",
            _told(mode.std_hz),
            _told(mode.std_assumed_hz),
            _ratio(mode.damping_ratio),
            "-" if abs(mode.damping_ratio) < NOTHING else _told(mode.damping_std),
            "-" if abs(mode.damping_ratio) < NOTHING else _told(mode.damping_std_assumed),
            mode.whirl + (", both planes" if mode.count > 1 else ""),
        )
        for number, mode in enumerate(ringing(found).modes[:MOST_MODES], start=1)
    ]
    headings = ("mode", "frequency in Hz", "std", ERR, "damping ratio", "std", ERR, "whirl")
    return assuming_table(headings, rows)


def summary(found: Modes) -> list[str]:
    said = list(found.remarks)
    heard = ringing(found).modes
    if len(heard) > MOST_MODES:
        said.append(f"{len(heard) - MOST_MODES} modes above; --json holds all")
    if dull := len(found.modes) - len(heard):
        said.append(f"{dull} overdamped, with no peak in any response, not shown; --json holds all")
    growing = [mode for mode in found.modes if mode.damping_ratio < -NOTHING]
    if not found.modes:
        said.append("no natural frequencies: only free motion, or real poles")
    if found.rigid:
        said.append(f"free motion (rigid body): {found.rigid} poles at zero, not listed")
    if growing:
        listed = ", ".join(f"{mode.frequency_hz:.5g} Hz" for mode in growing)
        said.append(f"warning: unstable modes (negative damping): {listed}")
    if any(pole > 0 for pole in found.real_poles):
        listed = ", ".join(f"{pole:.4g}" for pole in found.real_poles if pole > 0)
        said.append(f"warning: unstable real poles, at {listed} rad/s")
    damped = sorted((pole for pole in found.real_poles if pole <= 0), reverse=True)
    if damped:
        listed = ", ".join(f"{pole:.4g}" for pole in damped[:4])
        said.append(f"{len(damped)} real poles, the slowest at {listed} rad/s")
    if any(mode.close for mode in found.modes):
        said.append("~: closely spaced; order or shape uncertain, std by Monte Carlo")
    if any(mode.whirl == "mixed" for mode in found.modes):
        said.append("mixed: forward at some places and backward at others")
    return said


def critical_table(found: Campbell) -> Table:
    rows = [
        (
            str(number),
            f"{each.speed_rad_s * RPM:.6g}",
            _told(each.std, RPM),
            _told(each.std_assumed, RPM),
            f"{each.speed_rad_s:.6g}",
            each.whirl,
            _ratio(each.damping_ratio),
        )
        for number, each in enumerate(found.critical, start=1)
    ]
    headings = ("critical speed", "rpm", "std", ERR, "rad/s", "whirl", "damping ratio")
    return assuming_table(headings, rows)


def campbell_table(found: Campbell) -> Table:
    chosen = np.unique(np.linspace(0, len(found.speed) - 1, SHOWN).round().astype(int))
    found = ringing_curves(found)
    low = np.nanmin(found.frequency_hz, axis=0, initial=np.inf)
    within = low <= REACH * abs(found.speed[-1]) / (2 * np.pi)
    within[np.argsort(low, kind="stable")[:FEWEST]] = True
    curves = np.flatnonzero(within)[:MOST_CURVES]
    headings = ("rpm", *(found.whirl[i] for i in curves))
    rows = [
        (
            f"{found.speed[k] * RPM:.5g}",
            *(_told(f, form=".5g") for f in found.frequency_hz[k, curves]),
        )
        for k in chosen
    ]
    return table(headings, rows)


def response_table(found: UnbalanceResponse, k: int = 0) -> Table:
    """Return the table of a response at the speed of number k."""
    columns, units = (
        (found.motion[k], found.std[k], found.std_assumed[k]),
        found.machine.model.units,
    )
    every = list(zip(found.coordinates, *columns, strict=True))
    named = [row for row in every if len(every) <= MOST_ROWS or not NODE.search(row[0])]
    rows = []
    for name, value, std, assumed in named[:MOST_ROWS]:
        unit, factor = by_hand(units.get(name, ""), abs(value))
        size = factor * abs(value)
        rows.append(
            (
                name,
                f"{size:.4g}" if np.isfinite(size) else "no bound",
                _told(std, factor),
                _told(assumed, factor),
                unit,
                f"{np.degrees(np.angle(value)):.1f}" if np.isfinite(size) else "",
            )
        )
    title = f"unbalance response at {found.speed[k] * RPM:.6g} rpm"
    return assuming_table((title, "amplitude", "std", ERR, "unit", "phase in deg"), rows)


def _ratio(value: float) -> str:
    return "0" if abs(value) < NOTHING else f"{value:.4g}"


def machine_part(source: Estimate | Model, speed: float) -> Passage:
    try:
        found = modes(source, speed=speed)
        diagram = campbell(source, BEYOND * speed) if speed else None
    except InputError as error:
        return Passage("Modes", said=(f"No modes are told: {error.found}; {error.cure}.",))
    part = _machine_part(machine_of(source), found, diagram)
    return replace(part, said=(modes_sentence(found, diagram), *part.said))


def modes_report(
    source: Estimate | Model, found: Modes, diagram: Campbell | None, notes: Sequence[str]
) -> str:
    machine = machine_of(source)
    part, model = _machine_part(machine, found, diagram), machine.model
    picture = next((one for one in part.parts if one.panels), None)
    named = replace(part, title=model.title or model.name, lead=part.title)
    page = replace(named, verdict=modes_sentence(found, diagram), picture=picture)
    return page_of(page, tab=f"{model.name}: {part.title}", model=model, done=notes)


def _machine_part(machine: Machine, found: Modes, diagram: Campbell | None) -> Passage:
    model, response = machine.model, None
    if diagram is not None and machine.linear.load_terms:
        response = response_of(machine, np.linspace(0, diagram.speed[-1], SPEEDS + 1)[1:])
    free = ", ".join(model.inputs)
    whose = "Of the machine as its equations have it"
    if free:
        whose += f", without forces at its inputs ({free}): controller and magnets excluded"
    critical = critical_table(diagram) if diagram is not None and diagram.critical else None
    return Passage(
        f"Modes at {RPM * found.speed:.5g} rpm" if found.speed else "Modes at standstill",
        said=(f"{whose}.", *summary(found), *_assumed(assumed_by(found, diagram))),
        parts=(
            Passage("Natural frequencies", table=mode_table(found)),
            Passage("Critical speeds", table=critical),
            *_pictures(model, found, diagram, response),
        ),
    )


def _pictures(
    model: Model, found: Modes, diagram: Campbell | None, response: UnbalanceResponse | None
) -> Iterator[Passage]:
    if diagram is not None:
        yield Passage(
            "Campbell diagram",
            "Natural frequencies over the speed, up to three times the rotation; a critical "
            "speed is where one meets the rotation. Bars and bands hold 95 %.",
            panels=(drawn.campbell(ringing_curves(diagram)),),
        )
    yield Passage(
        "Mode shapes",
        "At the moment of the largest motion, as a sum of a forward and a backward circle.",
        panels=tuple(shape_panels(found)),
    )
    if response is not None:
        yield Passage(
            "Unbalance response",
            "Amplitude by unbalance, without forces at the inputs; the band holds 95 %.",
            panels=tuple(drawn.response(response, model.units)),
        )


def _places(model: Model) -> Sequence[tuple[int, ...]]:
    """Return the places whose motion is drawn: pairs of lengths, else single coordinates."""
    names = model.coordinates
    pairs = partners(names)
    lengths = [pair for pair in pairs if model.units[names[pair[0]]] == "m"]
    return lengths or pairs or [(k,) for k in range(len(names))]


def _positions(model: Model, places: Sequence[tuple[int, ...]]) -> Floats | None:
    if not isinstance(model, RotorModel):
        return None
    at = {n.coordinates[0]: n.position for n in model.rotor.nodes}
    found = [at.get(model.coordinates[place[0]]) for place in places]
    return None if None in found else np.array(found, dtype=float)


MOODS: dict[str, Mood] = {"zone A": "good", "zone C": "bad", "zone D": "bad"}
"""How a verdict is coloured; zone B, and one that is undecided, is a doubt."""


def sensitivity_page(found: Sequence[AxisSensitivity]) -> Page:
    return [_sensitivity_sentence(found), _sensitivity_table(found)]


def sensitivity_report(
    found: Sequence[AxisSensitivity], name: str, done: Sequence[str] = ()
) -> str:
    limits = ", ".join(f"{zone} below {limit:g}" for zone, limit in LIMITS.items())
    by_axis = Passage(
        "Largest sensitivity by axis",
        "The largest sensitivity of each loop, the others closed. Zones of ISO 14839-3: "
        f"{limits}, D above. Where the 95 % interval lies across a limit the zone is "
        "undecided: measure longer, or excite more.",
        _sensitivity_table(found),
    )
    curves = Passage(
        "Sensitivity over the frequency",
        "S = E / R of each loop as it was measured, and the limits of the zones.",
        panels=tuple(drawn.loops(found, LIMITS)),
    )
    page = Passage(
        f"{name}: sensitivity of the loops",
        lead="After ISO 14839-3",
        verdict=f"{_sensitivity_sentence(found)}.",
        mood=MOODS.get(worst_of(found), "doubt"),
        parts=(by_axis, curves),
    )
    return page_of(page, done=done)


def _sensitivity_table(found: Sequence[AxisSensitivity]) -> Table:
    rows = [
        (
            each.axis,
            f"{each.peak:.3g}",
            f"{each.interval[0]:.3g} to {each.interval[1]:.3g}",
            f"{each.peak_db:.1f}",
            f"{each.peak_hz:.4g}",
            each.verdict,
        )
        for each in found
    ]
    return table(("axis", "peak of S", "95 %", "dB", "at Hz", "ISO 14839-3"), rows)


def _sensitivity_sentence(found: Sequence[AxisSensitivity]) -> str:
    worst = max(found, key=lambda each: each.interval[1])
    low, high = worst.interval
    verdict = worst_of(found)
    return (
        f"{verdict[:1].upper()}{verdict[1:]}: the largest sensitivity is {worst.peak:.3g} "
        f"({worst.peak_db:.1f} dB) at {worst.peak_hz:.4g} Hz, of {worst.axis}; with 95 % it lies "
        f"between {low:.3g} and {high:.3g}"
    )


RESULTS: dict[type, tuple[Callable[[Any], Page], Callable[[Any], Sequence[drawn.Panel]]]] = {
    Modes: (modes_page, shape_panels),
    Campbell: (campbell_page, lambda found: [drawn.campbell(ringing_curves(found))]),
    UnbalanceResponse: (response_page, lambda f: drawn.response(f, f.machine.model.units)),
    Balance: (balance_page, drawn.corrections),
    AxisSensitivity: (lambda f: sensitivity_page([f]), lambda f: drawn.loops([f], LIMITS)),
    LoopSensitivity: (
        lambda found: [*sensitivity_page(found.axes), *(note.text for note in found.notes)],
        lambda found: drawn.loops(found.axes, LIMITS),
    ),
}
"""The page of each result, and its panels."""
