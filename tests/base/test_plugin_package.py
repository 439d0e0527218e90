"""A package with one plug-in of each kind, installed as a stranger would install it, and used by name alone."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import jsonschema
import pytest
from tests.support.places import ROOT

PACKAGE = ROOT / "tests" / "plugin_package"

SCENARIO = """\
name: plugged
truth: {source: weave, cars: 2, amplitude_m: 3, duration_s: 4, rate_hz: 10}
sensors:
  sonar: {type: sonar, rate_hz: 10, range_sigma_m: 0.3, bearing_sigma_deg: 0.5}
  radar: {type: radar, rate_hz: 5, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.1}
trackers:
  ekf_singer: {filter: ekf, motion: correlated, acceleration_sigma_mps2: 2, time_constant_s: 4}
  ukf_singer: {filter: ukf, motion: {model: correlated, acceleration_sigma_mps2: 2}, initial: truth}
  gains: {use: nearest_position, options: {alpha: 0.5}}
monte_carlo: {runs: 12, seed: 3}
score: {settle_s: 0.5, metrics: [{use: largest_error, options: {after_s: 1}}]}
expect:
  - {tracker: ekf_singer, metric: largest_error, below: 2}
  - {tracker: ekf_singer, metric: largest_error, better_than: gains}
"""

Trackbench = Callable[..., subprocess.CompletedProcess[str]]
Many = Callable[..., list[tuple[int, str, str]]]


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


#: Commands from stdin, each with its folder, one after the other; prints their statuses, outputs and messages.
COMMANDS = """
import json, os, sys, tempfile
from trackbench.cli.commands import run_command_line

outcomes = []
for folder, arguments in json.load(sys.stdin):
    os.chdir(folder)
    sys.argv = ["trackbench", *arguments]
    kept = [os.dup(number) for number in (1, 2)]
    files = [tempfile.TemporaryFile("w+") for _ in kept]
    for number, file in zip((1, 2), files):
        os.dup2(file.fileno(), number)
    status = run_command_line()
    sys.stdout.flush()
    for number, before in zip((1, 2), kept):
        os.dup2(before, number)
    outcomes.append((status, *(file.seek(0) or file.read() for file in files)))
