"""An estimate for other programs: state space; csv, mat, tex, json.

States are the coordinates and their derivatives. Coordinates without inertia have no derivative of
their own: with damping they are states of first order, without it they follow from the others.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable, Sequence
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.answer.estimate import Estimate, value_tables
from rotorid.answer.parts import Value
from rotorid.core.errors import InputError, one_line, printable, require_names, require_type
from rotorid.core.files import MARK, Kind, check_target, write_whole
from rotorid.core.units import finite_speed
from rotorid.core.values import Floats, frozen
from rotorid.models import Model
from rotorid.models.linear_form import solved
from rotorid.results.machine import Machine, machine_of, require_shares


@frozen
class StateSpace:
    """Matrices of a linear machine at one speed, in SI units."""

    # shapes (state, state), (state, input), (output, state), (output, input)
    A: Floats
    B: Floats
    C: Floats
    D: Floats
    # sequence of (name, unit)
    states: tuple[tuple[str, str], ...]
    inputs: tuple[tuple[str, str], ...]
    outputs: tuple[tuple[str, str], ...]
    speed: float  # rad/s
    model: str

    def to_scipy(self) -> Any:
        from scipy.signal import StateSpace as Continuous  # takes its time to load

        return Continuous(self.A, self.B, self.C, self.D)

    def to_control(self) -> Any:
        """Return ``control.StateSpace`` with its names; ImportError without python-control."""
        try:
            import control
        except ImportError:
            raise ImportError("no python-control; install it: pip install control") from None
        named = {  # it allows no points in names
            kind: [name.replace(".", "_") for name, _ in getattr(self, kind)]
            for kind in ("states", "inputs", "outputs")
        }
        return control.ss(self.A, self.B, self.C, self.D, remove_useless_states=False, **named)

    def to_dict(self) -> dict[str, Any]:
        names = {
            kind: [{"name": name, "unit": unit} for name, unit in getattr(self, kind)]
            for kind in ("states", "inputs", "outputs")
        }
        matrices = {name: getattr(self, name).tolist() for name in "ABCD"}
        return {"model": self.model, "speed_rad_s": self.speed, **matrices, **names}


def state_space(
    source: Estimate | Model,
    speed: float | str = 0.0,
    *,
    outputs: Sequence[str] = (),
    record: int = 0,
) -> StateSpace:
    """Return the state space of a result or a model, from its inputs to its coordinates.

    ``M q'' + (D + Omega G) q' + K q = B u`` with the gyroscopic terms of the speed; unbalance is no
    part of it.

    Parameters
    ----------
    source : Estimate or Model
        A model is taken at its nominal values.
    speed : float or str
        rad/s, or a text with unit.
    outputs : sequence of str
        Combinations of coordinates, as a sensor reads them: ``x - 0.2*theta_y``; by default every
        coordinate.
    record : int
        Whose values are taken of what every record has to itself.

    Returns
    -------
    StateSpace

    Raises
    ------
    InputError
        For a result that leaves the matrices undetermined, structural damping, which has no state
        space, and outputs that are no combination of coordinates.

    Examples
    --------
    >>> import rotorid as rid
    >>> plant = rid.state_space(rid.load_model("jeffcott"))
    >>> plant.A.shape, [name for name, _ in plant.states]
    ((4, 4), ['x', 'y', "x'", "y'"])
    """
    machine = machine_of(source, record)
    turning = finite_speed(speed)
    named = list(outputs) or list(machine.model.coordinates)
    cure = "name coordinates, as a sensor reads them"
    rows = [require_shares(machine, "output", text, cure) for text in named]
    of_each = [machine.model.units[name] for name in machine.model.coordinates]
    held = [[of_each[i] for i in np.flatnonzero(row)] or ["1"] for row in rows]
    units = ["m" if "m" in some else some[0] for some in held]  # of its lengths, if it has any
    return _spaces(machine, turning, np.array(rows), tuple(zip(named, units, strict=True)))


def _spaces(
    machine: Machine, speed: float, rows: Floats, named: tuple[tuple[str, str], ...]
) -> StateSpace:
    matrices = machine.matrices(speed)
    if np.iscomplexobj(matrices):
        expected = "damping that has a state space"
        cure = "write internal or external damping in its place, right at the frequency of interest"
        raise InputError("structural damping", expected, cure, file=machine.model.name)
    stiffness, damping, mass = matrices
    push = machine.input_matrix()
    heavy, damped = ((part != 0).any(axis=0) for part in (mass, damping))
    body, light = np.flatnonzero(heavy), np.flatnonzero(damped & ~heavy)
    gain, away = np.flatnonzero(heavy | damped), np.flatnonzero(~(heavy | damped))
    still = int((~((mass != 0) | (damping != 0)).any(axis=1)).sum())
    if still != len(away):
        found = f"{len(away)} coordinates and {still} equations without inertia and damping"
        cure = "give the massless coordinates a little inertia"
        raise InputError(found, "as many of one as of the other", cure, file=machine.model.name)
    # Of each coordinate the highest derivative that it has follows from what is below, and from u:
    # E (z', v', q_away) = - K z - D v + B u, z with inertia or damping, v the velocities of masses.
    lead = np.concatenate([damping[:, light], mass[:, body], stiffness[:, away]], axis=1)
    below = np.concatenate([-stiffness[:, gain], -damping[:, body], push], axis=1)
    follows = _solved(machine, lead, below)
    n, count = len(gain), len(gain) + len(body)
    own = np.searchsorted(gain, body)
    slopes = np.zeros((count, count + push.shape[1]))
    slopes[own, n + np.arange(len(body))] = 1.0
    slopes[np.searchsorted(gain, light)] = follows[: len(light)]
    slopes[n:] = follows[len(light) : n]
    coordinates = np.zeros((len(mass), slopes.shape[1]))
    coordinates[gain, np.arange(n)] = 1.0
    coordinates[away] = follows[n:]
    model = machine.model
    states = [(q, model.units[q]) for q in (model.coordinates[i] for i in gain)]
    states += [(f"{q}'", f"{unit}/s") for q, unit in (states[i] for i in own)]
    read = rows @ coordinates
    return StateSpace(
        slopes[:, :count],
        slopes[:, count:],
        read[:, :count],
        read[:, count:],
        tuple(states),
        tuple((name, model.units[name]) for name in model.inputs),
        named,
        speed,
        model.name,
    )


def _solved(machine: Machine, matrix: Floats, right: Floats) -> Floats:
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            found = np.real(solved(matrix[None], right[None], np.zeros(1))[0])
    except InputError:
        raise InputError(
            "an inertia, or a damping of what has none, that is singular",
            "coordinates that each have their own",
            "give the massless coordinates a little inertia",
            file=machine.model.name,
        ) from None
    if not np.isfinite(found).all():
        expected = "a machine with finite values"
        cure = "check the values and their units"
        raise InputError("a machine beyond all bounds", expected, cure, file=machine.model.name)
    return np.asarray(found)


SCHEMA = "rotorid-state-space/1"
_COLUMNS = ("kind", "name", "unit", "value", "std", "std_inflated", "fixed")
_MAT_TEXT = f"MATLAB 5.0 MAT-file, {MARK}".encode()
_MAT_TEXT_BYTES = 116
EXPORT = Kind("rotorid export")
_LATEX = {"\\": r"\textbackslash{}", "^": r"\textasciicircum{}", "~": r"\textasciitilde{}"}
_LATEX |= {c: "\\" + c for c in "&%$#_{}"}


def export(
    estimate: Estimate,
    path: str | Path,
    *,
    ending: str | None = None,
    speed: float | str = 0.0,
    force: bool = False,
) -> None:
    """Write the parameters, nuisance and derived quantities of an estimate, and their covariance.

    Parameters
    ----------
    estimate : Estimate
    path : str or Path
        Its ending says how: ``.csv`` (a row per quantity, then its row of the covariance),
        ``.mat`` (MATLAB 5: a struct ``estimate``, and a struct ``plant`` of a linear machine, for
        ``ss(plant.A, plant.B, plant.C, plant.D)``), ``.tex`` (two ``tabular``), ``.json`` (the
        state space).
    ending : str, optional
        In place of the path's.
    speed : float or str
        Of the state space: rad/s, or a text with unit.
    force : bool
        Replaces a file that no export wrote, or that was edited since.

    Raises
    ------
    InputError
        For any other ending, another's file, and a state space that the machine does not have.
    OSError
        Where the file cannot be written.

    Examples
    --------
    >>> import tempfile, rotorid as rid
    >>> mass = rid.Value("m", "kg", 2.0, std=0.01)
    >>> estimate = rid.Estimate("one", "ls", "ok", (mass,), covariance=[[1e-4]])
    >>> path = Path(tempfile.mkdtemp()) / "mass.csv"
    >>> rid.export(estimate, path)
    >>> print(path.read_text().splitlines()[1])
    parameter,m,kg,2.0,0.01,,False,0.0001
    """
    require_type(estimate, Estimate, place="estimate")
    check_target(Path(path), EXPORT, force=force)
    write_whole(path, exported(estimate, path, ending=ending, speed=speed))


def exported(
    estimate: Estimate, path: str | Path, *, ending: str | None = None, speed: float | str = 0.0
) -> bytes:
    return EXPORT.signed(_WRITERS[known_ending(path, ending)](estimate, speed))


def known_ending(path: str | Path, ending: str | None = None) -> str:
    ending = (ending or Path(path).suffix).lower()
    cure = "name the file so, for example result.csv"
    require_names([ending], _WRITERS, "the ending {}", cure, file=str(path))
    return ending


def _quantities(estimate: Estimate) -> Iterable[tuple[str, Value]]:
    kinds = {
        "parameter": estimate.parameters,
        "nuisance": estimate.nuisance,
        "derived": estimate.derived,
    }
    return ((kind, value) for kind, values in kinds.items() for value in values)


def _covariance_names(estimate: Estimate) -> list[str]:
    """Return the names of the rows of the covariance; none where they do not match it."""
    names = [value.name for value in estimate.free]
    return names if len(names) == len(estimate.covariance) else []


def _csv(estimate: Estimate, _: float | str) -> bytes:
    names = _covariance_names(estimate)
    covariance = iter(estimate.covariance.tolist() if names else [])
    stream = StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([*_COLUMNS, *(f"cov[{name}]" for name in names), MARK])
    for kind, v in _quantities(estimate):
        row: list[float] = next(covariance, []) if kind != "derived" and not v.fixed else []
        # A spreadsheet runs a text that begins like a formula.
        texts = (
            f"'{t}" if t.startswith(("=", "+", "-", "@")) else t for t in (kind, v.name, v.unit)
        )
        writer.writerow([*texts, v.value, v.std, v.std_inflated, v.fixed, *row])
    return _encoded(stream.getvalue())


def plant_of(estimate: Estimate, speed: float | str) -> StateSpace | None:
    """Return the state space of an estimate; None where its machine has none."""
    finite_speed(speed)
    try:
        return state_space(estimate, speed=speed)
    except InputError:
        return None


def _json(estimate: Estimate, speed: float | str) -> bytes:
    plant = state_space(estimate, speed=speed).to_dict()
    marked = {"schema": SCHEMA, **plant, "written": MARK}
    return (json.dumps(marked, indent=1, allow_nan=False) + "\n").encode()


def _mat(estimate: Estimate, speed: float | str) -> bytes:
    from scipy.io import savemat  # only here

    def cells(texts: Iterable[str]) -> np.ndarray:
        return np.array(list(texts), dtype=object)

    def numbers(values: Iterable[float | None]) -> np.ndarray:
        return np.array([np.nan if x is None else x for x in values], dtype=float)

    kinds, values = zip(*_quantities(estimate), strict=True) if estimate.parameters else ((), ())
    content = {
        "model": estimate.model,
        "method": estimate.method,
        "status": estimate.status,
        "kind": cells(kinds),
        "name": cells(v.name for v in values),
        "unit": cells(v.unit for v in values),
        "value": numbers(v.value for v in values),
        "std": numbers(v.std for v in values),
        "fixed": np.array([v.fixed for v in values]),
        "interval": np.array([v.interval or (np.nan, np.nan) for v in values]),
        "covariance": estimate.covariance,
        "covariance_name": cells(_covariance_names(estimate)),
    }
    stream = BytesIO()
    structs: dict[str, object] = {"estimate": content}
    plant = plant_of(estimate, speed)
    if plant is not None:
        structs["plant"] = {name: getattr(plant, name) for name in "ABCD"} | {
            "speed": plant.speed,
            **{
                f"{kind}_{what}": cells(pair[k] for pair in getattr(plant, f"{kind}s"))
                for kind in ("state", "input", "output")
                for k, what in enumerate(("name", "unit"))
            },
        }
    savemat(stream, structs, oned_as="column")  # type: ignore[arg-type]
    # The text at its beginning is free; with the date that stands there no two files are alike.
    return _MAT_TEXT.ljust(_MAT_TEXT_BYTES) + stream.getvalue()[_MAT_TEXT_BYTES:]


def _tex(estimate: Estimate, _: float | str) -> bytes:
    tables = [(t.headings, t.rows, t.numeric) for t in value_tables(estimate).values()]
    names = _covariance_names(estimate)
    if names:
        rows = tuple(
            (name, *(f"{x:.4g}" for x in row))
            for name, row in zip(names, estimate.covariance, strict=True)
        )
        tables.append((("covariance", *names), rows, (False, *[True] * len(names))))
    title = f"{estimate.model}, {estimate.method}: {estimate.status}"
    lines = [f"% {one_line(title)}", f"% {MARK}"]
    for headings, body, numeric in tables:
        lines += [rf"\begin{{tabular}}{{{''.join('r' if n else 'l' for n in numeric)}}}", r"\hline"]
        lines += [_tex_row(headings), r"\hline", *map(_tex_row, body)]
        lines += [r"\hline", r"\end{tabular}", ""]
    return _encoded("\n".join(lines))


def _tex_row(cells: Iterable[str]) -> str:
    escaped = str.maketrans(_LATEX)
    return " & ".join(printable(cell).translate(escaped) for cell in cells) + r" \\"


def _encoded(text: str) -> bytes:
    return text.encode("utf-8", "backslashreplace")


_WRITERS: dict[str, Callable[[Estimate, float | str], bytes]] = {
    ".csv": _csv,
    ".mat": _mat,
    ".tex": _tex,
    ".json": _json,
}
"""How a file of each ending is written."""
