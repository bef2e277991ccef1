"""A case of a study, and the process of its own in which it runs.

    python -m rotorid.studies.study_case

takes a case and a folder per line of its standard input (JSON), and answers with the row of its
result. What is not done within the time limit of a case ends the process, wherever its work hangs.
"""

from __future__ import annotations

import faulthandler
import json
import math
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, replace
from functools import cached_property, lru_cache, partial
from hashlib import blake2b
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tomlkit

from rotorid.answer.estimate import Estimate
from rotorid.core.distributions import HALF_WIDTH
from rotorid.core.errors import LINE, InputError, one_line
from rotorid.core.frozen import frozen
from rotorid.core.toml import parse_table, read_bytes
from rotorid.experiment import Experiment, load_experiment
from rotorid.experiment.duplicates import used
from rotorid.models import Model
from rotorid.models.equations import polynomial
from rotorid.rig.file import RigPlan, parse_rig
from rotorid.rig.files import experiment_text, record_bytes
from rotorid.rig.logger import Logged
from rotorid.studies.drawn_lines import DrawnLines

Row = dict[str, Any]
Place = tuple[str, ...]
"""Where in a file a value stands: keys from the outside in, numbers in lists, `*` for all there."""
Change = tuple[Place, Any]

ABSENT = "absent"
"""The value that takes a key away."""
ENDS = ("", "_std", "_true", "_covered")
"""Of the names of the columns that each parameter has."""
DATED = ("serial", "date")
"""Keys of an experiment file that say which machine it is of, and when: columns where they do."""
MACHINE = (*DATED, "model", "record")
"""These, and of a machine the meaning of its parameters, and the data that tell them."""
FAILED = "failed"
"""Status and verdict of a case that ended with an error."""
STOPPED = "stopped"
"""Verdict of a failed case that the machine ended: time, memory, disk, or somebody."""
PREPARED = 64
"""Points of a grid whose rigs without noise a process keeps: cases take them in turn."""


def found(table: Any, place: Place) -> Any:
    """Return the value at a place of a table that is read from a file."""
    for key in place:
        try:
            table = table[int(key) if isinstance(table, list) else key]
        except (KeyError, IndexError, TypeError, ValueError):
            cure = "name what is there; a spread is about a value of the rig file"
            raise InputError(f"no {key} there", "a value to change", cure) from None
    return table


def changed(table: Any, place: Place, value: Any) -> None:
    """Put a value at a place of such a table; tables on the way to it are added."""
    key, rest = place[0], place[1:]
    if key == "*":
        for each in range(len(table)) if isinstance(table, list) else list(table):
            changed(table, (str(each), *rest), value)
    elif rest:
        if isinstance(table, dict):
            table.setdefault(key, {})
        changed(found(table, (key,)), rest, value)
    elif isinstance(table, dict):
        table[key] = value
        if value == ABSENT:
            del table[key]
    else:
        found(table, (key,))  # refuses what is neither
        table[int(key)] = value


