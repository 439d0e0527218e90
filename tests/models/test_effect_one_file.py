"""One class in one file makes an effect of a sensor; its options are checked where they stand."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.places import ROOT

import trackbench as tb

SCENARIO = """\
name: one_file
truth: {{source: scripted, duration_s: 20, rate_hz: 10, objects: {{a: {{start: {{x: 40, y: 20, speed_mps: 1}}}}}}}}
sensors:
  radar:
    type: radar
    rate_hz: 10
    range_sigma_m: 0.3
    azimuth_sigma_deg: 0.5
    range_rate_sigma_mps: 0.2
    effects:
      - {effect}
trackers:
  ekf: {{filter: ekf, motion: cv, acceleration_sigma_mps2: 1}}
monte_carlo: {{runs: 5}}
"""


@pytest.fixture
def spikes(tmp_path: Path, write_module: Callable[[Path, str], str]) -> str:
    page = (ROOT / "docs" / "start" / "maintainer.md").read_text(encoding="utf-8")
    return write_module(tmp_path, page.partition("```python\n")[2].partition("```")[0])


def written(folder: Path, effect: str) -> Path:
    file = folder / "one_file.yaml"
    file.write_text(SCENARIO.format(effect=effect), encoding="utf-8")
    return file


def test_the_effect_of_the_page_is_seen_in_the_measurements(tmp_path: Path, spikes: str) -> None:
    effect = f'{{type: "{spikes}:Spikes", probability: 0.05, size_m: 20}}'
    measured = np.concatenate([scan.measurement[0, 0] for scan in tb.sense(written(tmp_path, effect), range(5))])
    far = np.abs(measured - np.median(measured)) > 12
    assert 5 < far.sum() < 80


@pytest.mark.parametrize(
    ("effect", "message"),
    [
        (
            "{type: reflektion}",
            "11: sensors.radar.effects.0.type: 'reflektion' is not known; did you mean 'reflection'?",
        ),
        (
            "{type: reflection, along_cm: 3}",
            "11: sensors.radar.effects.0.along_cm: unknown key; use along_m (metres): 0.03",
        ),
        ("{type: bias, sigmas: {azimut_deg: 1}}", "11: sensors.radar.effects.0.sigmas.azimut_deg: is no component"),
        (
            "{type: interference, per_minute: 1, duration_s: 1, alarms_per_scan: 3}",
            "11: sensors.radar.effects.0.alarms_per_scan: needs a limited range",
        ),
        ("{along_m: 1}", "11: sensors.radar.effects.0.type: missing"),
    ],
)
def test_mistakes_are_named_at_their_place(tmp_path: Path, effect: str, message: str, cli: Callable[..., Any]) -> None:
    done = cli("check", written(tmp_path, effect))
    assert done.status == 2
    assert message in done.err


def test_typical_effects_of_each_built_in_sensor_are_valid(tmp_path: Path) -> None:
    file = written(tmp_path, "x")
    text = file.read_text().replace("effects:\n      - x", "effects: typical")
    file.write_text(text, encoding="utf-8")
    assert tb.load(file).config.sensors["radar"].effects[0].type == "reflection"
    lidar = text.replace("type: radar", "type: lidar").replace("range_sigma_m: 0.3", "position_sigma_m: 0.1")
    file.write_text("\n".join(line for line in lidar.split("\n") if "azimuth" not in line and "rate_sigma" not in line))
    assert tb.load(file).config.sensors["radar"].effects
