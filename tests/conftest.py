"""Property tests draw the same examples in every run, so that a run says what changed."""

from hypothesis import settings

settings.register_profile("fixed", derandomize=True, deadline=None)
settings.load_profile("fixed")

collect_ignore = ["fuzz_atheris.py"]
"""It instruments what it imports, with a package of its own: `make fuzz` runs it."""
