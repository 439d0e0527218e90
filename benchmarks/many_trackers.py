"""What a sweep of many trackers costs: processor seconds and memory.

    python -m benchmarks.many_trackers [POINTS...]

Each sweep is ``trackbench run`` of highway with so many Kalman filters, twenty runs of one second, without a recording:
a process of its own, measured from its start to its end. Filtering and scoring are the blocks of runs. All together has
to stay within the goals at ``GOAL_POINTS`` points.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.goal import at_most

POINTS = (500, 1000)
GOAL_POINTS, GOAL_SECONDS, GOAL_GIB = 1000, 40.0, 1.0
SETTINGS = ("truth.duration_s=1", "monte_carlo.runs=20", "score.settle_s=0", "score.lost_after_s=1")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("points", nargs="*", type=int, default=POINTS)
    parser.add_argument("--inside", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.inside is not None:
        print(json.dumps(_spent(arguments.inside)))
        return 0
    met = True
    for points in arguments.points:
        spent = measure(points)
        print(f"{points} points: " + ", ".join(f"{name} {value:.3g}" for name, value in spent.items()), flush=True)
        if points == GOAL_POINTS:
            goals = [
                at_most(f"{points} points: processor seconds", spent["filtering_s"] + spent["rest_s"], GOAL_SECONDS),
                at_most(f"{points} points: GiB", spent["gib"], GOAL_GIB),
            ]
            print(*(json.dumps(goal) for goal in goals), sep="\n")
            met = all(goal["met"] for goal in goals)
    return 0 if met else 1


def measure(points: int) -> dict[str, float]:
    """Processor seconds of filtering and of the rest, the largest memory of each, the size of the result."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "many.yaml"
        path.write_text(_scenario(points), encoding="utf-8")
        command = [sys.executable, "-m", "benchmarks.many_trackers", "--inside", str(path)]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        spent: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
        return spent


def _scenario(points: int) -> str:
    """Highway with one Kalman filter a point and nothing else."""
    from trackbench.scenario.shipped import find_scenario

    head = (
        find_scenario("highway")
        .read_text(encoding="utf-8")
        .partition("trackers:")[0]
        .replace("name: highway", "name: many")
    )
    sigmas = [round(0.5 + 10 * number / points, 4) for number in range(points)]
    sweep = {"filter": "kf", "motion": "cv", "sensors": ["roof_lidar"], "sweep": {"acceleration_sigma_mps2": sigmas}}
    return f"{head}trackers:\n  kf: {json.dumps(sweep)}\n"


def _spent(path: Path) -> dict[str, float]:
    """Run the command in this process."""
    from click.testing import CliRunner

    from trackbench.cli.commands import cli
    from trackbench.runner import loop

    filtering = filtering_gib = 0.0
    run_block = loop.run_block

    def timed(*arguments: Any, **options: Any) -> Any:
        nonlocal filtering, filtering_gib
        begin = time.process_time()
        try:
            return run_block(*arguments, **options)
        finally:
            filtering += time.process_time() - begin
            filtering_gib = _largest_gib()

    loop.run_block = timed
    sets = [word for setting in SETTINGS for word in ("--set", setting)]
    out = path.parent / "results"
    command = ["run", str(path), "--no-recording", "--workers", "1", "--out", str(out), *sets]
    outcome = CliRunner().invoke(cli, command, catch_exceptions=False)
    assert outcome.exit_code == 0, outcome.output
    return {
        "filtering_s": filtering,
        "rest_s": time.process_time() - filtering,
        "filtering_gib": filtering_gib,
        "gib": _largest_gib(),
        "json_mb": (out / "many" / "result.json").stat().st_size / 1e6,
        "folder_mb": sum(file.stat().st_size for file in (out / "many").iterdir()) / 1e6,
    }


def _largest_gib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


if __name__ == "__main__":
    sys.exit(main())
