"""The benchmark's page: trackbench beside FilterPy, Stone Soup and C++ with Eigen in one table, and how a run grows."""

from __future__ import annotations

from typing import Any

from benchmarks.digits import digits

from benchmarks import growth, whole_runs

#: Headings of the page, by what is measured.
TITLES = {
    "filters": "filters",
    "traffic_trackers": "trackers of several objects",
    "whole_runs": "whole runs",
    "growth": "how it grows",
}
#: Columns of the table beside the fused engine, by the name of the data.
BESIDE = {"numpy": "NumPy", "C++ with Eigen": "C++ with Eigen", "FilterPy": "FilterPy", "Stone Soup": "Stone Soup"}

#: Microseconds by what is computed, and by engine or package.
Times = dict[tuple[str, str], float]


def markdown(measured: dict[str, Any]) -> str:
    """Return the page that is written beside ``benchmark.json``."""
    again: dict[str, list[str]] = {}
    for part, place in measured.get("again", {}).items():
        again.setdefault(where(place), []).append(TITLES[part])
    lines = [
        "# Benchmark",
        "",
        f"Made by `make benchmark`. {where(measured)}.",
        "",
        *(f"Measured again later, on {place}: {', '.join(parts)}.\n" for place, parts in again.items()),
        speed(measured["filters"], measured["traffic_trackers"]),
        whole_runs.section(measured["whole_runs"], filter_times(measured["filters"])),
        growth.section(measured["growth"]),
    ]
    return "\n".join(lines)


def where(place: dict[str, Any]) -> str:
    """Return the machine and the versions in words."""
    machine, versions = place["machine"], place["versions"]
    packages = ", ".join(f"{name} {number}" for name, number in versions.items())
    return f"{machine['cpu']}, one thread, Python {machine['python']}, {packages}"


def speed(filters: dict[str, Any], trackers: list[dict[str, Any]]) -> str:
    """Return the section with one row for each filter and tracker."""
    problem = filters["problem"]
    times = filter_times(filters) | tracker_times(trackers)
    names = list(dict.fromkeys(name for name, _ in times))
    others = [other for other in BESIDE if any(key == other for _, key in times)]

    def cell(name: str, other: str) -> str:
        if (name, other) not in times:
            return ""
        return f"{digits(times[name, other])} ({digits(times[name, other] / times[name, 'fused'])} times)"

    rows = [
        f"| {name} | {digits(times[name, 'fused'])} | {' | '.join(cell(name, other) for other in others)} |"
        for name in names
    ]
    apart = [row["value"] for row in filters["largest_difference"]]
    apart += [row["largest_difference"] for row in trackers]
    missing = filters["without_eigen"]
    return "\n".join(
        [
            "## Speed",
            "",
            "Microseconds of processor time by the fused engine, by NumPy and by others on the same measurements; in "
            "brackets how many times as long as by the fused engine. A filter takes a prediction and an update of one "
            f"run: radar and lidar in turn, {problem['steps']} measurements of one weaving target, {problem['runs']} "
            f"runs at once ({problem['peer_runs']} by FilterPy and Stone Soup). A tracker takes a scan of one run: 20 "
            "vehicles, 10 false alarms a scan; Stone Soup follows 20 given tracks, starts and ends none, and its JPDA "
            "is by belief propagation. C++ takes one run after the other, compiled with `-O3 -march=native`. All "
            f"estimates are compared before anything is timed; the largest difference is {max(apart):.1e}.",
            *(["", f"Nothing is compared with C++ and Eigen: {missing}."] if missing else []),
            "",
            f"| | fused | {' | '.join(BESIDE[other] for other in others)} |",
            f"|---|---:|{'---:|' * len(others)}",
            *rows,
            "",
        ]
    )


def filter_times(filters: dict[str, Any]) -> Times:
    """Return the times of filters."""
    rows = filters["microseconds_per_step"]
    return {(row["problem"], row["engine"]): row["value"] for row in rows}


def tracker_times(trackers: list[dict[str, Any]]) -> Times:
    """Return the times of trackers of several objects by number of runs, trackbench's first."""

    def name(row: dict[str, Any]) -> str:
        return f"{row['method']}, one run" if row["runs"] == 1 else f"{row['method']}, {row['runs']} runs at once"

    ordered = sorted(trackers, key=lambda row: row["engine"] == "Stone Soup")
    return {(name(row), row["engine"]): 1e3 * row["ms_per_scan"] for row in ordered}
