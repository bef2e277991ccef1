"""``rotorid export``."""

from __future__ import annotations

from pathlib import Path

from rotorid.commands import OK
from rotorid.commands.console import check_outputs, show, write
from rotorid.estimate import load_estimate
from rotorid.io.output import check_apart
from rotorid.results.export import export


def run(result: Path, target: Path) -> int:
    """Write a result for another program."""
    targets = check_outputs(target)
    estimate = load_estimate(result)
    check_apart(targets, [result])
    write((target, lambda path: export(estimate, path, ending=target.suffix)))
    show([f"{target}: {len(estimate.parameters)} parameters, {len(estimate.nuisance)} nuisance"])
    return OK
