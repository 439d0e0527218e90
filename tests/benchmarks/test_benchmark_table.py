"""The benchmark's page."""

from __future__ import annotations

import json
from typing import Any

import pytest

from benchmarks import speed, table, traffic_trackers


def cells(section: str) -> list[list[str]]:
    """Return the first table of a section, heading first; every row has as many cells as it."""
    lines = section[section.index("| | fused") :].partition("\n\n")[0].splitlines()
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]
    assert {len(row) for row in rows} == {len(rows[0])}
    return [rows[0], *rows[2:]]


def figures(key: str, values: dict[tuple[str, str], float]) -> dict[str, Any]:
    return {key: [{"problem": name, "engine": by, "value": value} for (name, by), value in values.items()]}


def filters(**others: float) -> dict[str, Any]:
    """Of two problems, one of which the others solve too."""
    ours = {"fused": 0.05, "numpy": 0.2}
    time = {(name, by): value for name in ("EKF", "IMM") for by, value in ours.items()}
    apart = {(name, by): 1e-13 for name, by in time if "numpy" in by}
    return {
        "problem": {"runs": 1000, "steps": 500, "peer_runs": 10, "repetitions": 7},
        "without_eigen": None,
        **figures("microseconds_per_step", time | {("EKF", by): value for by, value in others.items()}),
        **figures("largest_difference", apart | {("EKF", by): 1e-10 for by in others}),
    }


def test_what_is_measured_fills_the_table(monkeypatch: pytest.MonkeyPatch):
    for name, value in {"STEPS": 8, "BATCH": 2, "PEER_STEPS": 2, "REPETITIONS": 1}.items():
        monkeypatch.setattr(traffic_trackers, name, value)
    rows = traffic_trackers.measure()
    assert all(row["largest_difference"] < 1e-6 for row in rows)
    own = [row for row in rows if row["engine"] == "fused"]
    assert len(cells(table.speed(filters(), rows))) == 1 + 2 + len(own)


def test_the_committed_page_shows_the_committed_data():
    measured = json.loads((speed.RESULTS / "benchmark.json").read_text(encoding="utf-8"))
    assert (speed.RESULTS / "benchmark.md").read_text(encoding="utf-8") == table.markdown(measured)
