"""Predicted sensitivity and stability of control loops (docs/sensitivity.md).

The closed loop's poles are the zeros of ``D = det(I + L) prod (s - p)``, p those of the plant.
From infinity down to 0 the angle of D comes back to where it began if no zero lies on the right;
each one there adds pi, each pole of the controller at 0 (an integrator) takes pi/2, and the slope
of the size of D at the first lines tells how many there are. The controller by itself is stable.
``L = - C P``, ``P = Y (Z - B k_s X)^-1 B k_i`` from commands to readings, X the displacements.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from rotorid.answer.estimate import Estimate
from rotorid.core.distributions import HALF_WIDTH
from rotorid.core.errors import InputError
from rotorid.core.notes import Note
from rotorid.core.units import finite_speed
from rotorid.core.values import Complexes, Floats, Result, frozen
from rotorid.models import Model
from rotorid.models.modal import poles_of
from rotorid.results.machine import (
    Laws,
    Machine,
    directions_of,
    laws_of,
    machine_of,
    require_shares,
)
from rotorid.results.sensitivity import AxisSensitivity
from rotorid.results.sensitivity_peak import peak_of

COARSE = np.deg2rad(100.0)
"""Turn of D from line to line from which on its sense is not told: a pole passes between them."""
QUIET = 0.8
"""Gain at the last line (the largest eigenvalue of L) above which the loop still acts beyond it."""
WHOLE = 0.3
"""Distance from a whole number of poles above which the first line lies too high to tell."""
AXIS = 1e-9
"""Share of its size by which a plant's pole left or right of the axis is on it: rounding."""


def poles_on_the_right(omega: Floats, returned: Complexes, poles: Complexes) -> int | str:
    """Return how many poles of the closed loop are unstable, or why the lines do not tell.

    `returned` is ``I + L``, (line, loop, loop), on rising lines; `poles` are those of the plant.
    """
    kept = omega > 0
    omega, returned = omega[kept], returned[kept]
    away = 1j * omega[:, None] - poles
    if len(omega) < 2 or not np.isfinite(returned).all() or not away.all():
        return "its lines are too few, or one is on a pole of the plant"
    gain = np.abs(np.linalg.eigvals(returned[-1] - np.eye(returned.shape[1]))).max()
    if gain > QUIET:
        return "the loop still acts at its end: widen the band"
    difference = np.linalg.det(returned)
    unit = away / np.abs(away)
    ratio = difference[1:] / difference[:-1] * np.prod(unit[1:] / unit[:-1], axis=1)
    turns = np.angle(ratio)
    if np.abs(turns).max() > COARSE:
        return "the lines are too far apart: take them closer"
    angle = np.angle(difference[-1]) + _from_above(away[-1]).sum() - turns.sum()
    first, second = (np.log(abs(difference[k])) + np.log(np.abs(away[k])).sum() for k in (0, 1))
    order = (first - second) / np.log(omega[1] / omega[0])  # of a pole at 0, where there is one
    count = float(angle / np.pi + order / 2)
    whole = round(count)
    if abs(count - whole) > WHOLE or whole < 0:
        return "begin the band lower"
    return whole


def _from_above(away: Complexes) -> Floats:
    """Return the angles of ``i omega - p``, followed from a quarter turn at infinity."""
    right = away.real < -AXIS * np.abs(away)  # of a pole on the right: past half a turn
    angle = np.angle(np.where(np.abs(away.real) < AXIS * np.abs(away), 1j * away.imag, away))
    return np.asarray(np.where(right, np.mod(angle, 2 * np.pi), angle))


UNSTABLE = "the loop is not stable, whatever its sensitivity on the lines"
"""Caveat of a loop that has poles on the right."""
UNTOLD = "whether the loop is stable is not told"
"""Caveat of one whose lines do not say."""


@frozen
class LoopSensitivity(Result):
    axes: tuple[AxisSensitivity, ...]
    frequency_hz: Floats  # (line,)
    return_difference: Complexes  # (line,): ``det(I + L)``
    # (axis,): how far each peak may move if what is assumed is wrong; NaN at the speeds of records
    peak_std_assumed: Floats
    notes: tuple[Note, ...]


