"""Score answers: accuracy against the bound, cover, time, memory; as a table in Markdown.

    python benchmarks/peers/score.py OUT

OUT/sealed/NNNN.json holds the truth and the bound, OUT/answers/ENTRANT/NNNN.json an answer:
{"parameters": {name: SI}, "std": {...}, "seconds": s, "peak_mb": MB}; instead of parameters
"frequencies_hz" or "cannot"; with "doubt" where the entrant itself doubts. An answer is lost where
a mass, an inertia, a stiffness or a length is off by half of it: it counts in no other figure.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from common import NAMES, frequencies

PHYSICAL = NAMES[:9]
NORMAL = 1.959964
BAND = 20.0, 300.0  # Hz, of the natural frequencies compared


def read(folder: Path) -> dict[str, dict[str, Any]]:
    return {path.stem: json.loads(path.read_text("utf-8")) for path in sorted(folder.iterdir())}


def frequency_errors(answer: dict[str, Any], sealed: dict[str, Any]) -> np.ndarray:
    """Return the errors in percent of the frequency nearest to each true one in the band."""
    speed = sealed["speed_rad_s"]
    true = frequencies(sealed["truth"], speed)
    true = true[(true > BAND[0]) & (true < BAND[1])]
    found = answer.get("frequencies_hz") or frequencies(answer["parameters"], speed)
    return 100 * (np.abs(np.subtract.outer(true, found)).min(axis=1) / true)


def lost(found: dict[str, float] | None, truth: dict[str, float]) -> bool:
    return found is not None and any(abs(found[n] / truth[n] - 1) > 0.5 for n in PHYSICAL)


def rms(each: Any, axis: int | None = None) -> Any:
    return np.sqrt(np.mean(np.square(each), axis=axis))


def score(answers: dict[str, dict], sealed: dict[str, dict]) -> dict[str, Any]:
    """Return what an entrant's answers come to; a case without an answer counts as unanswered."""
    given = {n: a for n, a in answers.items() if "cannot" not in a}
    astray = {n for n, a in given.items() if lost(a.get("parameters"), sealed[n]["truth"])}
    kept = {n: a for n, a in given.items() if n not in astray}
    told = {
        "answered": len(given),
        "doubted": sum("doubt" in a for a in given.values()),
        "lost": len(astray),
        "lost unsaid": sum("doubt" not in given[n] for n in astray),
        "cannot": sorted({a["cannot"] for a in answers.values() if "cannot" in a}),
    }
    if kept:
        told["ms"] = 1e3 * float(np.median([a["seconds"] for a in given.values()]))
        told["peak MB"] = max(a["peak_mb"] for a in given.values())
        off = np.concatenate([frequency_errors(a, sealed[n]) for n, a in kept.items()])
        told["frequency %"] = float(rms(off))
    if some := [n for n, a in kept.items() if "parameters" in a]:
        free = list(sealed[some[0]]["bound"])  # not what is known

        def of(rows: list[dict[str, float]]) -> np.ndarray:
            return np.array([[row.get(name, np.nan) for name in free] for row in rows])

        error = of([kept[n]["parameters"] for n in some]) - of([sealed[n]["truth"] for n in some])
        scaled = error / of([sealed[n]["bound"] for n in some])
        std = of([kept[n].get("std", {}) for n in some])
        told["rms/bound"] = dict(zip(free, rms(scaled, axis=0).tolist(), strict=True))
        told["rms/bound, all"] = float(rms(scaled))
        if np.isfinite(std).all():
            told["cover %"] = 100 * float((np.abs(error) < NORMAL * std).mean())
    return told


ROWS = dict.fromkeys(("answered", "doubted", "lost", "lost unsaid"), "d")
ROWS |= {"rms/bound, all": ".2f", "cover %": ".1f", "frequency %": ".2g", "ms": ".0f"}
ROWS |= {"ratio": ".2f", "peak MB": ".0f"}


def table(scores: dict[str, dict[str, Any]]) -> str:
    """Return a column for each entrant, a row for each figure."""
    ours = scores.get("rotorid", {}).get("ms")
    rows = [["", *scores], ["---"] * (len(scores) + 1)]
    for each in scores.values():
        if ours and "ms" in each:
            each["ratio"] = each["ms"] / ours
    for row, form in ROWS.items():
        rows.append([row, *(format(e[row], form) if row in e else "" for e in scores.values())])
    for name in NAMES:
        cells = (e.get("rms/bound", {}).get(name) for e in scores.values())
        rows.append([name, *("" if cell is None else f"{cell:.2f}" for cell in cells)])
    text = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    cannot = [f"{name}: {told}" for name, e in scores.items() for told in e["cannot"]]
    return "\n".join([text, "", *cannot])


def main(out: Path) -> None:
    sealed = read(out / "sealed")
    entrants = sorted((out / "answers").iterdir())
    scores = {folder.name: score(read(folder), sealed) for folder in entrants}
    (out / "scores.json").write_text(json.dumps(scores, indent=1), "utf-8")
    print(table(scores))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
