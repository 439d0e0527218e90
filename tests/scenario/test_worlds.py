"""A world is a set of changes of a scenario: what each changes, where there is none, and what is expected where."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.scenario.load import in_worlds
from trackbench.scenario.worlds import WORLDS

SCRIPTED = """\
name: small
truth: {source: scripted, duration_s: 6, rate_hz: 10, objects: {a: {start: {x: 30, y: 5, speed_mps: 8}}}}
sensors:
  radar: {type: radar, rate_hz: 10, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.2}
  lidar: {type: lidar, rate_hz: 10, position_sigma_m: 0.15, detection_probability: 0.9}
trackers:
  slow: {filter: ekf, motion: cv, acceleration_sigma_mps2: 0.3}
  fast: {filter: ekf, motion: cv, acceleration_sigma_mps2: 30}
monte_carlo: {runs: 20}
expect:
  - {tracker: slow, metric: position_rmse, below: 1}
  - {tracker: slow, metric: position_rmse, below: 5, worlds: [typical]}
  - {tracker: slow, metric: position_rmse, better_than: fast, worlds: [ideal, typical]}
"""


def effects(scenario: tb.Scenario) -> dict[str, list[str]]:
    return {name: [effect.type for effect in sensor.effects] for name, sensor in scenario.config.sensors.items()}


def test_each_world_changes_drivers_and_sensors_and_nothing_else() -> None:
    written = tb.load("highway").config
    for world, drivers, typical in (("ideal", None, False), ("human", "human", False), ("typical", "human", True)):
        scenario = tb.load("highway", set={"world": world})
        assert (scenario.config.truth.drivers == "human") == (drivers == "human")
        assert all(bool(own) == typical for own in effects(scenario).values())
        assert all(sensor.occlusion == typical for sensor in scenario.config.sensors.values())
        assert scenario.config.name == written.name
        assert scenario.config.full_name == f"highway-{world}"
        assert scenario.config.trackers == written.trackers
    ideal = tb.load("highway", set={"world": "ideal"}).config
    assert ideal.model_copy(update={"world": None}) == written


def test_the_recorded_world_has_the_motion_of_the_package_and_the_scenarios_targets() -> None:
    scenario = tb.load("highway", set={"world": "recorded"}, scenes=3)
    assert scenario.config.truth.source == "recorded-traffic"
    assert scenario.config.truth.targets == tb.load("highway").config.truth.targets
    assert all(effects(scenario).values())
    assert all(sensor.occlusion for sensor in scenario.config.sensors.values())
    assert {sensor.rate_hz for sensor in scenario.config.sensors.values()} == {10}
    with pytest.raises(InputError, match="none, for no recording of its kind of road"):
        tb.load("roundabout", set={"world": "recorded"})


def test_the_recorded_world_slows_a_sensor_to_the_rate_of_its_traffic_and_quickens_none() -> None:
    rates = {"front_radar": 20, "roof_lidar": 5}
    stated = {f"sensors.{name}.rate_hz": rate for name, rate in rates.items()}
    sensors = tb.load("highway", set={"world": "recorded", **stated}).config.sensors
    assert [sensors[name].rate_hz for name in rates] == [10, 5]


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({"truth.drivers": "steady"}, "truth.drivers: the world human sets this to human: remove it"),
        (
            {"sensors.front_radar.effects": [{"type": "reflection", "along_m": 1}]},
            "front_radar.effects: the world human",
        ),
    ],
)
def test_what_a_world_sets_is_not_stated_otherwise(stated: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        tb.load("highway", set={**stated, "world": "human"})
    with pytest.raises(InputError, match=message):
        tb.worlds(tb.load("highway", set=stated), ["human"])
    assert tb.load("highway", set={"truth.drivers": "human", "world": "human"}).config.truth.drivers == "human"


def test_a_typical_sensor_is_not_said_to_see_through_vehicles() -> None:
    message = "front_radar.occlusion: the world typical sets this to true: remove it"
    with pytest.raises(InputError, match=message):
        tb.load("highway", set={"sensors.front_radar.occlusion": False, "world": "typical"})
    assert tb.load("highway", set={"sensors.front_radar.occlusion": True, "world": "typical"})


def test_recorded_traffic_is_in_the_recorded_world_as_it_is() -> None:
    written, scenario = tb.load("recorded/i80").config, tb.load("recorded/i80", set={"world": "recorded"})
    assert scenario.config.truth == written.truth
    assert all(effects(scenario).values())


def test_a_scenario_is_in_each_world_once() -> None:
    assert len(tb.worlds(tb.load("highway"), [*WORLDS, "ideal"])) == len(WORLDS)


def test_the_recorded_world_has_as_many_scenes_as_are_asked_for() -> None:
    for scenes, expected in ((3, 3), (20, 10)):
        truth = tb.load("highway", set={"world": "recorded"}, scenes=scenes).config.truth
        assert len(truth.scenes()) == expected


@pytest.mark.parametrize(
    ("worlds", "settings", "message"),
    [
        (",", (), "--worlds: name at least one of ideal, human"),
        ("ideal", ("--set", "world=human"), "world: its key world already says human"),
    ],
)
def test_worlds_that_contradict_are_refused(cli, worlds: str, settings: tuple[str, ...], message: str) -> None:
    done = cli("run", "highway", "--worlds", worlds, *settings)
    assert done.status == 2
    assert message in done.err


def test_worlds_in_which_a_scenario_cannot_be_say_none_and_why() -> None:
    scenarios, notes = in_worlds(tb.load(SCRIPTED), WORLDS)
    assert [scenario.config.world for scenario in scenarios] == ["ideal", "typical"]
    assert [note.partition(":")[0] for note in notes] == ["small in the world human", "small in the world recorded"]
    assert all(": none, for " in note for note in notes)
    with pytest.raises(InputError, match="none, for its truth has no simulated drivers"):
        tb.load(SCRIPTED, set={"world": "human"})


def test_stated_worlds_are_gone_through_and_others_win() -> None:
    text = SCRIPTED + "worlds: [typical]\n"
    assert [scenario.config.world for scenario in tb.worlds(text)] == ["typical"]
    assert [scenario.config.world for scenario in tb.worlds(text, ["ideal"])] == ["ideal"]
    assert [scenario.config.world for scenario in tb.worlds(SCRIPTED)] == [None]
    (kept,) = tb.worlds(tb.load(text, trackers=["fast"]))
    assert list(kept.config.trackers) == ["fast"]


def test_what_is_expected_is_of_the_worlds_that_it_names() -> None:
    limits = {
        world: [(item.below, item.better_than) for item in tb.load(SCRIPTED, set={"world": world}).config.expect]
        for world in ("ideal", "typical")
    }
    assert limits == {"ideal": [(1, None), (None, "fast")], "typical": [(5, None), (None, "fast")]}
    assert [item.below for item in tb.load(SCRIPTED).config.expect] == [1]


def test_an_unknown_world_is_named_with_the_nearest() -> None:
    with pytest.raises(InputError, match="did you mean 'typical'"):
        tb.worlds(SCRIPTED, ["typcal"])
    with pytest.raises(InputError, match=r"world: .*human"):
        tb.load(SCRIPTED, set={"world": "humane"})


def test_a_run_over_worlds_has_a_folder_each_and_says_where_the_order_holds(tmp_path: Path, cli) -> None:
    (tmp_path / "small.yaml").write_text(SCRIPTED, encoding="utf-8")
    done = cli("run", "small.yaml", "--worlds", "ideal,human,typical", "--no-recording", "--out", "out")
    assert "small in the world human: none" in done.err
    assert {path.name for path in (tmp_path / "out").iterdir() if path.is_dir()} >= {"small-ideal", "small-typical"}
    assert re.search(r"^slow, fast +slow +slow +holds$", done.out, re.MULTILINE)
    page = (tmp_path / "out" / "comparison.md").read_text(encoding="utf-8")
    assert "In which worlds does it hold?" in page
    alone = cli("run", "small.yaml", "--set", "world=typical", "--no-recording", "--out", "again")
    assert alone.status in (0, 1)
    kept = [(tmp_path / name / "small-typical" / "result.json").read_text() for name in ("out", "again")]
    fingerprints, other = (text.partition('"fingerprints"')[2].partition("]")[0] for text in kept)
    assert fingerprints == other
    assert fingerprints
