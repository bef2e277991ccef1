"""Pages of modes, balancing and sensitivity."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from rotorid.answer.estimate import Estimate
from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.values import Floats
from rotorid.models import Model
from rotorid.models.rotor import RotorModel
from rotorid.report import drawn
from rotorid.report.drawn import RPM
from rotorid.report.html import Passage, answer, filled, render
from rotorid.report.machine_tables import (
    balance_sentence,
    centring_table,
    correction_table,
    critical_table,
    mass_table,
    mode_table,
    modes_sentence,
    residual_table,
    ringing,
    ringing_curves,
    said_of,
    sensitivity_sentence,
    sensitivity_table,
    summary,
)
from rotorid.results.balancing import POOR, Balance
from rotorid.results.centring import Feedforward
from rotorid.results.critical import Campbell, UnbalanceResponse, campbell, response_of
from rotorid.results.machine import Machine, machine_of
from rotorid.results.modes import Modes, modes, partners
from rotorid.results.sensitivity import LIMITS, AxisSensitivity, worst_of

BEYOND = 1.5
"""A diagram goes to this many times the highest speed of the records."""
SPEEDS = 121
"""Speeds of a response that is drawn."""


@frozen
class Part:
    """What a page shows of a machine: a verdict, sentences, tables and pictures."""

    title: str
    said: tuple[str, ...]
    sections: Sequence[Passage] = ()
    verdict: str = ""


def machine_part(source: Estimate | Model, speed: float) -> Part:
    """Return the modes at a speed, and the way there and beyond, as part of a page."""
    try:
        found = modes(source, speed=speed)
        diagram = campbell(source, BEYOND * speed) if speed else None
    except InputError as error:
        return Part("Modes", (f"No modes are told: {error.found}; {error.cure}.",))
    return part_of(machine_of(source), found, diagram)


def part_of(machine: Machine, found: Modes, diagram: Campbell | None) -> Part:
    model, response = machine.model, None
    title = f"Modes at {RPM * found.speed:.5g} rpm" if found.speed else "Modes at standstill"
    if diagram is not None and machine.linear.load_terms:
        response = response_of(machine, np.linspace(0, diagram.speed[-1], SPEEDS + 1)[1:])
    free = ", ".join(model.inputs)
    said = [
        f"Of the machine as its equations have it, without forces at its inputs ({free}): what a "
        "controller or the magnets add is no part of it."
        if free
        else "Of the machine as its equations have it.",
        *summary(found),
    ]
    critical = critical_table(diagram) if diagram is not None and diagram.critical else None
    sections = [
        Passage("Natural frequencies", table=mode_table(found) if ringing(found).modes else None),
        Passage("Critical speeds", table=critical),
        *_pictures(model, found, diagram, response),
    ]
    return Part(title, tuple(said), filled(sections), modes_sentence(found, diagram))


def _pictures(
    model: Model, found: Modes, diagram: Campbell | None, response: UnbalanceResponse | None
) -> Iterator[Passage]:
    pairs, alone = _places(model)
    if diagram is not None:
        yield Passage(
            "Campbell diagram",
            "Natural frequencies over the speed, up to three times the rotation; a critical "
            "speed is where one meets the rotation. Bars and bands hold 95 %.",
            panels=(drawn.campbell(ringing_curves(diagram)),),
        )
    yield Passage(
        "Mode shapes",
        "Each place at the moment when the largest is at its largest, as the sum of a "
        "circle run through with the rotation and one against it.",
        panels=tuple(drawn.shapes(ringing(found), pairs, alone, _positions(model, pairs))),
    )
    if response is not None:
        yield Passage(
            "Unbalance response",
            "Amplitude that the unbalance makes, without forces at the inputs; the band "
            "holds 95 %.",
            panels=tuple(drawn.response(response, model.units)),
        )


def _places(model: Model) -> tuple[list[tuple[int, int]], list[int]]:
    """Return the places whose motion is drawn: pairs of lengths, else single coordinates."""
    names = model.coordinates
    pairs = partners(names)
    lengths = [pair for pair in pairs if model.units[names[pair[0]]] == "m"]
    if lengths:
        return lengths, []
    return ([], list(range(len(names)))) if not pairs else (pairs, [])


def _positions(model: Model, pairs: Sequence[tuple[int, int]]) -> Floats | None:
    """Return where the pairs stand along the rotor, where a drawing tells it."""
    if not isinstance(model, RotorModel):
        return None
    at = {n.coordinates[0]: n.position for n in model.rotor.nodes}
    found = [at.get(model.coordinates[x]) for x, _ in pairs]
    return None if None in found else np.array(found, dtype=float)


def modes_report(
    source: Estimate | Model,
    found: Modes,
    diagram: Campbell | None,
    notes: Sequence[str],
) -> str:
    machine = machine_of(source)
    part = part_of(machine, found, diagram)
    return render("modes.html", part=part, model=machine.model, notes=notes)


MOODS = {"zone A": "ok", "zone B": "rejected", "zone C": "not_converged", "zone D": "not_converged"}
"""How a verdict is coloured; one that is undecided is a doubt."""


def balance_report(
    found: Balance,
    centred: Sequence[Feedforward],
    model: Model,
    done: Sequence[str] = (),
) -> str:
    masses = any(each.masses for each in found.corrections)
    said = said_of(found)
    warned = [each.removeprefix("warning: ") for each in said if each.startswith("warning: ")]
    speeds = ", ".join(f"{speed * RPM:.6g}" for speed in found.speeds)
    sections = [
        Passage(
            "What to add",
            "Angles count in the rotor, from x to y, from what stands along x where the rotor "
            "angle is 0: at its mark. Taking away is adding on the other side.",
            correction_table(found),
        ),
        Passage(
            "Masses to mount",
            "The masses that come nearest to it, all planes together.",
            mass_table(found) if masses else None,
        ),
        Passage(
            "What is left",
            "The true unbalance is not the identified one: with 95 % less than this is left.",
            residual_table(found),
        ),
        Passage(
            "Inertial centring",
            "The other way to a quiet machine: the rotor turns about its own axis of inertia if "
            "these currents, a cos(phi + angle), are fed forward.",
            centring_table(centred, found.speeds[0]) if centred else None,
        ),
        Passage(
            "The planes, seen along the shaft",
            "What is to be added in each plane, as a vector. The right correction lies within the "
            "circle about its end with 95 %: no wider than its dot where the unbalance is well "
            "known. Masses stand on the rim at their angles.",
            panels=tuple(drawn.corrections(found)),
        ),
        Passage("Besides", items=tuple(each for each in said if not each.startswith("warning: "))),
    ]
    return answer(
        f"Balance at {speeds} rpm",
        balance_sentence(found),
        "rejected" if found.share > POOR or found.status != "ok" else "ok",
        sections,
        lead=f"Of the rotor {model.title or model.name}",
        steps=warned,
        model=model,
        done=done,
    )


def sensitivity_report(
    found: Sequence[AxisSensitivity], name: str, done: Sequence[str] = ()
) -> str:
    limits = ", ".join(f"{zone} below {limit:g}" for zone, limit in LIMITS.items())
    sections = [
        Passage(
            "Axis by axis",
            "The largest sensitivity of each loop, the others closed. Zones of ISO 14839-3: "
            f"{limits}, D above. Where the 95 % interval lies across a limit the zone is "
            "undecided: measure longer, or excite more.",
            sensitivity_table(found),
        ),
        Passage(
            "Sensitivity over the frequency",
            "S = E / R of each loop as it was measured, and the limits of the zones.",
            panels=tuple(drawn.loops(found, LIMITS)),
        ),
    ]
    title, mood = f"{name}: sensitivity of the loops", MOODS.get(worst_of(found), "rejected")
    lead = "After ISO 14839-3"
    return answer(title, sensitivity_sentence(found), mood, sections, lead=lead, done=done)
