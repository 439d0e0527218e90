"""A package with one plug-in of each kind, installed as a stranger would install it, and used by name alone."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

PACKAGE = Path(__file__).parent / "plugin_package"

SCENARIO = """\
name: plugged
truth: {source: weave, cars: 2, amplitude_m: 3, duration_s: 4, rate_hz: 10}
sensors:
  sonar: {type: sonar, rate_hz: 10, range_sigma_m: 0.3, bearing_sigma_deg: 0.5}
  radar: {type: radar, rate_hz: 5, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.1}
trackers:
  ekf_singer: {filter: ekf, motion: singer, acceleration_sigma_mps2: 2, time_constant_s: 4}
  ukf_singer: {filter: ukf, motion: {model: singer, acceleration_sigma_mps2: 2}, initial: truth}
  gains: {use: nearest_position, options: {alpha: 0.5}}
monte_carlo: {runs: 6, seed: 3}
"""

Trackbench = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder into which the package is installed."""
    source, target = tmp_path_factory.mktemp("source") / "package", tmp_path_factory.mktemp("site")
    shutil.copytree(PACKAGE, source)
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*command, "--target", str(target), str(source)], check=True, capture_output=True)
    return target


@pytest.fixture
def installed(site: Path, trackbench: str, tmp_path: Path) -> Trackbench:
    """Runs the command with the package installed."""

    def call(*arguments: str) -> subprocess.CompletedProcess[str]:
        env = {**os.environ, "PYTHONPATH": str(site), "COLUMNS": "200"}
        return subprocess.run(
            [trackbench, *arguments], cwd=tmp_path, env=env, capture_output=True, text=True, check=False
        )

    return call


def scenario(folder: Path, *changes: tuple[str, str]) -> str:
    text = SCENARIO
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (folder / "plugged.yaml").write_text(text, encoding="utf-8")
    return "plugged.yaml"


def test_a_scenario_of_plug_ins_runs(installed: Trackbench, tmp_path: Path) -> None:
    done = installed("run", scenario(tmp_path), "--json", "--no-recording")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["truth"]["source"] == "weave"
    errors = {entry["name"]: entry["metrics"]["position_rmse"]["value"] for entry in result["trackers"]}
    assert errors.keys() == {"ekf_singer", "ukf_singer", "gains"}
    # A sonar's measurement at 60 m is off by about 0.6 m; a filter with the right model is better than that.
    assert max(errors["ekf_singer"], errors["ukf_singer"]) < 0.6
    assert errors["gains"] < 3


@pytest.mark.parametrize(
    ("what", "line"),
    [
        ("motion-models", "singer .*time_constant_s .seconds."),
        ("sensors", "sonar .*Measures range and bearing; options range_sigma_m .metres., bearing_sigma_deg .degrees."),
        ("truth-sources", "weave .*options .*amplitude_m .metres."),
        ("trackers", "nearest_position .*options alpha, beta"),
        ("trackers", "broken .*failed: cannot import 'broken': no module named 'example_missing'"),
    ],
)
def test_they_are_listed(installed: Trackbench, what: str, line: str) -> None:
    import re

    done = installed("list", what)
    assert done.returncode == 0, done.stderr
    assert re.search(line.replace(" .*", r"[\s\S]*?"), " ".join(done.stdout.split()))


