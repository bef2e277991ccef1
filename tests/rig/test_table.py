"""The page of faults is what a run gives; deviations hold on the shipped rigs. Slow."""

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

from rotorid.rig.faults import FAULTS

DOCS = Path(__file__).parents[2] / "docs"
KINDS = {"right", "said", "named", "not named", "wrong", "none"}


def script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def rows() -> dict[str, tuple[str, str]]:
    """Return what is wanted of each fault on the page, and what the answer was."""
    found = {}
    for line in (DOCS / "faults.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        if len(cells) == 9 and cells[0] in FAULTS:
            found[cells[0]] = (cells[4], cells[5].strip("*"))
    return found


def test_every_fault_is_on_the_page() -> None:
    page = rows()
    assert set(page) == set(FAULTS)
    assert {kind for _, kind in page.values()} <= KINDS
    for name, fault in FAULTS.items():
        assert page[name][0] == fault.wanted


def test_no_fault_is_believed_and_most_are_named() -> None:
    """Of the faults on the page that matter: none `ok` and wrong, two dozen called by name."""
    kinds = [kind for _, kind in rows().values()]
    assert not {"wrong", "none"} & {*kinds}
    assert kinds.count("named") >= 24
    text = (DOCS / "faults.md").read_text(encoding="utf-8").replace("\n", " ")
    told = re.search(r"(\d+) are refused and (\d+) move .*; (\d+) of these (\d+) are named", text)
    assert told is not None
    refused, far, named, all_ = (int(number) for number in told.groups())
    assert refused + far == all_ >= 30
    assert named >= 24


# Of each kind one, and those whose answer hangs on most: some minutes.
SAMPLED = (
    "iron-path", "bias-mismatch", "hysteresis", "gap-drift", "sensor-plane", "runout-1",
    "transient", "encoder-lost", "anti-alias", "lost-sample", "notch",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", SAMPLED)
def test_the_page_is_what_a_run_gives(name: str) -> None:
    """One of the records behind the page: no worse than it says there."""
    order = ("wrong", "none", "not named", "named", "said", "right")
    answer = script("make_faults").answer_of(name, 1)
    assert order.index(answer.kind) >= order.index(rows()[name][1]), answer


@pytest.mark.slow
@pytest.mark.parametrize("case", ["measured", "commanded", "flux"])
def test_intervals_hold_the_truth(case: str) -> None:
    """Eight records: 56 errors or more, correlated in each record; 95 % give 85 to 100."""
    ok, cover, rms, _ = script("calibration").calibration([case], 8, 10.0, 1)[case]
    assert ok >= 7
    assert cover > 85.0
    assert 0.7 < rms < 1.4
