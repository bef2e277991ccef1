"""``rotorid inspect``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rotorid.commands import OK
from rotorid.commands.console import Outputs, done
from rotorid.core.files import check_apart
from rotorid.core.notes import worst
from rotorid.core.watch import watch
from rotorid.experiment.experiment import inspect_experiment, named_files
from rotorid.report.records import inspection_page, inspection_report
from rotorid.signals.inspection import Inspection, LineInspection


def run(experiment: Path, answer: Outputs) -> int:
    targets = answer.check()
    if targets:
        check_apart(targets, named_files(experiment))
    watch("reading")
    found, told = inspect_experiment(experiment)
    page = [part for one in found for part in inspection_page(one)]
    if told:
        page = [told, *page]

    def html() -> str:
        work = done(answer.given, named_files(experiment))
        return inspection_report(experiment.name, found, told, work)

    parts = [_one(one) if isinstance(one, Inspection) else _table(one) for one in found]
    whole = {**parts[0], "verdict": worst(check for one in found for check in one.checks)}
    answer.give(page, whole if len(parts) == 1 else {**whole, "records": parts}, html)
    return OK


_LEVELS = ("name", "unit", "snr_db", "low", "high")
_SAMPLED = ("rms", "crest_factor", "coherence", "odd", "even", "orders")


def _one(one: Inspection) -> dict[str, Any]:
    periods = one.periods
    return {
        "verdict": one.verdict,
        "checks": [check.as_check for check in one.checks],
        "period_samples": None if periods is None else periods.samples,
        "periods": None if periods is None else periods.periods,
        "harmonics": None if periods is None else periods.harmonics,
        "sample_rate_hz": one.record.sample_rate,
        "speed_rad_s": one.record.speed,
        "channels": [{key: getattr(c, key) for key in (*_LEVELS, *_SAMPLED)} for c in one.channels],
    }


def _table(one: LineInspection) -> dict[str, Any]:
    """Return the same of a table, which has neither samples nor periods."""
    lines = one.lines
    return {
        "verdict": one.verdict,
        "checks": [check.as_check for check in one.checks],
        **dict.fromkeys(("period_samples", "periods", "harmonics", "sample_rate_hz")),
        "speed_rad_s": float(lines.speed[0]) if len(set(lines.speed.tolist())) == 1 else None,
        "kind": "phasors" if one.turning else "responses",
        "rows": len(lines.frequency),
        "frequency_hz": [lines.frequency.min(), lines.frequency.max()],
        "channels": [{key: getattr(c, key) for key in _LEVELS} for c in one.channels],
    }
