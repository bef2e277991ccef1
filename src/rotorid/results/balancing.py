"""The two ways to a quiet rotor (docs/balancing.md): correction masses, and inertial centring.

Notation: ``H(Omega) = Z^-1`` without forces at the inputs, g the identified unbalance, P the
planes, A what is weighed. The correction W minimizes the sum over the speeds of
``|A H (g + Omega^2 P W)|^2``. An unbalance U (kg m, complex), a mass at the angle ``arg U`` in the
rotor, has the force ``Re(U Omega^2 exp(i phi))`` in x and ``Re(-i U Omega^2 exp(i phi))`` in y.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import partial
from itertools import product

import numpy as np

from rotorid.answer.estimate import Estimate
from rotorid.core.distributions import bound_of_length
from rotorid.core.errors import InputError, WrongTypeError, require_positive
from rotorid.core.notes import Note
from rotorid.core.units import finite_speed, quantity
from rotorid.core.values import Complexes, Floats, frozen
from rotorid.models.rotor import RotorModel
from rotorid.results.machine import (
    Laws,
    Machine,
    OfAMachine,
    directions_of,
    laws_of,
    machine_of,
    own_model,
    shares_of,
)
from rotorid.results.modes import amplitude_std, partners

FREE = 360
"""Angles that are tried where masses may be mounted anywhere: one degree is what hands can do."""
NEAREST = 24
"""Ways to mount masses in a plane that are tried with those of the other planes: the nearest."""
MOST = 4_000
"""Places times masses: more make more pairs of masses than are tried in a second."""
Mounted = tuple[tuple[float, float], ...]
"""Masses and angles in one plane, (kg, rad) each."""


@frozen
class Masses:
    """What can be mounted in a plane: radius in m, masses in kg, number of holes."""

    radius: float | None
    masses: tuple[float, ...]
    holes: int | None

    @classmethod
    def of(
        cls, radius: float | str | None, masses: Sequence[float | str], holes: int | None
    ) -> Masses:
        if (masses or holes is not None) and radius is None:
            found = "masses or holes without the radius at which they are"
            raise InputError(found, "a radius", 'give it: --radius "30 mm"', place="radius")
        if holes is not None and (holes < 1 or holes != int(holes)):
            raise InputError(
                f"{holes} holes", "a whole number, 1 or more", "count them", place="holes"
            )
        sizes = tuple(_above_zero(mass, "kg", "masses") for mass in masses)
        if len(sizes) * (holes or FREE) > MOST:
            found = f"{len(sizes)} masses in {holes or FREE} places"
            expected = f"{MOST} choices at the most"
            raise InputError(found, expected, "leave out masses that hardly differ", place="masses")
        return cls(None if radius is None else _above_zero(radius, "m", "radius"), sizes, holes)


def _above_zero(value: float | str, unit: str, place: str) -> float:
    found = float(quantity(value, unit, place=place))
    require_positive(found, unit, f"give it in {unit}", place=place)
    return found


def chosen(
    kit: Masses, ideal: Complexes, weighed: tuple[Complexes, Complexes]
) -> tuple[Complexes, list[Mounted]]:
    """Return corrections, kg m, and their mounts: those that leave least of what is weighed."""
    if kit.radius is None:
        return ideal, [() for _ in ideal]
    if not kit.masses and kit.holes is None:
        single = [((float(abs(w) / kit.radius), float(np.angle(w))),) for w in ideal]
        return ideal, list(single)
    if not kit.masses:
        split = [_between_holes(w, kit.holes or 1, kit.radius) for w in ideal]
        moments = ([m * kit.radius * np.exp(1j * a) for m, a in each] for each in split)
        return np.array([complex(sum(each)) for each in moments]), split
    ways = [_nearest(kit, complex(w)) for w in ideal]
    effects, load = weighed
    if len(ideal) > 3:  # more planes than can be tried together: each by itself
        ways = [each[:1] for each in ways]

    def left(way: Sequence[tuple[complex, Mounted]]) -> float:
        return float(np.linalg.norm(load + effects @ np.array([value for value, _ in way])))

    best = min(product(*ways), key=left)
    return np.array([value for value, _ in best]), [mounted for _, mounted in best]


def _between_holes(ideal: complex, holes: int, radius: float) -> Mounted:
    """Split a correction between the two holes beside it."""
    if holes < 3:
        expected = "3 holes or more, which reach every direction"
        cure = "leave holes out, or give the masses that there are"
        raise InputError(f"{holes} holes and masses of any size", expected, cure, place="holes")
    step = 2 * np.pi / holes
    first = np.floor(np.angle(ideal) / step) * step
    sides = np.array([first, first + step])
    matrix = np.array([np.cos(sides), np.sin(sides)])
    shares = np.linalg.solve(matrix, np.array([ideal.real, ideal.imag])) / radius
    pairs = zip(shares.tolist(), sides.tolist(), strict=True)
    return tuple((float(m), _turned(a)) for m, a in pairs if m > 1e-9 * abs(ideal) / radius)


def _turned(angle: float) -> float:
    """Return an angle between - pi and pi."""
    return float(np.angle(np.exp(1j * angle)))


def _nearest(kit: Masses, ideal: complex) -> list[tuple[complex, Mounted]]:
    """Return the ways to mount no mass, one or two that come nearest to a correction."""
    assert kit.radius is not None
    count = kit.holes or FREE
    first = 0.0 if kit.holes else float(np.angle(ideal))
    angles = first + 2 * np.pi * np.arange(count) / count
    each: Floats = np.array([(m, a) for m in kit.masses for a in angles])
    values = kit.radius * each[:, 0] * np.exp(1j * each[:, 1])
    nearest = np.argsort(np.abs(values - ideal), kind="stable")[:NEAREST].tolist()
    ways: list[tuple[int, ...]] = [(), *((i,) for i in nearest)]
    # The second mass is the one nearest to what the first leaves.
    for i, value in enumerate(values):
        second = np.argsort(np.abs(values + value - ideal), kind="stable")[:2].tolist()
        ways += [(i, j) for j in second]
    size = abs(ideal) or 1.0
    found = [(complex(values[list(way)].sum()), way) for way in ways]
    found.sort(key=lambda one: (round(abs(one[0] - ideal) / size, 9), len(one[1])))
    unique: dict[complex, tuple[complex, Mounted]] = {}
    for value, way in found:
        mounted = tuple((float(m), _turned(float(a))) for m, a in each[list(way)])
        unique.setdefault(np.round(value / size, 9), (value, mounted))
    return list(unique.values())[:NEAREST]


CONFIDENCE = 0.95
"""Chance that what is left is less than the residual that is stated."""
COARSE = 0.1
"""Share of a correction that masses may leave before it is said that they are too coarse."""
WEIGHED, MOUNTED = 0.01, np.radians(1.0)
"""Tolerances of a mass, relative, and of its angle that a page states the effect of: in their
proportion others leave more, or less."""
POOR = 0.2
"""Share of the response from which on it is said that the planes leave it."""
DEPENDENT = 1e-6
"""Planes whose effects differ by less than this share do the same: no measurement tells them."""


@frozen
class Correction:
    """What is to be added in one plane."""

    plane: str
    unbalance_kg_m: float  # mass times radius
    angle_rad: float  # in the rotor, from x to y, counted from what stands along x at phi = 0
    # ``None`` where nothing is known of the deviations
    std_kg_m: float | None
    angle_std_rad: float | None
    masses: Mounted = ()  # what to mount, where radius or masses were given
    std_assumed_kg_m: float = np.nan  # if what is assumed is wrong; NaN at the speeds of records


@frozen
class Residual:
    plane: str
    # it is less than this with 95 percent; ``None`` where nothing is known of the deviations
    unbalance_kg_m: float | None
    std_kg_m: float | None  # of each of its two components, root mean square
    # ``unbalance_kg_m Omega / m``, m the mass of the rotor, at the highest speed; ``None`` where
    # the planes cannot do away with the unbalance: what they do not reach is left besides
    grade_mm_s: float | None
    off_kg_m: float  # what the masses that there are leave


@frozen
class Balance(OfAMachine):
    machine: Machine = field(repr=False, compare=False)
    speeds: tuple[float, ...]  # rad/s
    corrections: tuple[Correction, ...]
    residual: tuple[Residual, ...]
    # (2 planes, 2 planes), or None: of the residual: real and imaginary part of each plane, kg^2
    # m^2
    covariance: Floats | None
    # what is left of the weighed response if the values are right: what planes and masses cannot do
    # away with
    share: float
    rotor_mass: float | None  # kg
    grade_mm_s: float | None  # of all planes together, at their worst
    grade_before_mm_s: float | None  # of the unbalance that the planes take away
    # what `WEIGHED` and `MOUNTED` leave, all planes at their worst
    grade_mounted_mm_s: float | None
    notes: tuple[Note, ...] = ()  # what is assumed at the highest speed, and what that may move


def balance(
    estimate: Estimate,
    planes: Sequence[str],
    speed: float | str | Sequence[float | str],
    *,
    at: Mapping[str, float] | None = None,
    radius: float | str | None = None,
    masses: Sequence[float | str] = (),
    holes: int | None = None,
    record: int = 0,
) -> Balance:
    """Return correction masses in some planes, and the unbalance that is left, with deviations.

    The correction minimizes the response ``H (g + Omega^2 P W)`` that the estimate predicts, at all
    speeds together, without forces at the inputs. Runout that was identified is no unbalance and is
    not balanced.

    Parameters
    ----------
    estimate : Estimate
    planes : sequence of str
        Pairs of coordinates ``x2,y2``, of combinations of them, or of inputs; or names of places.
    speed : float or str, or sequence of them
        rad/s, or texts with units.
    at : mapping of str to float, optional
        Coordinates, or combinations of them, whose motion is to be small, with their weights; by
        default all, weighted by their inertia.
    radius : float or str, optional
        Of the correction masses, in m.
    masses : sequence of float or str
        Masses that there are (kg): two of them, the same twice too, go into a plane.
    holes : int, optional
        Number of places for a mass in each plane, the first at the angle zero.
    record : int
        Whose values are taken of what every record has to itself.

    Returns
    -------
    Balance

    Raises
    ------
    InputError
        For planes that the rotor does not have or that do the same, and for an estimate that does
        not determine the unbalance.

    Examples
    --------
    >>> import numpy as np, rotorid as rid
    >>> model = rid.load_model("jeffcott")
    >>> found = [rid.Value(p.name, p.unit, p.nominal, 0.01 * p.nominal) for p in model.parameters]
    >>> spread = np.diag([value.std**2 for value in found])
    >>> estimate = rid.Estimate("jeffcott", "ml", "ok", tuple(found), covariance=spread)
    >>> (mass,) = rid.balance(estimate, ["x,y"], "3000 rpm").corrections
    >>> f"{mass.unbalance_kg_m * 1e6:.1f} g mm at {np.degrees(mass.angle_rad):.1f} deg"
    '111.8 g mm at -116.6 deg'
    """
    speeds = _speeds(speed)
    planes = [planes] if isinstance(planes, str) else planes
    machine = unbalanced(machine_of(estimate, record))
    for plane in planes:
        if not isinstance(plane, str):
            given, taken = type(plane).__name__, "the name of a place, or two coordinates, as text"
            raise WrongTypeError(given, taken, "write 'x2,y2'", place="planes")
    if not planes:
        raise InputError("no plane", "one plane or more", "name it: --plane x2,y2", place="plane")
    if len({plane.replace(" ", "") for plane in planes}) < len(planes):
        raise InputError("one plane twice", "different planes", "name each once", place="plane")
    columns = np.column_stack([plane_column(machine, plane) for plane in planes])
    task = _Task(columns, speeds, at)
    ideal = task.solution(machine)
    kit = Masses.of(radius, masses, holes)
    effects, load = task.weigh(machine)
    applied, mounted = chosen(kit, ideal, (effects, load))
    share = float(np.linalg.norm(load + effects @ applied) / np.linalg.norm(load))
    covariance = root = None
    if machine.covariance is not None:  # of the correction that the values ask for
        root = machine.changes(task.solution)
        covariance = np.asarray(root.view(np.float64).T @ root.view(np.float64))
    more = (*_said_of(estimate), *_too_coarse(planes, applied, ideal, kit))
    machine = replace(machine, remarks=(*machine.remarks, *more))
    off = float(np.hypot(WEIGHED, MOUNTED))
    mass, top = rotor_mass(machine), float(np.abs(speeds).max())
    beyond = np.linalg.norm(load + effects @ ideal) > POOR * np.linalg.norm(load)
    weighed = None if beyond else mass  # what no plane reaches is left besides, and has no place
    corrections, residual = [], []
    for k, plane in enumerate(planes):
        part = None if covariance is None else covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2]
        own = None if root is None else root[:, k]
        corrections.append(_correction(plane, complex(applied[k]), own, mounted[k]))
        residual.append(_residual(plane, complex(applied[k] - ideal[k]), part, weighed, top))
    corrections, notes = _assuming(machine, task, corrections)
    grades = [each.grade_mm_s for each in residual]
    per_unbalance = None if weighed is None else 1e3 * top / weighed
    return Balance(
        machine,
        tuple(speeds.tolist()),
        tuple(corrections),
        tuple(residual),
        covariance,
        share,
        mass,
        None if None in grades else float(sum(g for g in grades if g is not None)),
        None if per_unbalance is None else per_unbalance * float(np.abs(ideal).sum()),
        None if per_unbalance is None else per_unbalance * off * float(np.abs(applied).sum()),
        tuple(notes),
    )


def _assuming(
    machine: Machine, task: _Task, corrections: Sequence[Correction]
) -> tuple[list[Correction], list[Note]]:
    """Return corrections with what errors of what is assumed move them by, and notes on it."""
    toward = np.exp(-1j * np.array([each.angle_rad for each in corrections]))
    names = [f"the correction in {each.plane}" for each in corrections]
    std = np.array([each.std_kg_m or 0.0 for each in corrections])
    top = float(np.abs(task.speeds).max())
    moved, notes = machine.assumed_of(top, names, std, lambda at: task.solution(at) * toward)
    pairs = zip(corrections, moved.tolist(), strict=True)
    return [replace(each, std_assumed_kg_m=far) for each, far in pairs], notes


def _speeds(speed: float | str | Sequence[float | str]) -> Floats:
    given = [speed] if isinstance(speed, str | float | int) else list(speed)
    found = np.array([finite_speed(each) for each in given])
    if not len(found) or (found == 0).any():
        raise InputError(
            "no speed" if not len(found) else "a speed of 0",
            "the speed at which the rotor is to run quietly",
            'give it: --speed "8400 rpm"',
            place="speed",
        )
    return found


def unbalanced(machine: Machine) -> Machine:
    """Refuse a machine whose unbalance is not known."""
    held = {u for t in machine.linear.load_terms for u in machine.monomials.factors[t.monomial]}
    held = {int(u) for u in held if u < len(machine.names)}
    open_ = [name for name in machine.undetermined if machine.names.index(name) in held]
    if open_:
        raise InputError(
            f"a result that leaves {', '.join(open_)} undetermined",
            "the unbalance of the rotor",
            "measure at a second speed where runout is unknown (it does not grow with the speed), "
            "with a trial mass where no force is known; then identify again",
        )
    load, _ = machine.load(1.0)
    if not np.abs(load).any():
        expected = "unbalance parameters that were identified"
        cure = "leave them free in the experiment, with the rotor turning, and identify again"
        raise InputError("a result without unbalance", expected, cure)
    return machine


def _said_of(estimate: Estimate) -> list[str]:
    runout = sorted({v.name.rpartition(".")[0] for v in estimate.nuisance if "runout[" in v.name})
    said = [f"not unbalance, and left as it is: {', '.join(runout)}"] if runout else []
    model = own_model(estimate)
    held = sorted({t.monomial for t in model.require_linear().load_terms})
    loads = set(np.flatnonzero(model.monomials[held].any(axis=0)).tolist())
    named = {model.parameter_names[k] for k in loads}
    exact = [v.name for v in estimate.parameters if v.fixed and v.value and v.name in named]
    if exact:
        said.append(f"taken as exact, and not counted in what is left: {', '.join(exact)}")
    return said


def _too_coarse(
    planes: Sequence[str], applied: Complexes, ideal: Complexes, kit: Masses
) -> list[str]:
    return [
        f"warning: plane {plane} needs {1e3 * abs(wanted) / kit.radius:.4g} g at "
        f"{1e3 * kit.radius:g} mm; the masses given leave "
        f"{100 * abs(got - wanted) / abs(wanted):.0f} % of it"
        for plane, got, wanted in zip(planes, applied, ideal, strict=True)
        if kit.radius is not None and abs(got - wanted) > COARSE * abs(wanted)
    ]


@frozen
class _Task:
    """What a correction is to do: planes as columns (row, plane), speeds, what is weighed."""

    columns: Complexes
    speeds: Floats
    at: Mapping[str, float] | None

    def weigh(self, machine: Machine) -> tuple[Complexes, Complexes]:
        """Return what the planes do, (weighed, plane), and what the unbalance does, (weighed,)."""
        weights = _weights(machine, self.at)
        effects, loads = [], []
        for speed in self.speeds.tolist():
            load, _ = machine.load(speed)
            moved = machine.answer(speed, np.column_stack([load, speed**2 * self.columns]))
            scale = 1 / speed**2 if len(self.speeds) == 1 else 1.0
            loads.append(scale * weights @ moved[:, 0])
            effects.append(scale * weights @ moved[:, 1:])
        return np.concatenate(effects), np.concatenate(loads)

    def solution(self, machine: Machine) -> Complexes:
        """Return the correction of each plane, kg m."""
        effects, load = self.weigh(machine)
        size = np.linalg.norm(effects, axis=0)
        scaled = effects / np.where(size > 0, size, 1.0)
        apart = np.linalg.svd(scaled, compute_uv=False) > DEPENDENT
        if (size == 0).any() or apart.sum() < effects.shape[1]:
            raise InputError(
                "planes of which one does what others do, or nothing",
                "planes whose effects differ where they are weighed",
                "leave one out, or give more speeds, or more places with --at",
                place="plane",
            )
        return np.asarray(np.linalg.lstsq(scaled, -load, rcond=None)[0] / size)


def _weights(machine: Machine, at: Mapping[str, float] | None) -> Floats:
    """Return what is weighed, shape (weighed, coordinate)."""
    if not at:
        inertia = machine.inertia()
        return np.diag(np.sqrt(inertia if inertia.any() else np.ones(len(inertia))))
    rows = []
    for text, weight in at.items():
        shares = shares_of(machine, text)
        if shares is None or not np.isfinite(weight) or weight <= 0:
            raise InputError(
                f"{text[:60]!r} with the weight {weight:g}",
                f"a combination of {', '.join(machine.model.coordinates[:8])}, a weight above 0",
                "name coordinates whose motion is to be small",
                place="at",
            )
        rows.append(weight * shares)
    return np.array(rows)


def _correction(
    plane: str, applied: complex, root: Complexes | None, masses: Mounted
) -> Correction:
    size, angle = abs(applied), float(np.angle(applied))
    if root is None:
        return Correction(plane, size, angle, None, None, masses)
    along = np.exp(-1j * angle) * root  # real: of the size; imaginary: across it
    std, across = float(np.linalg.norm(along.real)), float(np.linalg.norm(along.imag))
    turned = min(across / size, np.pi) if size > 0 else None
    return Correction(plane, size, angle, std, turned, masses)


def _residual(
    plane: str, off: complex, covariance: Floats | None, mass: float | None, speed: float
) -> Residual:
    if covariance is None:
        return Residual(plane, None, None, None, abs(off))
    bound = bound_of_length(np.array([off.real, off.imag]), covariance, CONFIDENCE)
    std = float(np.sqrt(np.trace(covariance) / 2))
    grade = None if mass is None else 1e3 * bound * speed / mass
    return Residual(plane, bound, std, grade, abs(off))


@frozen
class Feedforward:
    """The current a cos(phi + angle) by which a magnet exerts no force on the rotation's line."""

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
    laws: Laws | None = None,
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


