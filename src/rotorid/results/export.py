"""An estimate for other programs: CSV, MATLAB, LaTeX."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from rotorid.errors import InputError
from rotorid.estimate import Estimate, Value

_LATEX = {"\\": r"\textbackslash{}", "^": r"\textasciicircum{}", "~": r"\textasciitilde{}"}
_LATEX |= {c: "\\" + c for c in "&%$#_{}"}


def export(estimate: Estimate, path: str | Path, *, ending: str | None = None) -> None:
    """Write the parameters, nuisance and derived quantities of an estimate, and their covariance.

    Parameters
    ----------
    estimate : Estimate
    path : str or Path
        Its ending says how: ``.csv`` (a row per quantity, then its row of the covariance),
        ``.mat`` (MATLAB 5, one struct ``estimate``), ``.tex`` (two ``tabular``).
    ending : str, optional
        In place of the path's.

    Raises
    ------
    InputError
        For any other ending.
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
    ending = (ending or Path(path).suffix).lower()
    if ending not in WRITERS:
        raise InputError(
            f"the ending {ending!r}",
            f"one of {', '.join(WRITERS)}",
            "name the file so, for example result.csv",
            file=str(path),
        )
    WRITERS[ending](estimate, Path(path))


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


def _write_csv(estimate: Estimate, path: Path) -> None:
    names = _covariance_names(estimate)
    covariance = iter(estimate.covariance.tolist() if names else [])
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        columns = ["kind", "name", "unit", "value", "std", "std_inflated", "fixed"]
        writer.writerow([*columns, *(f"cov[{name}]" for name in names)])
        for kind, v in _quantities(estimate):
            row: list[float] = next(covariance, []) if kind != "derived" and not v.fixed else []
            writer.writerow([kind, v.name, v.unit, v.value, v.std, v.std_inflated, v.fixed, *row])


def _write_mat(estimate: Estimate, path: Path) -> None:
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
    savemat(str(path), {"estimate": content}, appendmat=False, oned_as="column")


def _write_tex(estimate: Estimate, path: Path) -> None:
    tables = [(t.headings, t.rows, t.numeric) for t in estimate.value_tables]
    names = _covariance_names(estimate)
    if names:
        rows = tuple(
            (name, *(f"{x:.4g}" for x in row))
            for name, row in zip(names, estimate.covariance, strict=True)
        )
        tables.append((("covariance", *names), rows, (False, *[True] * len(names))))
    title = f"% {estimate.model}, {estimate.method}: {estimate.status}".replace("\n", " ")
    lines = [title]
    for headings, body, numeric in tables:
        lines += [rf"\begin{{tabular}}{{{''.join('r' if n else 'l' for n in numeric)}}}", r"\hline"]
        lines += [_tex_row(headings), r"\hline", *map(_tex_row, body)]
        lines += [r"\hline", r"\end{tabular}", ""]
    path.write_text("\n".join(lines), encoding="utf-8")


def _tex_row(cells: Iterable[str]) -> str:
    return " & ".join(re.sub(r"[\\^~&%$#_{}]", _escaped, cell) for cell in cells) + r" \\"


def _escaped(found: re.Match[str]) -> str:
    return _LATEX[found.group()]


WRITERS: dict[str, Callable[[Estimate, Path], None]] = {
    ".csv": _write_csv,
    ".mat": _write_mat,
    ".tex": _write_tex,
}
