"""Runs whose detections nobody labelled: from a scenario to scores, and what a tracker may do to them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackbench.base.execution import executor
from trackbench.results import Result
from trackbench.runner.run import run_scenario
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of

SCENARIO = """\
name: lanes
truth:
  source: scripted
  duration_s: 6
  rate_hz: 10
  objects:
    a: {start: {x: 10, y: 20, speed_mps: 8}, pieces: [{for_s: 6}]}
    b: {start: {x: 40, y: 32, course_deg: 180, speed_mps: 6}, pieces: [{for_s: 6}]}
    c: {start: {x: 5, y: 44, speed_mps: 10}, pieces: [{for_s: 6}]}
sensing: {identities: hidden}
sensors:
  radar:
    type: radar
    rate_hz: 10
    range_sigma_m: 0.3
    azimuth_sigma_deg: 0.5
    range_rate_sigma_mps: 0.1
    max_range_m: 150
    detection_probability: 0.95
    clutter: {per_scan: 2}
  lidar: {type: lidar, rate_hz: 5, position_sigma_m: 0.15, max_range_m: 150}
trackers:
  gnn:
    filter: ekf
    motion: cv
    acceleration_sigma_mps2: 1
    initial: {from: first_measurement}
    associate: {method: gnn}
  oracle:
    filter: ekf
    motion: cv
    acceleration_sigma_mps2: 1
    initial: {from: first_measurement}
    associate: {method: oracle}
monte_carlo: {runs: 4, seed: 3}
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    file = tmp_path / "lanes.yaml"
    file.write_text(SCENARIO, encoding="utf-8")
    return file


def result(file: Path, *overrides: str, workers: int = 1) -> Result:
    loaded = load_scenario(file, overrides)
    with executor(workers) as chosen:
        return run_scenario(loaded, truths_of(loaded, executor=chosen), executor=chosen)


def test_a_run_does_not_depend_on_the_others(scenario: Path) -> None:
    few, many = result(scenario, "monte_carlo.runs=2"), result(scenario, "monte_carlo.runs=5")
    assert many.summary.fingerprints[:2] == few.summary.fingerprints
    tracks = [each.tables["tracks"].to_pandas() for each in (few, many)]
    np.testing.assert_allclose(tracks[0]["px_m"], tracks[1]["px_m"], rtol=1e-12)


FAULTS = {
    "twice": (
        "return 0, (np.zeros(2, int), np.zeros((4, 2)), np.eye(4)[:, :, None] * [1, 1])",
        "two tracks have the id 0",
    ),
    "shape": (
        "return 0, (np.arange(2), np.zeros((3, 2)), np.eye(4)[:, :, None] * [1, 1])",
        "the mean has the shape (3, 2)",
    ),
    "nan": (
        "return 0, (np.arange(1), np.full((4, 1), np.nan), np.eye(4)[:, :, None])",
        "the estimate is not finite: track 0 has the mean [nan, nan, nan, nan]",
    ),
    "too_few_ids": (
        "return 0, (np.arange(1), np.zeros((4, 2)), np.eye(4)[:, :, None] * [1, 1])",
        "the mean has the shape (4, 2), where (4, 1) is needed",
    ),
    "indefinite": (
        "return 0, (np.array([3, 7]), np.zeros((4, 2)), np.eye(4)[:, :, None] * [1, -1])",
        "the covariance is not positive definite: that of track 7 has the eigenvalue -1",
    ),
    "no_state": (
        "return trackbench.base.types.Tracks(np.arange(1), np.zeros((4, 1)), np.eye(4)[:, :, None])",
        "step must return (state, Tracks), not Tracks",
    ),
    "ids": ("return 0, (np.array([.5]), np.zeros((4, 1)), np.eye(4)[:, :, None])", "the ids are not whole numbers"),
    "existence": (
        "return 0, (np.arange(1), np.zeros((4, 1)), np.eye(4)[:, :, None], np.array([2.]))",
        "the existence probability of track 0 is 2, which is not between 0 and 1",
    ),
    "used": (
        "return 0, (np.arange(1), np.zeros((4, 1)), np.eye(4)[:, :, None], None, np.array([99]))",
        "used names detection 99",
    ),
    "single": ("return 0, (np.zeros(4), np.eye(4))", "it gave an estimate of one object"),
    "raises": ("return 1 / 0", "ZeroDivisionError"),
    "of_one": (
        "return scan.measurement[0, 99]",
        "does it follow one object only? With hidden identities a scan has detections of",
    ),
}


@pytest.mark.parametrize("in_process", [True, False])
def test_what_is_no_tracks_fails_alone(
    scenario: Path, write_module: Any, cli: Callable[..., Any], in_process: bool
) -> None:
    code = "import numpy as np\nimport trackbench.base.types\n"
    for name, (body, _) in FAULTS.items():
        code += f"class {name}:\n    def step(self, state, scan):\n        {body}\n"
    module = write_module(scenario.parent, code)
    settings = [word for name in FAULTS for word in ("--set", f"trackers.{name}.use={module}:{name}")]
    done = cli("run", scenario, "--json", "--no-recording", *settings, *(["--in-process"] if in_process else []))
    assert done.status == 3, done.err
    trackers = {tracker["name"]: tracker for tracker in json.loads(done.out)["trackers"]}
    for name, (_, cause) in FAULTS.items():
        assert cause in trackers[name]["failed"]["cause"]
        assert trackers[name]["failed"]["sensor"] == "radar"
    assert trackers["gnn"]["failed"] is None


