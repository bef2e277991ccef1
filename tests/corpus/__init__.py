"""What has once destroyed, hung, killed or misled, or could: each case a command and its files.

Small files that have no other origin (bytes that ended a process) lie in this folder; all others
are made by a function that says what is wrong with them. `CASES` names them all.
"""

from collections.abc import Callable, Mapping

from fuzz_harness import Case

from corpus.formats import FORMAT_CASES
from corpus.texts import TEXT_CASES

CASES: Mapping[str, Callable[[], Case]] = {**TEXT_CASES, **FORMAT_CASES}
