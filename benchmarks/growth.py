"""How the time of a run grows with its duration, targets, scenes and trackers: figures and slopes.

``python -m benchmarks.growth`` prints the section and draws ``results/figures/benchmark-growth-*.svg``.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from benchmarks.digits import digits
from benchmarks.whole_runs import cost
from matplotlib.figure import Figure as Canvas

from trackbench.document import Figure
from trackbench.document.drawing import svg_file

FIGURES = Path(__file__).parent.parent / "results" / "figures"


class Case(NamedTuple):
    """What is varied."""

    name: str
    unit: str
    values: tuple[int, ...]
    scenario: str
    changes: dict[str, Any]
    options: dict[str, Any]
    varied: str
    """The key of the scenario; "trackers", "runs" or "scenes"."""
    what: str
    """The rest of the run."""

    def seconds(self, value: int) -> float:
        """Processor seconds of a run."""
        changes, options = dict(self.changes), dict(self.options)
        if self.varied == "trackers":
            entry = {"filter": "kf", "motion": "cv"}
            changes |= {f"trackers.kf{i}": entry | {"acceleration_sigma_mps2": 1 + i / value} for i in range(value)}
            options["trackers"] = [f"kf{i}" for i in range(value)]
        elif self.varied in ("runs", "scenes"):
            options[self.varied] = value
        else:
            changes[self.varied] = {"nearest": value} if self.varied == "truth.targets" else value
        seconds = cost(self.scenario, changes, options).seconds
        print(f"{self.name} {value}: {seconds:.3f} s", file=sys.stderr)
        return seconds


ONE = {"trackers": ["ekf_cv"]}
DENSE = {"truth.config": {"vehicles_count": 150, "vehicles_density": 2.5}, "truth.duration_s": 5}
CASES = (
    Case("runs", "runs", (100, 300, 1000, 3000, 10000), "highway", {}, ONE, "runs", "`highway`, `ekf_cv`, 5 vehicles"),
    Case("duration", "s", (5, 10, 20, 40, 80), "highway", {}, ONE | {"runs": 200}, "truth.duration_s",
         "`highway`, `ekf_cv`, 5 vehicles, 200 runs"),
    Case("scenes", "scenes", (1, 3, 10, 30, 100, 300), "highway", {"truth.duration_s": 3}, ONE | {"runs": 20}, "scenes",
         "`highway` of 3 s, `ekf_cv`, 5 vehicles, 20 runs of each; the truth is cached"),
    Case("targets", "targets", (5, 10, 20, 50, 100), "highway", DENSE, ONE | {"runs": 20}, "truth.targets",
         "dense `highway` of 5 s, `ekf_cv`, identities known, 20 runs; sensors see to 150 m"),
    Case("targets in traffic", "targets", (5, 10, 20, 50, 100), "traffic/dense_highway", DENSE,
         {"trackers": ["gnn"], "runs": 5, "scenes": 1}, "truth.targets",
         "dense `traffic/dense_highway` of 5 s, `gnn`, identities hidden, 5 runs; as far"),
    Case("trackers", "trackers", (1, 3, 10, 30, 100), "highway", {"truth.duration_s": 5}, {"runs": 20}, "trackers",
         "`highway` of 5 s, Kalman filters, 5 vehicles, 20 runs"),
)  # fmt: skip


def measure(cases: Sequence[Case] = CASES) -> list[dict[str, Any]]:
    """By case the seconds, and the power of the larger half."""
    rows = []
    for case in cases:
        seconds = [case.seconds(value) for value in case.values]
        last = slice(len(seconds) // 2, None)
        slope = np.polyfit(np.log(case.values[last]), np.log(seconds[last]), 1)[0]
        rows.append({"case": case.name, "values": list(case.values), "seconds": seconds, "slope": float(slope)})
    return rows


def draw(measured: Sequence[dict[str, Any]]) -> None:
    """One figure for each case, in ``results/figures``."""
    for case, row in zip(CASES, measured, strict=True):

        def paint(canvas: Canvas, case: Case = case, row: dict[str, Any] = row) -> None:
            axes = canvas.add_subplot()
            axes.loglog(row["values"], row["seconds"], "o-", color="#0072B2")
            axes.set_xlabel(case.unit if case.unit == case.name else f"{case.name}, {case.unit}")
            axes.set_ylabel("processor time, s")
            axes.set_xticks(row["values"], [str(value) for value in row["values"]], minor=False)
            axes.minorticks_off()
            axes.grid(alpha=0.3)

        alternative = f"Processor time of a run over {case.name}: {_cells(row)}"
        figure = Figure(_file(case), "", "", alternative, paint, 220, 420)
        (FIGURES / f"{_file(case)}.svg").write_text(svg_file(figure), encoding="utf-8")


def section(measured: Sequence[dict[str, Any]]) -> str:
    """The figures as Markdown."""
    lines = [
        "## How it grows",
        "",
        "Processor time of `tb.run` by the fused engine on one thread, best of two, truth and kernels cached. The "
        "power is that of a straight line through the larger half of the points, both axes logarithmic: 1 is linear.",
        "",
        "| over | power | seconds | the rest |",
        "|---|---:|---|---|",
        *(
            f"| {case.name} | {row['slope']:.2f} | {_cells(row)} | {case.what} |"
            for case, row in zip(CASES, measured, strict=True)
        ),
        "",
    ]
    for case in CASES:
        lines += [f"![Processor time of a run over {case.name}](figures/{_file(case)}.svg)", ""]
    return "\n".join(lines)


def _cells(row: dict[str, Any]) -> str:
    return ", ".join(f"{value}: {digits(spent)}" for value, spent in zip(row["values"], row["seconds"], strict=True))


def _file(case: Case) -> str:
    return f"benchmark-growth-{case.name.replace(' ', '-')}"


if __name__ == "__main__":
    measured_now = measure()
    draw(measured_now)
    print(section(measured_now))
