"""Sensitivity of the loops of an identified plant with a controller whose response is known.

``E = (I - C P)^-1 R`` with P from commands to readings, ``P = Y (Z - B k_s X)^-1 B k_i``: Z of the
estimate at any speed, magnets by k_i and k_s, X the displacements in them. The sign of the feedback
is in C, so that ``- C P`` is L, and ``det(I + L)`` says how near the loop is to its limit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from rotorid.errors import InputError
from rotorid.estimate import Estimate
from rotorid.frozen import frozen
from rotorid.models import Model
from rotorid.record import Complexes, Floats
from rotorid.results.balancing import STEP
from rotorid.results.centring import laws_of
from rotorid.results.machine import Machine, machine_of
from rotorid.results.modes import NORMAL, finite_speed
from rotorid.results.nyquist import plant_poles, poles_on_the_right
from rotorid.results.planes import directions_of, shares_of
from rotorid.results.sensitivity import AxisSensitivity, peak_of

UNSTABLE = "the loop is not stable, whatever its sensitivity on the lines"
"""Caveat of a loop that has poles on the right."""
UNTOLD = "whether the loop is stable is not told"
"""Caveat of one whose lines do not say."""


@frozen
class LoopSensitivity:
    """Sensitivity of each loop as it follows from plant and controller.

    Parameters
    ----------
    axes : sequence of AxisSensitivity
    frequency_hz : array, shape (line,)
    return_difference : complex array, shape (line,)
        ``det(I + L)``.
    """

    axes: tuple[AxisSensitivity, ...]
    frequency_hz: Floats
    return_difference: Complexes


def loop_sensitivity(
    source: Estimate | Model,
    controller: Callable[[Floats], Complexes],
    frequency: Sequence[float] | Floats,
    *,
    sensors: Sequence[str],
    speed: float | str = 0.0,
    laws: Mapping[str, tuple[float, float]] | None = None,
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
    rows = [_row(machine, text) for text in sensors]
    omega = 2 * np.pi * hertz
    response = np.asarray(controller(omega), dtype=np.complex128)
    shape = (len(hertz), len(machine.model.inputs), len(rows))
    if response.shape != shape or len(hertz) < 2 or (np.diff(hertz) <= 0).any():
        raise InputError(
            f"a controller's response of shape {response.shape}",
            f"{shape}: lines of rising frequency, inputs, sensors",
            "give a command for each input from each sensor, 0 where there is none",
        )
    closed = partial(
        _loops, speed=turning, omega=omega, response=response, reads=np.array(rows), known=known
    )
    here, returned = closed(machine)
    slopes, peaks = _changes(machine, hertz, lambda other: closed(other)[0])
    axes = []
    top, where = peak_of(hertz, here.T)
    caveat = _caveat(omega, returned, plant_poles(*_plant(machine, turning, known)[:3]))
    if caveat == UNSTABLE:
        top = np.full(len(top), np.inf)
    for j, name in enumerate(machine.model.inputs):
        spread = float(np.linalg.norm([each[j] for each in peaks])) if peaks else 0.0
        std = np.sqrt(sum((np.abs(each[:, j]) ** 2 for each in slopes), np.zeros(len(hertz))) / 2)
        reach = NORMAL * spread
        interval = (max(float(top[j]) - reach, 0.0), float(top[j]) + reach)
        found = (here[:, j], std, float(top[j]), float(where[j]), interval, caveat)
        axes.append(AxisSensitivity(name, hertz, *found))
    return LoopSensitivity(tuple(axes), hertz, np.linalg.det(returned))


def _changes(
    machine: Machine, hertz: Floats, closed: Callable[[Machine], Complexes]
) -> tuple[list[Complexes], list[Floats]]:
    """Return how S and its peaks change by one deviation, for each direction of the plant's."""
    slopes, peaks = [], []
    for direction in [] if machine.covariance is None else machine.root.T:
        if not direction.any():
            continue
        sides = [
            closed(replace(machine, values=machine.values + s * STEP * direction)) for s in (1, -1)
        ]
        slopes.append((sides[0] - sides[1]) / (2 * STEP))
        ends = [peak_of(hertz, side.T)[0] for side in sides]
        peaks.append((ends[0] - ends[1]) / (2 * STEP))
    return slopes, peaks


def _caveat(omega: Floats, returned: Complexes, poles: Complexes) -> str:
    """Say that the loop is not stable, or why it is not told; empty where it is."""
    right = poles_on_the_right(omega, returned, poles)
    if isinstance(right, str):
        return f"{UNTOLD}, {right}"
    return UNSTABLE if right else ""


def _row(machine: Machine, text: str) -> Floats:
    found = shares_of(machine, text)
    if found is None:
        raise InputError(
            f"the sensor {text[:60]!r}",
            f"a combination of {', '.join(machine.model.coordinates[:8])}",
            "say what it reads",
            place="sensors",
        )
    return found


def _loops(
    machine: Machine,
    speed: float,
    omega: Floats,
    response: Complexes,
    reads: Floats,
    known: Mapping[str, tuple[float, float]],
) -> tuple[Complexes, Complexes]:
    """Return S_jj, (line, input), and I + L, (line, input, input)."""
    stiffness, damping, mass, gains = _plant(machine, speed, known)
    s = 1j * omega[:, None, None]
    dynamic = s**2 * mass + s * damping + stiffness
    driven = np.broadcast_to(gains + 0j, (len(omega), *gains.shape))
    plant = reads @ np.linalg.solve(dynamic, driven)
    one = np.eye(gains.shape[1])
    back = one - response @ plant
    whole = np.linalg.solve(back, np.broadcast_to(one + 0j, back.shape))
    return np.diagonal(whole, axis1=1, axis2=2).copy(), back


def _plant(
    machine: Machine, speed: float, known: Mapping[str, tuple[float, float]]
) -> tuple[Floats | Complexes, Floats | Complexes, Floats | Complexes, Floats]:
    """Return K less that of the magnets, D and M, and the forces of the commands, (row, input)."""
    stiffness, damping, mass = machine.matrices(speed)
    push, directions = machine.input_matrix(), directions_of(machine)
    values = dict(zip(machine.names, machine.values.tolist(), strict=True))
    ki, ks = np.ones(push.shape[1]), np.zeros(push.shape[1])
    for j, name in enumerate(machine.model.inputs):
        law = known.get(name, (1.0, 0.0))
        ki[j] = values.get(f"ki[{name}]", law[0])
        ks[j] = values.get(f"ks[{name}]", values.get("ks", law[1]))
    displacement = directions.forces(push)
    return stiffness - (push * ks) @ displacement.T, damping, mass, push * ki