def _answers(machine: Machine, speed: float, forces: Sequence[str], known: Laws) -> Complexes:
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


ALIKE = 1e-3
"""Share by which x and y of one place may differ, and their size from one: digits of a drawing."""


def plane_column(machine: Machine, plane: str) -> Complexes:
    """Return what 1 kg m in a plane does to the equations, over Omega^2, (row,).

    A plane is a pair ``x2,y2`` of coordinates, of combinations such as ``x + 0.1*theta_y,
    y - 0.1*theta_x``, or of inputs; the name of a place; or the one direction of a single axis.
    """
    if "," not in plane and _one_axis(machine):
        column = _force_column(machine, plane.strip())
        if column is not None and column.any():
            return column.astype(complex)
    for pair in _readings(plane):
        columns = [_force_column(machine, name) for name in pair]
        if columns[0] is not None and columns[1] is not None:
            combined = not {*pair} & {*machine.model.inputs}
            _check_pair(machine, plane, columns[0], columns[1], combined=combined)
            return np.asarray(columns[0] - 1j * columns[1])
    expected = f"a pair of coordinates or inputs, {_offered(machine)}"
    cure = "name the two directions in which its force acts, x before y: --plane x2,y2"
    raise InputError(f"the plane {plane[:60]!r}", expected, cure, place="plane")


