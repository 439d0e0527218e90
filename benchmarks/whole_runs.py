"""What a user pays for a whole run: processor time and memory of ``tb.run``, beside the bare filters of others.

A run senses, starts, filters, scores, computes the bound and gives verdicts. Each is measured in a process of its own.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from typing import Any, NamedTuple

from benchmarks.digits import digits

#: A first run of each tracker counts for nothing: it makes the truth and the kernels.
INSIDE = """
import json, resource, sys, time
import trackbench as tb

scenario, changes, options, repetitions = json.loads(sys.argv[1])
tb.run(tb.load(scenario, changes, **options | {"runs": 2}), workers=1, engine="fused")
spent = []
for _ in range(repetitions):
    begin = time.process_time()
    tb.run(tb.load(scenario, changes, **options), workers=1, engine="fused")
    spent.append(time.process_time() - begin)
print(json.dumps([min(spent), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024]))
"""


class Cost(NamedTuple):
    """What a run costs."""

    seconds: float
    """Processor time, the least of the repetitions."""
    mebibytes: float
    """Largest memory of the process, MiB (where ``ru_maxrss`` is in KiB, as on Linux)."""


def cost(scenario: str, changes: Mapping[str, Any], options: Mapping[str, Any], repetitions: int = 2) -> Cost:
    """Measure a run in a process of its own, by the fused engine on one thread."""
    command = [sys.executable, "-c", INSIDE, json.dumps([scenario, changes, options, repetitions])]
    return Cost(*json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout))


class Case(NamedTuple):
    """A run that is measured."""

    scenario: str
    trackers: list[str] | None
    """None: all of the scenario."""
    runs: int
    object_scans: int | None
    """Objects times scans, in each run; None where it is not given per object and scan."""
    problem: str | None
    """The bare filter of ``benchmarks.filters`` that the run is compared with."""
    changes: Mapping[str, Any] = {}
    """Of the scenario."""

    @property
    def name(self) -> str:
        """Return the run in words."""
        trackers = f"{len(self.trackers)} trackers" if self.trackers and len(self.trackers) > 1 else self._single
        changed = "".join(f", {key.rpartition('.')[2]} {str(value).lower()}" for key, value in self.changes.items())
        return f"`{self.scenario}`, {trackers}{changed}, {self.runs:,} runs"

    @property
    def _single(self) -> str:
        return f"`{self.trackers[0]}`" if self.trackers else "all trackers"


CASES = (
    Case("scripted/figure_eight", ["ekf"], 10_000, 600, "EKF, CV"),
    Case("scripted/figure_eight", ["ukf"], 10_000, 600, "UKF, CTRV", {"trackers.ukf.augmented": False}),
    Case("scripted/figure_eight", ["ukf"], 10_000, 600, "UKF, CTRV"),
    Case("highway", ["ekf_cv"], 10_000, 5 * 602, "EKF, CV"),
    Case("highway", ["ukf_ctrv"], 10_000, 5 * 602, "UKF, CTRV", {"trackers.ukf_ctrv.augmented": False}),
    Case("highway", ["ukf_ctrv"], 10_000, 5 * 602, "UKF, CTRV"),
    Case("highway", None, 10_000, None, None),
    Case("traffic/dense_highway", None, 2, None, None),
)


def measure() -> list[dict[str, Any]]:
    """One row for each case."""
    rows = []
    for case in CASES:
        options = {"runs": case.runs} | ({"trackers": case.trackers} if case.trackers else {})
        seconds, mebibytes = cost(case.scenario, case.changes, options)
        each = 1e6 * seconds / (case.runs * case.object_scans) if case.object_scans else None
        row = {"run": case.name, "problem": case.problem, "seconds": seconds, "mebibytes": mebibytes}
        rows.append(row | {"microseconds": each})
        print(f"{case.name}: {seconds:.2f} s, {mebibytes:.0f} MiB", file=sys.stderr)
    return rows


def section(measured: list[dict[str, Any]], filters: Mapping[tuple[str, str], float]) -> str:
    """Return the costs as Markdown; ``filters`` are microseconds of a step by problem, and by engine or package."""

    def beside(row: dict[str, Any], other: str) -> str:
        if (row["problem"], other) not in filters:
            return ""
        return f"{digits(row['microseconds'] / filters[row['problem'], other])}"

    rows = [
        f"| {row['run']} | {digits(row['seconds'])} | {row['mebibytes']:.0f} "
        f"| {digits(row['microseconds']) if row['microseconds'] else ''} "
        f"| {beside(row, 'C++ with Eigen')} | {beside(row, 'FilterPy')} |"
        for row in measured
    ]
    return "\n".join(
        [
            "## A whole run",
            "",
            "`tb.run` by the fused engine on one thread, truth and kernels cached: sensing, start, filter, scores, "
            "bound and verdicts. The last two columns are its time for an object and a scan over that of a prediction "
            "and an update alone, in C++ with Eigen and by FilterPy (the table above), which do not augment the UKF.",
            "",
            "| run | CPU s | MiB | us an object and scan | of Eigen's filter | of FilterPy's |",
            "|---|---:|---:|---:|---:|---:|",
            *rows,
            "",
        ]
    )


if __name__ == "__main__":
    for found in measure():
        print(found)
