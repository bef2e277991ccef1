"""What a study found: accuracy against what was stated, verdicts, times, and the worst cases."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from rotorid.answer.estimate import ERR, assuming_table
from rotorid.core.files import write_whole
from rotorid.core.frozen import frozen
from rotorid.core.tables import Page, Table, table
from rotorid.core.values import Floats, grouped
from rotorid.core.watch import counting, watch
from rotorid.report.html import Passage, page_of
from rotorid.report.records import cell
from rotorid.studies.fleet import FleetParameter, FleetResult, fleet_parameter
from rotorid.studies.plan import StudyPlan
from rotorid.studies.store import check_folder, read_rows
from rotorid.studies.study_case import ENDS, FAILED, Row

WORST = 3  # cases whose files are written for a closer look, and errors that are told
_SAID = (
    "Errors are those of the answers with status ok, in SI. std: root of the mean of the variances "
    "that they state; cover: share of 95 % intervals that contain the true value."
)

_SAID_OF_FLEETS = (
    "In SI, of answers with status ok. scatter: standard deviation between machines; shrunk: best "
    "estimate of one, knowing the others; away: from what the others predict; if assumptions err: "
    "std of what errors of the assumptions may shift, of several results the largest."
)


@frozen
class Accuracy:
    """Errors of a parameter over the accepted answers, against the deviations that they state."""

    name: str
    count: int
    bias: float  # mean error, in SI
    rms: float  # root mean square error
    std: float  # root of the mean of std^2
    cover: float  # share of 95 % intervals that hold the true value
    interval: tuple[float, float]  # 95 % interval of this share, after Clopper and Pearson

    @classmethod
    def of(cls, name: str, error: Floats, std: Floats, covered: Floats) -> Accuracy:
        count, hits = len(error), int(covered.sum())
        rms, stated = (float(np.sqrt(np.mean(each**2))) for each in (error, std))
        low = scipy.special.betaincinv(hits, count - hits + 1, 0.025) if hits else 0.0
        high = scipy.special.betaincinv(hits + 1, count - hits, 0.975) if hits < count else 1.0
        share, mean = hits / count, float(error.mean())
        return cls(name, count, mean, rms, stated, share, (float(low), float(high)))

    @property
    def row(self) -> tuple[str, ...]:
        bias, rms, cover = self.bias / self.std, self.rms / self.std, f"{100 * self.cover:.1f}"
        low, high = (f"{100 * end:.1f}" for end in self.interval)
        count = str(self.count)
        return self.name, count, f"{bias:+.2f}", f"{rms:.2f}", cover, f"{low} to {high}"


@frozen
class Group:
    """The cases of one point of the grid, of a fleet those of all its machines."""

    label: str
    cases: int
    statuses: dict[str, int]
    verdicts: dict[str, int]
    seconds: tuple[float, float]  # of an identification: the median, and what 95 % stay below
    accuracy: tuple[Accuracy, ...]  # empty where no true value is known

    @property
    def row(self) -> tuple[str, ...]:
        """The group in a line, all its parameters together, each in its stated deviations."""
        counts, parts = [part.count for part in self.accuracy], self.accuracy
        cover = rms = None
        if parts:
            cover = np.average([part.cover for part in parts], weights=counts)
            rms = np.average([(part.rms / part.std) ** 2 for part in parts], weights=counts) ** 0.5
        bias = max(parts, key=lambda part: abs(part.bias / part.std), default=None)
        unanswered = sum(self.statuses.get(each, 0) for each in ("not_converged", FAILED))
        told = self.label or "all", self.cases, self.statuses.get("ok", 0), self.cases - unanswered
        worst = "" if bias is None else f"{bias.bias / bias.std:+.2f} ({bias.name})"
        seconds = (f"{each:.3g}" for each in self.seconds)
        return *map(str, told), cell(cover, ".1f", 100.0), cell(rms, ".2f"), worst, *seconds


@frozen
class StudySummary:
    """What a study found, point by point of its grid, and the files of its worst cases."""

    groups: tuple[Group, ...]
    fleet: tuple[FleetParameter, ...]  # empty where fewer than two serial numbers are stated
    fleet_remarks: tuple[str, ...]  # results that are in none, and why
    errors: tuple[tuple[str, int], ...]  # of cases that failed, the most frequent first
    worst: tuple[str, ...]  # experiment files

    @property
    def page(self) -> Page:
        """What a terminal shows: all points, and the parameters of one that stands alone."""
        tables = [each for _, each in self._tables] if len(self.groups) == 1 else []
        return [self._overview, *tables, *self._fleet, *self._remarks]

    @property
    def _fleet(self) -> list[Table]:
        heads = "fleet", "machines", "results", "common", "half of its 95 %", ERR, "scatter"
        rows = [each.row for each in self.fleet]
        return [assuming_table((*heads, "its 95 % interval"), rows)] if rows else []

    @property
    def _overview(self) -> Table:
        heads = "study", "cases", "ok", "converged", "cover %", "rms/std", "largest bias/std"
        return table((*heads, "median s", "95 % s"), (group.row for group in self.groups))

    @property
    def _tables(self) -> list[tuple[str, Table]]:
        heads = "parameter", "answers", "bias/std", "rms/std", "cover %", "its 95 % interval"
        told = (group for group in self.groups if group.accuracy)
        return [(g.label or "all", table(heads, (each.row for each in g.accuracy))) for g in told]

    @property
    def _remarks(self) -> list[str]:
        verdicts = sum((Counter(group.verdicts) for group in self.groups), Counter[str]())
        told = [f"verdicts: {', '.join(f'{n} {each}' for each, n in verdicts.most_common())}"]
        told += [f"failed, {count} cases: {error}" for error, count in self.errors]
        told += [*self.fleet_remarks, *(told for each in self.fleet for told in each.remarks)]
        return [*told, *(f"worst: {file}" for file in self.worst)]

    def write(self, folder: Path) -> None:
        """Write `summary.json` and `summary.html`."""
        first = Passage("All cases", _SAID, self._overview, tuple(self._remarks))
        parts = (Passage(f"Parameters: {label}", table=each) for label, each in self._tables)
        every = tuple(each.passage for each in self.fleet)
        fleet = (Passage("Fleet", _SAID_OF_FLEETS, each, parts=every) for each in self._fleet)
        html = page_of(Passage("Study", parts=(first, *parts, *fleet)))
        write_whole(folder / "summary.html", html.encode())
        write_whole(folder / "summary.json", json.dumps(asdict(self), indent=2).encode())


def summarize_study(plan: StudyPlan, folder: Path) -> StudySummary:
    """Summarize the rows that a folder holds, and write that and the worst cases into it."""
    check_folder(folder, plan.identity, resume=True)
    rows = read_rows(folder)
    points = rows["point"].to_pylist()
    serials = rows["serial"].to_pylist() if "serial" in rows.column_names else []
    named = {point for point, serial in zip(points, serials, strict=bool(serials)) if serial}
    of = {p: plan.fleet(p) if p in named else plan.label(p) for p in sorted({*points})}
    labels = np.array([of[point] for point in points])
    counted = counting([*dict.fromkeys(of.values())], "summarizing points of the grid")
    groups = [_group(each, rows.filter(labels == each)) for each in counted]
    failed = Counter(error for error in rows["error"].to_pylist() if error).most_common(WORST)
    fleets, remarks = _fleets(plan, rows)
    names = [n.removesuffix("_true") for n in rows.column_names if n.endswith("_true")]
    fleet, worst = tuple(_fleet(fleets, names)), tuple(_worst(plan, rows, folder))
    summary = StudySummary(tuple(groups), fleet, tuple(remarks), tuple(failed), worst)
    summary.write(folder)
    return summary


def _group(label: str, rows: Any) -> Group:
    statuses, verdicts = (Counter(rows[name].to_pylist()) for name in ("status", "verdict"))
    median, most = np.quantile(rows["seconds"].to_numpy(), [0.5, 0.95]).tolist()
    accuracy = []
    for name, *columns in _errors(rows.filter(np.array(rows["status"].to_pylist()) == "ok")):
        if (known := np.isfinite(columns).all(axis=0)).any():
            accuracy.append(Accuracy.of(name, *(column[known] for column in columns)))
    return Group(label, len(rows), dict(statuses), dict(verdicts), (median, most), tuple(accuracy))


def _errors(rows: Any) -> Iterator[tuple[str, Floats, Floats, Floats]]:
    """Yield name, errors, deviations and covering of each parameter, NaN where one is unknown."""
    for name in (n.removesuffix("_true") for n in rows.column_names if n.endswith("_true")):
        columns = (np.array(rows[name + end].to_pylist(), dtype=float) for end in ENDS)
        value, std, true, covered = columns
        yield name, value - true, np.where(std > 0, std, np.nan), covered


def _fleets(plan: StudyPlan, rows: Any) -> tuple[dict[str, list[Row]], list[str]]:
    """Return accepted answers with serial numbers by fleet, a record once; and what that leaves."""
    known = rows.to_pylist() if "serial" in rows.column_names else []
    good = [row for row in known if row["serial"] and row["status"] == "ok"]
    several = len({row.get("model") for row in good}) > 1
    found, uses = defaultdict[str, list[Row]](list), defaultdict[Any, list[Any]](list)
    again = list[tuple[bool, int, str]]()
    for row in counting(good, "sorting results into fleets"):
        apart = plan.fleet(row["point"]), several * f"model = {row.get('model')}"
        label = ", ".join(filter(None, apart))
        taken = [((label, file), *times) for file, *times in json.loads(row.get("record") or "[]")]
        held = ((begin, end, use) for file, begin, end in taken for use in uses[file])
        same = next((one for begin, end, (b, e, one) in held if begin < e and b < end), None)
        if same:
            named = (f"case {each['case']} (serial {each['serial']})" for each in (row, same))
            first = row["serial"] == same["serial"], len(again)  # those of two serial numbers
            again.append((*first, " repeats ".join(named)))
            continue
        found[label].append(row)
        for file, *times in taken:
            uses[file].append((*times, row))
    said = "; ".join(text for *_, text in sorted(again)[:WORST])
    told = [f"left out, of records that count already, {len(again)} cases: {said}"] * bool(again)
    alone = {label: {row["serial"] for row in each} for label, each in found.items() if several}
    told += [f"no machine but {min(s)} has {k}" for k, s in alone.items() if len(s) == 1]
    return found, told


def _fleet(fleets: Mapping[str, Sequence[Row]], names: Sequence[str]) -> Iterator[FleetParameter]:
    """Yield what they say, parameter by parameter."""
    every = [*product(fleets.items(), names)]
    for (setting, members), name in counting(every, "comparing machines of a fleet"):
        std = f"{name}_std"
        found = [row for row in members if 0 < (row[std] or 0.0) < np.inf]
        of = ((r, (r[name], r[std], r.get(f"{std}_assumed"))) for r in found)
        told = grouped(
            (row["serial"], FleetResult(row.get("date") or "", row["case"], *said))
            for row, said in of
        )
        if len(told) > 1:
            yield fleet_parameter(f"{name}, {setting}" if setting else name, told)


def _worst(plan: StudyPlan, rows: Any, folder: Path) -> Iterator[str]:
    """Write the cases of the largest errors, or of the least p-values where no truth is known."""
    if plan.entry.noise == "lines":  # no samples to write
        return
    rows = rows.filter(np.array(rows["status"].to_pylist()) != FAILED)
    score = -np.nan_to_num(np.array(rows["p_value"].to_pylist(), dtype=float), nan=2.0)
    for _, error, std, _ in _errors(rows):
        score = np.fmax(score, np.abs(error) / std)
    numbers = rows["case"].to_numpy()[np.argsort(-score, kind="stable")[:WORST]]
    for number in numbers.tolist():
        watch("writing the worst cases")
        target = folder / "worst" / f"case-{number}"
        target.mkdir(parents=True, exist_ok=True)
        yield str(plan.case(number).write(target))