json.dump(outcomes, sys.stdout)
"""


@pytest.fixture
def many(site: Path) -> Many:
    """Runs several commands in one process with the package installed: status, output and message of each."""

    def call(commands: Sequence[tuple[Path, Sequence[str]]]) -> list[tuple[int, str, str]]:
        env = {**os.environ, "PYTHONPATH": str(site), "COLUMNS": "200"}
        content = json.dumps([(str(folder), arguments) for folder, arguments in commands])
        done = subprocess.run(
            [sys.executable, "-c", COMMANDS], input=content, env=env, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        outcomes: list[tuple[int, str, str]] = json.loads(done.stdout)
        return outcomes

    return call


def scenario(folder: Path, *changes: tuple[str, str]) -> str:
    text = SCENARIO
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (folder / "plugged.yaml").write_text(text, encoding="utf-8")
    return "plugged.yaml"


def test_a_scenario_of_plug_ins_runs_and_its_reports_have_the_metric(installed: Trackbench, tmp_path: Path) -> None:
    done = installed("run", scenario(tmp_path), "--no-recording")
    assert done.returncode == 0, done.stderr
    assert "all 2 expectations of the scenario are met" in " ".join(done.stdout.split())
    # The terminal's table has the same columns for every scenario.
    assert "largest_error" not in done.stdout
    folder = tmp_path / "results" / "plugged"
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    assert result["truth"]["source"] == "weave"
    # A sonar's measurement at 60 m is off by about 0.6 m; a filter with the right model is better than that.
    errors = {entry["name"]: entry["metrics"]["position_rmse"]["value"] for entry in result["trackers"]}
    assert max(errors["ekf_singer"], errors["ukf_singer"]) < 0.6
    values = {entry["name"]: entry["metrics"]["largest_error"] for entry in result["trackers"]}
    for entry in result["trackers"]:
        value = values[entry["name"]]
        assert value["unit"] == "m"
        assert value["ci95"][0] < value["value"] < value["ci95"][1]
        assert value["value"] > entry["metrics"]["position_rmse"]["value"]
    text = (folder / "report.md").read_text(encoding="utf-8")
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert re.search(r"^\| tracker \|.* largest_error, m \|", text, re.M)
    assert re.search("<th[^>]*>largest_error, m</th>", page)
    for name, value in values.items():
        low, high = value["ci95"]
        assert high - value["value"] == pytest.approx(value["value"] - low, abs=5e-4)
        cell = re.escape(f"{value['value']:.3f} (±{(high - low) / 2:.3f})")
        assert re.search(rf"^\| \*\*{name}\*\* \|.* {cell} \|", text, re.M)
        assert re.search(f"<td[^>]*>{value['value']:.3f}<", page)


#: What is listed, and a line of it.
LISTED = [
    ("motion-models", "correlated .*time_constant_s .seconds."),
    ("sensors", "sonar .*Measures range and bearing; options range_sigma_m .metres., bearing_sigma_deg .degrees."),
    ("truth", "weave .*options .*amplitude_m .metres."),
    ("metrics", "largest_error .*mean over the runs of the largest position error in each .m."),
    ("trackers", "nearest_position .*options alpha, beta"),
    ("trackers", "broken .*failed: cannot import 'broken': no module named 'example_missing'"),
]


def test_they_are_listed(many: Many, tmp_path: Path) -> None:
    outcomes = many([(tmp_path, ["list", what]) for what, _ in LISTED])
    for (_, line), (status, out, err) in zip(LISTED, outcomes, strict=True):
        assert status == 0, err
        assert re.search(line.replace(" .*", r"[\s\S]*?"), " ".join(out.split()))


PAGES = "from trackbench.scenario.docs import scenario_pages; print(*scenario_pages().values())"


def test_the_schema_and_the_reference_have_them(installed: Trackbench, site: Path) -> None:
    schema = json.loads(installed("schema").stdout)
    assert schema["$defs"]["Sonar"]["properties"]["bearing_sigma_deg"]["maximum"] == 90
    assert "time_constant_s" in schema["$defs"]["FilterConfig"]["properties"]
    assert "amplitude_m" in schema["$defs"]["Weave"]["properties"]
    metrics = {**schema["$defs"]["Score"]["properties"]["metrics"], "$defs": schema["$defs"]}
    good = ["largest_error", {"use": "largest_error", "options": {"after_s": 1}}, {"use": "own:Metric", "options": {}}]
    jsonschema.validate(good, metrics)
    for bad in ("largest_eror", {"use": "largest_error", "options": {"after": 1}}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate([bad], metrics)
    env = {**os.environ, "PYTHONPATH": str(site)}
    page = subprocess.run([sys.executable, "-c", PAGES], env=env, capture_output=True, text=True, check=True).stdout
    for text in (
        "`type: sonar`",
        "`source: weave`",
        "`motion: correlated`",
    ):
        assert text in page


#: A text of the scenario, a wrong one in its place, and how the message begins.
MISTAKES = [
    ("type: sonar", "type: sonr", "4: sensors.sonar.type: 'sonr' is not known; did you mean 'sonar'?"),
    (
        "bearing_sigma_deg: 0.5",
        "bearing_sigma_rad: 0.01",
        "4: sensors.sonar.bearing_sigma_rad: unknown key; use bearing_sigma_deg (degrees): 0.573",
    ),
    (
        "motion: correlated, acceleration_sigma_mps2: 2, time_constant_s: 4",
        "motion: correlated, acceleration_sigma_mps2: 2, time_constant: 4",
        "7: trackers.ekf_singer.time_constant: unknown key; use time_constant_s (seconds)",
    ),
    ("source: weave", "source: weav", "2: truth.source: 'weav' is not known; did you mean 'weave'?"),
    (
        "use: largest_error",
        "use: largest_eror",
        "11: score.metrics.0.use: 'largest_eror' is not known; did you mean 'largest_error'?",
    ),
    ("after_s: 1", "after: 1", "11: score.metrics.0.options.after: unknown key; use after_s (seconds)"),
    ("alpha: 0.5", "alpha: 2", "9: trackers.gains.options.alpha: 2 is not possible: it must be at most 1"),
    ("use: nearest_position", "use: broken", "9: trackers.gains.use: cannot import 'broken': no module named"),
]


def test_mistakes_are_located(many: Many, tmp_path: Path) -> None:
    calls = []
    for number, (old, new, _) in enumerate(MISTAKES):
        folder = tmp_path / str(number)
        folder.mkdir()
        calls.append((folder, ["check", scenario(folder, (old, new))]))
    for (_, _, message), (status, _, err) in zip(MISTAKES, many(calls), strict=True):
        assert status == 2
        assert f"plugged.yaml:{message}" in err
        assert "Traceback" not in err
        assert err.count("\n") == 1
