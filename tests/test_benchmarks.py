"""The benchmarks start: each is imported, none is timed."""

import runpy
from pathlib import Path

import pytest

BENCHMARKS = sorted((Path(__file__).parents[1] / "benchmarks").glob("*.py"))


@pytest.mark.parametrize("file", BENCHMARKS, ids=lambda file: file.stem)
def test_imports(file):
    """What a benchmark takes from the program is there."""
    runpy.run_path(str(file))
