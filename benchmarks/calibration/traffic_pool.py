"""Many runs of the traffic problem, and many scenes of it, from which results are drawn."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

import trackbench as tb
from trackbench.base.execution import Executor
from trackbench.base.types import Array, Indices
from trackbench.metrics.intervals import Interval, clustered
from trackbench.metrics.traffic import TRACK_METRICS, TRACKS, run_sums
from trackbench.runner.loop import run_block
from trackbench.runner.recorded import Outcome
from trackbench.runner.work import work_of
from trackbench.scenario.truth import PendingTruths

TRACKERS = ("gnn", "jpda", "pmb")
RUNS = 1000
SCENES, RUNS_OF_SCENE = 60, 8
#: Where the cars of a scene start, m.
STARTS: dict[str, dict[str, tuple[float, float]]] = {
    "first": {"x": (15, 40)},
    "second": {"x": (15, 40), "y": (2.5, 6)},
    "third": {"x": (25, 60), "y": (-10, -5)},
}


def runs() -> Array:
    """``(trackers, RUNS, 2, paths)`` totals and counts of each run of one scene."""
    return _sums({}, RUNS)


def scenes() -> Array:
    """``(trackers, SCENES, RUNS_OF_SCENE, 2, paths)`` of runs of each of many scenes."""
    random = np.random.default_rng(1)
    found = []
    for number in range(SCENES):
        changes: dict[str, object] = {"name": f"calibration_traffic_{number}"}
        for car, places in STARTS.items():
            changes |= {f"truth.objects.{car}.start.{key}": random.uniform(*ends) for key, ends in places.items()}
        found.append(_sums(changes, RUNS_OF_SCENE))
    return np.stack(found, axis=1)


def interval(sums: Array, path: str, scene: Indices | None = None) -> Interval | None:
    """A metric of runs ``(runs, 2, paths)``, as a result makes it; None where no run tells it."""
    found = TRACK_METRICS[path].of_runs(*run_sums(sums, path))
    if found is None:
        return None
    # Also below the number of runs from which on a result has one.
    found = found._replace(fewest=2)
    return found if scene is None else clustered(found, scene)


def _sums(changes: Mapping[str, object], number: int) -> Array:
    scenario = tb.load(Path(__file__).with_name("traffic.yaml"), changes, runs=number)
    work = work_of(scenario, PendingTruths(scenario, Executor()).collect())
    blocks = [run_block(work, piece) for piece in work.pieces()]
    found = []
    for name in TRACKERS:
        scores = [block.outcomes[name] for block in blocks]
        kept = [each.sums[TRACKS.name] for each in scores if isinstance(each, Outcome)]
        found.append(np.concatenate(kept))
    return np.array(found)
