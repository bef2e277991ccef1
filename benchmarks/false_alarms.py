"""False alarms: good records of six machines, none of which should be called anything but ok.

    OPENBLAS_NUM_THREADS=1 python benchmarks/false_alarms.py 600 [machine ...]

Every record goes the whole way: samples, periods with all their checks, maximum likelihood.
Machines, noise, number of periods and speed vary from record to record. Each row counts statuses
other than ok, checks that warn or refuse, and what a misfit test of 5 % rejects; a line for each
alarm follows.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from good_records import MACHINES, good_record

from rotorid.answer.identify import identify
from rotorid.core.errors import InputError


@dataclass
class Tally:
    """What was said of the records of one machine."""

    statuses: Counter[str] = field(default_factory=Counter)
    rejected: int = 0
    alarms: list[str] = field(default_factory=list)
    wrong: int = 0
    seconds: float = 0.0

    def add(self, name: str, seed: int) -> None:
        """Identify one record."""
        begin = time.process_time()
        good = good_record(name, seed)
        label = f"{name} {seed} ({good.what})"
        try:
            estimate = identify(good.model, good.records(), good.estimator)
        except InputError as error:
            self.statuses["refused"] += 1
            self.alarms.append(f"{label}: {error}")
            return
        self.seconds += time.process_time() - begin
        self.statuses[estimate.status] += 1
        grave = [str(c) for c in estimate.checks if c.verdict in ("warning", "refused")]
        told = [w for w in estimate.warnings if w.startswith(("not identifiable", "the data"))]
        if grave or estimate.status != "ok":
            self.alarms.append(f"{label}: {estimate.status} {[*grave, *told][:2]}")
        assert estimate.misfit is not None
        self.rejected += estimate.misfit.p_value < 0.05
        free = [v for v in estimate.parameters if not v.fixed and v.std]
        off = max(abs(v.value - good.truth[v.name]) / v.std for v in free if v.std)
        if estimate.status == "ok" and off > 5:
            self.wrong += 1
            self.alarms.append(f"{label}: ok, {off:.3g} deviations off")

    def row(self, name: str) -> str:
        """Return a row of the table."""
        count = max(1, sum(self.statuses.values()))
        return (
            f"{name:12s} {count:5d} records {dict(self.statuses)}, alarms {len(self.alarms)}, "
            f"5 % test rejects {100 * self.rejected / count:.1f} %, "
            f"{self.seconds / count:.2f} s a record"
        )


def main(count: int, names: list[str]) -> None:
    """Go through the machines by turns."""
    chosen = names or list(MACHINES)
    tallies = {name: Tally() for name in chosen}
    for number in range(count):
        name = chosen[number % len(chosen)]
        tallies[name].add(name, number // len(chosen))
        if (number + 1) % max(len(chosen), count // 8) == 0:
            for each in chosen:
                print(tallies[each].row(each), flush=True)
            print(*(a for t in tallies.values() for a in t.alarms), sep="\n", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 600, sys.argv[2:])
