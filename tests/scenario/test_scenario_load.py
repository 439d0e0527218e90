"""What a scenario file becomes when it is right."""

from pathlib import Path

import pytest

from trackbench.api.scenario import load_several
from trackbench.base.errors import InputError
from trackbench.scenario import Scenario, load_scenario
from trackbench.scenario.check import check
from trackbench.trackers.config import FilterConfig, PluginConfig

GOOD = """\
name: example
truth: {source: highway-env, env: highway-v0, duration_s: 2, rate_hz: 20, config: {lanes_count: 3}}
sensors:
  front: {type: radar, rate_hz: 20, range_sigma_m: 1e-1, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.1}
  roof: {type: lidar, preset: velodyne_vlp16, max_range_m: 50}
trackers:
  ekf: &ekf {filter: ekf, motion: cv, acceleration_sigma_mps2: 3, initial: first_measurement}
  ckf: {<<: *ekf, filter: ckf, sensors: [roof]}
  mine: {use: raw}
expect:
  - {tracker: ekf, metric: whiteness.front.verdict, is: white}
"""


def load(folder: Path, text: str, *overrides: str) -> Scenario:
    path = folder / "scenario.yaml"
    path.write_text(text, encoding="utf-8")
    return load_scenario(path, overrides)


def test_values_and_defaults(tmp_path: Path) -> None:
    loaded = load(tmp_path, GOOD)
    scenario = loaded.config

    assert loaded.text == GOOD
    assert scenario.sensors["front"].range_sigma_m == 0.1  # 1e-1 is a number, as in YAML 1.2
    assert scenario.truth.targets == "all"
    assert scenario.truth.observer == "ego"
    assert scenario.monte_carlo.runs == 100
    assert scenario.expect[0].equals == "white"
    assert isinstance(scenario.trackers["mine"], PluginConfig)


def test_initial_as_one_word(tmp_path: Path) -> None:
    tracker = load(tmp_path, GOOD).config.trackers["ekf"]

    assert isinstance(tracker, FilterConfig)
    assert tracker.initial.source == "first_measurement"


def test_preset_gives_defaults_that_keys_override(tmp_path: Path) -> None:
    roof = load(tmp_path, GOOD).config.sensors["roof"]

    assert (roof.rate_hz, roof.position_sigma_m, roof.max_range_m) == (10, 0.03, 50)


def test_merged_mapping_keeps_its_own_keys(tmp_path: Path) -> None:
    tracker = load(tmp_path, GOOD).config.trackers["ckf"]

    assert isinstance(tracker, FilterConfig)
    assert (tracker.filter, tracker.motion.acceleration_sigma_mps2, tracker.sensors) == ("ckf", 3, ["roof"])


def test_yaml_1_2_keeps_words_and_keys_as_text(tmp_path: Path) -> None:
    text = GOOD.replace("{use: raw}", "{use: raw, options: {on: yes, 1: 1:30, t: 2020-01-01, d: 0x10, n: ~, f: .5}}")
    tracker = load(tmp_path, text).config.trackers["mine"]

    assert isinstance(tracker, PluginConfig)
    assert tracker.options == {"on": "yes", "1": "1:30", "t": "2020-01-01", "d": 16, "n": None, "f": 0.5}


def test_byte_order_mark_and_windows_lines(tmp_path: Path) -> None:
    path = tmp_path / "scenario.yaml"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())

    assert load_scenario(path).config.name == "example"


def test_overrides(tmp_path: Path) -> None:
    scenario = load(
        tmp_path,
        GOOD,
        "monte_carlo.runs=7",
        "score.reference.velocity_sigma_mps=5",
        "expect.0.is=coloured",
        "truth.config={lanes_count: 4, vehicles_count: 9}",
        "truth.config.lanes_count=2",
        "trackers.ekf.acceleration_sigma_mps2=2",
    ).config

    assert scenario.monte_carlo.runs == 7
    assert scenario.score.reference.velocity_sigma_mps == 5
    assert scenario.expect[0].equals == "coloured"
    assert scenario.truth.config == {"lanes_count": 2, "vehicles_count": 9}
    assert scenario.trackers["ekf"].motion.acceleration_sigma_mps2 == 2
    assert scenario.trackers["ckf"].motion.acceleration_sigma_mps2 == 3  # what shares its anchor does not change


def test_locate_puts_file_and_line_to_a_key(tmp_path: Path) -> None:
    loaded = load(tmp_path, GOOD, "truth.config.lanes_count=0", "truth.seed=3")

    def place(key: str | None) -> str:
        return str(loaded.locate(InputError("wrong", key=key))).replace(str(loaded.path), "FILE")

    assert place("sensors.roof.preset") == "FILE:5: sensors.roof.preset: wrong"
    assert place("expect.0.metric") == "FILE:11: expect.0.metric: wrong"
    assert place("truth.env.no.such") == "FILE:2: truth.env.no.such: wrong"
    assert place("truth.config.lanes_count") == "--set truth.config.lanes_count=0: truth.config.lanes_count: wrong"
    assert place(None) == "FILE:1: wrong"


def test_check_accepts(tmp_path: Path) -> None:
    check(load(tmp_path, GOOD))


def test_check_names_every_mistake_that_needs_other_code(tmp_path: Path) -> None:
    text = GOOD.replace("lanes_count", "lane_count").replace("use: raw", "use: rwa")

    with pytest.raises(InputError) as caught:
        check(load(tmp_path, text))

    first, second = str(caught.value).splitlines()
    assert ":2: truth.config.lane_count: " in first
    assert "lanes_count" in first
    assert ":9: trackers.mine.use: " in second
    assert "'raw'" in second


def test_scenes_of_several_leave_those_that_have_one() -> None:
    loaded, unchanged = load_several(["highway", "traffic/cut_in"], scenes=3, runs=2)
    assert [len(item.config.truth.scenes()) for item in loaded] == [3, 1]
    assert [item.config.monte_carlo.runs for item in loaded] == [2, 2]
    assert unchanged == ["cut_in always has one scene: --scenes is ignored"]
    with pytest.raises(InputError, match=r"truth\.seeds: unknown key"):
        load_several(["traffic/cut_in"], scenes=3)
    assert len(load_several(["traffic/cut_in"], runs=2)[0]) == 1
