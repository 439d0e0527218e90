"""Where the time of a command goes: processor seconds and elapsed seconds of each stage, for a few commands.

``make benchmark`` shows them beside those of an earlier commit, which are kept in ``stages_before.json``. Machines
differ and are busy with other things, so a fixed piece of work is timed beside every command, and the times before are
stated in seconds of the machine of now. ``python benchmarks/stages.py`` prints the table alone.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import table

HERE = Path(__file__).parent
BEFORE = HERE / "stages_before.json"
CLOCK = HERE / "stage_clock.py"
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
    initial: {{from: first_reading}}
    sweep:
      acceleration_sigma_mps2: {sigmas}
      initial.velocity_sigma_mps: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]
monte_carlo: {{runs: 20, seed: 7}}
"""


def main() -> None:
    print(table.stages(before(), measure()))


def before() -> dict[str, Any]:
    """What :func:`measure` gave for an earlier commit, and which that was."""
    found: dict[str, Any] = json.loads(BEFORE.read_text(encoding="utf-8"))
    return found


def measure() -> list[dict[str, Any]]:
    """Of each command: its name, the seconds of the fixed work beside it, and of each stage the two times."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        out = folder / "results"
        scenarios = HERE.parent / "scenarios"
        run_warm: dict[str, list[str]] = {
            "run highway": ["highway"],
            "run highway --runs 1000": ["highway", "--runs", "1000"],
            "run scenarios/": [str(scenarios)],
            "a sweep of 100 points": [str(_sweep(folder, 100))],
            "a sweep of 200 points": [str(_sweep(folder, 200))],
        }
        found = [_repeated("run highway, the first time", ["highway"], out, folder / "cache", cold=True)]
        _timed(["run", str(scenarios), "--runs", "1", "--out", str(out), "--no-recording"], folder / "cache")
        found += [_repeated(name, command, out, folder / "cache") for name, command in run_warm.items()]
    return found


def _sweep(folder: Path, points: int) -> Path:
    path = folder / f"sweep_{points}.yaml"
    sigmas = [round(0.5 + 0.1 * number, 1) for number in range(points // 10)]
    path.write_text(SWEEP.format(sigmas=sigmas), encoding="utf-8")
    return path


def _repeated(name: str, scenario: list[str], out: Path, cache: Path, *, cold: bool = False) -> dict[str, Any]:
    print(f"stages of {name} ...", file=sys.stderr)
    repetitions: list[dict[str, Any]] = []
    begin = time.perf_counter()
    while len(repetitions) < (1 if cold else REPETITIONS) and time.perf_counter() - begin < SECONDS:
        work = fixed_work()
        stages = _timed(["run", *scenario, "--workers", "1", "--out", str(out)], cache)
        repetitions.append({"command": name, "fixed_work": min(work, fixed_work()), "stages": stages})
    return min(repetitions, key=lambda one: sum(cpu for cpu, _ in one["stages"].values()) / one["fixed_work"])


def _timed(command: list[str], cache: Path) -> dict[str, list[float]]:
    """By stage, seconds of the processor and elapsed, in a process of its own."""
    file = cache.parent / "stages.json"
    one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    environment = {**os.environ, **one_thread, "TRACKBENCH_CACHE": str(cache)}
    subprocess.run([sys.executable, str(CLOCK), str(file), *command], check=True, capture_output=True, env=environment)
    found: dict[str, list[float]] = json.loads(file.read_text(encoding="utf-8"))
    return found


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