def loop_sensitivity(
    source: Estimate | Model,
    controller: Callable[[Floats], Complexes],
    frequency: Sequence[float] | Floats,
    *,
    sensors: Sequence[str],
    speed: float | str = 0.0,
    laws: Laws | None = None,
    record: int = 0,
) -> LoopSensitivity:
    """Return the sensitivity of each loop of an identified plant, at any speed, with deviations.

    ``S = (I - C P)^-1``. The controller is taken as known, and as stable by itself; deviations are
    those of the plant. Where the loop is not stable, which the turns of ``det(I + L)`` over the
    lines tell, the peak is infinite and the zone D; where they do not tell, a caveat says why.

    Parameters
    ----------
    source : Estimate or Model
    controller : callable
        From omega in rad/s, (line,), to the response from readings to commands, (line, input,
        sensor), with its sign, its hold and its delays: what was measured, interpolated, or a
        formula.
    frequency : array, shape (line,)
        Hz, increasing, as fine as peaks are to be found; from below the slowest pole of the loop,
        for what is slower than the first line is not seen.
    sensors : sequence of str
        What the controller reads, as combinations of coordinates.
    speed : float or str
        rad/s, or a text with unit.
    laws : mapping of str to (ki, ks), optional
        N/A and N/m of the magnet at each input, in place of those of the estimate or its
        experiment; an input without them is commanded as a force.
    record : int
        Whose values are taken of what every record has to itself.

    Returns
    -------
    LoopSensitivity

    Raises
    ------
    InputError
        For sensors that are no combination of coordinates, a response of another shape, and as
        `rid.modes`.

    Examples
    --------
    >>> import numpy as np, rotorid as rid
    >>> damper = lambda omega: -(1e6 + 3e3j * omega)[:, None, None] * np.eye(2)
    >>> found = rid.loop_sensitivity(rid.load_model("jeffcott"), damper, np.arange(1.0, 2000.0),
    ...                              sensors=["x", "y"])
    >>> [axis.verdict for axis in found.axes]
    ['zone A', 'zone A']
    """
    machine, turning = machine_of(source, record), finite_speed(speed)
    hertz = np.asarray(frequency, dtype=float)
    known = ({} if isinstance(source, Model) else laws_of(source)) | dict(laws or {})
    rows = [require_shares(machine, "sensor", text, "say what it reads") for text in sensors]
    omega = 2 * np.pi * hertz
    response = np.asarray(controller(omega), dtype=np.complex128)
    shape = (len(hertz), len(machine.model.inputs), len(rows))
    if response.shape != shape or len(hertz) < 2 or (np.diff(hertz) <= 0).any():
        expected = f"{shape}: lines of rising frequency, inputs, sensors"
        cure = "give a command for each input from each sensor, 0 where there is none"
        raise InputError(f"a controller's response of shape {response.shape}", expected, cure)
    closed = partial(
        _loops, speed=turning, omega=omega, response=response, reads=np.array(rows), known=known
    )
    here, returned = closed(machine)

    def lines_and_peaks(other: Machine) -> Complexes:
        found, _ = closed(other)
        return np.vstack([found, [peak_of(hertz, column)[0] for column in found.T]])

    changes = machine.changes(lines_and_peaks)
    deviations = np.linalg.norm(changes, axis=0)
    axes = []
    top, where, _ = np.array([peak_of(hertz, column) for column in here.T]).T
    stiffness, damping, mass, _ = _plant(machine, turning, known)
    right = poles_on_the_right(omega, returned, poles_of(mass, damping, stiffness))
    caveat = f"{UNTOLD}, {right}" if isinstance(right, str) else UNSTABLE if right else ""
    if caveat == UNSTABLE:
        top = np.full(len(top), np.inf)
    for j, name in enumerate(machine.model.inputs):
        std = deviations[:-1, j] / np.sqrt(2)
        reach = HALF_WIDTH * float(deviations[-1, j])
        interval = (max(float(top[j]) - reach, 0.0), float(top[j]) + reach)
        found = (here[:, j], std, float(top[j]), float(where[j]), interval, caveat)
        axes.append(AxisSensitivity(name, hertz, *found))
    names = [f"the peak of {name}" for name in machine.model.inputs]
    assumed, notes = machine.assumed_of(
        turning, names, deviations[-1], lambda at: lines_and_peaks(at)[-1]
    )
    return LoopSensitivity(tuple(axes), hertz, np.linalg.det(returned), assumed, tuple(notes))


def _loops(
    machine: Machine, speed: float, omega: Floats, response: Complexes, reads: Floats, known: Laws
) -> tuple[Complexes, Complexes]:
    """Return S_jj, (line, input), and I + L, (line, input, input)."""
    plant = plant_response(machine, speed, omega, reads, known)
    one = np.eye(plant.shape[2])
    back = one - response @ plant
    whole = np.linalg.solve(back, np.broadcast_to(one + 0j, back.shape))
    return np.diagonal(whole, axis1=1, axis2=2).copy(), back


def plant_response(
    machine: Machine, speed: float, omega: Floats, reads: Floats, known: Laws
) -> Complexes:
    """Return what is read of each command, (line, reading, input)."""
    stiffness, damping, mass, gains = _plant(machine, speed, known)
    s = 1j * omega[:, None, None]
    dynamic = s**2 * mass + s * damping + stiffness
    driven = np.broadcast_to(gains + 0j, (len(omega), *gains.shape))
    return np.asarray(reads @ np.linalg.solve(dynamic, driven))


def _plant(
    machine: Machine, speed: float, known: Laws
) -> tuple[Floats | Complexes, Floats | Complexes, Floats | Complexes, Floats]:
    """Return K less that of the magnets, D and M, and the forces of the commands, (row, input)."""
    stiffness, damping, mass = machine.matrices(speed)
    push, directions = machine.input_matrix(), directions_of(machine)
    inputs = machine.model.inputs
    known = dict.fromkeys(inputs, (1.0, 0.0)) | dict(known)  # commanded as a force, unless told
    ki, ks = np.array([machine.law(name, known) for name in inputs]).reshape(-1, 2).T
    displacement = directions.forces(push)
    return stiffness - (push * ks) @ displacement.T, damping, mass, push * ki
