"""``rotorid modes``."""

from __future__ import annotations

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
from rotorid.results.critical import Campbell, UnbalanceResponse, campbell, response_of
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
    response = _response(read, finite_speed(speed), record)
    page = modes_page(found, diagram, response, machine_of(read, record).model)

    def html() -> str:
        return modes_report(read, found, diagram, done(answer.given, [Path(source)]))

    answer.give(page, content(found, diagram), html)
    return OK if found.status in ("ok", "rejected") else NO_ANSWER


def source_of(source: str) -> Estimate | Model:
    """Read a result, or the model of that name or in that file."""
    return load_estimate(source) if source.lower().endswith(".json") else load_model(source)


def _response(read: Estimate | Model, speed: float, record: int) -> UnbalanceResponse | None:
    machine = machine_of(read, record)
    if not speed or not machine.linear.load_terms:
        return None
    return response_of(machine, np.array([speed]))


_FIGURES = ("frequency_hz", "std_hz", "damping_ratio", "damping_std", "whirl", "count", "close")


def content(found: Modes, diagram: Campbell | None) -> dict[str, Any]:
    return {
        "speed_rad_s": found.speed,
        "modes": [
            {
                **{key: getattr(mode, key) for key in _FIGURES},
                "interval_hz": mode.interval_hz,
                "eigenvalue_rad_s": [mode.eigenvalue.real, mode.eigenvalue.imag],
                "shape": {
                    name: [value.real, value.imag]
                    for name, value in zip(found.coordinates, mode.shape, strict=True)
                },
            }
            for mode in found.modes
        ],
        "critical_speeds": []
        if diagram is None
        else [
            {
                "speed_rad_s": each.speed_rad_s,
                "std": each.std,
                "whirl": each.whirl,
                "damping_ratio": each.damping_ratio,
                "interval_rad_s": each.interval,
            }
            for each in diagram.critical
        ],
        "model": found.model,
        "status": found.status,
        "poles_at_zero": found.rigid,
        "real_poles_rad_s": list(found.real_poles),
        "remarks": list(found.remarks),
        "campbell": None if diagram is None else _curves(diagram),
    }


def _curves(diagram: Campbell) -> dict[str, Any]:
    """Return the curves of a Campbell diagram; null where a mode does not oscillate."""

    def rows(values: Any) -> list[list[float | None]]:
        return [[None if v != v else v for v in row] for row in values.T.tolist()]

    return {
        "speed_rad_s": diagram.speed.tolist(),
        "whirl": list(diagram.whirl),
        "frequency_hz": rows(diagram.frequency_hz),
        "std_hz": rows(diagram.std_hz),
        "damping_ratio": rows(diagram.damping_ratio),
    }