def test_an_id_that_is_used_again_is_a_fault_of_health(
    scenario: Path, write_module: Any, cli: Callable[..., Any]
) -> None:
    code = (
        "import numpy as np\nclass T:\n    def step(self, state, scan):\n        n = (state or 0) + 1\n"
        "        there = np.arange(n % 4 < 2)\n"
        "        mean = np.zeros((4, len(there)))\n        mean[0] = n * self.step_m + 0.001 * scan.measurement.sum()\n"
        "        return n, (there, mean, np.tile(np.eye(4)[:, :, None], len(there)))\n"
        "    step_m = 10.0\nclass Back(T):\n    step_m = 1.0\n"
    )
    module = write_module(scenario.parent, code)
    use = f"trackers.again.use={module}:T"
    # A track that comes back near where it was is the same one: three scans later, 3 m away.
    assert result(scenario, f"trackers.again.use={module}:Back")["again"].health.reused_ids == 0
    found = result(scenario, use)
    times = found["again"].health.reused_ids
    assert times > 0
    done = cli("run", scenario, "--set", use, "--no-recording")
    said = f"identities used again after their track had ended are scored as one track: again {times} times"
    assert said in " ".join(done.out.split())
    report = Path("results/lanes/report.md").read_text(encoding="utf-8")
    assert f"- {said}." in report
    assert "used again" not in cli("run", scenario, "--no-recording").out


def test_expectations_of_tracks(scenario: Path, cli: Callable[..., Any]) -> None:
    expect = (
        "expect=[{tracker: gnn, metric: gospa, below: 5}, {tracker: gnn, metric: id_switches, below: 1}, "
        "{tracker: gnn, metric: health.reused_ids, below: 1}]"
    )
    assert cli("run", scenario, "--set", expect).status == 0
    assert cli("run", scenario, "--set", "expect=[{tracker: gnn, metric: hota, above: 1}]").status == 1
    wrong = cli("run", scenario, "--set", "expect=[{tracker: gnn, metric: gopsa, below: 1}]")
    assert wrong.status == 2
    assert "did you mean 'gospa'?" in wrong.err


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("associate: {method: gnn}", "", "trackers.gnn.filter: follows one object, but"),
        ("trackers:\n", "trackers:\n  raw: {use: raw}\n", "trackers.raw.use: raw follows one object, but"),
        ("sensing:", "score: {settle_s: 1}\nsensing:", "score.settle_s: only used with sensing: {id"),
        ("sensing:", "score: {reference: {}}\nsensing:", "score.reference: only used with sensing: {id"),
        ("method: gnn", "method: gnn, confirm: 3/5", "[M, N], such as [3, 5], score or existence is needed, not 3/5\n"),
        ("identities: hidden", "identities: known", "trackers.gnn.associate: only used with sensing: {id"),
        ("method: gnn", "method: gnn, confirm: [5, 3]", "[M, N] needs M from 1 to N"),
    ],
)
def test_mistakes_are_located(scenario: Path, cli: Callable[..., Any], old: str, new: str, message: str) -> None:
    scenario.write_text(SCENARIO.replace(old, new), encoding="utf-8")
    done = cli("check", scenario)
    assert done.status == 2
    assert message in done.err


#: A tracker that never gives a track.
BLIND = """
import numpy as np
class T:
    def step(self, state, scan):
        return 0, (np.zeros(0, int), np.zeros((4, 0)), np.zeros((4, 4, 0)), None, np.zeros(0, int))
"""


def test_a_blind_tracker_has_no_latency_and_is_not_compared_by_it(scenario: Path, write_module: Any) -> None:
    found = result(scenario, f"trackers.blind.use={write_module(scenario.parent, BLIND)}:T")
    blind = found["blind"].metrics
    assert (blind["confirm_latency"].value, blind["confirm_latency"].reason) == (None, "no object was ever tracked")
    assert blind["never_confirmed"].value == 1
    assert found["gnn"].metrics["never_confirmed"].value == 0
    pairs = {(d.a, d.b) for d in found.differences if d.metric == "confirm_latency"}
    assert pairs
    assert not any("blind" in pair for pair in pairs)


def test_what_a_tracker_loads_at_first_is_not_timed(scenario: Path, write_module: Any, cli: Callable[..., Any]) -> None:
    code = "import time\nclass Loads:\n    def step(self, state, scan):\n        state or time.sleep(0.3)\n"
    module = write_module(scenario.parent, f"{code}        return True, None\n")
    done = cli("run", scenario, "--json", "--no-recording", "--set", f"trackers.loads.use={module}:Loads")
    found = next(tracker for tracker in json.loads(done.out)["trackers"] if tracker["name"] == "loads")
    # Over all 90 scans it would be 3333 us.
    assert found["metrics"]["step_time"]["value"] < 1000


def test_where_nothing_was_due_nobody_is_ranked(scenario: Path, cli: Callable[..., Any]) -> None:
    done = cli("run", scenario, "--set", "sensors.radar.max_range_m=2", "--set", "sensors.lidar.max_range_m=2")
    assert "NOT RANKED gnn: no object was ever due" in done.out
    assert "GOSPA" not in done.out
    page = Path("results/lanes/report.md").read_text(encoding="utf-8")
    assert "**no object was ever due: none came into a sensor's view" in page
    assert "interval" not in page
    found = json.loads(Path("results/lanes/result.json").read_text(encoding="utf-8"))
    assert Result.load("results/lanes").differences == []
    assert {tracker["metrics"]["gospa"]["value"] for tracker in found["trackers"]} == {None}
    compared = cli("compare", "results/lanes")
    assert "gospa not compared: gnn in results/lanes: no object was ever due" in compared.out.replace("\n", " ")
