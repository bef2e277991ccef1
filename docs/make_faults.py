"""Run every fault of the levitated rig through `simulate` and `identify`; write docs/faults.md.

    python docs/make_faults.py [--runs N] [--jobs N] [FAULT ...]

With names of faults it runs these again and leaves the other rows of the page as they are.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from rotorid.cli import run
from rotorid.rig.faults import FAULTS, Fault

PAGE = Path(__file__).parent / "faults.md"
FIRST = 3  # suspects that a reader looks at
WRONG = 5.0  # deviations; the largest of ten right ones is beyond 4 in one record of 1600
PAIRS = (("xi", "zeta"), ("mu", "eta"))  # directions, x and y, of the shipped models' unbalance

HEAD = """# Faults, and what `identify` says of them

Faults of machines and loggers that an experiment file does not mention. `rotorid simulate RIG
--fault NAME[=SIZE]` simulates a record with one fault or several, and `rotorid simulate --faults`
lists them. A fault acts inside the closed loop where it does so in a machine; the experiment file
is that of the faultless rig. A new fault is one entry in `rotorid/rig/faults.py`.

`python docs/make_faults.py` writes this page: {runs} records of each fault, at the size and of the
shipped rig in the table, identified by the default method. *Error* is the largest error of a
physical parameter in units of its stated std. *Wanted*: `right`, the answer is within its std;
`warned`, it is so and a warning names the fault; `rejected`, the answer is rejected or the record
refused, and the fault is among the first {first} possible causes or in a message. *Answer*:

- right: `ok`, no parameter off by more than {wrong:g} std
- said: right, and the fault is named
- named: rejected or refused, and the fault is named
- not named: rejected, or refused, for other reasons
- **wrong**: `ok`, and a parameter off by more than {wrong:g} std

{summary}

| fault | what | size | rig | wanted | answer | status | error | first named |
|---|---|---|---|---|---|---|---|---|
"""


@dataclass(frozen=True)
class Answer:
    """What `identify` said of one record."""

    fault: str
    status: str
    error: float
    worst: str
    said: tuple[str, ...]
    kind: str


def truth_of(path: Path, fault: Fault) -> dict[str, float]:
    """Return the parameters of a record; directions as they count from the mark."""
    with h5py.File(path) as data:
        found = {name: float(value) for name, value in data["truth/parameters"].attrs.items()}
    if fault.turns:
        for x, y in PAIRS:
            both = (found[x] + 1j * found[y]) * np.exp(1j * fault.size)
            found[x], found[y] = both.real, both.imag
    return found


def answer_of(name: str, seed: int) -> Answer:
    """Simulate a fault, identify the record, and judge the answer."""
    fault = FAULTS[name]
    with tempfile.TemporaryDirectory() as folder:
        out, result = Path(folder) / "run.h5", Path(folder) / "result.json"
        said, errors = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(errors):
            made = ["simulate", fault.rig, "--out", str(out), "--seed", str(seed)]
            if run([*made, "--fault", name]) != 0:
                return Answer(name, "no record", np.nan, "", (errors.getvalue().strip(),), "none")
            code = run(["identify", str(out.with_suffix(".toml")), "--json", str(result)])
        if code == 2:
            message = errors.getvalue().strip().removeprefix("error: ")
            named = any(word.lower() in message.lower() for word in fault.names)
            kind = "named" if named else "not named"
            return Answer(name, "refused", np.nan, "", (message.replace(f"{folder}/", ""),), kind)
        return judge(fault, json.loads(result.read_text()), truth_of(out, fault))


def judge(fault: Fault, found: dict, truth: dict[str, float]) -> Answer:
    """Hold an estimate against the truth, and its words against the fault's name."""
    off = {
        p["name"]: abs(p["value"] - truth[p["name"]]) / p["std"]
        for p in found["parameters"]
        if p["name"] in truth and not p["fixed"] and p["std"]
    }
    worst = max(off, key=lambda name: off[name], default="")
    error = off.get(worst, np.nan)
    terms = [suspect["term"] for suspect in found["suspects"][:FIRST]]
    checks = [
        f"{c['check']} {c['channel'] or ''}: {c['found']}"
        for c in found.get("checks", ())
        if c["verdict"] in ("warning", "refused")
    ]
    words = [*checks, *found["warnings"]]
    named = any(
        any(term.startswith(name) for term in terms)
        or any(name.lower() in text.lower() for text in words)
        for name in fault.names
    )
    if found["status"] == "ok":
        kind = "wrong" if error > WRONG else "said" if named else "right"
    else:
        kind = "named" if named else "not named"
    return Answer(fault.name, found["status"], error, worst, (*terms, *words), kind)


