"""One class in one file beside a scenario makes a motion model: every command knows it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.places import ROOT

from trackbench.results import Result

CODE = (ROOT / "tests" / "plugin_package" / "example_motion.py").read_text(encoding="utf-8")
SCENARIO = """\
name: one_file
truth: {{source: scripted, duration_s: 6, rate_hz: 10, objects: {{a: {{start: {{x: 10, y: 20, speed_mps: 8}}}}}}}}
sensors:
  lidar: {{type: lidar, rate_hz: 10, position_sigma_m: 0.15}}
  radar: {{type: radar, rate_hz: 10, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.2}}
trackers:
  ekf: {{filter: ekf, motion: "{motion}", acceleration_sigma_mps2: 1, time_constant_s: 3}}
  ukf: {{filter: ukf, motion: "{motion}", acceleration_sigma_mps2: 1, time_constant_s: 3}}
  both:
    filter: ekf
    motion:
      imm:
        - {{model: cv, acceleration_sigma_mps2: 0.5}}
        - {{model: "{motion}", acceleration_sigma_mps2: 1, time_constant_s: 3}}
      stay_s: [5, 5]
monte_carlo: {{runs: 8, seed: 3}}
"""


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory, write_module: Callable[[Path, str], str]) -> Path:
    """A scenario of a stranger's motion model, of a module beside it."""
    place = tmp_path_factory.mktemp("motion")
    name = f"{write_module(place, CODE)}:Singer"
    (place / "one_file.yaml").write_text(SCENARIO.format(motion=name), encoding="utf-8")
    return place / "one_file.yaml"


def test_filters_of_every_kind_run_with_it(scenario: Path, tmp_path: Path, cli: Callable[..., Any]) -> None:
    done = cli("run", scenario, "--no-recording", "--out", tmp_path, "--in-process")
    assert done.status == 0, done.err
    result = Result.load(tmp_path / "one_file")
    rmse = [result[name].metrics["position_rmse"].value for name in ("ekf", "ukf", "both")]
    assert max(rmse) < 0.15
    # The model is linear: both filters see the same measurements and differ by the radar's linearisation alone.
    np.testing.assert_allclose(rmse[0], rmse[1], rtol=0.01)


def test_its_options_can_be_tuned(scenario: Path, tmp_path: Path, cli: Callable[..., Any]) -> None:
    options = ("--trackers", "ekf", "--trials", "4", "--out", tmp_path / "tuned.yaml", "--in-process")
    done = cli("tune", scenario, *options)
    assert done.status == 0, done.err
    assert "acceleration_sigma_mps2" in (tmp_path / "tuned.yaml").read_text(encoding="utf-8")
