"""Study files: what varies, and the cases that follow, each made when it is asked for."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence, Set
from contextlib import suppress
from copy import deepcopy
from functools import cached_property
from glob import glob
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import tomlkit
from pydantic import Field, JsonValue, StrictInt, model_validator

from rotorid.core.errors import InputError, naming
from rotorid.core.frozen import frozen
from rotorid.core.toml import Schema, parse_table, parse_toml, read_toml, shipped, si
from rotorid.core.units import number_and_unit, si_factor, to_si
from rotorid.rig.faults import find_fault
from rotorid.rig.file import LIBRARY, RigFile, load_rig
from rotorid.studies.drawn_lines import require_lines
from rotorid.studies.study_case import ABSENT, DATED, Place, StudyCase, changed, found, moved

CHECKED = 100
"""Points of the grid whose rig files are held against their schema before anything runs."""
_SPREAD, _BETWEEN = {"spread"}, {"from", "to"}
_EXPERIMENT, _FAULTS, _LABEL = ("experiment",), ("faults",), ("label",)
"""Places that no rig file has: of the experiment file that a rig writes, faults, a name."""
_NAMING = {*_EXPERIMENT, *DATED, "file", "files"}
_MEASURED = {*DATED, "records", "channels"}
"""Last keys of what names a machine or its record, and first ones of how it was measured."""


class StudyFile(Schema):
    """A study file.

    ``rig``: simulated records, with ``experiment`` in place of the file that the rig writes;
    ``experiments``: measured ones, paths with ``*``. ``vary`` holds places of the rig file (of the
    experiment files), each with a value, a list, which makes a grid, or what it is drawn from:
    ``{ spread = "10 %" }`` or ``{ from = .., to = .. }``. ``variants`` are tables of such places
    that change together. ``noise`` of a rig is drawn on its samples or on the lines alone.
    """

    rig: str | None = None
    experiment: str | None = None
    experiments: Annotated[list[str] | None, Field(min_length=1)] = None
    cases: Annotated[StrictInt | None, Field(ge=1, le=10**9)] = None
    seed: Annotated[StrictInt, Field(ge=0)] = 0
    timeout: Annotated[float, si("s"), Field(gt=0, le=1e6)] = 600.0
    noise: Literal["samples", "lines"] = "samples"
    vary: dict[str, JsonValue] = Field(default_factory=dict)
    variants: list[dict[str, JsonValue]] = Field(default_factory=list)

    @model_validator(mode="after")
    def _one_source(self) -> StudyFile:
        given = self.model_fields_set & {"rig", "experiment", "experiments"}
        if not given or (len(given) > 1 and "experiments" in given):
            raise InputError(
                " and ".join(sorted(given)) or "no source of records",
                "a rig, with an experiment or without, or experiments",
                'write rig = "three-mass", or experiments = ["fleet/*.toml"]',
            )
        if self.noise == "lines" and self.rig is None:
            found, cure = 'noise = "lines" of measured records', "remove it, or name a rig"
            raise InputError(found, "a rig, whose noise is drawn", cure)
        return self


class Choice(NamedTuple):
    label: str  # what tells it from the others of its axis
    values: dict[Place, Any]


@frozen
class StudyPlan:
    """A study: the grid, and how each case follows from its number."""

    folder: Path
    entry: StudyFile
    paths: tuple[str, ...]  # of measured experiments, or of the one beside a rig
    table: dict[str, Any]  # of the rig, without which it is empty
    axes: tuple[list[Choice], ...]

    @property
    def points(self) -> int:
        """How many points the grid has; cases take them in turn."""
        return math.prod(len(axis) for axis in self.axes)

    def __len__(self) -> int:
        return self.entry.cases or self.points

    @property
    def identity(self) -> str:
        """What results in one folder must agree in: all but how many cases, and for how long."""
        said = self.entry.model_dump(mode="json", exclude={"cases", "timeout"})
        return json.dumps({"study": said, "files": self.paths, "rig": self.table}, indent=1)

    def choices(self, number: int) -> list[Choice]:
        """Return where a case stands on each axis; the last one varies fastest."""
        at = np.unravel_index(number % self.points, [len(axis) for axis in self.axes])
        return [axis[k] for axis, k in zip(self.axes, at, strict=True)]

    def label(self, point: int) -> str:
        """Return where a point stands on each axis."""
        return ", ".join(filter(None, (choice.label for choice in self.choices(point))))

    def fleet(self, point: int) -> str:
        """Return that without what a machine is, beside its name, and how it was measured."""
        told = list[str]()
        for label, values in self.choices(point):
            if _NAMING.isdisjoint(place[-1] for place in values):
                told.append(label)
                continue
            for place, value in values.items():
                inside = place[1:] if place[:1] == _EXPERIMENT else place * (not self.table)
                told += [f"{place[-1]} = {value}"] * (not _MEASURED.issuperset(inside[:1]))
        return ", ".join(filter(None, told))

    @cached_property
    def _texts(self) -> Set[Place]:
        """Places whose columns are texts: one value there is none of a quantity, or a name."""
        every = (pair for axis in self.axes for choice in axis for pair in choice.values.items())
        told = ((place, said) for place, said in every if not _is_drawn(said))
        return {p for p, said in told if p[-1] in DATED or isinstance(_told(said), str)}

    def case(self, number: int) -> StudyCase:
        """Return the case of a number: its files, with what is drawn for it, and its seed."""
        drawing, noise = np.random.SeedSequence(self.entry.seed, spawn_key=(number,)).spawn(2)
        rng, rig = np.random.default_rng(drawing), deepcopy(self.table)
        settings, changes, faults = dict[str, Any](), list[tuple[Place, Any]](), list[str]()
        path = self.paths[0] if self.paths else ""
        for place, said in (pair for c in self.choices(number) for pair in c.values.items()):
            with naming(place=".".join(("vary", *place))):
                value: Any = _drawn(said, rig, place, rng) if _is_drawn(said) else said
                if place == _EXPERIMENT:
                    path = value
                elif place == _FAULTS:
                    faults = list(map(str, value if isinstance(value, list) else [value]))
                elif not rig or place[:1] == _EXPERIMENT:
                    inside = place[1:] if rig else place
                    changes.append((inside, moved(value, self.folder, place[-1])))
                else:
                    changed(rig, place, value)
            tell = _text if place in self._texts else _told
            settings[".".join(("vary", *place))] = tell(value)
        return StudyCase(
            number=number,
            point=number % self.points,
            seed=int(noise.generate_state(1, np.uint64)[0] >> np.uint64(1)),
            settings=settings,
            rig=rig,
            faults=faults,
            experiment=str((self.folder / path).resolve()) if path else "",
            changes=changes,
            noise=self.entry.noise,
            timeout=self.entry.timeout,
        )


def load_study(path: str | Path) -> StudyPlan:
    """Read a study file, and the rig file or the names of the experiment files in it."""
    entry, folder, table = read_toml(path, StudyFile), Path(path).parent, dict[str, Any]()
    with naming(str(path)):
        if entry.rig is not None:
            table = _rig_table(entry.rig if entry.rig in shipped(LIBRARY) else folder / entry.rig)
        globs = entry.experiments or filter(None, [entry.experiment])
        paths = tuple(name for pattern in globs for name in _matches(folder, pattern))
        plan = StudyPlan(folder, entry, paths, table, tuple(_axes(entry, paths)))
        for number in range(min(plan.points, len(plan), CHECKED)):
            case = plan.case(number)
            if table:
                parse_toml(tomlkit.dumps(case.rig).encode(), RigFile)
            list(map(find_fault, case.faults))  # refuses one that is unknown
            if case.noise == "lines":
                require_lines(case.plan.rig)
            if case.changes:
                case.check()
    return plan


def _rig_table(name: str | Path) -> dict[str, Any]:
    """Return a rig file as a table, with all its parameters, and a model found from anywhere."""
    plan = load_rig(name)
    units = plan.rig.model.parameter_units
    told = {name: f"{value!r} {units[name]}" for name, value in plan.rig.values.items()}
    return {**parse_table(plan.text.encode()), "model": plan.model, "parameters": told}


def _matches(folder: Path, pattern: str) -> list[str]:
    paths = sorted(glob(pattern, root_dir=folder, recursive=True))
    if not paths:
        cure = "paths are relative to the study file; check this one"
        raise InputError(f"no file {pattern[:60]!r}", "experiment files", cure, place="experiments")
    return paths


def _axes(entry: StudyFile, paths: Sequence[str]) -> Iterator[list[Choice]]:
    """Yield the axes of the grid: files, variants, and every list."""
    if len(paths) > 1:
        yield [Choice(path, {_EXPERIMENT: path}) for path in paths]
    if tables := [dict(_leaves(variant)) for variant in entry.variants]:
        labels = [str(t.pop(_LABEL, f"variant {k}")) for k, t in enumerate(tables, start=1)]
        yield [Choice(*each) for each in zip(labels, tables, strict=True)]
    for place, said in _leaves(entry.vary):
        several = said if isinstance(said, list) else [said]
        if not several:
            cure = "remove it, or write [[]] for a list without members"
            raise InputError("an empty grid", "values", cure, place=".".join(("vary", *place)))
        one = len(several) == 1
        yield [Choice("" if one else f"{place[-1]} = {v}", {place: v}) for v in several]


def _leaves(tree: dict[str, Any], place: Place = ()) -> Iterator[tuple[Place, Any]]:
    for key, value in tree.items():
        if isinstance(value, dict) and value and not _is_drawn(value):
            yield from _leaves(value, (*place, key))
        else:
            yield (*place, key), value


def _is_drawn(value: object) -> bool:
    return isinstance(value, dict) and value.keys() in (_SPREAD, _BETWEEN)


def _drawn(said: dict[str, Any], table: Any, place: Place, rng: np.random.Generator) -> str | float:
    """Draw a quantity in the unit in which it is written: normal about the file's, or uniform."""
    if "spread" in said:
        number, unit = _quantity(found(table, place))
        if not 0 <= (spread := to_si(said["spread"], "1")) <= 1:
            raise InputError(f"a spread of {said['spread']}", "0 to 100 %", 'write "5 %"')
        number *= 1 + spread * rng.standard_normal()
    else:
        (low, unit), (high, other) = map(_quantity, (said["from"], said["to"]))
        high *= si_factor(other, unit)
        if not 0 <= high - low < math.inf:
            raise InputError(str(said), "a range", "write the lower limit in from")
        number = rng.uniform(low, high)
    return number if unit == "1" else f"{number!r} {unit}"


def _quantity(value: object) -> tuple[float, str]:
    if (written := number_and_unit(value)) is None:
        cure = 'write { spread = "10 %" } about a quantity, or { from = "1 um", to = "3 um" }'
        raise InputError(repr(value)[:60], "a quantity to draw from or about", cure)
    return float(written[0]), written[1] or "1"


def _told(value: object) -> float | str | None:
    """Return a setting as a column of quantities has it: in SI, or as a text what is none."""
    with suppress(InputError):
        if (written := number_and_unit(value)) is not None:
            return float(written[0]) * si_factor(written[1] or "1")
    return _text(value)


def _text(value: object) -> str | None:
    return None if value == ABSENT else value if isinstance(value, str) else json.dumps(value)
