"""What is to be mounted where, what is left, and the feedforward of centring, as tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.results.balancing import POOR, Balance
from rotorid.results.centring import Feedforward
from rotorid.tables import Page, Table, table

GMM = 1e6
"""g mm in a kg m."""
RPM = 30 / np.pi


def balance_page(found: Balance, centred: Sequence[Feedforward]) -> Page:
    """Return the page of a balance."""
    speeds = ", ".join(f"{speed * RPM:.6g}" for speed in found.speeds)
    page: list[str | Table] = [
        f"{found.model} at {speeds} rpm: add in each plane, angles in the rotor from x to y, "
        "counted from what stands along x at the rotor angle 0",
        correction_table(found),
    ]
    if any(each.masses for each in found.corrections):
        page.append(mass_table(found))
    page.append(residual_table(found))
    page += said_of(found)
    if centred:
        page.append(centring_table(centred, found.speeds[0]))
    return page


def sentence_of(found: Balance) -> str:
    """Return what a balance comes to."""
    if found.share > POOR:
        return (
            f"These planes cannot do away with the unbalance: {100 * found.share:.2g} % of the "
            "response is left."
        )
    if found.covariance is None:
        return "What to add is computed; the result states no deviations, so what is left is open."
    if found.grade_mm_s is not None and found.rotor_mass is not None:
        return (
            f"Balanced with this to less than G {found.grade_mm_s:.2g} mm/s (ISO 21940-11), all "
            "planes together, with 95 %."
        )
    most = max(each.unbalance_kg_m or 0.0 for each in found.residual)
    return f"With this less than {GMM * most:.2g} g mm is left in any plane, with 95 %."


def correction_table(found: Balance) -> Table:
    """Return a row per plane: what to add."""
    rows = [
        (
            each.plane,
            f"{each.unbalance_kg_m * GMM:.5g}",
            _std(each.std_kg_m, GMM),
            f"{np.degrees(each.angle_rad):.1f}",
            _std(each.angle_std_rad, 180 / np.pi),
        )
        for each in found.corrections
    ]
    return table(("correction", "g mm", "std", "at deg", "std"), rows)


def mass_table(found: Balance) -> Table:
    """Return a row per mass to be mounted."""
    rows = [
        (each.plane, f"{1e3 * mass:.4g}", f"{np.degrees(angle) % 360:.1f}")
        for each in found.corrections
        for mass, angle in each.masses
    ]
    return table(("mount in plane", "g", "at deg"), rows)


def residual_table(found: Balance) -> Table:
    """Return a row per plane: what is left."""
    rows = [
        (
            each.plane,
            "-" if each.unbalance_kg_m is None else f"{each.unbalance_kg_m * GMM:.4g}",
            _std(each.std_kg_m, GMM),
            "-" if each.grade_mm_s is None else f"{each.grade_mm_s:.3g}",
        )
        for each in found.residual
    ]
    return table(("left, with 95 %", "less than g mm", "std", "grade in mm/s"), rows)


def said_of(found: Balance) -> list[str]:
    """Return what is to be said besides the tables."""
    said = list(found.remarks)
    if found.grade_mm_s is not None and found.rotor_mass is not None:
        said.append(
            f"grade of all planes together: below G {found.grade_mm_s:.3g} mm/s "
            f"(rotor of {found.rotor_mass:.4g} kg, ISO 21940-11)"
        )
    if found.covariance is None:
        said.append("the result states no deviations: what is left beyond the masses is not known")
    said.append(f"{100 * found.share:.2g} % of the response is left if the values are right")
    if found.share > POOR:
        said.append(
            "warning: these planes cannot do away with it; add a plane, or weigh with --at what "
            "has to be quiet"
        )
    return said


def centring_table(found: Sequence[Feedforward], speed: float) -> Table:
    """Return a row per axis: what to feed forward."""
    known = any(each.amplitude_ampere is not None for each in found)
    rows = []
    for each in found:
        row = [each.input, f"{1e6 * each.motion_m:.4g}", _std(each.motion_std_m, 1e6)]
        if known:
            row += ["-" if (a := each.amplitude_ampere) is None else f"{1e3 * a:.4g}"]
            row += [_std(each.std_ampere, 1e3)]
            row += ["-" if (b := each.angle_rad) is None else f"{np.degrees(b):.1f}"]
            row += [_std(each.angle_std_rad, 180 / np.pi)]
        rows.append(tuple(row))
    headings = [f"inertial centring at {speed * RPM:.6g} rpm", "motion in um", "std"]
    if known:
        headings += ["feed forward mA", "std", "at deg", "std"]
    return table(tuple(headings), rows)


def _std(value: float | None, factor: float) -> str:
    return "-" if value is None else f"{factor * value:.2g}"