def test_the_schema_and_the_reference_have_them(installed: Trackbench, site: Path) -> None:
    schema = json.loads(installed("schema").stdout)
    assert schema["$defs"]["Sonar"]["properties"]["bearing_sigma_deg"]["maximum"] == 90
    assert "time_constant_s" in schema["$defs"]["FilterConfig"]["properties"]
    assert "amplitude_m" in schema["$defs"]["Weave"]["properties"]
    env = {**os.environ, "PYTHONPATH": str(site)}
    page = subprocess.run(
        [sys.executable, "-m", "trackbench.scenario.docs"], env=env, capture_output=True, text=True, check=True
    ).stdout
    for text in ("`type sonar`", "`source weave`", "| `singer` |", "| `nearest_position` | `alpha`, `beta` |"):
        assert text in page


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("type: sonar", "type: sonr", "4: sensors.sonar.type: 'sonr' is not known; did you mean 'sonar'?"),
        (
            "bearing_sigma_deg: 0.5",
            "bearing_sigma_rad: 0.01",
            "4: sensors.sonar.bearing_sigma_rad: unknown key; use bearing_sigma_deg (degrees): 0.573",
        ),
        (
            "motion: singer, acceleration_sigma_mps2: 2, time_constant_s: 4",
            "motion: singer, acceleration_sigma_mps2: 2, time_constant: 4",
            "7: trackers.ekf_singer.time_constant: unknown key; use time_constant_s (seconds)",
        ),
        (
            "time_constant_s: 4",
            "time_constant_s: 4 s",
            "7: trackers.ekf_singer.time_constant_s: a number in seconds is needed, not '4 s'; write 4",
        ),
        (
            "motion: {model: singer, acceleration_sigma_mps2: 2}",
            "motion: {model: singer, acceleration_sigma_mps2: -2}",
            "8: trackers.ukf_singer.motion.acceleration_sigma_mps2: -2 is not possible: it must be above 0; write 2",
        ),
        (
            "motion: singer, acceleration_sigma_mps2: 2, time_constant_s: 4",
            "motion: cv, acceleration_sigma_mps2: 2, time_constant_s: 4",
            "7: trackers.ekf_singer.time_constant_s: motion cv does not use this; it uses acceleration_sigma_mps2",
        ),
        ("amplitude_m: 3", "amplitude: 3", "2: truth.amplitude: unknown key; use amplitude_m (metres)"),
        ("source: weave", "source: weav", "2: truth.source: 'weav' is not known; did you mean 'weave'?"),
        ("alpha: 0.5", "alpha: 2", "9: trackers.gains.options.alpha: Input should be less than or equal to 1"),
        ("use: nearest_position", "use: broken", "9: trackers.gains.use: cannot import 'broken': no module named"),
    ],
)
def test_mistakes_are_located(installed: Trackbench, tmp_path: Path, old: str, new: str, message: str) -> None:
    done = installed("check", scenario(tmp_path, (old, new)))
    assert done.returncode == 2
    assert done.stderr.startswith(f"plugged.yaml:{message}") or f"plugged.yaml:{message}" in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stderr.count("\n") == 1


def test_the_equations_fit(site: Path) -> None:
    code = """
from example_motion import Singer
from example_sensor import Sonar
from trackbench.testing import check_motion_model, check_sensor, check_tracker
check_motion_model(Singer(acceleration_sigma_mps2=2, time_constant_s=3))
check_sensor(Sonar(rate_hz=10, range_sigma_m=0.3, bearing_sigma_deg=0.5))
check_tracker("nearest_position", alpha=0.6)
"""
    env = {**os.environ, "PYTHONPATH": str(site)}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_singer_model_keeps_its_variance_and_ends_as_constant_acceleration(
    site: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(site)
    from example_motion import Singer

    from trackbench.models.motion import process_noise

    slow = Singer(acceleration_sigma_mps2=2, time_constant_s=1e6)
    f = slow.jacobian(np.zeros(6), 0.1)
    np.testing.assert_allclose(f[:2, 4:], 0.005 * np.eye(2), rtol=1e-4)
    short = Singer(acceleration_sigma_mps2=2, time_constant_s=3)
    p = np.zeros((6, 6))
    p[4, 4] = p[5, 5] = 4.0
    for dt in (0.1, 2.0):
        f = short.jacobian(np.zeros(6), dt)
        after = f @ p @ f.T + process_noise(short, np.zeros(6), dt)
        np.testing.assert_allclose(np.diag(after)[4:], 4.0)
