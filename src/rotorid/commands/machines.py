"""``rotorid modes`` and ``rotorid balance``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import copysign
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.answer.estimate import Estimate
from rotorid.answer.parts import under
from rotorid.answer.result_file import load_estimate
from rotorid.commands import NO_ANSWER, OK, REJECTED
from rotorid.commands.console import Outputs, done
from rotorid.core.errors import InputError, naming
from rotorid.core.files import check_apart
from rotorid.core.toml import table_within
from rotorid.core.units import finite_speed
from rotorid.core.watch import watch
from rotorid.models import Model, load_model
from rotorid.report.machines import (
    assumed_by,
    balance_page,
    balance_report,
    modes_page,
    modes_report,
)
from rotorid.results.balancing import Balance, Feedforward, centring
from rotorid.results.balancing import balance as find_balance
from rotorid.results.machine import machine_of, own_model
from rotorid.results.modes import (
    Campbell,
    CriticalSpeed,
    Modes,
    UnbalanceResponse,
    campbell,
    response_of,
)
from rotorid.results.modes import modes as find_modes


def modes(
    source: str, speed: str, to: str | None, record: int, strict: bool, answer: Outputs
) -> int:
    targets = answer.check()
    check_apart(targets, [Path(source)])
    read = source_of(source)
    watch("computing")
    found = find_modes(read, speed=speed, record=record)
    diagram = None if to is None else campbell(read, to, record=record)
    machine, turning = machine_of(read, record), finite_speed(speed)
    response = None
    if turning and machine.linear.load_terms:
        response = response_of(machine, np.array([turning]))

    def html() -> str:
        return modes_report(read, found, diagram, done(answer.given, [Path(source)]))

    page = modes_page(found, diagram, response)
    content = modes_content(found, diagram, response)
    answer.give(page, content, html)
    return _code(content, strict)


def _code(content: Mapping[str, Any], strict: bool) -> int:
    if strict and content["verdict"] != "ok":
        return REJECTED
    return OK if content["status"] in ("ok", "rejected") else NO_ANSWER


def source_of(source: str) -> Estimate | Model:
    return load_estimate(source) if source.lower().endswith(".json") else load_model(source)


_ASSUMED = ("std_assumed_hz", "damping_std_assumed")
_FIGURES = ("frequency_hz", "std_hz", "damping_ratio", "damping_std", "whirl", "count", "close")
_CURVES = ("whirl", "frequency_hz", "std_hz", "std_assumed_hz", "damping_ratio")
_CRITICAL = ("speed_rad_s", "std", "std_assumed", "whirl", "damping_ratio")


def modes_content(
    found: Modes, diagram: Campbell | None, response: UnbalanceResponse | None
) -> dict[str, Any]:
    critical: Sequence[CriticalSpeed] = () if diagram is None else diagram.critical
    notes = assumed_by(found, diagram, response)
    curves = None
    if diagram is not None:  # a row for each, null where it does not oscillate
        curves = {key: np.asarray(getattr(diagram, key)).T for key in _CURVES}
        curves["speed_rad_s"] = diagram.speed
    return {
        "speed_rad_s": found.speed,
        "modes": [
            {
                **{key: getattr(mode, key) for key in (*_FIGURES, *_ASSUMED, "interval_hz")},
                "eigenvalue_rad_s": mode.eigenvalue,
                "shape": dict(zip(found.coordinates, mode.shape, strict=True)),
            }
            for mode in found.modes
        ],
        "critical_speeds": [
            {
                **{key: getattr(each, key) for key in _CRITICAL},
                "interval_rad_s": each.interval,
            }
            for each in critical
        ],
        "model": found.model,
        "status": found.status,
        "verdict": under(found.verdict, notes),
        "notes": notes,
        "poles_at_zero": found.rigid,
        "real_poles_rad_s": found.real_poles,
        "remarks": found.remarks,
        "campbell": curves,
    }


def balance(
    result: Path,
    planes: Sequence[str],
    more: Sequence[str],
    speed: Sequence[str],
    at: Sequence[str],
    radius: str | None,
    masses: str | None,
    holes: int | None,
    record: int,
    strict: bool,
    answer: Outputs,
) -> int:
    targets = answer.check()
    check_apart(targets, [result])
    estimate = load_estimate(result)
    speeds = list(speed) or speeds_of(estimate)
    kit = [part.strip() for part in masses.split(",")] if masses else []
    with naming(str(result)):
        watch("computing")
        found = find_balance(
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

    content = balance_content(found, centred)
    answer.give(balance_page(found, centred), content, html)
    return _code(content, strict)


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


STEADY = 1e-3  # relative difference between the lowest and highest speed of a record at one speed


def speeds_of(estimate: Estimate) -> list[str]:
    """Return the speeds of the records: as the experiment states them, else as measured."""
    text = "" if estimate.provenance is None else estimate.provenance.experiment
    entries = table_within(text).get("records")
    records = [r for r in entries if isinstance(r, dict)] if isinstance(entries, list) else []
    stated = [r["speed"] for r in records if isinstance(r.get("speed"), str)]
    seen = estimate.evidence.records if estimate.evidence else ()
    measured = list[str]()
    for one in (one for one in seen if len(one.speed_rad_s) == 2):
        low, high = one.speed_rad_s
        if high and abs(high - low) <= STEADY * abs(high):  # by an encoder or a keyphasor
            measured.append(f"{(low + high) / 2:.6g} rad/s")
        elif one.kind == "phasors":
            measured += [f"{copysign(f, low):.6g} Hz" for f in one.frequency_hz]
    speeds = list(dict.fromkeys(stated or measured))
    if not speeds:
        expected = "the speed at which the rotor is to run quietly"
        cure = 'give it: --speed "8400 rpm"'
        raise InputError("no speed, and none in the result", expected, cure, place="speed")
    return speeds


def balance_content(found: Balance, centred: Sequence[Feedforward]) -> dict[str, Any]:
    return {
        "corrections": [
            {**vars(each), "masses": [{"mass_kg": m, "angle_rad": a} for m, a in each.masses]}
            for each in found.corrections
        ],
        "residual": found.residual,
        "speeds_rad_s": found.speeds,
        "rotor_mass_kg": found.rotor_mass,
        "grade_mm_s": found.grade_mm_s,
        "grade_before_mm_s": found.grade_before_mm_s,
        "grade_mounted_mm_s": found.grade_mounted_mm_s,
        "share_left": found.share,
        "covariance_kg2_m2": found.covariance,
        "feedforward": centred,
        "model": found.model,
        "status": found.status,
        "verdict": found.verdict,
        "notes": found.notes,
        "remarks": found.remarks,
    }
