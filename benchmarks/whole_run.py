"""What a user's run costs: processor time of ``tb.run`` for an object and scan, beside FilterPy in its own loop.

``python -m benchmarks.whole_run`` prints the table alone.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from typing import Any

from benchmarks.goal import at_most
from benchmarks.table_cells import digits, goals

from benchmarks import engines

SCENARIO, OBJECTS, SCANS = "highway", 5, 602
RUNS = (100, 1_000, 10_000)
#: By tracker of the scenario the goal at the most runs, us, and which problem FilterPy solves.
TRACKERS = {"ekf_cv": (0.12, "EKF, CV"), "ukf_ctrv": (0.2, "UKF, CTRV"), "imm_cv_ca": (0.25, None)}
ALL, GOAL_OF_ALL = "all seven trackers", 30.0
#: Of one tracker.
MANY, GOAL_OF_MANY = 100_000, 60.0
REPETITIONS, PEER_RUNS, PEER_SCANS = 3, 10, 500
#: Of a process of its own: a first run loads everything, and counts for nothing.
INSIDE = """
import json, resource, sys, time
import trackbench as tb

runs, repetitions, *trackers = json.loads(sys.argv[1])
chosen = {"trackers": trackers} if trackers else {}
tb.run(tb.load("highway", runs=20, **chosen), workers=1, engine="fused")
spent = []
for _ in range(repetitions):
    begin = time.process_time()
    tb.run(tb.load("highway", runs=runs, **chosen), workers=1, engine="fused")
    spent.append(time.process_time() - begin)
print(json.dumps([min(spent), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024]))
"""


def measure() -> dict[str, Any]:
    """Microseconds by tracker and runs; seconds of all trackers, and of many runs, with the memory."""
    rows = []
    for name in TRACKERS:
        for runs in RUNS:
            seconds, _ = spent(runs, 1 if runs == RUNS[-1] else REPETITIONS, name)
            rows.append({"tracker": name, "runs": runs, "us": 1e6 * seconds / (runs * OBJECTS * SCANS)})
    every, memory_of_all = spent(RUNS[-1], 1)
    many, memory_of_many = spent(MANY, 1, next(iter(TRACKERS)))
    return {
        "rows": rows,
        "filterpy": {name: filterpy(problem) for name, (_, problem) in TRACKERS.items() if problem},
        "all": {"seconds": every, "bytes": memory_of_all},
        "many": {"seconds": many, "bytes": memory_of_many},
    }


def spent(runs: int, repetitions: int, *trackers: str) -> tuple[float, float]:
    """Processor seconds of a run, one thread, and the largest memory of its process, bytes."""
    command = [sys.executable, "-c", INSIDE, json.dumps([runs, repetitions, *trackers])]
    seconds, memory = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    print(f"{trackers or ALL}, {runs} runs: {seconds:.1f} s", file=sys.stderr)
    return seconds, memory


def filterpy(problem: str) -> float:
    """Microseconds of a step by FilterPy, which neither draws measurements nor scores."""
    task = engines.task(engines.problem(PEER_RUNS, PEER_SCANS), problem, PEER_RUNS)
    least = float("inf")
    for _ in range(REPETITIONS):
        begin = time.process_time()
        engines.peer_estimates(engines.PEERS[problem]["FilterPy"], task)
        least = min(least, time.process_time() - begin)
    return 1e6 * least / (PEER_RUNS * PEER_SCANS)


def section(measured: dict[str, Any]) -> str:
    """The figures as Markdown."""
    us = {(row["tracker"], row["runs"]): row["us"] for row in measured["rows"]}
    peers = measured["filterpy"]

    def row(name: str) -> str:
        cells = [digits(us[name, runs]) for runs in RUNS]
        peer = f"{digits(peers[name])} ({digits(peers[name] / us[name, RUNS[-1]])} times)" if name in peers else ""
        return f"| `{name}` | {' | '.join(cells)} | {peer} |"

    rows = [
        *(
            at_most(f"`{name}`, {RUNS[-1]:,} runs: µs for an object and scan", us[name, RUNS[-1]], goal)
            for name, (goal, _) in TRACKERS.items()
        ),
        at_most(f"{ALL}, {RUNS[-1]:,} runs: processor seconds", measured["all"]["seconds"], GOAL_OF_ALL),
        at_most(f"`ekf_cv`, {MANY:,} runs: processor seconds", measured["many"]["seconds"], GOAL_OF_MANY),
    ]
    gib = {name: measured[name]["bytes"] / 2**30 for name in ("all", "many")}
    return "\n".join(
        [
            "## What a user pays",
            "",
            f"Processor time of `tb.run` of `{SCENARIO}` with one tracker: {OBJECTS} vehicles and {SCANS} scans of "
            "radar and lidar, by the fused engine on one thread. Microseconds for one object at one scan; the start of "
            "tracks, the drawing of all measurements, scores, the bound, tables and verdicts are included. FilterPy "
            "runs the filter in a loop of its own, given the measurements, and scores nothing; in brackets how many "
            f"times as long as {RUNS[-1]:,} runs.",
            "",
            f"| tracker | {' | '.join(f'{runs:,} runs' for runs in RUNS)} | FilterPy |",
            f"|---|{'---:|' * len(RUNS)}---:|",
            *(row(name) for name in TRACKERS),
            "",
            *goals(rows, "one thread"),
            "",
            f"The largest memory was {digits(gib['all'])} GiB with {ALL} and {RUNS[-1]:,} runs, and "
            f"{digits(gib['many'])} GiB with one tracker and {MANY:,} runs.",
            "",
        ]
    )


if __name__ == "__main__":
    print(section(measure()))
