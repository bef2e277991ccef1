"""Print the lowest versions that `pyproject.toml` allows, as constraints of pip.

    python tests/lowest.py > lowest.txt

`make test-lowest` installs them and runs the fast tests: a bound that is not tried does not hold.
The tools of the tests themselves are left as they are.
"""

import re
import tomllib
from pathlib import Path

PYPROJECT = Path(__file__).resolve().parent.parent / "pyproject.toml"


def lowest(text: str) -> list[str]:
    """Return ``name==bound`` for what the package itself needs, and its extra of file formats."""
    project = tomllib.loads(text)["project"]
    needed = [*project["dependencies"], *project["optional-dependencies"]["files"]]
    found = [re.match(r"([\w.-]+)\s*>=\s*([\w.]+)", line) for line in needed]
    without = [line for line, match in zip(needed, found, strict=True) if match is None]
    if without:
        raise ValueError(f"dependencies without lower bound: {', '.join(without)}")
    return [f"{match[1]}=={match[2]}" for match in found if match]


if __name__ == "__main__":
    print("\n".join(lowest(PYPROJECT.read_text(encoding="utf-8"))))
