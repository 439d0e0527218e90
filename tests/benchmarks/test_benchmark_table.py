"""The benchmark's sections."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks import table, table_stages, traffic_scores, traffic_trackers


def cells(section: str) -> list[list[str]]:
    """Of the section's table, heading first; every row has as many cells as it."""
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in section.splitlines() if line.startswith("|")]
    assert {len(row) for row in rows} == {len(rows[0])}
    return [rows[0], *rows[2:]]


def figures(key: str, values: dict[tuple[str, str], float]) -> dict[str, Any]:
    return {key: [{"problem": name, "engine": by, "value": value} for (name, by), value in values.items()]}


def filters(**others: float) -> dict[str, Any]:
    """Of two problems, one of which the others solve too."""
    ours = {"fused": 0.05, "fused, scored": 0.1, "numpy": 0.2, "numpy, scored": 0.25}
    time = {(name, by): value for name in ("EKF", "IMM") for by, value in ours.items()}
    apart = {(name, by): 1e-13 for name, by in time if "numpy" in by}
    return {
        "problem": {"runs": 1000, "steps": 500, "peer_runs": 10, "repetitions": 7},
        "goals": [{"what": "EKF: µs", "value": 0.05, "goal": "at most 0.04", "met": False}],
        "without_eigen": None,
        **figures("microseconds_per_step", time | {("EKF", by): value for by, value in others.items()}),
        **figures("largest_difference", apart | {("EKF", by): 1e-10 for by in others}),
    }


def test_both_engines_stand_beside_the_others():
    section = table.filters(filters(Eigen=0.06, FilterPy=20.0))
    assert cells(section.partition("The UKF")[0]) == [
        ["", "fused", "NumPy", "Eigen", "FilterPy", "scoring: fused, NumPy"],
        ["EKF", "0.05", "0.2 (4 times)", "0.06 (1.2 times)", "20 (400 times)", ""],
        ["with scoring", "0.1", "0.25 (2.5 times)", "(0.6 times)", "(200 times)", "50 %, 20 %"],
        ["IMM", "0.05", "0.2 (4 times)", "", "", ""],
        ["with scoring", "0.1", "0.25 (2.5 times)", "", "", "50 %, 20 %"],
    ]
    assert "| EKF: µs | 0.05 | at most 0.04 | missed |\n" in section
    assert "| IMM | 1.0e-13 | 1.0e-13 |\n" in section
    assert "- EKF: Eigen: 1.0e-10\n" in section


def test_it_is_said_why_there_is_no_column_of_eigen():
    section = table.filters(filters(FilterPy=20.0) | {"without_eigen": "no C++ compiler"})
    assert "Nothing is compared with C++ and Eigen: no C++ compiler." in section
    assert cells(section.partition("The UKF")[0])[0][3:] == ["FilterPy", "scoring: fused, NumPy"]


def spent(command: str, engine: str | None, work: float, **stages: float) -> dict[str, Any]:
    times = {stage: [cpu, 2 * cpu] for stage, cpu in stages.items()}
    return {"command": command, "engine": engine, "fixed_work": work, "stages": times}


def test_stages_before_and_by_each_engine():
    found = {
        "commands": [
            spent("run first", "numpy", 0.5, tracking=3.0),
            spent("run first", "fused", 0.5, tracking=1.0, tracing=0.5, compiling=1.5),
            spent("run", "numpy", 0.5, tracking=3.0),
            spent("run", "fused", 0.5, tracking=1.0, tracing=0.5),
        ],
        "kernels": 7,
        "goals": [{"what": "`run`: elapsed seconds", "value": 3.0, "goal": "at most 4", "met": True}],
    }
    before = {"commit": "abc", "commands": [spent("run", None, 1.0, tracking=8.0)]}
    section = table_stages.stages(before, found)
    assert "| `run`: elapsed seconds | 3 | at most 4 | met |\n" in section
    assert cells(section.partition("| the fused engine")[0]) == [
        ["stage", "`run first`", "`run`"],
        ["tracking", "3.00 → 1.00", "4.00 → 3.00 → 1.00"],
        ["tracing", "0.00 → 0.50", "0.00 → 0.00 → 0.50"],
        ["compiling", "0.00 → 1.50", "0.00 → 0.00 → 0.00"],
        ["all", "3.00 → 3.00", "4.00 → 3.00 → 1.50"],
        ["elapsed", "6.00 → 6.00", "8.00 → 6.00 → 3.00"],
    ]
    section = table_stages.compiling(found)
    assert "takes 7 kernels" in section
    assert cells(section)[1:] == [
        ["the first time", "0.5", "0", "1.5", "0", "2", "3"],
        ["again", "0.5", "0", "0", "0", "0.5", "1.5"],
    ]


def tracked(engine: str, method: str, speed: float, required: float | None = None) -> dict[str, Any]:
    figures = {"ms_per_scan": 25 / speed, "times_real_time": speed, "required": required, "goal": None}
    return {"engine": engine, "method": method, "runs": 1, "largest_difference": 2e-13, **figures}


def test_trackers_by_both_engines_stand_beside_stone_soup():
    goal = {"what": "gnn: times as fast as NumPy", "value": 2.5, "goal": "at least 2", "met": True}
    rows = [
        tracked("Stone Soup", "gnn", 0.5),
        {**tracked("fused", "gnn", 50.0, 100.0), "goal": goal},
        tracked("numpy", "gnn", 20.0),
        tracked("fused", "pmb", 25.0),
        tracked("numpy", "pmb", 50.0),
    ]
    section = table.traffic_trackers(rows)
    assert "- gnn: Stone Soup: 2.0e-13\n" in section
    assert "| gnn: times as fast as NumPy | 2.5 | at least 2 | met |\n" in section
    assert cells(section.partition("| the fused engine")[0])[1:] == [
        ["gnn", "1", "0.5", "1.25 (2.5 times)", "50", "at least 100", "missed", "0.5", "100"],
        ["pmb", "1", "1", "0.5 (0.5 times)", "25", "", "", "", ""],
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
    assert all(row["largest_difference"] < 1e-6 for row in rows if row.get("peer") or "engine" in row)
    own = [row for row in rows if row.get("engine", "fused") == "fused"]
    assert len(cells(section(rows).partition("| the fused engine")[0])) == 1 + len(own)


def test_a_program_stands_beside_a_bare_exchange_and_the_filter_inside():
    rows = [
        {"members": members, "tracker": name, "us": us}
        for name, times in {"program": (20.0, 500.0), "inside": (10.0, 400.0)}.items()
        for members, us in zip((1, 2000), times, strict=True)
    ]
    goals = [{"what": "program: µs", "value": 20.0, "goal": "at most 30", "met": True}]
    section = table.languages({"bare_us": 5.0, "rows": rows, "goals": goals})
    assert cells(section.partition("| a program in")[0]) == [
        ["", "one member", "2000 members", "bare exchanges"],
        ["program", "20", "500", "4"],
        ["inside", "10", "400", "2"],
    ]
    assert "| program: µs | 20 | at most 30 | met |\n" in section
    assert "no C++ compiler" in table.languages({"without": "no C++ compiler"})