@frozen
class StudyCase:
    """A record, simulated or measured, to be identified; all fields are as JSON has them."""

    number: int
    point: int  # of the grid
    seed: int  # of the noise
    settings: Row  # what varies, in SI, by the name of its column
    rig: Row  # a rig file as a table; empty where records are measured
    faults: list[str]
    experiment: str  # path; empty where the rig's own is taken
    changes: list[Change]  # of the experiment file
    noise: Literal["samples", "lines"]  # what it is drawn on
    timeout: float  # s

    @cached_property
    def plan(self) -> RigPlan:
        return parse_rig(tomlkit.dumps(self.rig), file="rig.toml").with_faults(self.faults)

    @property
    def lines(self) -> DrawnLines:
        """What the lines are drawn from: the same for cases that differ by their seeds alone."""
        alike = replace(self, number=0, point=0, seed=0, settings={})
        return _prepared(json.dumps(asdict(alike)))

    def write(self, folder: Path, record: Logged | None = None) -> Path:
        """Write the files of the case, or of a record of its rig; return its experiment file."""
        if self.experiment:
            data = read_bytes(self.experiment)
            table = moved(parse_table(data, file=self.experiment), Path(self.experiment).parent)
        if self.rig:
            record = record or self.plan.record(self.seed)
            (folder / "rig.toml").write_text(self.plan.text, encoding="utf-8")
            # Without the true motion, which takes longer to write than the rig to run.
            content = record_bytes(replace(record, truth=None))  # type: ignore[arg-type]
            (folder / "run.h5").write_bytes(content)
            if self.experiment:
                changed(table, ("records", "*", "file"), "run.h5")
            else:
                table = parse_table(experiment_text(self.plan, record, "run.h5").encode())
        for place, value in self.changes:
            changed(table, tuple(place), value)
        target = folder / ("run.toml" if self.rig else Path(self.experiment).name)
        target.write_text(tomlkit.dumps(table), encoding="utf-8")
        return target

    def check(self) -> None:
        """Refuse changes with which an experiment file is none, before anything runs.

        A file, or a rig, that is none without them fails by itself, and leaves the others alone.
        """
        short = self.rig and {**self.rig, "duration": "1 ms", "settling": "0 s"}
        case = replace(self, rig=short)  # whose samples nobody reads
        if (fault := case._fault) and not replace(case, changes=[])._fault:
            place = ".".join(filter(None, ("experiment" * bool(self.rig), fault.place)))
            raise InputError(fault.found, fault.expected, fault.cure, place=place)

    @property
    def _fault(self) -> InputError | None:
        """What is wrong with the experiment file, as far as its records need not be read."""
        with tempfile.TemporaryDirectory() as folder:
            try:
                load_experiment(self.write(Path(folder)))
            except InputError as error:
                return error
        return None

    def row(self, status: str, seconds: float, **said: Any) -> Row:
        """Return the columns that a case has whatever became of it."""
        head = {"case": self.number, "point": self.point, "seed": self.seed, "status": status}
        rest = {"verdict": status, "p_value": None, "seconds": seconds, "error": None}
        return {**head, **rest, **said, **self.settings}

    def _origin(self, experiment: Experiment) -> Row:
        """Return digests of what the parameters mean, and of the data that tell them."""
        model, plans = experiment.model, () if self.rig else experiment.channels
        meaning = blake2b(repr((model.texts, model.parameter_units)).encode(), digest_size=4)
        record = json.dumps([each for plan in plans for each in used(plan)])
        return {"model": meaning.hexdigest(), "record": record}

    def run(self) -> Row:
        """Identify: a row of the answer, or of the error."""
        begun = time.perf_counter()
        stated: Row = {}
        with tempfile.TemporaryDirectory() as folder:
            try:
                identify: Callable[[], Estimate]
                if self.noise == "lines":
                    lines, begun = self.lines, time.perf_counter()
                    experiment, rng = lines.experiment, np.random.default_rng(self.seed)
                    identify = partial(lines.identify, rng)
                else:
                    path = self.write(Path(folder))
                    begun = time.perf_counter()  # to simulate is no part of it
                    experiment = load_experiment(path)
                    identify = experiment.identify
                said = {key: getattr(experiment.entry, key) for key in DATED}
                stated = {key: str(value) for key, value in said.items() if value is not None}
                estimate = identify()
                seconds = time.perf_counter() - begun
                if "serial" in stated:
                    stated |= self._origin(experiment)
                truth = self.plan.rig.as_described.values if self.rig else {}
                values = _values(estimate, truth, experiment.model)
                if taken := values.keys() & {*self.row("", 0.0), *MACHINE}:
                    raise _taken(min(taken))
            except Exception as error:
                kind = "" if isinstance(error, InputError) else f"{type(error).__name__}: "
                told = one_line(f"{kind}{error}".replace(f"{folder}{os.sep}", ""), LINE)
                verdict = STOPPED if isinstance(error, (MemoryError, OSError)) else FAILED
                seconds = time.perf_counter() - begun
                return self.row(FAILED, seconds, verdict=verdict, error=told, **stated)
        p_value = None if estimate.misfit is None else estimate.misfit.p_value
        said = {"verdict": estimate.verdict, "p_value": p_value, **stated}
        return {**self.row(estimate.status, seconds, **said), **values}


@lru_cache(PREPARED)
def _prepared(said: str) -> DrawnLines:
    case = StudyCase(**json.loads(said))
    with tempfile.TemporaryDirectory() as folder:
        try:
            return DrawnLines.of(case.plan, partial(case.write, Path(folder)))
        except InputError as error:
            error.file = Path(error.file).name  # the same, whatever the folder
            raise


def moved(value: Any, folder: Path, key: str = "") -> Any:
    """Return what a file says, with whole paths of the files that it names."""
    if isinstance(value, dict):
        return {key: moved(inner, folder, key) for key, inner in value.items()}
    if isinstance(value, list):
        return [moved(inner, folder, key) for inner in value]
    named = key in ("model", "file", "files", "quiet", "table") and isinstance(value, str)
    return str((folder / value).resolve()) if named and (folder / value).is_file() else value


def _values(estimate: Estimate, truth: Mapping[str, float], model: Model) -> Row:
    row: Row = {}
    for value in (each for each in estimate.parameters if not each.fixed):
        reach = HALF_WIDTH * (math.nan if value.std is None else value.std)
        low, high = value.interval or (value.value - reach, value.value + reach)
        true = _true(value.name, truth, model)
        known = not math.isnan(low + true)
        said = value.value, value.std, true, low <= true <= high if known else None
        own = dict(zip((value.name + end for end in ENDS), said, strict=True))
        own[f"{value.name}_std_assumed"] = value.std_assumed
        if row.keys() & own.keys():
            raise _taken(min(row.keys() & own.keys()))
        row |= own
    return row


def _taken(name: str) -> InputError:
    found = f"a parameter with the column {name}, which another has"
    return InputError(found, "a column of its own", "rename it in the model")


def _true(name: str, truth: Mapping[str, float], model: Model) -> float:
    """Return the true value of a parameter or a base parameter; NaN where nobody knows it."""
    values = [truth.get(each, math.nan) for each in model.parameter_names]
    terms = polynomial(name.partition("[")[0], model.parameter_names).items()
    return sum(float(f) * math.prod(map(pow, values, powers)) for powers, f in terms)


def main() -> None:
    """Answer each case of the standard input; what libraries print goes nowhere."""
    answers, nowhere = os.fdopen(os.dup(1), "w"), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    folder = ""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"), suppress(BrokenPipeError):
        for line in sys.stdin:
            said, folder = json.loads(line)
            case, tempfile.tempdir = StudyCase(**said), folder
            faulthandler.dump_traceback_later(case.timeout, exit=True, file=nowhere)
            row = case.run()
            faulthandler.cancel_dump_traceback_later()
            print(json.dumps(row), file=answers, flush=True)
    shutil.rmtree(folder, ignore_errors=True)  # whoever gave it may have been killed


if __name__ == "__main__":
    main()
