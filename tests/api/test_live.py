"""``tb.live``: an episode that the caller drives has the scans, the truth and the ends of the same drive in a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import trackbench as tb
from trackbench.base.types import Scan

IDLE, FASTER, SLOWER = 1, 3, 4
GNN = {"gnn": {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3, "associate": {"method": "gnn"}}}
EKF = {"ekf": {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3}}
AGENTS = {"type": "MultiAgentAction", "action_config": {"type": "DiscreteMetaAction"}}
IDENTITIES: dict[str, dict[str, Any]] = {
    "hidden": {"truth.targets": {"nearest": 1000}, "trackers": GNN, "score": {}},
    "known": {"truth.targets": "all", "trackers": EKF},
}


def scenario(name: str = "highway", identities: str = "hidden", **changes: Any) -> tb.Scenario:
    """A shipped scenario whose ego vehicle does nothing, in which every vehicle is an object."""
    keys = {"sensing.identities": identities, **IDENTITIES[identities], "expect": [], "truth.ego": "idle"}
    return tb.load(name, {**keys, **changes})


def drive(loaded: tb.Scenario, action: Any = IDLE) -> tuple[list[Scan], Any]:
    """The scans of an episode of one action, and its last step."""
    live = tb.live(loaded)
    scans, latest = [*live.latest.scans], live.latest
    while not (latest.terminated or latest.truncated):
        latest = live.step(action)
        scans += latest.scans
    return scans, latest


@pytest.mark.parametrize("identities", IDENTITIES)
@pytest.mark.parametrize("decisions_hz", [1, 5])
def test_scans_and_truth_are_those_of_a_run_however_often_is_decided(identities: str, decisions_hz: int) -> None:
    short = {"truth.duration_s": 6}
    loaded = scenario(identities=identities, **short)
    truth = tb.truth(loaded)
    scans, latest = drive(scenario(identities=identities, **short, **{"truth.config.policy_frequency": decisions_hz}))
    assert latest.truncated
    for name in ("time", "px", "py", "heading", "alive"):
        assert np.array_equal(getattr(latest.truth, name), getattr(truth, name)), name
    # How vehicles steer from now on is not known before the next decision.
    for name in ("vx", "vy"):
        assert np.array_equal(getattr(latest.truth, name)[:-1], getattr(truth, name)[:-1]), name
    batch = tb.sense(loaded)
    assert [(scan.sensor, scan.time) for scan in scans] == [(scan.sensor, scan.time) for scan in batch]
    same = 0
    for live, other in zip(scans, batch, strict=True):
        measurement = other.measurement if identities == "hidden" else other.measurement[..., 0]
        assert live.measurement.shape == measurement.shape
        assert np.array_equal(live.measurement[:2], measurement[:2], equal_nan=True)
        if not np.isclose(live.time * decisions_hz % 1.0, 0.0):
            assert np.array_equal(live.measurement, measurement, equal_nan=True)
        np.testing.assert_allclose(live.measurement[2:], measurement[2:], atol=0.02)
        same += np.array_equal(live.measurement, measurement, equal_nan=True)
    assert same > 0.8 * len(batch)


def test_the_action_drives_the_ego_vehicle() -> None:
    ways = [
        drive(scenario(**{"truth.duration_s": 4}), action)[1].truth.observer.px for action in (SLOWER, IDLE, FASTER)
    ]
    slower, idle, faster = (way[-1] - way[0] for way in ways)
    assert slower + 5 < idle < faster - 5


def test_scans_of_now_and_earlier_come_with_each_step_and_before_the_first() -> None:
    live = tb.live(scenario(**{"truth.duration_s": 3}))
    assert {scan.time for scan in live.latest.scans} == {0.0}
    assert len(live.latest.truth.time) == 1
    for second in (1, 2, 3):
        latest = live.step(IDLE)
        assert latest is live.latest
        assert {round(scan.time, 6) for scan in latest.scans} == {
            round(second - 1 + 0.05 * step, 6) for step in range(1, 21)
        }
        assert latest.truth.time[-1] == pytest.approx(second)
    with pytest.raises(tb.InputError, match="the episode is over"):
        live.step(IDLE)


def test_an_episode_ends_with_a_collision() -> None:
    _, latest = drive(scenario(**{"truth.config.vehicles_density": 2, "truth.duration_s": 30}), FASTER)
    assert latest.terminated
    observer, px, py = latest.truth.observer, latest.truth.px[-1, :, 0], latest.truth.py[-1, :, 0]
    nearest = np.hypot(px - observer.px[-1], py - observer.py[-1]).min()
    assert nearest < 8


def test_a_seed_repeats_an_episode() -> None:
    short = {"truth.duration_s": 3}
    drives = [
        drive(tb.load("traffic/dense_highway", {**short, "truth.seed": seed}, seed=seed), SLOWER)[0]
        for seed in (3, 3, 4)
    ]
    first, again, other = ([scan.measurement.tobytes() for scan in scans] for scans in drives)
    assert first == again
    assert first != other


def test_vehicles_may_come_and_episodes_may_go_on_side_by_side() -> None:
    """An intersection changes the classes of its vehicles, of which the other episode must see nothing."""
    loaded = scenario("intersection", **{"truth.duration_s": 8})
    alone, last = drive(loaded)
    one, other = tb.live(loaded), tb.live(scenario("roundabout", **{"truth.observer": "ego"}))
    at_first, scans, counts = len(one.latest.truth.ids), [*one.latest.scans], set()
    while not (one.latest.terminated or one.latest.truncated):
        scans += one.step(IDLE).scans
        counts.add(len(one.latest.truth.ids))
        if not (other.latest.terminated or other.latest.truncated):
            other.step(IDLE)
    assert [scan.measurement.tobytes() for scan in scans] == [scan.measurement.tobytes() for scan in alone]
    ids = last.truth.ids
    assert len(set(ids)) == len(ids) > at_first
    assert last.truth.alive.any(axis=0).sum() > at_first + 1
    # There is room for those to come, since each change of it changes the noise.
    assert len(counts) <= 2
    same_drive = tb.truth(loaded)
    for place, name in enumerate(same_drive.ids):
        there = same_drive.alive[:, place]
        assert np.array_equal(same_drive.px[there, place], last.truth.px[there, ids.index(name)])


@pytest.mark.parametrize("action", [7, -1, 1.0, None, "FASTER", [1]])
def test_what_is_no_action_is_refused(action: Any) -> None:
    live = tb.live(scenario())
    with pytest.raises(tb.InputError, match=r"action: .* is not in Discrete\(5\)"):
        live.step(action)
    live.step(IDLE)


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("traffic/cut_in", {}, r"cut_in.yaml:\d+: truth: the observer must be the ego of highway-env; write source: h"),
        (
            "highway",
            {"truth.observer": {"x": 0}},
            "truth: the observer must be the ego of highway-env; .* ego",
        ),
        ("highway", {"truth.config.vehicle_count": 3}, "truth.config.vehicle_count: unknown key; did you mean"),
        ("highway", {"truth.config.action": AGENTS}, "truth.config.action: several agents"),
        ("no_such", {}, "no_such"),
    ],
)
def test_a_scenario_that_cannot_be_driven_is_named_in_one_line(
    name: str, changes: Mapping[str, Any], message: str
) -> None:
    with pytest.raises(tb.InputError, match=message) as caught:
        tb.live(tb.load(name, changes))
    assert "\n" not in str(caught.value)
