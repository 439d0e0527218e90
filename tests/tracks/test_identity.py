"""Identities count in the ranking, alike at any rate."""

from __future__ import annotations

import numpy as np
import pytest
from tests.tracks.conftest import TRAFFIC

import trackbench as tb
from trackbench.base.types import DUE, Array
from trackbench.document.files import document_text
from trackbench.metrics.traffic import TRACK_METRICS, TrackHistory, TrafficScoreOptions, TruthHistory, score_run
from trackbench.report.result import result_document
from trackbench.results import Result

RENAMED = """
import numpy as np

from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi import build_multi

GNN = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3, "associate": {"method": "gnn"}}


class Renewed:
    multi_object = True

    def __init__(self):
        self.gnn = build_multi(FilterConfig.model_validate(GNN)).tracker

    def step(self, state, scan):
        state, tracks = self.gnn.step(state, scan)
        return state, tracks._replace(ids=self.other(tracks.ids, int(scan.time + 1e-6)))

    def other(self, ids, second):
        return ids + 1000 * second


class Swapped(Renewed):
    def other(self, ids, second):
        return np.roll(ids, second)
"""
NAIVE = "  naive: {<<: *ekf, associate: {method: naive}}"
OTHERS = '  renewed: {use: "renamed:Renewed"}\n  swapped: {use: "renamed:Swapped"}\n'


@pytest.fixture(scope="module")
def renamed(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """A GNN beside the same whose identities are new, or swapped, every second."""
    folder = tmp_path_factory.mktemp("renamed")
    (folder / "renamed.py").write_text(RENAMED, encoding="utf-8")
    scenario = TRAFFIC.replace(NAIVE, OTHERS + NAIVE).replace("runs: 3", "runs: 20")
    (folder / "three_cars.yaml").write_text(scenario, encoding="utf-8")
    return tb.run(folder / "three_cars.yaml")


def test_identities_that_change_every_second_rank_below_those_of_the_same_tracks_that_last(renamed: Result) -> None:
    gnn = {path: metric.value or 0.0 for path, metric in renamed["gnn"].metrics.items()}
    for name in ("renewed", "swapped"):
        metrics = renamed[name].metrics
        # Tracks that change places are as near to the objects as before.
        assert metrics["gospa"].value == pytest.approx(gnn["gospa"], rel=1e-9)
        assert (metrics["tgospa"].value or 0.0) > 1.5 * gnn["tgospa"]
        (pair,) = (item for item in renamed.differences if (item.metric, item.a, item.b) == ("tgospa", "gnn", name))
        assert pair.better == "gnn"
        assert pair.p_value is not None
        assert pair.p_value < 1e-3
        names = [tracker.name for tracker in renamed.contenders]
        assert names.index(name) > names.index("naive") > names.index("gnn")


def test_the_report_says_what_a_switch_costs(renamed: Result) -> None:
    document = result_document(renamed)
    assert "A switch costs as much as missing the object for 0.5 s." in document_text(document)


def wandering(rate: float, seed: int, factor: float = 1.0) -> tuple[TruthHistory, TrackHistory]:
    """Two objects for 60 s whose tracks wander around them and have a new identity every 3 s."""
    time = np.arange(0, 60, 1 / rate)
    random = np.random.default_rng(seed)
    knots, phase = np.arange(61.0), random.uniform(0, 6, (2, 2))
    offset = random.normal(0, 0.5, (2, 2, 61))
    truth, mean = (np.zeros((4, len(time), 2)) for _ in range(2))
    truth[0], truth[1] = 20 * time[:, None], [0, 4]
    mean[:2] = truth[:2]
    for axis in range(2):
        for item in range(2):
            mean[axis, :, item] += np.interp(time, knots, offset[axis, item])
    ids: Array = np.floor((time[:, None] + phase[0]) / (3 / factor)) * 2 + [0, 1]
    unit = np.broadcast_to(np.eye(4)[:, :, None, None], (4, 4, len(time), 2))
    status = np.full((len(time), 2), DUE, dtype=np.int8)
    return TruthHistory(time, truth, status), TrackHistory(ids.astype(int), mean, unit)


def value(path: str, histories: tuple[TruthHistory, TrackHistory], options: TrafficScoreOptions | None = None) -> float:
    total, count = score_run(*histories, options).values[path]
    return float(np.sqrt(total / count))


@pytest.mark.parametrize("seed", range(5))
def test_a_rate_twice_as_high_gives_the_same_value(seed: int) -> None:
    slow, fast = (value("tgospa", wandering(rate, seed)) for rate in (20, 40))
    assert slow == pytest.approx(fast, rel=0.005)
    # Switches are what it mostly is.
    assert slow > 1.5 * value("gospa", wandering(20, seed))


def test_what_is_beside_gospa_is_what_the_identities_cost() -> None:
    histories = wandering(10, 0)
    squares = {path: value(path, histories) ** 2 for path in TRACK_METRICS if "gospa" in path}
    assert squares["tgospa"] == pytest.approx(squares["gospa"] + squares["gospa_switch"])
    # Some 20 changes of each of two objects in 60 s, each as if it were missed for half a second.
    assert squares["gospa_switch"] == pytest.approx(2 * 19.5 * 0.5 * 12.5 / 60, rel=0.03)
