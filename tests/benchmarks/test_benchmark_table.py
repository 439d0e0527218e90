"""The benchmark's page."""

from __future__ import annotations

import json

from benchmarks import speed, table


def test_the_committed_page_shows_the_committed_data():
    measured = json.loads((speed.RESULTS / "benchmark.json").read_text(encoding="utf-8"))
    assert (speed.RESULTS / "benchmark.md").read_text(encoding="utf-8") == table.markdown(measured)