def _one_axis(machine: Machine) -> bool:
    """Tell whether all displacements of a model are along one axis, as their names say."""
    units = machine.model.units
    moved = [name for name in machine.model.coordinates if units[name] == "m"]
    return len({re.sub(r"[\d_].*", "", name) for name in moved}) == 1


def _check_pair(machine: Machine, plane: str, *columns: Floats, combined: bool) -> None:
    """Refuse what is not x and y of one place: couples, y before x, parts or multiples of it."""
    product = np.prod([np.linalg.norm(column) for column in columns])
    if product > 0 and abs(columns[0] @ columns[1]) > (1 - 1e-9) * product:
        found = f"one direction twice: {plane[:60]!r}"
        raise _no_plane(machine, found, "name the one alone" if _one_axis(machine) else "")
    directions, names = directions_of(machine), list(machine.model.coordinates)
    lengths = np.array([machine.model.units[name] == "m" for name in names])
    if any(directions.forces(column)[k] for column in columns for k in directions.faults):
        return  # inputs: what they do stands in the equations, whatever these are
    first, second = (np.where(lengths, directions.forces(column), 0.0) for column in columns)
    turned = np.zeros(len(names))
    for a, b in partners(names):
        turned[b] += first[a]
        turned[a] -= first[b]
    x, y = np.array(partners(names), dtype=np.int64).reshape(-1, 2).T
    size = np.hypot(first[x].sum(), first[y].sum())
    if not (first.any() and second.any()):
        found = "a couple, where a mass makes a force"
    elif turned.any() and np.allclose(second, -turned):
        found = "a pair in which y comes before x"
    elif turned.any() and not np.allclose(second, turned, atol=ALIKE * size):
        found = "two directions that are not x and y of one place"
    elif combined and _levers_differ(machine, *columns):
        found = "x and y of two places along the axis, as a sign that is wrong makes them"
    elif combined and turned.any() and abs(size - 1) > ALIKE:
        found = f"{size:.4g} times the motion of a place"
    else:
        return
    raise _no_plane(machine, f"{found}: {plane[:60]!r}")


