"""Runs the published projects on the Udacity recording and writes the tables of udacity-ukf.md and udacity-fusion.md.

``TRACKBENCH_DATA=... python docs/projects/udacity.py`` from the repository's folder.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from tables import fill, markdown

from trackbench.results import Result
from trackbench.runner.run import run
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truth_of

HERE = Path(__file__).resolve().parent
SCENARIOS = HERE.parent.parent / "scenarios" / "recorded"
COMPONENTS = ("px", "py", "vx", "vy")
TUNING, FUSION = "udacity_ukf_tuning", "udacity_fusion"


class Row(NamedTuple):
    """A published row, and the tracker that is to give it."""

    what: str
    scenario: str
    tracker: str
    rmse: tuple[float, float, float, float]
    """px, py m, vx, vy m/s."""


PUBLISHED = (
    Row("UKF, lidar and radar", TUNING, "ukf", (0.0672, 0.0805, 0.3754, 0.2166)),
    Row("UKF, lidar", TUNING, "ukf_lidar", (0.1019, 0.0953, 0.4250, 0.2098)),
    Row("UKF, radar", TUNING, "ukf_radar_faulty", (0.1396, 0.1639, 0.3960, 0.2626)),
    # The published vx is 0.5454, a misprint: the same program gives 0.4546.
    Row("std_a 0.1, std_yawdd 0.1", TUNING, "tuned_0p1_0p1", (0.1305, 0.1341, 0.4546, 0.3111)),
    Row("std_a 0.2, std_yawdd 0.1", TUNING, "tuned_0p2_0p1", (0.1162, 0.1164, 0.4541, 0.3129)),
    Row("std_a 0.4, std_yawdd 0.1", TUNING, "tuned_0p4_0p1", (0.1131, 0.1090, 0.4548, 0.3172)),
    Row("std_a 0.4, std_yawdd 0.2", TUNING, "tuned_0p4_0p2", (0.0763, 0.0866, 0.3954, 0.2416)),
    Row("std_a 0.4, std_yawdd 0.4", TUNING, "tuned_0p4_0p4", (0.0654, 0.0853, 0.3771, 0.2165)),
    Row("std_a 0.8, std_yawdd 0.8", TUNING, "tuned_0p8_0p8", (0.0648, 0.0823, 0.3743, 0.2191)),
    Row("std_a 1.6, std_yawdd 0.8", TUNING, "tuned_1p6_0p8", (0.0686, 0.0816, 0.3769, 0.2257)),
    Row("std_a 1.6, std_yawdd 1.6", TUNING, "tuned_1p6_1p6", (0.0683, 0.0839, 0.3850, 0.2473)),
    Row("EKF, from the first measurement", FUSION, "ekf", (0.0972, 0.0854, 0.4509, 0.4396)),
    Row("EKF, from two lidar measurements", FUSION, "ekf_half_known", (0.0988, 0.0850, 0.4328, 0.4751)),
)


def result(name: str) -> Result:
    """The result of one of the scenarios."""
    path = SCENARIOS / f"{name}.yaml"
    loaded = load_scenario(path)
    return run(loaded, truth_of(loaded))


def entry(found: Result, tracker: str) -> dict[str, Any]:
    return next(item for item in found.json()["trackers"] if item["name"] == tracker)


def rmse(found: Result, tracker: str) -> list[float]:
    errors = entry(found, tracker)["metrics"]["rmse"]
    return [errors[name]["value"] for name in COMPONENTS]


def _beside(found: Result, rows: list[Row]) -> str:
    head = ("", "tracker", *(f"{name} published, ours" for name in COMPONENTS), "largest difference")
    cells = []
    for row in rows:
        ours = rmse(found, row.tracker)
        largest = max((b / a - 1 for a, b in zip(row.rmse, ours, strict=True)), key=abs)
        pairs = (f"{a:.4f}, {b:.4f}" for a, b in zip(row.rmse, ours, strict=True))
        cells.append((row.what, f"`{row.tracker}`", *pairs, f"{100 * largest:+.1f} %"))
    return markdown(head, cells)


def _all(found: Result) -> str:
    head = ("tracker", *COMPONENTS, "NEES", "lidar NIS under its line", "radar NIS under its line")

    def share(metrics: dict[str, Any], sensor: str) -> str:
        value = (metrics["nis"].get(sensor) or {}).get("inside95")
        return "" if value is None else f"{100 * value:.1f} %"

    rows = []
    for item in found.json()["trackers"]:
        metrics = item["metrics"]
        errors = (f"{value:.4f}" for value in rmse(found, item["name"]))
        nees = f"{metrics['nees']['mean']:.1f}"
        rows.append((f"`{item['name']}`", *errors, nees, share(metrics, "lidar"), share(metrics, "radar")))
    return markdown(head, rows)


def main() -> None:
    tuning, fusion = result(TUNING), result(FUSION)
    ukf = [row for row in PUBLISHED if row.scenario == TUNING]
    # The program as it should be, held against the same published row.
    sound = ukf[2]._replace(what="UKF, radar, without the faults", tracker="ukf_radar")
    ekf = [row for row in PUBLISHED if row.scenario == FUSION]
    literal = ekf[1]._replace(what="EKF, from two lidar measurements, taken literally", tracker="ekf_two_readings")
    fill(
        HERE / "udacity-ukf.md",
        {"sensors": _beside(tuning, [*ukf[:3], sound]), "tuning": _beside(tuning, ukf[3:]), "all": _all(tuning)},
    )
    fill(HERE / "udacity-fusion.md", {"published": _beside(fusion, [*ekf, literal]), "all": _all(fusion)})


if __name__ == "__main__":
    main()
