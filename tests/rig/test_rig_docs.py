"""What docs/rig.md and docs/signals.md show, runs."""

import re
from pathlib import Path

import pytest

from rotorid.testing import parse_rig

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(page: str, language: str) -> list[str]:
    found = BLOCK.findall((DOCS / page).read_text(encoding="utf-8"))
    return [text for kind, text in found if kind == language]


@pytest.mark.slow
@pytest.mark.parametrize("page", ["rig.md", "signals.md"])
def test_python_of_the_pages_runs(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for code in blocks(page, "python"):
        exec(code, {})
    assert capsys.readouterr().out


@pytest.mark.slow
def test_rig_file_of_the_page_runs() -> None:
    (text,) = blocks("rig.md", "toml")
    plan = parse_rig(text.replace('"13 s"', '"50 ms"'))
    record = plan.run()
    assert record.names == ("F_x1", "F_y1", "F_x3", "F_y3", "x1", "y1", "s3", "y3")
    assert plan.seed == 1
