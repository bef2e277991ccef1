"""Inertial centring: the current that lets the rotor turn about its own axis of inertia.

Without force on the rotation's line the rotor moves as ``x = Re(X exp(i phi))``, X of the unbalance
alone. A magnet with ``F = k_i i + k_s x`` exerts none there with ``i = - (k_s / k_i) x``, which is
fed forward in place of what the controller would answer with.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from pydantic import ValidationError

from rotorid.answer.estimate import Estimate
from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.toml import table_within
from rotorid.core.values import Complexes
from rotorid.force.entry import LawEntry, law_keys
from rotorid.force.laws import Differential, Linear
from rotorid.results.balancing import unbalanced
from rotorid.results.critical import amplitude_std
from rotorid.results.machine import Machine, machine_of
from rotorid.results.modes import finite_speed
from rotorid.results.planes import directions_of


@frozen
class Feedforward:
    """What one axis needs so that its magnet exerts no force on the rotation's line.

    The current is ``amplitude_ampere cos(phi + angle_rad)``, phi the rotor angle.
    """

    input: str
    # amplitude of the rotor at the magnet, turning about its axis of inertia
    motion_m: float
    motion_std_m: float | None
    # ``None`` where ki and ks are not known, deviations where there are none
    amplitude_ampere: float | None
    std_ampere: float | None
    angle_rad: float | None
    angle_std_rad: float | None


def centring(
    estimate: Estimate,
    speed: float | str,
    *,
    laws: Mapping[str, tuple[float, float]] | None = None,
    record: int = 0,
) -> list[Feedforward]:
    """Return the feedforward of inertial centring for each input that is a force, with deviations.

    ``i = - (k_s / k_i) x`` on the rotation's line, x the motion of the rotor without forces there.
    Constants of the force laws are those of the estimate where it found them, else those of its
    experiment.

    Parameters
    ----------
    estimate : Estimate
    speed : float or str
        rad/s, or a text with unit.
    laws : mapping of str to (ki, ks), optional
        N/A and N/m of each input, in place of the experiment's.
    record : int
        Whose values are taken of what every record has to itself.

    Returns
    -------
    list of Feedforward

    Raises
    ------
    InputError
        For an estimate that does not determine the unbalance, and at a speed of zero.

    Examples
    --------
    >>> import rotorid as rid
    >>> model = rid.load_model("rigid")
    >>> found = [rid.Value(p.name, p.unit, p.nominal, 0.0) for p in model.parameters]
    >>> estimate = rid.Estimate("rigid", "ml", "ok", tuple(found))
    >>> first = rid.centring(estimate, "6000 rpm", laws={"F_xa": (120.0, 3e5)})[0]
    >>> f"{first.input}: {first.motion_m * 1e6:.1f} um, {1e3 * first.amplitude_ampere:.1f} mA"
    'F_xa: 5.1 um, 12.7 mA'
    """
    turning = finite_speed(speed)
    if turning == 0:
        raise InputError("a speed of 0", "the speed of the rotor", "give it", place="speed")
    machine = unbalanced(machine_of(estimate, record))
    known = laws_of(estimate) | dict(laws or {})
    forces = [name for name in machine.model.inputs if machine.model.units[name] == "N"]
    answer = partial(_answers, speed=turning, forces=forces, known=known)
    here = answer(machine)
    slopes = machine.changes(answer)
    return [
        _feedforward(name, here[j], slopes[:, j], machine.covariance is not None)
        for j, name in enumerate(forces)
    ]


def laws_of(estimate: Estimate) -> dict[str, tuple[float, float]]:
    """Return ki and ks of each input whose law stands in the experiment file of an estimate."""
    text = "" if estimate.provenance is None else estimate.provenance.experiment
    channels = table_within(text).get("channels")
    found = {}
    for name, entry in channels.items() if isinstance(channels, dict) else ():
        if not isinstance(entry, dict) or entry.get("law") not in ("linear", "differential"):
            continue
        try:
            law = LawEntry.model_validate({k: entry[k] for k in law_keys() if k in entry})
            built = law.build()
        except (ValidationError, ValueError):
            continue
        if isinstance(built, Linear | Differential):
            slope = built.linearize()
            found[name] = (slope.ki, slope.ks)
    return found


def _answers(
    machine: Machine, speed: float, forces: Sequence[str], known: Mapping[str, tuple[float, float]]
) -> Complexes:
    """Return motion and current of each force, (force, 2), amplitudes of exp(i phi), or NaN."""
    motion, _ = machine.response(speed)
    directions, inputs = directions_of(machine), machine.input_matrix()
    found = np.zeros((len(forces), 2), dtype=np.complex128)
    for j, name in enumerate(forces):
        acts = directions.forces(inputs[:, machine.model.inputs.index(name)])
        directions.check(acts)
        there = complex(acts @ motion)
        ki, ks = machine.law(name, known)
        found[j] = there, -ks / ki * there
    return found


def _feedforward(name: str, answer: Complexes, slopes: Complexes, known: bool) -> Feedforward:
    motion, current = (complex(each) for each in answer)
    std = [float(amplitude_std(answer[k], slopes[:, k])) if known else None for k in (0, 1)]
    if not np.isfinite(current):
        return Feedforward(name, abs(motion), std[0], None, None, None, None)
    turned = None
    if known and abs(current) > 0:
        across = (slopes[:, 1] * np.conj(current)).imag / abs(current) ** 2
        turned = min(float(np.linalg.norm(across)), np.pi)
    angle = float(np.angle(current))
    return Feedforward(name, abs(motion), std[0], abs(current), std[1], angle, turned)
