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


def tracked(engine: str, method: str, ms: float, runs: int = 1) -> dict[str, Any]:
    own = {"ms_per_scan": ms, "times_real_time": 25 / ms}
    return {"engine": engine, "method": method, "runs": runs, "largest_difference": 2e-13, **own}


TRACKED = [
    tracked("Stone Soup", "gnn", 40.0),
    tracked("fused", "gnn", 0.5),
    tracked("numpy", "gnn", 1.25),
    tracked("fused", "gnn", 0.05, runs=100),
    tracked("numpy", "gnn", 0.1, runs=100),
]


def test_filters_and_trackers_stand_in_one_table_beside_the_others():
    section = table.speed(filters(FilterPy=20.0, **{"C++ with Eigen": 0.06}), TRACKED)
    assert cells(section) == [
        ["", "fused", "NumPy", "C++ with Eigen", "FilterPy", "Stone Soup"],
        ["EKF", "0.05", "0.2 (4 times)", "0.06 (1.2 times)", "20 (400 times)", ""],
        ["IMM", "0.05", "0.2 (4 times)", "", "", ""],
        ["gnn, one run", "500", "1250 (2.5 times)", "", "", "40000 (80 times)"],
        ["gnn, 100 runs at once", "50", "100 (2 times)", "", "", ""],
    ]
    assert "the largest difference is 1.0e-10." in section


def test_it_is_said_why_there_is_no_column_of_eigen():
    section = table.speed(filters(FilterPy=20.0) | {"without_eigen": "no C++ compiler"}, TRACKED)
    assert "Nothing is compared with C++ and Eigen: no C++ compiler." in section
    assert cells(section)[0] == ["", "fused", "NumPy", "FilterPy", "Stone Soup"]


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
