"""Property tests draw the same examples in every run; of many cases some are fast tests."""

import gc
from collections import defaultdict

import pytest
from hypothesis import settings

settings.register_profile("fixed", derandomize=True, deadline=None)
settings.load_profile("fixed")

collect_ignore = ["fuzz_atheris.py"]
"""It instruments what it imports, with a package of its own: `make fuzz` runs it."""


def pytest_collection_finish() -> None:
    """Leave what was collected alone: thousands of tests are not looked through at every turn."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Of the cases of a test marked ``sampled(count)`` leave so many fast, spread over all."""
    cases = defaultdict(list)
    for item in items:
        if item.get_closest_marker("sampled"):
            cases[item.nodeid.partition("[")[0]].append(item)
    for found in cases.values():
        count = min(found[0].get_closest_marker("sampled").args[0], len(found))
        kept = {k * len(found) // count for k in range(count)}
        for number, item in enumerate(found):
            if number not in kept:
                item.add_marker(pytest.mark.slow)
