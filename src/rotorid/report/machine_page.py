"""The levitated machine of the demonstration: what came out, beside the truth."""

from __future__ import annotations

import math

from rotorid.demo.machine import MASS, STATED, MachineResult
from rotorid.report.verdict import verdict_of
from rotorid.tables import Page, Table, table


def machine_page(result: MachineResult) -> Page:
    """Return what was done, in sentences, and every quantity beside its truth."""
    periods, seconds = result.periods, result.periods.periods / result.periods.fundamental
    fixed = [f"{v.name} = {v.value:g} {v.unit}" for v in result.estimate.parameters if v.fixed]
    return [
        "A levitated rotor from its bearings: four position sensors, four coil currents",
        f"simulated: {seconds:g} s at {periods.sample_rate:g} Hz, "
        f"{periods.speed * 30 / math.pi:.0f} rpm, under a controller",
        f"inspected: {result.inspection.verdict}. {result.inspection.sentence}",
        f"known beforehand: {', '.join(fixed)}, {MASS} by a scale; the constants of the bearings "
        f"were stated {100 * (1 - STATED):.0f} % too small, and are unknown",
        f"identified: {verdict_of(result.estimate).sentence}",
        beside_the_truth(result),
    ]


def beside_the_truth(result: MachineResult) -> Table:
    """Return each free quantity, true and found, and its error in deviations."""
    rows = []
    for value in result.estimate.free:
        if value.name not in result.truth or not value.std:
            continue
        truth = result.truth[value.name]
        off = (value.value - truth) / value.std
        size = f"{100 * value.std / abs(truth):.2g}"
        unit = "" if value.unit == "1" else value.unit
        rows.append((value.name, f"{truth:.6g}", f"{value.value:.6g}", size, f"{off:+.1f}", unit))
    return table(("parameter", "true", "found", "std %", "off by std", "unit"), rows)
