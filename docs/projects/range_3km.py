"""Runs the published EKF at 3 km, writes the tables of range-3km.md and prints that of the hypotheses.

``python docs/projects/range_3km.py [RUNS]`` from the repository's folder.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tables import fill, markdown

from trackbench.base.types import Array
from trackbench.results import Result
from trackbench.runner.run import run_scenario
from trackbench.scenario import load_scenario
from trackbench.scenario.load import select_trackers
from trackbench.scenario.truth import truths_of

HERE = Path(__file__).resolve().parent
SCENARIOS = HERE.parent.parent / "scenarios" / "published"

#: The published RMSE (x, y) of the one run of each case, m: filtered, raw.
PUBLISHED = {
    "a": {"ekf": (6.74, 18.67), "raw": (35.63, 34.57)},
    "b": {"ekf": (19.70, 3.99), "raw": (43.44, 35.81)},
    "c": {"ekf": (16.62, 24.24), "raw": (36.53, 42.73)},
    "d": {"ekf": (26.74, 17.84), "raw": (33.46, 35.95)},
}
AXES = ("x", "y")


def _start(words: str) -> str:
    return f"initial: {{{words}, covariance_diag: [100, 100, 250, 250]}}"


Q = "process_noise_diag: [20, 20, 4, 4]"
FIRST = _start("from: first_measurement, velocity: zero")
#: From the true velocity, and a position with the error of a reading there; from the true state.
KNOWN_VELOCITY = _start("from: truth, position_sigma_m: 34.4, velocity_sigma_mps: 0.001")
KNOWN_START = _start("from: truth, position_sigma_m: 0.001, velocity_sigma_mps: 0.001")
WHITE = "acceleration_sigma_mps2: 2"

#: What the published program may have done otherwise: options of the filter, further settings.
HYPOTHESES: dict[str, tuple[str, Sequence[str]]] = {
    "as published": (f"{Q}, {FIRST}", ()),
    "first 10 s not scored": (f"{Q}, {FIRST}", ("score.settle_s=10",)),
    "first velocity along the line of sight": (f"{Q}, {_start('from: first_measurement, velocity: radial')}", ()),
    "speed read without error": (f"{Q}, {FIRST}", ("sensors.speed_radar.speed_sigma_mps=0.001",)),
    "first velocity known": (f"{Q}, {KNOWN_VELOCITY}", ()),
    "start known": (f"{Q}, {KNOWN_START}", ()),
    "Q with 4 for position, 20 for velocity": (f"process_noise_diag: [4, 4, 20, 20], {FIRST}", ()),
    "Q for velocity alone": (f"process_noise_diag: [0, 0, 4, 4], {FIRST}", ()),
    "Q of white acceleration, 2 m/s^2": (f"{WHITE}, {FIRST}", ()),
    "Q of white acceleration, start known": (f"{WHITE}, {KNOWN_START}", ()),
    "Q of white acceleration, first velocity known": (f"{WHITE}, {KNOWN_VELOCITY}", ()),
}


@dataclass(frozen=True)
class Place:
    """Where a published value lies among the runs."""

    published: float
    values: Array
    """``(runs,)`` the RMSE of each run, m."""

    @property
    def percentile(self) -> float:
        """Share of the runs below the published value, per cent."""
        return float(100 * np.mean(self.values < self.published))

    @property
    def range95(self) -> tuple[float, float]:
        low, high = np.percentile(self.values, [2.5, 97.5])
        return float(low), float(high)

    @property
    def inside(self) -> bool:
        low, high = self.range95
        return low <= self.published <= high

    def shown(self) -> str:
        """The percentile, in bold type where the value is outside the 95 % range."""
        text = f"{self.percentile:.1f}"
        return text if self.inside else f"**{text}**"


def result(case: str, *overrides: str, tracker: str | None = None) -> Result:
    """The result of one case, of all trackers unless one is named."""
    loaded = load_scenario(SCENARIOS / f"range_3km_{case}.yaml", overrides)
    chosen = loaded if tracker is None else select_trackers(loaded, [tracker])
    return run_scenario(chosen, truths_of(chosen))


def places(case: str, found: Result, tracker: str) -> list[Place]:
    """Of the published values of x and y."""
    table = found.tables["runs"]
    of = np.array(table["tracker"].to_pylist()) == tracker
    columns = (table[f"p{axis}_rmse_m"].to_numpy()[of] for axis in AXES)
    return [Place(*pair) for pair in zip(PUBLISHED[case][tracker], columns, strict=True)]


def percentiles(runs: str) -> str:
    head = ("case", "published, m", "median, m", "95 % of the runs, m", "percentile")
    rows = [
        (
            f"({case}) filtered {axis}",
            f"{place.published:.2f}",
            f"{np.median(place.values):.2f}",
            "{:.2f} to {:.2f}".format(*place.range95),
            place.shown(),
        )
        for case in PUBLISHED
        for axis, place in zip(AXES, places(case, result(case, runs, tracker="ekf"), "ekf"), strict=True)
    ]
    return markdown(head, rows)


def trackers(results: dict[str, Result]) -> str:
    """RMSE of x and y over all runs, and how many runs lost the target."""

    def cells(entry: dict) -> str:
        errors, lost = entry["metrics"], entry["health"]["diverged_runs"]
        text = f"{errors['rmse.px']['value']:.1f}, {errors['rmse.py']['value']:.1f}"
        return f"{text} ({lost} lost)" if lost else text

    entries = {case: {item["name"]: item for item in found.json()["trackers"]} for case, found in results.items()}
    names = [item["name"] for item in results["a"].json()["trackers"]]
    rows = [(f"`{name}`", *(cells(entries[case][name]) for case in results)) for name in names]
    return markdown(("tracker", *(f"({case}) x, y, m" for case in results)), rows)


def hypotheses(runs: str) -> Iterator[tuple[str, ...]]:
    for name, (options, settings) in HYPOTHESES.items():
        tracker = f"{{filter: ekf, motion: cv, sensors: [speed_radar], {options}}}"
        common = (runs, "expect=[]", f"trackers={{ekf: {tracker}}}", *settings)
        found = [place for case in PUBLISHED for place in places(case, result(case, *common), "ekf")]
        yield name, *(place.shown() for place in found), str(sum(not place.inside for place in found))


def main() -> None:
    runs = f"monte_carlo.runs={sys.argv[1] if len(sys.argv) > 1 else 1000}"
    results = {case: result(case, runs) for case in PUBLISHED}
    head = ("hypothesis", *(f"({case}) {axis}" for case in PUBLISHED for axis in AXES), "outside")
    fill(HERE / "range-3km.md", {"percentiles": percentiles(runs), "trackers": trackers(results)})
    print(markdown(head, list(hypotheses(runs))))


if __name__ == "__main__":
    main()
