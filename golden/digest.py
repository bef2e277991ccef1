"""What is kept of a text or a file: no paths, dates or hashes, long columns folded."""

from __future__ import annotations

import json
import math
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np

DIGITS = 12
EVIDENCE_DIGITS = 6
"""Of evidence, which its file rounds to six digits."""
FEW = 24
"""The longest list of numbers, or of rows, that is kept as it is."""
DROPPED = {"version", "environment", "sha256", "written"}
LONG_TEXT = 200
"""Texts of files stand in a result as they were read; longer ones of several lines are dropped."""

_NORMAL = (
    (re.compile(r"(rotorid-sha256:)?\b[0-9a-f]{32,}\b"), "<hash>"),
    (re.compile(r"\b\d{4}-\d\d-\d\d([ T]\d\d:\d\d(:\d\d)?)?\b"), "<date>"),
    (re.compile(r"\brotorid,? (version )?\d+\.\d+(\.\w+)*"), "rotorid <version>"),
)


def text_lines(text: str, folder: Path) -> list[str]:
    """Return the lines of a text without what depends on place and time."""
    text = text.replace(str(folder), "<here>")
    for pattern, name in _NORMAL:
        text = pattern.sub(name, text)
    return [line.rstrip() for line in text.splitlines()]


def file_digest(file: Path, folder: Path) -> Any:
    """Return what is kept of a file, by its ending."""
    kind = file.suffix
    if kind == ".json":
        return json_digest(json.loads(file.read_text("utf-8")), folder)
    if kind in (".h5", ".mat"):
        return _columns_of(file)
    if kind == ".html":
        return text_lines(visible_text(file.read_text("utf-8")), folder)
    return text_lines(file.read_text("utf-8", errors="replace"), folder)


def json_digest(value: Any, folder: Path, key: str = "", short: bool = False) -> Any:
    """Return a value of a JSON file, folded; `short` inside of the evidence."""
    if isinstance(value, dict):
        inside = short or key == "evidence"
        return {k: json_digest(v, folder, k, inside) for k, v in value.items() if k not in DROPPED}
    if isinstance(value, list):
        return _list_digest(value, folder, key, short)
    if isinstance(value, str):
        if len(value) > LONG_TEXT and "\n" in value:
            return "<text>"
        return "\n".join(text_lines(value, folder))
    return _rounded(value, EVIDENCE_DIGITS if short else DIGITS)


def _list_digest(value: list[Any], folder: Path, key: str, short: bool) -> Any:
    if value and _is_numbers(value) and (short or len(value) > FEW):
        return folded(value)
    if key == "covariance" and value:
        return correlations(value)
    if len(value) > 2 and all(isinstance(row, list) and _is_numbers(row) for row in value):
        return folded([x for row in value for x in row])
    if len(value) > FEW and all(isinstance(row, dict) for row in value):
        keys = sorted({k for row in value for k in row})
        columns = {k: [row.get(k) for row in value] for k in keys}
        return {"#": len(value)} | {k: folded(c) for k, c in columns.items() if _is_numbers(c)}
    return [json_digest(v, folder, key, short) for v in value]


def _is_numbers(values: list[Any]) -> bool:
    return all(
        v is None or (isinstance(v, int | float) and not isinstance(v, bool)) for v in values
    )


def folded(values: list[float | None]) -> dict[str, Any]:
    """Return length and Euclidean norm of a column, and how many are missing."""
    numbers = [float(v) for v in values if v is not None]
    found = {"#": len(values), "about": _rounded(math.hypot(*numbers), EVIDENCE_DIGITS)}
    return found | ({"none": len(values) - len(numbers)} if len(numbers) < len(values) else {})


def correlations(matrix: list[list[float]]) -> dict[str, Any]:
    """Return a number for each row of a covariance: its correlations, weighted by their place."""
    whole = np.array(matrix, dtype=float)
    std = np.sqrt(np.abs(np.diagonal(whole)))
    std[std == 0] = 1.0
    rows = (whole / np.outer(std, std)) @ np.arange(1, len(whole) + 1)
    return {"#": len(whole), "correlated": [_rounded(row, 9) for row in rows.tolist()]}


def _rounded(value: Any, digits: int) -> Any:
    if not isinstance(value, float):
        return value
    return float(f"{value:.{digits}g}") if math.isfinite(value) else repr(value)


def _columns_of(file: Path) -> dict[str, Any]:
    """Return shape and norm of every array of an HDF5 or MAT file, and what it says of itself."""
    found: dict[str, Any] = {}
    if file.suffix == ".mat":
        import scipy.io

        for name, values in scipy.io.loadmat(file).items():
            if not name.startswith("__"):
                found[name] = _array_digest(np.asarray(values))
        return found
    import h5py

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            found[name] = _array_digest(item[()])
        for key, value in item.attrs.items():
            if key not in DROPPED:
                found[f"{name}@{key}"] = _array_digest(np.asarray(value))

    with h5py.File(file) as data:
        visit("", data)
        data.visititems(visit)
    return found


def _array_digest(values: Any) -> Any:
    values = np.asarray(values)
    if values.dtype.kind not in "fiucb":
        text = str(values.tolist())
        return "<text>" if len(text) > LONG_TEXT else text
    numbers = values.astype(complex if values.dtype.kind == "c" else float)
    return {"#": list(values.shape), "norm": _rounded(float(np.linalg.norm(numbers)), DIGITS)}


class _Visible(HTMLParser):
    """The text of a page that a reader sees, pictures aside."""

    HIDDEN = ("script", "style", "svg")

    def __init__(self) -> None:
        super().__init__()
        self.depth, self.lines = 0, list[str]()

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.depth += tag in self.HIDDEN

    def handle_endtag(self, tag: str) -> None:
        self.depth -= tag in self.HIDDEN

    def handle_data(self, data: str) -> None:
        if not self.depth and data.strip():
            self.lines.append(" ".join(data.split()))


def visible_text(page: str) -> str:
    """Return what a reader sees of a page."""
    parser = _Visible()
    parser.feed(page)
    return "\n".join(parser.lines)
