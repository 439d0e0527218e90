"""Speed of a prediction and an update by both engines of trackbench, in C++ with Eigen, by FilterPy and by Stone Soup.

Nothing is timed before all agree. The repetitions of all alternate, and the best of each counts.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.eigen.programs import SOURCES, Missing, Program, program

from benchmarks import engines
from trackbench.base.types import Array
from trackbench.engine.choice import Engine

RUNS, STEPS = 1000, 500
PEER_RUNS = 10
ENGINES: tuple[Engine, ...] = ("fused", "numpy")
EIGEN = "C++ with Eigen"
#: Largest difference that counts as agreement: of the engines in standard deviations; of the others of any state
#: component, in m, m/s, rad and rad/s.
AGREEMENT = {"numpy": 1e-9, EIGEN: 1e-9, "FilterPy": 1e-4, "Stone Soup": 1e-4}
#: Numbers by problem, and by engine or package.
Found = dict[tuple[str, str], float]


def measure(repetitions: int) -> dict[str, Any]:
    """Differences, microseconds for a step of one run, and why there is no Eigen where there is none."""
    problem = engines.problem(RUNS, STEPS)
    with tempfile.TemporaryDirectory() as folder:
        built, missing = _built(problem, Path(folder))
        differences = agree(problem, built)
        best = timed(problem, built, repetitions)
    return {
        "problem": {"runs": RUNS, "steps": STEPS, "peer_runs": PEER_RUNS, "repetitions": repetitions},
        "largest_difference": _rows(differences),
        "microseconds_per_step": _rows(best),
        "without_eigen": missing,
    }


def _built(problem: engines.Problem, folder: Path) -> tuple[dict[str, Program], str | None]:
    try:
        return {name: program(problem, name, folder) for name in SOURCES}, None
    except Missing as reason:
        return {}, str(reason)


def _rows(found: Found) -> list[dict[str, Any]]:
    return [{"problem": name, "engine": engine, "value": value} for (name, engine), value in found.items()]


def agree(problem: engines.Problem, built: Mapping[str, Program]) -> Found:
    """The largest difference of each; ends the process where one is too large."""
    found: Found = {}
    for name in engines.TRACKERS:
        print(f"agreement of {name} ...", file=sys.stderr)
        found[name, "numpy"] = engines.estimates_apart(problem, name)
    for name, peers in engines.PEERS.items():
        ours = engines.estimates(problem, name)
        if name in built:
            found[name, EIGEN] = _gap(built[name].estimates(), ours)
        given = engines.task(problem, name, PEER_RUNS)
        for peer, call in peers.items():
            found[name, peer] = _gap(engines.peer_estimates(call, given), ours[:PEER_RUNS])
    for (name, engine), value in found.items():
        if not value < AGREEMENT[engine]:
            sys.exit(f"{name}, {engine}: differs by {value:g}, limit {AGREEMENT[engine]:g}; nothing is timed")
    return found


def _gap(theirs: Array, ours: Array) -> float:
    """Largest difference of states ``(runs, steps, n)``."""
    gap = np.abs(theirs - ours)
    if gap.shape[-1] == 5:
        gap[..., 3] = np.minimum(gap[..., 3] % (2 * np.pi), -gap[..., 3] % (2 * np.pi))
    return float(gap.max())


def timed(problem: engines.Problem, built: Mapping[str, Program], repetitions: int) -> Found:
    """Microseconds for a step of one run."""
    calls: dict[tuple[str, str], Callable[[], float]] = {}
    for name in engines.TRACKERS:
        for by in ENGINES:
            calls[name, by] = lambda name=name, by=by: engines.filtering(problem, name, by)
    for name, peers in engines.PEERS.items():
        if name in built:
            calls[name, EIGEN] = built[name].run
        given = engines.task(problem, name, PEER_RUNS)
        for peer, call in peers.items():
            calls[name, peer] = lambda call=call, given=given: engines.seconds_of_peer(call, given)
    best = dict.fromkeys(calls, float("inf"))
    for repetition in range(repetitions):
        print(f"repetition {repetition + 1} of {repetitions}", file=sys.stderr)
        for (name, engine), call in calls.items():
            runs = PEER_RUNS if engine in engines.PEERS.get(name, {}) else problem.runs
            best[name, engine] = min(best[name, engine], call() / (runs * problem.steps) * 1e6)
    return best
