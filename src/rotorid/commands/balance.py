"""``rotorid balance``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rotorid.answer.estimate import Estimate
from rotorid.answer.result_file import load_estimate
from rotorid.commands import NO_ANSWER, OK
from rotorid.commands.console import Outputs, done
from rotorid.core.errors import InputError, naming
from rotorid.core.files import check_apart
from rotorid.core.toml import table_within
from rotorid.core.watch import watch
from rotorid.report.machines import balance_page, balance_report
from rotorid.results.balancing import Balance, Feedforward, balance, centring
from rotorid.results.machine import own_model


def run(
    result: Path,
    planes: Sequence[str],
    more: Sequence[str],
    speed: Sequence[str],
    at: Sequence[str],
    radius: str | None,
    masses: str | None,
    holes: int | None,
    record: int,
    answer: Outputs,
) -> int:
    targets = answer.check()
    check_apart(targets, [result])
    estimate = load_estimate(result)
    speeds = list(speed) or speeds_of(estimate)
    kit = [part.strip() for part in masses.split(",")] if masses else []
    with naming(str(result)):
        watch("computing")
        found = balance(
            estimate,
            [*planes, *more],
            speeds,
            at=dict(map(_weighed, at)) or None,
            radius=radius,
            masses=kit,
            holes=holes,
            record=record,
        )
        centred = centring(estimate, speeds[0], record=record)

    def html() -> str:
        return balance_report(found, centred, own_model(estimate), done(answer.given, [result]))

    answer.give(balance_page(found, centred), content(found, centred), html)
    return OK if found.status in ("ok", "rejected") else NO_ANSWER


def _weighed(text: str) -> tuple[str, float]:
    """Split ``x2=2`` into a combination of coordinates and its weight."""
    name, equals, weight = text.rpartition("=")
    if not equals:
        return text.strip(), 1.0
    try:
        return name.strip(), float(weight)
    except ValueError:
        raise InputError(
            f"{text[:60]!r}", "a coordinate, or coordinate=weight", "write x2=2", place="at"
        ) from None


STEADY = 1e-3
"""Relative difference between the lowest and highest speed of a record at one speed."""


def speeds_of(estimate: Estimate) -> list[str]:
    """Return the speeds of the records: as the experiment states them, else as measured."""
    text = "" if estimate.provenance is None else estimate.provenance.experiment
    records = table_within(text).get("records")
    entries = records if isinstance(records, list) else []
    found = [r["speed"] for r in entries if isinstance(r, dict) and "speed" in r]
    speeds = list(dict.fromkeys(each for each in found if isinstance(each, str)))
    seen = estimate.evidence.records if estimate.evidence else ()
    for low, high in (one.speed_rad_s for one in seen if not speeds and len(one.speed_rad_s) == 2):
        if abs(high - low) <= STEADY * abs(high) and high:  # by an encoder or a keyphasor
            found.append(f"{(low + high) / 2:.6g} rad/s")
    speeds = list(dict.fromkeys(each for each in found if isinstance(each, str)))
    if not speeds:
        raise InputError(
            "no speed, and none in the result",
            "the speed at which the rotor is to run quietly",
            'give it: --speed "8400 rpm"',
            place="speed",
        )
    return speeds


def content(found: Balance, centred: Sequence[Feedforward]) -> dict[str, Any]:
    return {
        "corrections": [
            {**vars(each), "masses": [{"mass_kg": m, "angle_rad": a} for m, a in each.masses]}
            for each in found.corrections
        ],
        "residual": found.residual,
        "speeds_rad_s": found.speeds,
        "rotor_mass_kg": found.rotor_mass,
        "grade_mm_s": found.grade_mm_s,
        "share_left": found.share,
        "covariance_kg2_m2": found.covariance,
        "feedforward": centred,
        "model": found.model,
        "status": found.status,
        "remarks": found.remarks,
    }