def _no_plane(machine: Machine, found: str, cure: str = "") -> InputError:
    expected = f"the two directions in which a force acts, {_offered(machine)}"
    return InputError(found, expected, cure or "name them, x before y", place="plane")


def _levers_differ(machine: Machine, *columns: Floats) -> bool:
    """Tell whether y acts at another lever than x; which sign that has, the inputs tell."""
    directions, names = directions_of(machine), machine.model.coordinates
    angles = [pair for pair in partners(names) if machine.model.units[names[pair[0]]] != "m"]

    def levers(x: Floats, y: Floats) -> Floats:
        one, other = (directions.forces(column) for column in (x, y))
        return np.array([(one[b], other[a]) for a, b in angles]).reshape(-1, 2)

    forces, inputs = machine.input_matrix(), partners(machine.model.inputs)
    known = [levers(forces[:, a], forces[:, b]) for a, b in inputs]
    signs = {-1.0} if isinstance(machine.model, RotorModel) else set[float]()
    signs |= {float(sign) for pair in known for sign in np.sign(pair.prod(axis=1)) if sign}
    found = levers(*columns)
    if len(signs) != 1 or not found.size:
        return False
    away = np.abs(found[:, 1] - signs.pop() * found[:, 0])
    return bool((away > ALIKE * np.abs(found).max(axis=1)).any())


