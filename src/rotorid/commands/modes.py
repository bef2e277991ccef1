"""``rotorid modes``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.answer.estimate import Estimate
from rotorid.answer.result_file import load_estimate
from rotorid.commands import NO_ANSWER, OK
from rotorid.commands.console import Outputs, done
from rotorid.core.files import check_apart
from rotorid.core.watch import watch
from rotorid.models import Model, load_model
from rotorid.report.machines import modes_page, modes_report
from rotorid.results.critical import (
    Campbell,
    CriticalSpeed,
    campbell,
    response_of,
)
from rotorid.results.machine import machine_of
from rotorid.results.modes import Modes, finite_speed, modes


def run(
    source: str,
    speed: str,
    to: str | None,
    record: int,
    answer: Outputs,
) -> int:
    targets = answer.check()
    check_apart(targets, [Path(source)])
    read = source_of(source)
    watch("computing")
    found = modes(read, speed=speed, record=record)
    diagram = None if to is None else campbell(read, to, record=record)
    machine, turning = machine_of(read, record), finite_speed(speed)
    response = None
    if turning and machine.linear.load_terms:
        response = response_of(machine, np.array([turning]))

    def html() -> str:
        return modes_report(read, found, diagram, done(answer.given, [Path(source)]))

    page = modes_page(found, diagram, response, machine.model)
    answer.give(page, content(found, diagram), html)
    return OK if found.status in ("ok", "rejected") else NO_ANSWER


def source_of(source: str) -> Estimate | Model:
    """Read a result, or the model of that name or in that file."""
    return load_estimate(source) if source.lower().endswith(".json") else load_model(source)


_FIGURES = ("frequency_hz", "std_hz", "damping_ratio", "damping_std", "whirl", "count", "close")
_CURVES = ("whirl", "frequency_hz", "std_hz", "damping_ratio")
_CRITICAL = ("speed_rad_s", "std", "whirl", "damping_ratio")


def content(found: Modes, diagram: Campbell | None) -> dict[str, Any]:
    critical: Sequence[CriticalSpeed] = () if diagram is None else diagram.critical
    curves = None
    if diagram is not None:  # a row for each, null where it does not oscillate
        curves = {key: np.asarray(getattr(diagram, key)).T for key in _CURVES}
        curves["speed_rad_s"] = diagram.speed
    return {
        "speed_rad_s": found.speed,
        "modes": [
            {
                **{key: getattr(mode, key) for key in (*_FIGURES, "interval_hz")},
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
        "poles_at_zero": found.rigid,
        "real_poles_rad_s": found.real_poles,
        "remarks": found.remarks,
        "campbell": curves,
    }
