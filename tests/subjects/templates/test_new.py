"""``trackbench new``: what it writes works as it is."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Cli = Callable[..., Any]


def run_pytest(folder: Path, *files: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *files]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def test_what_is_written_passes_its_own_tests(tmp_path: Path, cli: Cli) -> None:
    kinds = {"tracker": "gains", "motion-model": "fading", "sensor": "sonar", "truth": "ring", "metric": "offset"}
    kinds["multi-tracker"] = "several"
    for kind, name in kinds.items():
        done = cli("new", kind, name)
        assert done.status == 0, done.err
        assert f"  python -m pytest test_{name}.py\n" in done.out
    done = run_pytest(tmp_path)
    assert done.returncode == 0, done.stdout
    assert "6 passed" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["tracker", "multi-tracker"])
def test_a_new_tracker_has_a_scenario_that_runs(tmp_path: Path, cli: Cli, trackbench: str, kind: str) -> None:
    cli("new", kind, "gains_scenario", "--out", "deep/folder")
    command = [trackbench, "run", "gains_scenario.yaml", "--runs", "2", "--json", "--no-recording"]
    done = subprocess.run(command, cwd=tmp_path / "deep/folder", capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert [entry["failed"] for entry in json.loads(done.stdout)["trackers"]] == [None, None]


def test_a_new_metric_is_named_in_a_scenario_as_printed(tmp_path: Path, cli: Cli, tiny: Path) -> None:
    printed = cli("new", "metric", "offset_named").out.splitlines()[-1]
    assert printed == '  score: {metrics: ["offset_named:OffsetNamed"]}'
    others = [line for line in tiny.read_text(encoding="utf-8").splitlines() if not line.startswith("score:")]
    tiny.write_text("\n".join([*others, printed.strip(), ""]), encoding="utf-8")
    done = cli("run", tiny, "--json", "--no-recording", "--runs", "2")
    assert done.status == 0, done.err
    for tracker in json.loads(done.out)["trackers"]:
        metrics = tracker["metrics"]
        assert metrics["offset_named"]["unit"] == "m"
        assert 0 < metrics["offset_named"]["value"] < metrics["position_rmse"]["value"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("tracker", "my-tracker"), "'my-tracker' is no name for a module"),
        (("tracker", "class"), "'class' is no name for a module"),
        (("metric", "nees"), "no metric can be written: its name 'nees' is that of a built-in one"),
        (("metric", "größe"), "no metric can be written: its name 'größe' may only have a to z, 0 to 9 and _"),
        (("tracker", "mine", "--out", "taken.txt/in"), "cannot be written"),
    ],
)
def test_what_cannot_be_written_leaves_nothing(
    tmp_path: Path, cli: Cli, arguments: tuple[str, ...], message: str
) -> None:
    (tmp_path / "taken.txt").write_text("")
    done = cli("new", *arguments)
    assert done.status == 2
    assert message in done.err
    assert done.err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["taken.txt"]


def test_a_file_that_is_there_is_kept(tmp_path: Path, cli: Cli) -> None:
    (tmp_path / "mine.yaml").write_text("mine")
    done = cli("new", "tracker", "mine")
    assert done.status == 2
    assert done.err == "mine.yaml is there already: use another name\n"
    assert [path.name for path in tmp_path.iterdir()] == ["mine.yaml"]


@pytest.mark.slow
@pytest.mark.parametrize("language", ["cpp", "c", "python-program"])
def test_a_tracker_in_another_language_is_built_and_runs_as_printed(
    tmp_path: Path, cli: Cli, trackbench: str, language: str
) -> None:
    """As printed: its commands, in the folder where it was written."""
    if shutil.which("make") is None or (language != "python-program" and shutil.which("g++") is None):
        pytest.skip("there is no compiler, or no make")
    written = cli("new", "tracker", "mine", "--language", language)
    assert written.status == 0, written.err
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    environment = os.environ | {"PATH": path}
    commands = [line.split() for line in written.out.splitlines() if line.startswith(("  make", "  trackbench run"))]
    assert len(commands) == (1 if language == "python-program" else 2)
    for command in commands:
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "results" / "mine" / "result.json").read_text())
    mine, ekf = (next(entry for entry in result["trackers"] if entry["name"] == name) for name in ("mine", "ekf"))
    assert mine["failed"] is None
    error, usual = (entry["metrics"]["position_rmse"]["value"] for entry in (mine, ekf))
    assert error < (6 if language == "c" else 1.5) * usual
    use = {"command": ["python3", "mine.py"] if language == "python-program" else ["./mine"]}
    code = f"from trackbench.testing import check_tracker; check_tracker({use!r})"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_trackers_of_a_folder_share_the_headers_and_nothing_else(tmp_path: Path, cli: Cli) -> None:
    for name in ("one", "two"):
        assert cli("new", "tracker", name, "--language", "cpp").status == 0
    assert f"there is no program 'one' in {tmp_path}" in cli("check", "one.yaml").err
    if shutil.which("make"):
        planned = subprocess.run(["make", "-n"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
        assert [line.split()[-1] for line in planned.splitlines()] == ["one", "two"]
    assert "one.yaml is there already" in cli("new", "tracker", "one", "--language", "c").err
    assert not (tmp_path / "one.c").exists()
    (tmp_path / "trackbench.h").write_text("my own")
    assert "trackbench.h is there already" in cli("new", "tracker", "three", "--language", "c").err


def test_a_language_goes_with_a_tracker_in_it(cli: Cli) -> None:
    assert "--language c does not go with metric" in cli("new", "metric", "m", "--language", "c").err
    several = cli("new", "multi-tracker", "m", "--language", "c")
    assert "--language c does not go with multi-tracker; it comes in python and cpp" in several.err


def test_a_tracker_of_several_objects_in_c_plus_plus_runs_as_printed(tmp_path: Path, cli: Cli) -> None:
    if shutil.which("make") is None or shutil.which("g++") is None:
        pytest.skip("there is no compiler, or no make")
    written = cli("new", "multi-tracker", "mine", "--language", "cpp")
    assert written.status == 0, written.err
    build = next(line.split() for line in written.out.splitlines() if line.startswith("  make"))
    assert subprocess.run(build, cwd=tmp_path, capture_output=True, check=False).returncode == 0
    scenario = ("mine.yaml", "--runs", "2", "--out", "own")
    # Both the scenario that is written and one that comes with the package, in heavy rain.
    shipped = ("traffic/cut_in", "--runs", "2", "--trackers", "gnn,mine", "--set", "trackers.mine.use.command=[./mine]")
    for arguments, most in ((scenario, 1.0), (shipped, 2.0)):
        done = cli("run", *arguments, "--json", "--no-recording")
        assert done.status == 0, done.err
        mine, gnn = (
            next(entry["metrics"] for entry in json.loads(done.out)["trackers"] if entry["name"] == name)
            for name in ("mine", "gnn")
        )
        assert mine["gospa"]["value"] < 1.1 * gnn["gospa"]["value"] < most
        assert mine["hota"]["value"] > 0.95
        assert mine["id_switches"]["value"] == 0
    code = f'from trackbench.testing import check_tracker; check_tracker({USE}, identities="hidden", confirm=(3, 5))'
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


USE = {"command": ["./mine"]}
