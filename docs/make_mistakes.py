"""Make every mistake of tests/mistakes.py; write the table at the end of docs/rejected.md.

python docs/make_mistakes.py
"""

from __future__ import annotations

import sys
import tempfile
import warnings
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from mistakes import MISTAKES, Verdict, judge  # noqa: E402

PAGE = ROOT / "docs" / "rejected.md"
MARK = "<!-- What follows is written by docs/make_mistakes.py -->"


def table(verdicts: list[Verdict]) -> str:
    """Return the rows, and how many were named."""
    named = sum(verdict.named for verdict in verdicts)
    rows = [
        f"{named} of {len(verdicts)} are named.\n",
        "| rig | mistake | status | said first | what names it |",
        "|---|---|---|---|---|",
    ]
    for verdict in verdicts:
        first = verdict.first.replace("|", "/")
        first = first if len(first) <= 90 else f"{first[:87]}..."
        what, by = verdict.mistake, verdict.by or "**nothing**"
        rows.append(f"| {what.rig} | {what.what} | {verdict.status} | {first} | {by} |")
    return "\n".join(rows)


def main() -> None:
    """Run and write."""
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        verdicts = [judge(mistake, folder) for mistake in MISTAKES]
    head = PAGE.read_text("utf-8").split(MARK)[0]
    PAGE.write_text(f"{head}{MARK}\n\n{table(verdicts)}\n", "utf-8")


if __name__ == "__main__":
    main()
