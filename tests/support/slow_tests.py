"""Which tests are left to the slow tier because of their cost, and which part of that tier a run takes.

pytest -n 2 -m "not docs_pages and not slow" --durations=0 -vv --durations-min=0 > durations.txt
python -m tests.support.slow_tests durations.txt > tests/slow_tests.txt
"""

from __future__ import annotations

import re
import sys
from collections import Counter, defaultdict
from pathlib import Path
from zlib import crc32

LIST = Path(__file__).parents[1] / "slow_tests.txt"
PARTS = 8
"""Of the slow tier: at most four minutes each on 2 cores."""
LARGEST_NUMBER = 700
"""A tenth of all tests."""

DURATION = re.compile(r"^\s*([\d.]+)s (?:call|setup|teardown) +(\S.*)$", re.MULTILINE)
OUTCOME = re.compile(r"^(?:\[gw\d+\] \[ *\d+%\] )?(?:PASSED|XFAIL) (tests/.*?)\s*$", re.MULTILINE)


def listed() -> frozenset[str]:
    """The node ids of the tests that are slow by their cost."""
    return frozenset(LIST.read_text(encoding="utf-8").splitlines())


def part(node_id: str) -> int:
    """Which part of the slow tier a test is in, from 0 on."""
    return crc32(node_id.encode()) % PARTS


def costliest(log: str) -> list[str]:
    """The costliest tests of a log of pytest with durations; a file keeps its cheaper half, and a lone test."""
    seconds: Counter[str] = Counter()
    for duration, node_id in DURATION.findall(log):
        seconds[node_id.rstrip()] += float(duration)
    files = defaultdict(list)
    for node_id in OUTCOME.findall(log):
        files[node_id.partition("::")[0]].append(node_id)
    movable = [
        node_id
        for tests in files.values()
        for node_id in sorted(tests, key=lambda test: -seconds[test])[: len(tests) // 2]
    ]
    return sorted(sorted(movable, key=lambda test: -seconds[test])[:LARGEST_NUMBER])


if __name__ == "__main__":
    print(*costliest(Path(sys.argv[1]).read_text(encoding="utf-8")), sep="\n")
