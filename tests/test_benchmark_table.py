"""The benchmark's sections on tracking in traffic and its scores."""

from __future__ import annotations

from typing import Any

import pytest
from benchmarks import table, traffic_scores, traffic_trackers


def cells(section: str) -> list[list[str]]:
    """Of the section's table, heading first; every row has as many cells as it."""
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in section.splitlines() if line.startswith("|")]
    assert {len(row) for row in rows} == {len(rows[0])}
    return [rows[0], *rows[2:]]


def tracked(engine: str, method: str, speed: float, required: float | None = None) -> dict[str, Any]:
    figures = {"ms_per_scan": 25 / speed, "times_real_time": speed, "required": required}
    return {"engine": engine, "method": method, "runs": 1, "largest_difference": 2e-13, **figures}


def test_trackers_stand_beside_stone_soup():
    rows = [
        tracked("Stone Soup", "gnn", 0.5),
        tracked("trackbench", "gnn", 50.0, 100.0),
        tracked("trackbench", "pmb", 25.0),
    ]
    section = table.traffic_trackers(rows)
    assert "- gnn: Stone Soup: 2.0e-13\n" in section
    assert cells(section)[1:] == [
        ["gnn", "1", "0.5", "50", "at least 100", "missed", "0.5", "100"],
        ["pmb", "1", "1", "25", "", "", "", ""],
    ]


def test_scores_stand_beside_their_peers():
    given = {"what": "GOSPA", "seconds": 0.2, "required_seconds": 2.0}
    peer = {"peer": "Stone Soup", "peer_seconds": 100.0, "largest_difference": 1e-12}
    alone = {"peer": None, "peer_seconds": None, "largest_difference": None}
    section = table.traffic_scores([{**given, **peer}, {**given, **alone, "seconds": 2.5}])
    assert "- Stone Soup: 1.0e-12\n" in section
    assert cells(section)[1:] == [
        ["GOSPA", "200", "at most 2000 ms", "met", "Stone Soup", "100000", "500"],
        ["GOSPA", "2500", "at most 2000 ms", "missed", "", "", ""],
    ]


@pytest.mark.parametrize(
    ("module", "section", "small"),
    [
        (traffic_trackers, table.traffic_trackers, {"STEPS": 8, "BATCH": 2, "PEER_STEPS": 2, "REPETITIONS": 1}),
        (traffic_scores, table.traffic_scores, {"LONG": 200, "PEER_STEPS": 2, "STEPS": 120, "REPETITIONS": 1}),
    ],
)
def test_what_is_measured_fills_the_table(module, section, small, monkeypatch):
    for name, value in small.items():
        monkeypatch.setattr(module, name, value)
    rows = module.measure()
    assert all(row["largest_difference"] < 1e-6 for row in rows if row.get("peer") or row.get("engine") == "Stone Soup")
    own = [row for row in rows if row.get("engine", "trackbench") == "trackbench"]
    assert len(cells(section(rows))) == 1 + len(own)