def _readings(plane: str) -> Iterator[tuple[str, str]]:
    """Yield what a text may mean, the pair that it writes first."""
    parts = [part.strip() for part in plane.split(",")]
    if len(parts) == 2 and all(parts):
        yield parts[0], parts[1]
    elif len(parts) == 1:
        for x, y in (("x_{}", "y_{}"), ("x{}", "y{}"), ("F_x{}", "F_y{}"), ("F_x_{}", "F_y_{}")):
            yield x.format(parts[0]), y.format(parts[0])


def _offered(machine: Machine) -> str:
    model = machine.model
    named = list(machine.model.coordinates)
    pairs = [f"{named[a]},{named[b]}" for a, b in partners(named) if model.units[named[a]] == "m"]
    pairs = [pair for pair in pairs if "node" not in pair] or pairs
    if not pairs and _one_axis(machine):
        pairs = [name for name in named if model.units[name] == "m"]
    forces = [name for name in model.inputs if model.units[name] == "N"]
    inputs = [f"{forces[a]},{forces[b]}" for a, b in partners(forces)]
    return (
        ("such as " + " or ".join([*pairs[:3], *inputs[:2]])) if pairs or inputs else "of x and y"
    )


def _force_column(machine: Machine, text: str) -> Floats | None:
    """Return what a force of 1 N does there to the equations, shape (row,); None for no place."""
    if text in machine.model.inputs:
        if machine.model.units[text] != "N":
            unit = machine.model.units[text]
            raise _no_plane(machine, f"the input {text} in {unit} for a plane")
        return np.asarray(machine.input_matrix()[:, machine.model.inputs.index(text)])
    shares = shares_of(machine, text)
    return None if shares is None else directions_of(machine).column(shares)


def rotor_mass(machine: Machine) -> float | None:
    """Return the mass that moves with all positions in x; None where there is none."""
    names = machine.model.coordinates
    along = [a for a, _ in partners(names) if machine.model.units[names[a]] == "m"]
    if not along:
        return None
    shares = np.zeros(len(names))
    shares[along] = 1.0
    mass = np.real(machine.matrices(0.0)[2])
    directions = directions_of(machine)
    if any(shares[k] for k in directions.faults):
        return None
    found = float(shares @ directions.forces(mass @ shares))
    return found if found > 0 else None
