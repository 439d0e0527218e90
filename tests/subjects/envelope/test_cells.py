"""A cell: its runs are those of a run of the same scenario, and its state follows from bounds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import trackbench as tb
from trackbench.metrics.intervals import Interval, ratio, root
from trackbench.subjects.envelope.api import envelope_of
from trackbench.subjects.envelope.bounds import bound, interval_difference
from trackbench.subjects.envelope.cells import Spending, decide
from trackbench.subjects.envelope.mapping import EnvelopeMap

NUMBERS = (25, 50, 100, 200, 300)


def values_of(mean: float, runs: int = 100, seed: int = 1) -> Interval:
    noise = np.random.default_rng(seed).gamma(4.0, 0.25, runs)
    return root(ratio(mean**2 * noise / noise.mean(), np.ones(runs), at_least=0.0))


def test_the_looks_of_a_cell_spend_its_share_of_the_error_in_proportion_to_the_runs() -> None:
    spending = Spending(0.05, 200, NUMBERS)
    levels = [spending.at(look) for look in range(len(NUMBERS))]
    assert sum(levels) == pytest.approx(0.05 / 200)
    assert np.array(levels) / sum(levels) == pytest.approx(np.array([25, 25, 50, 100, 100]) / 300)


def test_a_cell_holds_where_the_upper_bound_is_below_the_limit_and_fails_where_the_lower_one_is_above() -> None:
    interval = values_of(1.0)
    low, high = bound(interval, 1e-4, "lower"), bound(interval, 1e-4, "upper")
    for limit, below, above in (
        (0.999 * low, "fails", "holds"),
        (1.001 * low, "undecided", "undecided"),
        (0.999 * high, "undecided", "undecided"),
        (1.001 * high, "holds", "fails"),
    ):
        assert decide(interval, limit, "below", 1e-4).state == below
        assert decide(interval, limit, "above", 1e-4).state == above
    assert decide(interval, 1.0, "below", 1e-4)[2:] == (low, high)


def test_to_fail_is_shown_at_the_level_over_the_number_of_requirements_and_to_hold_at_the_whole_level() -> None:
    interval = values_of(1.0)
    for direction, held, failed in (("below", 3, 2), ("above", 2, 3)):
        decision = decide(interval, 1.0, direction, 1e-3, requirements=5)
        side = {3: "upper", 2: "lower"}
        assert decision[held] == bound(interval, 1e-3, side[held])
        assert decision[failed] == bound(interval, 1e-3 / 5, side[failed])


def test_too_few_runs_leave_a_cell_undecided_and_say_why() -> None:
    decision = decide(values_of(1.0, runs=20), 100.0, "below", 0.01)
    assert (decision.state, decision.low, decision.high) == ("undecided", None, None)
    assert decision.reason == "no bound holds with fewer than 25 runs"
    assert not decide(values_of(1.0), 100.0, "below", 0.01).reason


@pytest.mark.parametrize("same_runs", [True, False])
def test_a_difference_fails_where_the_value_is_shown_to_be_worse(same_runs: bool) -> None:
    before, after = values_of(0.7), values_of(1.5, seed=1 if same_runs else 2)
    worse, better = (interval_difference(*pair, same_runs=same_runs) for pair in ((after, before), (before, after)))
    assert decide(worse, 0.0, "below", 1e-4).state == decide(better, 0.0, "above", 1e-4).state == "fails"
    assert decide(better, 0.0, "below", 1e-4).state == "holds"


HIDDEN: dict[str, Any] = {
    "sensing": {"identities": "hidden"},
    "trackers": {
        "gnn": {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3, "associate": {"method": "gnn"}},
    },
    "expect": [{"tracker": "gnn", "metric": "tgospa", "below": 1.0}],
}
ROAD = {
    "source": "highway-env",
    "env": "highway-fast-v0",
    "config": {"vehicles_count": 5},
    "seed": 3,
    "seeds": 3,
    "duration_s": 2,
    "rate_hz": 10,
}


@pytest.mark.parametrize(
    "changes",
    [{}, HIDDEN, {"truth": ROAD}, {"truth": ROAD, **HIDDEN}],
    ids=["known", "hidden", "scenes", "scenes, hidden"],
)
def test_the_value_of_a_cell_is_that_of_a_run(
    changes: dict[str, Any], made_map: Callable[..., EnvelopeMap], request: pytest.FixtureRequest
) -> None:
    axes = {"s": {"key": "sensors.lidar.position_sigma_m", "values": [0.2, 0.9]}}
    made = made_map(**changes, runs={"first": 25, "most": 50}, cells=2, axes=axes)

    for cell in made.cells.values():
        ((name, tracker),) = cell.trackers.items()
        (decision,) = tracker.decisions
        assert decision is not None
        result = tb.run(tb.load(cell.loaded.document.value, runs=tracker.extent.runs, trackers=[name]))
        (limit,) = made.task.requirements
        assert decision.interval.value == pytest.approx(result[name].metrics[limit.metric].value, rel=1e-12)
        assert len(decision.interval.influence) == tracker.extent.runs


def test_traffic_like_these_repeats_scenes(made_map: Callable[..., EnvelopeMap]) -> None:
    made = made_map(
        truth=ROAD | {"config": {"vehicles_count": 2}, "duration_s": 1},
        score={"settle_s": 0},
        claim="traffic like these",
        monte_carlo={"runs": 2, "seed": 1},
        runs={"first": 30, "most": 60},
        cells=2,
        axes={"s": {"key": "sensors.lidar.position_sigma_m", "values": [0.2, 3]}},
        expect=[{"tracker": "kf", "metric": "position_rmse", "below": 0.5}],
    )

    for cell in made.cells.values():
        tracker = cell.trackers["kf"]
        (decision,) = tracker.decisions
        assert decision is not None
        assert tracker.extent.runs == 2
        assert tracker.extent.scenes in (30, 60)
        assert decision.interval.scenes
        assert len(decision.interval.influence) == tracker.extent.scenes
    assert [cell.states["kf"] for cell in made.cells.values()] == ["holds", "fails"]


@pytest.mark.slow
def test_a_world_has_its_own_number_of_scenes(made_map: Callable[..., EnvelopeMap]) -> None:
    made = made_map(
        truth=ROAD | {"env": "highway-v0", "seeds": 12, "duration_s": 2, "targets": {"nearest": 2}},
        runs={"first": 25, "most": 25},
        cells=2,
        axes={"world": {"key": "world", "choices": ["ideal", "recorded"]}},
    )

    assert [cell.trackers["kf"].runs.scene.max() + 1 for cell in made.cells.values()] == [12, 10]


def test_a_tracker_that_cannot_go_on_fails(made_map: Callable[..., EnvelopeMap]) -> None:
    made = made_map(
        trackers={"kf": {"use": "tests.subjects.envelope.test_cells:Broken"}},
        cells=2,
        axes={"s": {"key": "sensors.lidar.position_sigma_m", "values": [0.2, 0.9]}},
    )

    for cell in made.cells.values():
        assert cell.states == {"kf": "fails"}
        assert "no more" in cell.trackers["kf"].cause
    assert "no more" in envelope_of(made, "").claim.failures["kf"]


class Broken:
    """A tracker that raises."""

    def step(self, state: Any, scan: Any) -> Any:
        raise RuntimeError("no more")


RADAR = {
    "type": "radar",
    "rate_hz": 4,
    "range_sigma_m": 0.3,
    "azimuth_sigma_deg": 0.5,
    "range_rate_sigma_mps": 0.2,
    "detection_probability": 0.9,
}


def seen_at_times(made_map: Callable[..., EnvelopeMap], probability: float, seed: int) -> Any:
    """The cell of a tracker that gives what the radar sees, whose position is far better than is required."""
    made = made_map(
        truth={"source": "scripted", "duration_s": 8, "rate_hz": 4, "objects": {"lead": {"start": {"x": 40}}}},
        sensors={"radar": RADAR},
        trackers={"raw": {"use": "raw"}},
        score={"settle_s": 0},
        monte_carlo={"runs": 50, "seed": seed},
        expect=[{"tracker": "raw", "metric": "position_rmse", "below": 8}],
        cells=2,
        axes={"p": {"key": "sensors.radar.detection_probability", "values": [probability, 1]}},
    )
    return made.cells[(probability,)].trackers["raw"]


def test_a_coverage_that_may_be_enough_is_no_proof_that_a_cell_fails(made_map: Callable[..., EnvelopeMap]) -> None:
    # With a probability of .6 it is .944 to .955, depending on the noise.
    trackers = [seen_at_times(made_map, 0.6, seed) for seed in range(1, 5)]
    below = [item for item in trackers if item.coverage.interval.value < 0.95]

    assert 0 < len(below) < 4
    assert {item.state for item in trackers} == {"holds", "undecided"}
    assert all(item.state == "undecided" and "not shown to be more than 5 %" in item.cause for item in below)


def test_a_coverage_that_is_shown_to_be_too_small_fails(made_map: Callable[..., EnvelopeMap]) -> None:
    tracker = seen_at_times(made_map, 0.2, 1)

    assert tracker.state == "fails"
    assert tracker.coverage.high < 0.95
    assert "of the estimates are missing" in tracker.cause
