"""Where the time of a command goes: processor seconds and elapsed seconds of each stage, by each engine.

``make benchmark`` shows them beside those of an earlier commit, which are kept in ``stages_before.json``. Machines
differ and are busy with other things, so a fixed piece of work is timed beside every command, and the times before are
stated in seconds of the machine of now. ``python -m benchmarks.stages`` prints the tables alone; with ``--before
CHECKOUT`` it measures another commit, which is checked out there, and writes ``stages_before.json``.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.goal import at_most
from benchmarks.table_stages import compiling, stages

from trackbench.engine.choice import Engine

HERE = Path(__file__).parent
ROOT = HERE.parent
BEFORE = HERE / "stages_before.json"
CLOCK = HERE / "stage_clock.py"
ENGINES: tuple[Engine, ...] = ("numpy", "fused")
FIRST, DEMO, MANY = "run highway, the first time", "run highway", "run highway --runs 10000"
WARM = {
    DEMO: ["highway"],
    "run highway --runs 1000": ["highway", "--runs", "1000"],
    MANY: ["highway", "--runs", "10000"],
    "run scenarios/": ["scenarios"],
}
SWEEPS = (100, 200)
#: Of the fused engine: what ``make demo`` takes once its truth and kernels are there, elapsed s; and processor s.
DEMO_GOAL, MANY_GOAL = 4.0, 20.0
#: A command is repeated until so many seconds are spent on it, at most so often; the cheapest repetition counts.
SECONDS, REPETITIONS = 20.0, 3
SWEEP = """\
name: sweep
truth:
  source: scripted
  duration_s: 10
  rate_hz: 10
  objects: {{car: {{start: {{x: 20, speed_mps: 3}}, pieces: [{{for_s: 5}}, {{for_s: 5, turn_rate_degps: 10}}]}}}}
sensors:
  front: {{type: radar, rate_hz: 10, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.1}}
  roof: {{type: lidar, rate_hz: 10, position_sigma_m: 0.15}}
trackers:
  ekf:
    filter: ekf
    motion: cv
    initial: {{from: first_measurement}}
    sweep:
      acceleration_sigma_mps2: {sigmas}
      initial.velocity_sigma_mps: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]
monte_carlo: {{runs: 20, seed: 7}}
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", type=Path, metavar="CHECKOUT", help="measure this, and keep it as what was before")
    checkout = parser.parse_args().before
    if checkout is None:
        found = measure()
        print(compiling(found), stages(before(), found), sep="\n")
        return
    command = ["git", "-C", str(checkout), "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
    with tempfile.TemporaryDirectory() as folder:
        found = Bench(checkout, Path(folder)).commands([None])
    BEFORE.write_text(json.dumps({"commit": commit, "commands": found}, indent=1) + "\n", encoding="utf-8")


def before() -> dict[str, Any]:
    """The commands of an earlier commit, and which that was."""
    found: dict[str, Any] = json.loads(BEFORE.read_text(encoding="utf-8"))
    return found


def measure() -> dict[str, Any]:
    """The commands, each by each engine, how many kernels the first takes, and the goals."""
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(ROOT, Path(folder))
        found = bench.commands(ENGINES)
        return {"commands": found, "kernels": bench.kernels, "goals": goals(found)}


def goals(found: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """What was measured of the fused engine beside what is aimed at."""
    spent = {item["command"]: list(item["stages"].values()) for item in found if item["engine"] == "fused"}
    demo, many = sum(elapsed for _, elapsed in spent[DEMO]), sum(cpu for cpu, _ in spent[MANY])
    return [
        at_most(f"`{DEMO}`, which `make demo` does: elapsed seconds", demo, DEMO_GOAL),
        at_most(f"`{MANY}`: processor seconds", many, MANY_GOAL),
    ]


class Bench:
    """Times the commands of a checkout; ``folder`` is for what they write."""

    def __init__(self, checkout: Path, folder: Path) -> None:
        self._checkout, self._folder = checkout.resolve(), folder
        self.kernels = 0
        """How many the first command made."""

    def commands(self, engines: Sequence[Engine | None]) -> list[dict[str, Any]]:
        """Of each command by each engine (None: there is no choice): the seconds of the fixed work beside it, and of
        each stage the two times."""
        found = [self._repeated(FIRST, ["highway"], engine, cold=True) for engine in engines]
        self.kernels = len(list(self._cache(engines[-1]).rglob("*.o")))
        for engine in engines:
            self._timed(["scenarios", "--runs", "2", "--no-recording"], engine)
        sweeps = {f"a sweep of {points} points": [str(self._sweep(points))] for points in SWEEPS}
        for name, scenario in (WARM | sweeps).items():
            found += [self._repeated(name, scenario, engine) for engine in engines]
        return found

    def _sweep(self, points: int) -> Path:
        path = self._folder / f"sweep_{points}.yaml"
        sigmas = [round(0.5 + 0.1 * number, 1) for number in range(points // 10)]
        path.write_text(SWEEP.format(sigmas=sigmas), encoding="utf-8")
        return path

    def _repeated(self, name: str, scenario: list[str], engine: Engine | None, *, cold: bool = False) -> dict[str, Any]:
        print(f"stages of {name}{f', {engine}' if engine else ''} ...", file=sys.stderr)
        repetitions: list[dict[str, Any]] = []
        begin = time.perf_counter()
        while len(repetitions) < (1 if cold else REPETITIONS) and time.perf_counter() - begin < SECONDS:
            work = fixed_work()
            spent = self._timed(scenario, engine)
            work = min(work, fixed_work())
            repetitions.append({"command": name, "engine": engine, "fixed_work": work, "stages": spent})
        return min(repetitions, key=lambda one: sum(cpu for cpu, _ in one["stages"].values()) / one["fixed_work"])

    def _timed(self, scenario: list[str], engine: Engine | None) -> dict[str, list[float]]:
        """By stage, seconds of the processor and elapsed of a run, in a process of its own."""
        file, out = self._folder / "stages.json", self._folder / "results"
        by = ["--engine", engine] if engine else []
        command = [sys.executable, str(CLOCK), str(file), "run", *scenario, *by, "--workers", "1", "--out", str(out)]
        one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        own = {"TRACKBENCH_CACHE": str(self._cache(engine)), "PYTHONPATH": str(self._checkout / "src")}
        environment = {**os.environ, **one_thread, **own}
        subprocess.run(command, check=True, capture_output=True, env=environment, cwd=self._checkout)
        found: dict[str, list[float]] = json.loads(file.read_text(encoding="utf-8"))
        return found

    def _cache(self, engine: Engine | None) -> Path:
        return self._folder / f"cache {engine}"


def fixed_work() -> float:
    """Processor seconds of a piece of work that no change of trackbench changes: arrays, and plain Python."""
    begin = time.process_time()
    covariance = np.linspace(0.0, 1.0, 4 * 4 * 2000).reshape(4, 4, 2000)
    for _ in range(500):
        np.einsum("ik...,kj...->ij...", covariance, covariance)
    text = json.dumps([{"name": f"tracker_{number}", "value": number / 7} for number in range(2000)])
    for _ in range(60):
        json.dumps(json.loads(text), indent=2)
    return time.process_time() - begin


if __name__ == "__main__":
    main()
