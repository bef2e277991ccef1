"""An estimate for other programs: CSV, MATLAB, LaTeX; its state space as JSON and for MATLAB."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Iterable
from io import BytesIO, StringIO
from pathlib import Path

import numpy as np

from rotorid.errors import InputError
from rotorid.estimate import Estimate
from rotorid.estimate_parts import Value
from rotorid.results.modes import finite_speed
from rotorid.results.state_space import StateSpace, state_space
from rotorid.screen import one_line, printable
from rotorid.writing import Kind, write_whole

SCHEMA = "rotorid-state-space/1"
_COLUMNS = ("kind", "name", "unit", "value", "std", "std_inflated", "fixed")
_MAT_TEXT = b"MATLAB 5.0 MAT-file, written by rotorid export"
_MAT_TEXT_BYTES = 116
_TEX_MARK = "% Written by rotorid export: "
_LATEX = {"\\": r"\textbackslash{}", "^": r"\textasciicircum{}", "~": r"\textasciitilde{}"}
_LATEX |= {c: "\\" + c for c in "&%$#_{}"}


def export(
    estimate: Estimate, path: str | Path, *, ending: str | None = None, speed: float | str = 0.0
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

    Raises
    ------
    InputError
        For any other ending, and for a state space that the machine does not have.
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
    write_whole(path, exported(estimate, path, ending=ending, speed=speed))


def exported(
    estimate: Estimate, path: str | Path, *, ending: str | None = None, speed: float | str = 0.0
) -> bytes:
    """Return the content of the file that `export` writes."""
    known = _known_ending(path, ending)
    if known == ".json":
        return _json(estimate, speed)
    if known == ".mat":
        return _mat(estimate, speed)
    return WRITERS[known](estimate)


def kind_of(path: str | Path) -> Kind:
    """Return how a file of this name is known as written by `export`."""
    return Kind("rotorid export", _BEGINS[_known_ending(path)])


def _known_ending(path: str | Path, ending: str | None = None) -> str:
    ending = (ending or Path(path).suffix).lower()
    if ending not in _BEGINS:
        raise InputError(
            f"the ending {ending!r}",
            f"one of {', '.join(_BEGINS)}",
            "name the file so, for example result.csv",
            file=str(path),
        )
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


def _csv(estimate: Estimate) -> bytes:
    names = _covariance_names(estimate)
    covariance = iter(estimate.covariance.tolist() if names else [])
    stream = StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([*_COLUMNS, *(f"cov[{name}]" for name in names)])
    for kind, v in _quantities(estimate):
        row: list[float] = next(covariance, []) if kind != "derived" and not v.fixed else []
        writer.writerow([kind, v.name, v.unit, v.value, v.std, v.std_inflated, v.fixed, *row])
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
    return (json.dumps({"schema": SCHEMA, **plant}, indent=1, allow_nan=False) + "\n").encode()


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


def _tex(estimate: Estimate) -> bytes:
    tables = [(t.headings, t.rows, t.numeric) for t in estimate.value_tables]
    names = _covariance_names(estimate)
    if names:
        rows = tuple(
            (name, *(f"{x:.4g}" for x in row))
            for name, row in zip(names, estimate.covariance, strict=True)
        )
        tables.append((("covariance", *names), rows, (False, *[True] * len(names))))
    title = f"{estimate.model}, {estimate.method}: {estimate.status}"
    lines = [_TEX_MARK + one_line(title)]
    for headings, body, numeric in tables:
        lines += [rf"\begin{{tabular}}{{{''.join('r' if n else 'l' for n in numeric)}}}", r"\hline"]
        lines += [_tex_row(headings), r"\hline", *map(_tex_row, body)]
        lines += [r"\hline", r"\end{tabular}", ""]
    return _encoded("\n".join(lines))


def _tex_row(cells: Iterable[str]) -> str:
    said = (re.sub(r"[\\^~&%$#_{}]", _escaped, printable(cell)) for cell in cells)
    return " & ".join(said) + r" \\"


def _escaped(found: re.Match[str]) -> str:
    return _LATEX[found.group()]


def _encoded(text: str) -> bytes:
    return text.encode("utf-8", "backslashreplace")


WRITERS: dict[str, Callable[[Estimate], bytes]] = {".csv": _csv, ".tex": _tex}
_BEGINS = {
    ".csv": re.escape(",".join(_COLUMNS).encode()),
    ".mat": re.escape(_MAT_TEXT),
    ".tex": re.escape(_TEX_MARK.encode()),
    ".json": rb'\{\s*"schema": "rotorid-state-space/',
}
