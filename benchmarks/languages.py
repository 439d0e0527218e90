"""What a scan costs a tracker that is a program in C++, beside a bare exchange by pipes and the same filter inside.

Run as ``python -m benchmarks.languages``, it keeps itself and all that it starts on one core and prints JSON.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.goal import at_most

from benchmarks import engines
from trackbench.base.types import Scan
from trackbench.driving.isolation import Isolation
from trackbench.driving.remote import start_stepper
from trackbench.driving.steppers import Stepper
from trackbench.trackers.config import FilterConfig, PluginConfig

#: Members that are followed at once, and steps of which the median counts, so few of the long ones that other processes
#: take no turns between them; the best of so many repetitions.
STEPS = {1: 1000, 100: 400, 2000: 60}
REPETITIONS = 10
#: Bytes of a bare exchange there and back, as many as a scan and an estimate have.
THERE, BACK = 400, 200
#: Largest difference from the filter inside, relative to the largest entry.
SAME = 1e-9
LANGUAGES = files("trackbench.subjects.templates").joinpath("languages")
INSIDE = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3, "initial": {"velocity": "zero"}}
#: The example as a tracker of a batch, which writes the nanoseconds of each of its own steps to a file.
BATCH = """
#include <chrono>
#include <vector>
struct Batch {
    static constexpr bool batched = true;
    trackbench::Options options;
    std::vector<Mine> each;
    std::FILE *times = std::fopen("times", "wb");
    explicit Batch(const trackbench::Options &given) : options(given) {}
    bool step(const trackbench::Scan &scan, double *mean, double *covariance) {
        const auto begin = std::chrono::steady_clock::now();
        const int64_t n = scan.batch;
        if (each.empty()) each.assign(static_cast<size_t>(n), Mine(options));
        trackbench::Scan one = scan;
        double column[3];
        one.measurement = column;
        for (int64_t k = 0; k < n; k++) {
            for (int64_t i = 0; i < scan.components; i++) column[i] = scan.measurement[i * n + k];
            one.valid = scan.valid + k;
            const auto estimate = *each[static_cast<size_t>(k)].step(one);
            for (int i = 0; i < 4; i++) mean[i * n + k] = estimate.mean[static_cast<size_t>(i)];
            for (int i = 0; i < 16; i++) covariance[i * n + k] = estimate.covariance[static_cast<size_t>(i)];
        }
        const int64_t taken = (std::chrono::steady_clock::now() - begin) / std::chrono::nanoseconds(1);
        std::fwrite(&taken, sizeof taken, 1, times);
        std::fflush(times);
        return true;
    }
};
TRACKBENCH_TRACKER(Batch)
"""
PROGRAM, BATCHED, INSIDE_IT = "C++ program", "C++ program that takes batches", "of these, its own step"


def measure() -> dict[str, Any]:
    """Measured in a process of its own."""
    if shutil.which("g++") is None:
        return {"without": "no C++ compiler"}
    print("trackers in other languages ...", file=sys.stderr)
    command = [sys.executable, "-m", "benchmarks.languages"]
    found: dict[str, Any] = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return found


def timed(folder: Path) -> dict[str, Any]:
    """Microseconds of a bare exchange, and of a scan by members and tracker; and what is aimed at."""
    _build(folder)
    make: dict[str, Callable[[int], Stepper]] = {
        PROGRAM: partial(_own, folder, {"command": ["./mine"]}),
        BATCHED: partial(_own, folder, {"command": ["./batch"]}),
        "EKF inside, NumPy": partial(_inside, "numpy"),
        "EKF inside, fused": partial(_inside, "fused"),
    }
    _require_alike([_estimates(each(100), engines.problem(100, 50).scans) for each in make.values()])
    bare: list[float] = []
    found: dict[tuple[int, str], float] = {}
    for members, steps in STEPS.items():
        scans = engines.problem(members, steps).scans
        for _ in range(REPETITIONS):
            bare.append(_bare(1000))
            for name, each in make.items():
                microseconds = _median(each(members), scans)
                found[members, name] = min(found.get((members, name), np.inf), microseconds)
                if name == BATCHED:
                    own = float(np.median(np.fromfile(folder / "times", dtype=np.int64))) / 1e3
                    found[members, INSIDE_IT] = min(found.get((members, INSIDE_IT), np.inf), own)
    exchange, most = min(bare), max(STEPS)
    rows = [{"members": members, "tracker": name, "us": value} for (members, name), value in found.items()]
    goals = [
        at_most("a C++ program, one member: µs for a scan", found[1, PROGRAM], 25),
        at_most(
            f"{BATCHED}, {most} members: times as long as its own step",
            found[most, BATCHED] / found[most, INSIDE_IT],
            1.8,
        ),
    ]
    return {"bare_us": exchange, "rows": rows, "goals": goals}


def _build(folder: Path) -> None:
    for name in ("trackbench.h", "trackbench.hpp", "trackbench_program.h", "ekf.hpp"):
        (folder / name).write_text(LANGUAGES.joinpath(name).read_text(encoding="utf-8"), encoding="utf-8")
    source = LANGUAGES.joinpath("tracker.cpp.j2").read_text(encoding="utf-8").replace("{{ cls }}", "Mine")
    (folder / "mine.cpp").write_text(source, encoding="utf-8")
    (folder / "batch.cpp").write_text(source.replace("TRACKBENCH_TRACKER(Mine)", BATCH), encoding="utf-8")
    for name in ("mine", "batch"):
        # As the Makefile that is written for users.
        command = ["g++", "-std=c++17", "-O2", "-DTRACKBENCH_PROGRAM", f"{name}.cpp", "-o", name]
        subprocess.run(command, cwd=folder, check=True)


def _own(folder: Path, use: dict[str, Any], members: int) -> Stepper:
    config = PluginConfig.model_validate({"use": use})
    return start_stepper(config, folder, members, lambda tracker: tracker, Isolation())


def _inside(engine: str, members: int) -> Stepper:
    config = FilterConfig.model_validate(INSIDE)
    return start_stepper(config, None, members, lambda tracker: replace(tracker, engine=engine, lag_s=0.0), Isolation())


def _estimates(stepper: Stepper, scans: Sequence[Scan]) -> np.ndarray:
    """``(steps, 20, members)``."""
    estimates = [stepper.step(scan) for scan in scans]
    stepper.close()
    return np.stack([np.vstack([each.mean, each.covariance.reshape(16, -1)]) for each in estimates])


def _require_alike(found: Sequence[np.ndarray]) -> None:
    """Before anything is timed."""
    for rows in (slice(0, 4), slice(4, 20)):
        expected = found[-1][:, rows]
        largest = np.abs(expected).max(axis=1, keepdims=True)
        apart = max(float((np.abs(each[:, rows] - expected) / largest).max()) for each in found)
        if not apart < SAME:
            sys.exit(f"the trackers differ by {apart:g} of the largest entry; nothing is timed")


def _median(stepper: Stepper, scans: Sequence[Scan]) -> float:
    """Microseconds for a scan."""
    seconds = []
    for scan in scans:
        begin = time.perf_counter()
        stepper.step(scan)
        seconds.append(time.perf_counter() - begin)
    stepper.close()
    return 1e6 * float(np.median(seconds))


def _bare(times: int) -> float:
    """Microseconds of an exchange with a process that only reads and writes."""
    (their_in, out), (back, their_out) = os.pipe(), os.pipe()
    process = os.fork()
    if process == 0:
        os.close(out)
        while os.read(their_in, 1 << 16):
            os.write(their_out, bytes(BACK))
        os._exit(0)
    os.close(their_in)
    os.close(their_out)
    seconds = []
    for _ in range(times):
        begin = time.perf_counter()
        os.write(out, bytes(THERE))
        os.read(back, 1 << 16)
        seconds.append(time.perf_counter() - begin)
    os.close(out)
    os.waitpid(process, 0)
    os.close(back)
    return 1e6 * float(np.median(seconds))


if __name__ == "__main__":
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    with tempfile.TemporaryDirectory() as place:
        print(json.dumps(timed(Path(place)), indent=2))
