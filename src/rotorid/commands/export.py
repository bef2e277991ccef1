"""``rotorid export``."""

from __future__ import annotations

from pathlib import Path

from rotorid.answer.result_file import load_estimate
from rotorid.commands import OK
from rotorid.commands.console import check_outputs, show, write
from rotorid.core.files import check_apart
from rotorid.results.export import EXPORT, exported, known_ending, plant_of


def run(result: Path, target: Path, speed: str, force: bool) -> int:
    known_ending(target)
    targets = check_outputs((target, EXPORT), force=force)
    estimate = load_estimate(result)
    check_apart(targets, [result])
    write((target, lambda: exported(estimate, target, speed=speed)))
    found = f"{len(estimate.parameters)} parameters, {len(estimate.nuisance)} nuisance"
    if target.suffix.lower() in (".json", ".mat"):
        plant = plant_of(estimate, speed)
        space = f"state space of {0 if plant is None else len(plant.A)} states at {speed}"
        found = space if target.suffix.lower() == ".json" else f"{found}, {space}"
    show([f"{target}: {found}"])
    return OK