def good(wanted: str, kind: str) -> bool:
    """Whether an answer is what is wanted of it: being right is always enough."""
    return kind in {"right": ("right", "said"), "warned": ("said", "named", "right")}.get(
        wanted, ("right", "said", "named")
    )


def row(fault: Fault, answers: list[Answer]) -> str:
    """Return a row of the table: the worst of the answers stands for all."""
    order = ("wrong", "none", "not named", "named", "said", "right")
    worst = min(answers, key=lambda a: (order.index(a.kind), -np.nan_to_num(a.error)))
    error = "" if np.isnan(worst.error) else f"{worst.error:.3g}"
    said = "; ".join(text.replace("|", "/")[:70] for text in worst.said[:2])
    kind = f"**{worst.kind}**" if worst.kind == "wrong" else worst.kind
    cells = (fault.name, fault.what, fault.shown, fault.rig, fault.wanted, kind, worst.status)
    return "| " + " | ".join((*cells, error, said)) + " |"


def table(names: list[str], runs: int, jobs: int) -> dict[str, list[Answer]]:
    """Return the answers to some faults, so many records of each."""
    tasks = [(name, seed) for name in names for seed in range(1, runs + 1)]
    found: dict[str, list[Answer]] = {name: [] for name in names}
    with ProcessPoolExecutor(jobs) as pool:
        for answer in pool.map(answer_of, *zip(*tasks, strict=True)):
            found[answer.fault].append(answer)
            print(answer.fault, answer.kind, answer.status, f"{answer.error:.3g}", answer.said[:3])
    return found


def cells_of(line: str) -> list[str]:
    """Return the cells of a row."""
    return [cell.strip() for cell in line.split("|")[1:-1]]


def page_rows() -> dict[str, str]:
    """Return the rows of the page as it is, by fault."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    return {cells_of(x)[0]: x for x in lines if x.startswith("| ") and cells_of(x)[0] in FAULTS}


def summary(rows: dict[str, str]) -> str:
    """Say how many faults there are of each answer, and how many of them matter."""
    kinds = {name: cells_of(line)[5].strip("*") for name, line in rows.items()}
    counts = ", ".join(
        f"{list(kinds.values()).count(kind)} {kind}" for kind in dict.fromkeys(kinds.values())
    )
    refused = [name for name, line in rows.items() if cells_of(line)[6] == "refused"]
    far = [n for n, line in rows.items() if float(cells_of(line)[7] or 0) > WRONG]
    named = sum(kinds[name] == "named" for name in (*refused, *far))
    return (
        f"Of {len(rows)} faults, the worst answer of each: {counts}. {len(refused)} are refused "
        f"and {len(far)} move some parameter by more than {WRONG:g} deviations in that answer, "
        f"were it believed; {named} of these {len(refused) + len(far)} are named."
    )


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("faults", nargs="*", default=[], metavar="FAULT")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    names = options.faults or list(FAULTS)
    found = table(names, options.runs, options.jobs)
    kept = page_rows() if options.faults else {}
    rows = {**kept, **{name: row(FAULTS[name], answers) for name, answers in found.items()}}
    rows = {name: rows[name] for name in FAULTS if name in rows}
    head = HEAD.format(runs=options.runs, first=FIRST, wrong=WRONG, summary=summary(rows))
    PAGE.write_text(head + "\n".join(rows.values()) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
