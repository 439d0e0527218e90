"""Runs the published projects on the Udacity recording and writes the tables of udacity-ukf.md and udacity-fusion.md.

``TRACKBENCH_DATA=... python docs/projects/udacity.py`` from the repository's folder.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tables import fill, markdown

from trackbench.results import Result
from trackbench.runner.run import run_scenario
from trackbench.scenario import load_scenario
from trackbench.scenario.load import select_trackers
from trackbench.scenario.truth import truths_of

HERE = Path(__file__).resolve().parent
SCENARIOS = HERE.parent.parent / "scenarios" / "recorded"
COMPONENTS = ("px", "py", "vx", "vy")
TUNING, FUSION = "udacity_ukf_tuning", "udacity_fusion"
#: px, py m, vx, vy m/s.
Numbers = tuple[float, float, float, float]


class Row(NamedTuple):
    """A published row, and the trackers beside it."""

    what: str
    published: Numbers
    copy: str
    """The tracker that does as the published program did."""
    sound: str = ""
    """The same filter without the program's faults, where it has any."""


#: Of the UKF, whose program scores all but the last two of the 500 estimates.
UKF_SCORED = 498
UKF = (
    Row("lidar and radar", (0.0672, 0.0805, 0.3754, 0.2166), "published", "ukf"),
    Row("lidar", (0.1019, 0.0953, 0.4250, 0.2098), "published_lidar", "ukf_lidar"),
    Row("radar", (0.1396, 0.1639, 0.3960, 0.2626), "published_radar", "ukf_radar"),
)
TUNED = (
    # The published vx is 0.5454, a misprint: the same program gives 0.4554.
    Row("std_a 0.1, std_yawdd 0.1", (0.1305, 0.1341, 0.4554, 0.3111), "published_tuned_0p1_0p1", "tuned_0p1_0p1"),
    Row("std_a 0.2, std_yawdd 0.1", (0.1162, 0.1164, 0.4541, 0.3129), "published_tuned_0p2_0p1", "tuned_0p2_0p1"),
    Row("std_a 0.4, std_yawdd 0.1", (0.1131, 0.1090, 0.4548, 0.3172), "published_tuned_0p4_0p1", "tuned_0p4_0p1"),
    Row("std_a 0.4, std_yawdd 0.2", (0.0763, 0.0866, 0.3954, 0.2416), "published_tuned_0p4_0p2", "tuned_0p4_0p2"),
    Row("std_a 0.4, std_yawdd 0.4", (0.0654, 0.0853, 0.3771, 0.2165), "published_tuned_0p4_0p4", "tuned_0p4_0p4"),
    Row("std_a 0.8, std_yawdd 0.8", (0.0648, 0.0823, 0.3743, 0.2191), "published_tuned_0p8_0p8", "tuned_0p8_0p8"),
    Row("std_a 1.6, std_yawdd 0.8", (0.0686, 0.0816, 0.3769, 0.2257), "published_tuned_1p6_0p8", "tuned_1p6_0p8"),
    Row("std_a 1.6, std_yawdd 1.6", (0.0683, 0.0839, 0.3850, 0.2473), "published_tuned_1p6_1p6", "tuned_1p6_1p6"),
)
#: Of the EKF, whose program scores every estimate.
EKF = (
    Row("EKF, from the first measurement", (0.0972, 0.0854, 0.4509, 0.4396), "ekf"),
    Row("EKF, from two lidar measurements", (0.0988, 0.0850, 0.4328, 0.4751), "ekf_half_known"),
)


def result(name: str, trackers: Sequence[str] = ()) -> Result:
    """The result of one of the scenarios, of all its trackers unless some are named."""
    loaded = load_scenario(SCENARIOS / f"{name}.yaml")
    if trackers:
        loaded = select_trackers(loaded, trackers)
    return run_scenario(loaded, truths_of(loaded))


def rmse(found: Result, tracker: str, scored: int | None = None) -> Numbers:
    """RMSE over the first estimates; None: over all."""
    columns = ["px_m", "py_m", "vx_mps", "vy_mps"]
    estimates, truth = (found.to_pandas(table).set_index(["object", "time_s"]) for table in ("estimates", "truth"))
    errors = (estimates[estimates["tracker"] == tracker][columns] - truth.loc["cyclist":"cyclist", columns]).to_numpy()
    px, py, vx, vy = np.sqrt(np.mean(errors[:scored] ** 2, axis=0)).tolist()
    return px, py, vx, vy


def largest(ours: Numbers, published: Numbers) -> float:
    """The largest relative difference, with its sign."""
    return max((a / b - 1 for a, b in zip(ours, published, strict=True)), key=abs)


def _shown(values: Numbers) -> str:
    return " ".join(f"{value:.4f}" for value in values)


def _ukf_table(found: Result, rows: tuple[Row, ...]) -> str:
    head = ("", "published, and `published...`", "`ukf...`, `tuned...`", "largest difference")
    cells = []
    for row in rows:
        sound = rmse(found, row.sound, UKF_SCORED)
        difference = f"{100 * largest(sound, row.published):+.1f} %"
        cells.append((row.what, _shown(row.published), _shown(sound), difference))
    return markdown(head, cells)


def _ekf_table(found: Result, rows: tuple[Row, ...]) -> str:
    head = ("", "tracker", "published", "ours", "largest difference")
    cells = []
    for row in rows:
        ours = rmse(found, row.copy)
        difference = f"{100 * largest(ours, row.published):+.1f} %"
        cells.append((row.what, f"`{row.copy}`", _shown(row.published), _shown(ours), difference))
    return markdown(head, cells)


def main() -> None:
    tuning, fusion = result(TUNING), result(FUSION)
    literal = EKF[1]._replace(what="EKF, from two lidar measurements, taken literally", copy="ekf_two_readings")
    fill(HERE / "udacity-ukf.md", {"sensors": _ukf_table(tuning, UKF), "tuning": _ukf_table(tuning, TUNED)})
    fill(HERE / "udacity-fusion.md", {"published": _ekf_table(fusion, (*EKF, literal))})


if __name__ == "__main__":
    main()
