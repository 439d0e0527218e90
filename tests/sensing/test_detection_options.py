"""What is wrong with the options of detection, clutter and resolution: one message each."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.support.places import SCENARIOS

from trackbench.scenario.docs import OTHER_EXAMPLES

TRACKERS = 'trackers: {any: {use: "any_tracker:Any"}}\n'
SCENARIO = (
    """\
name: options
truth: {source: highway-env, env: highway-v0, duration_s: 2, rate_hz: 10}
sensing: {identities: hidden}
sensors:
  front: {type: radar, rate_hz: 10, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.1}
  roof: {type: lidar, rate_hz: 10, position_sigma_m: 0.15, max_range_m: 80}
  odd: {type: "speed_radar:SpeedRadar", rate_hz: 10, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, speed_sigma_mps: 0.1}
"""
    + TRACKERS
)
REMEDY = "only used with sensing: {identities: hidden}; write that, or remove this"
BAD = [
    ("front", "clutter: {per_scan: 5}", "5: sensors.front.max_range_m: missing: uniform clutter needs a limited range"),
    ("front", "states: {clutter_per_scan: 5}", "5: sensors.front.max_range_m: missing: uniform clutter needs a limited"
     " range"),
    ("odd", "max_range_m: 90, clutter: {per_scan: 5}", "7: sensors.odd.clutter.per_scan: a "
     "speed_radar:SpeedRadar has no uniform clutter; remove it"),
    ("roof", "clutter: {range_rate_mps: [5, -5]}", "6: sensors.roof.clutter.range_rate_mps: must be [low, high] with 5"
     " below -5"),
    ("roof", "clutter: {places: [{line: [], per_scan: 1}]}", "6: sensors.roof.clutter.places.0.line: must not be"
     " empty"),
    ("front", "resolution: {}", "5: sensors.front.resolution: is empty: add range_m, azimuth_deg or"
     " range_rate_mps"),
    ("roof", "resolution: {range_rate_mps: 1}", "6: sensors.roof.resolution.range_rate_mps: a lidar measures no range"
     " rate; remove it"),
]  # fmt: skip
ONLY_HIDDEN = [
    ("roof", "clutter: {per_scan: 5}", f"sensors.roof.clutter: {REMEDY}"),
    ("roof", "resolution: {range_m: 5}", f"sensors.roof.resolution: {REMEDY}"),
    ("roof", "states: {detection_probability: 0.5}", f"sensors.roof.states: {REMEDY}"),
]


@pytest.fixture
def check(tmp_path: Path, cli: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> Callable[[str], str]:
    monkeypatch.syspath_prepend(str(SCENARIOS / "published"))

    def call(text: str) -> str:
        (tmp_path / "any_tracker.py").write_text("class Any:\n    def step(self, state, scan): ...\n")
        file = tmp_path / "options.yaml"
        file.write_text(text, encoding="utf-8")
        done = cli("check", file)
        assert done.status == (2 if done.err else 0)
        return str(done.err).replace(f"{file}:", "")

    return call


def with_option(sensor: str, option: str) -> str:
    return SCENARIO.replace(f"  {sensor}: {{", f"  {sensor}: {{{option}, ")


@pytest.mark.parametrize(("sensor", "option", "message"), BAD, ids=[f"{one[0]} {one[1]}" for one in BAD])
def test_a_message_says_what_is_wrong(check: Callable[[str], str], sensor: str, option: str, message: str) -> None:
    assert check(with_option(sensor, option)) == f"{message}\n"


@pytest.mark.parametrize(("sensor", "option", "message"), ONLY_HIDDEN)
def test_what_needs_hidden_identities(check: Callable[[str], str], sensor: str, option: str, message: str) -> None:
    text = with_option(sensor, option)
    assert check(text) == ""
    assert check(text.replace("hidden", "known")) == f"6: {message}\n"


def test_shares_of_sizes_add_up_to_at_most_one(check: Callable[[str], str]) -> None:
    text = SCENARIO.replace("duration_s: 2", "duration_s: 2, sizes: {van: 0.7, truck: 0.4}")
    assert check(text) == "2: truth.sizes: the shares add up to 1.1; at most 1 is possible\n"


def test_the_example_of_the_reference_is_valid(check: Callable[[str], str]) -> None:
    truth = "truth: {source: highway-env, env: highway-v0, duration_s: 2, rate_hz: 20}\n"
    assert check(f"name: page\n{truth}{OTHER_EXAMPLES['Clutter']}{TRACKERS}") == ""
