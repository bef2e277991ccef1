"""The pages of a balance and of the sensitivity of loops."""

from __future__ import annotations

from collections.abc import Sequence

from rotorid.models import Model
from rotorid.plots import answers as drawn
from rotorid.report import balance_page as balanced
from rotorid.report.html import pictures, render
from rotorid.report.sensitivity_page import sensitivity_table, sentence_of
from rotorid.results.balancing import POOR, Balance
from rotorid.results.centring import Feedforward
from rotorid.results.sensitivity import LIMITS, AxisSensitivity, worst_of
from rotorid.tables import Table

RPM = balanced.RPM
MOODS = {"zone A": "ok", "zone B": "rejected", "zone C": "not_converged", "zone D": "not_converged"}
"""How a verdict is coloured; one that is undecided is a doubt."""


def balance_report(
    found: Balance,
    centred: Sequence[Feedforward],
    model: Model,
    done: Sequence[str] = (),
) -> str:
    """Return the page of a balance: what to mount, where, and what is left then."""
    tables: list[tuple[str, str, Table]] = [
        (
            "What to add",
            "Angles count in the rotor, from x to y, from what stands along x where the rotor "
            "angle is 0: at its mark. Taking away is adding on the other side.",
            balanced.correction_table(found),
        )
    ]
    if any(each.masses for each in found.corrections):
        told = "The masses that come nearest to it, all planes together."
        tables.append(("Masses to mount", told, balanced.mass_table(found)))
    told = "The true unbalance is not the identified one: with 95 % less than this is left."
    tables.append(("What is left", told, balanced.residual_table(found)))
    if centred:
        told = (
            "The other way to a quiet machine: the rotor turns about its own axis of inertia if "
            "these currents, a cos(phi + angle), are fed forward."
        )
        table = balanced.centring_table(centred, found.speeds[0])
        tables.append(("Inertial centring", told, table))
    said = balanced.said_of(found)
    warned = [each.removeprefix("warning: ") for each in said if each.startswith("warning: ")]
    speeds = ", ".join(f"{speed * RPM:.6g}" for speed in found.speeds)
    picture = (
        "The planes, seen along the shaft",
        "What is to be added in each plane, as a vector. The right correction lies within the "
        "circle about its end with 95 %: no wider than its dot where the unbalance is well known. "
        "Masses stand on the rim at their angles.",
        drawn.corrections(found),
    )
    return render(
        "answer.html",
        title=f"Balance at {speeds} rpm",
        lead=f"Of the rotor {model.title or model.name}",
        verdict=balanced.sentence_of(found),
        mood="rejected" if found.share > POOR or found.status != "ok" else "ok",
        steps=warned,
        tables=tables,
        pictures=list(pictures(picture)),
        notes=[each for each in said if not each.startswith("warning: ")],
        model=model,
        done=done,
    )


def sensitivity_report(
    found: Sequence[AxisSensitivity], name: str, done: Sequence[str] = ()
) -> str:
    """Return the page of the sensitivity of loops: zone, peaks, curves."""
    limits = ", ".join(f"{zone} below {limit:g}" for zone, limit in LIMITS.items())
    table = (
        "Axis by axis",
        f"The largest sensitivity of each loop, the others closed. Zones of ISO 14839-3: {limits}, "
        "D above. Where the 95 % interval lies across a limit the zone is undecided: measure "
        "longer, or excite more.",
        sensitivity_table(found),
    )
    picture = (
        "Sensitivity over the frequency",
        "S = E / R of each loop as it was measured, and the limits of the zones.",
        drawn.loops(found, LIMITS),
    )
    return render(
        "answer.html",
        title=f"{name}: sensitivity of the loops",
        lead="After ISO 14839-3",
        verdict=sentence_of(found),
        mood=MOODS.get(worst_of(found), "rejected"),
        steps=(),
        tables=[table],
        pictures=list(pictures(picture)),
        notes=(),
        model=None,
        done=done,
    )
