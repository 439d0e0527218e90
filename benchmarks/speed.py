"""Speed of trackbench's filters, trackers of traffic and scores beside those of other packages, on the same data.

Prints a table and writes it to ``results/benchmark.md`` and ``results/benchmark.json``. Every engine runs on one
thread; the repetitions of all engines alternate, and the best of each counts.
"""

from __future__ import annotations

import argparse
import os

# Before NumPy is imported: its linear algebra would take every core.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import json
import platform
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

import engines
import isolation
import stages
import table
import traffic_scores
import traffic_trackers

RESULTS = Path(__file__).parent.parent / "results"
RUNS, STEPS = 1000, 500
PEER_RUNS = 10
REPETITIONS = 7
#: Largest difference of any state component that counts as agreement, in m, m/s, rad and rad/s.
AGREEMENT = 1e-4
#: What is asked of each problem: times as fast as FilterPy, and microseconds for a step of one run.
REQUIRED = {"EKF, CV": (90.0, 0.25), "UKF, CTRV": (140.0, 1.2)}
SCORING_REQUIRED = 1.5
MEMORY_REQUIRED = 2 * 1024**3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=REPETITIONS)
    parser.add_argument("--no-memory", action="store_true", help="leave out the large run, which takes a minute")
    parser.add_argument("--no-stages", action="store_true", help="leave out where the time goes, three minutes")
    options = parser.parse_args()
    problem = engines.problem(RUNS, STEPS)
    tasks = {name: engines.task(problem, name, PEER_RUNS) for name in engines.PEERS}
    print(f"agreement of the estimates of {PEER_RUNS} runs, largest difference of any component:")
    agreement = agree(problem, tasks)
    calls = timings(problem, tasks)
    best = dict.fromkeys(calls, float("inf"))
    for repetition in range(options.repetitions):
        print(f"repetition {repetition + 1} of {options.repetitions}", file=sys.stderr)
        for key, (call, steps) in calls.items():
            best[key] = min(best[key], call() / steps * 1e6)
    found = {
        "machine": {"cpu": cpu_model(), "threads": 1, "python": platform.python_version()},
        "versions": {name: version(name) for name in ("trackbench", "numpy", "filterpy", "stonesoup", "trackeval")},
        "problem": {"runs": RUNS, "steps": STEPS, "peer_runs": PEER_RUNS, "repetitions": options.repetitions},
        "largest_difference": agreement,
        "microseconds_per_step": [{"problem": p, "engine": e, "value": value} for (p, e), value in best.items()],
        "ratios": ratios(best),
        "traffic_trackers": traffic_trackers.measure(),
        "traffic_scores": traffic_scores.measure(),
        "memory": None if options.no_memory else memory(),
        "isolation": isolation.measure(),
        "stages": None if options.no_stages else stages.measure(),
    }
    text = table.markdown({**found, "stages_before": stages.before()})
    print(text)
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "benchmark.md").write_text(text, encoding="utf-8")
    (RESULTS / "benchmark.json").write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


def agree(problem: engines.Problem, tasks: dict[str, engines.PeerTask]) -> dict[str, float]:
    """The largest difference of each peer from trackbench; ends the process where one is too large."""
    differences = {}
    for name, given in tasks.items():
        ours = engines.estimates(problem, name, PEER_RUNS)
        for peer, call in engines.PEERS[name].items():
            gap = np.abs(engines.peer_estimates(call, given) - ours)
            if gap.shape[-1] == 5:
                gap[..., 3] = np.minimum(gap[..., 3] % (2 * np.pi), -gap[..., 3] % (2 * np.pi))
            differences[f"{name}: {peer}"] = float(gap.max())
            print(f"  {name}: {peer} {gap.max():.1e}")
    worst = max(differences, key=differences.__getitem__)
    if not differences[worst] < AGREEMENT:
        sys.exit(f"{worst} does not agree with trackbench: {differences[worst]:g}, limit {AGREEMENT:g}")
    return differences


def timings(
    problem: engines.Problem, tasks: dict[str, engines.PeerTask]
) -> dict[tuple[str, str], tuple[Callable[[], float], int]]:
    """For each problem and engine: a call that gives seconds, and the number of steps of single runs it takes."""
    steps, peer_steps = RUNS * STEPS, PEER_RUNS * STEPS
    calls: dict[tuple[str, str], tuple[Callable[[], float], int]] = {}
    for name in engines.TRACKERS:
        calls[name, "trackbench"] = (lambda name=name: engines.filtering(problem, name), steps)
        calls[name, "trackbench, scored"] = (lambda name=name: engines.filtering_and_scoring(problem, name), steps)
        for peer, call in engines.PEERS.get(name, {}).items():
            calls[name, peer] = (
                lambda call=call, given=tasks[name]: engines.timed(lambda: engines.peer_estimates(call, given)),
                peer_steps,
            )
    return calls


def ratios(best: dict[tuple[str, str], float]) -> list[dict[str, Any]]:
    """What is required, and whether it is met."""
    found: list[dict[str, Any]] = []

    def add(what: str, value: float, required: str, met: bool | None) -> None:
        found.append({"what": what, "value": value, "required": required, "met": met})

    for name, (times, microseconds) in REQUIRED.items():
        ours = best[name, "trackbench"]
        add(f"{name}: microseconds for a step of one run", ours, f"at most {microseconds:g}", ours <= microseconds)
        faster = best[name, "FilterPy"] / ours
        add(f"{name}: times as fast as FilterPy", faster, f"at least {times:g}", faster >= times)
        add(f"{name}: times as fast as Stone Soup", best[name, "Stone Soup"] / ours, "", None)
    alone = best["EKF, CV", "trackbench"] + best["EKF, CTRV", "trackbench"]
    add("IMM of EKFs, over both alone", best["IMM of EKFs, CV and CTRV", "trackbench"] / alone, "", None)
    for name in engines.TRACKERS:
        cost = best[name, "trackbench, scored"] / best[name, "trackbench"]
        add(f"{name}: scored, over not scored", cost, f"at most {SCORING_REQUIRED:g}", cost <= SCORING_REQUIRED)
    return found


def memory() -> dict[str, Any]:
    """Peak memory of a large run, measured in a process of its own."""
    script = Path(__file__).with_name("memory.py")
    print("memory of a large run ...", file=sys.stderr)
    answer = subprocess.run([sys.executable, str(script)], check=True, capture_output=True, text=True).stdout
    found: dict[str, Any] = json.loads(answer)
    return {**found, "required_bytes": MEMORY_REQUIRED, "met": found["peak_bytes"] <= MEMORY_REQUIRED}


def cpu_model() -> str:
    """The name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


if __name__ == "__main__":
    main()
