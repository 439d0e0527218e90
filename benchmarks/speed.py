"""Speed of trackbench's filters and trackers beside those of other packages, on the same data, and how a run grows.

Prints a page and writes it to ``results/benchmark.md`` and ``results/benchmark.json``. Everything runs on one thread.
"""

from __future__ import annotations

import argparse
import os

# Before NumPy is imported: its linear algebra would take every core.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import json
import platform
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

from benchmarks import filters, growth, table, traffic_trackers, whole_runs
from trackbench.engine.machine import unavailable

RESULTS = Path(__file__).parent.parent / "results"
REPETITIONS = 7
#: What can be measured by itself.
PARTS: dict[str, Callable[[], Any]] = {
    "filters": lambda: filters.measure(REPETITIONS),
    "traffic_trackers": traffic_trackers.measure,
    "whole_runs": whole_runs.measure,
    "growth": growth.measure,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=REPETITIONS)
    parser.add_argument("--only", nargs="+", choices=PARTS, default=[], help="measure these again; the rest stays")
    options = parser.parse_args()
    if options.only:
        kept = json.loads((RESULTS / "benchmark.json").read_text())
        again = kept.get("again", {}) | dict.fromkeys(options.only, where())
        write(kept | {"again": again} | {name: PARTS[name]() for name in options.only})
        return
    if reason := unavailable():
        sys.exit(f"the fused engine cannot be measured: {reason}")
    found = {
        **where(),
        "filters": filters.measure(options.repetitions),
        **{name: PARTS[name]() for name in ("traffic_trackers", "whole_runs", "growth")},
    }
    write(found)


def write(found: dict[str, Any]) -> None:
    """Print the page and write it."""
    growth.draw(found["growth"])
    text = table.markdown(found)
    print(text)
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "benchmark.md").write_text(text, encoding="utf-8")
    (RESULTS / "benchmark.json").write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


def where() -> dict[str, Any]:
    """The machine and the versions."""
    names = ("trackbench", "numpy", "llvmlite", "filterpy", "stonesoup")
    return {
        "machine": {"cpu": cpu_model(), "threads": 1, "python": platform.python_version()},
        "versions": {name: version(name) for name in names},
    }


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
