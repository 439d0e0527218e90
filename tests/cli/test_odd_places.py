"""Folders that are read-only or shared, a user without a home, a package that does not load: messages, and results."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from trackbench.base.files import cache_folder

pytestmark = pytest.mark.slow

SCENARIO = """\
name: %s
truth: {source: scripted, duration_s: 1, rate_hz: 10, objects: {car: {start: {x: 20, y: 5, speed_mps: 10}}}}
sensors:
  lidar: {type: lidar, rate_hz: 10, position_sigma_m: 0.15}
trackers:
  raw: {use: raw}
  ekf: {filter: ekf, motion: cv, acceleration_sigma_mps2: 3}
score: {settle_s: 0}
monte_carlo: {runs: 2, seed: 7}
"""
SETPRIV = shutil.which("setpriv")

Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def start(tmp_path: Path, trackbench: str) -> Start:
    """Starts a run of two scenarios."""
    for name in ("one", "two"):
        (tmp_path / f"{name}.yaml").write_text(SCENARIO % name, encoding="utf-8")

    def call(*options: str, environment: dict[str, str] | None = None, **how: Any) -> subprocess.Popen[str]:
        command = [trackbench, "run", "one.yaml", "two.yaml", "--no-recording", "--quiet", *options]
        return subprocess.Popen(
            command, cwd=tmp_path, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            env=dict(os.environ) if environment is None else environment, **how,
        )  # fmt: skip

    return call


@pytest.mark.parametrize("where", ["--workers 1", "--cluster local:1"])
def test_several_runs_into_one_folder_at_once(start: Start, tmp_path: Path, where: str) -> None:
    runs = [start("--seed", str(seed), *where.split()) for seed in range(4)]
    for run in runs:
        _, err = run.communicate(timeout=300)
        assert (run.returncode, err) == (0, "")
    names = {path.name for path in (tmp_path / "results").iterdir()}
    assert not [name for name in names if name.startswith(".")]
    assert {"one", "two"} <= names
    for name in ("one", "two"):
        summary = json.loads((tmp_path / "results" / name / "result.json").read_text(encoding="utf-8"))
        assert summary["seed"] in range(4)
        written = {path.name for path in (tmp_path / "results" / name).iterdir()}
        assert written == {"result.json", *summary["artifacts"].values()}


def test_a_folder_that_is_read_only(tmp_path: Path, trackbench: str, start: Start) -> None:
    (tmp_path / "here").mkdir()
    (tmp_path / "here").chmod(0o555)
    command = [trackbench, "run", "one.yaml", "--quiet", "--out", "here"]
    if os.geteuid() == 0:
        if SETPRIV is None:
            pytest.skip("root may write anywhere, and nothing here takes that from it")
        command = [SETPRIV, "--bounding-set=-dac_override", *command]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300)
    assert (done.returncode, done.stderr) == (2, "--out: cannot write to here: Permission denied\n")


def test_a_user_without_a_home_has_a_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def nowhere() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", nowhere)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.delenv("TRACKBENCH_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert cache_folder().parent == tmp_path
    assert cache_folder() == cache_folder()


@pytest.mark.parametrize("raised", ["SystemExit(0)", "os._exit(0)"])
def test_a_published_plug_in_that_does_not_load(start: Start, tmp_path: Path, raised: str) -> None:
    act = raised if raised.startswith("os.") else f"raise {raised}"
    (tmp_path / "broken.py").write_text(f"import os\n{act}\n", encoding="utf-8")
    package = tmp_path / "broken-1.0.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n", encoding="utf-8")
    (package / "entry_points.txt").write_text("[trackbench.motion_models]\nbroken = broken:Broken\n", encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    # It disturbs no scenario that does not name it.
    run = start(environment=environment)
    assert (run.communicate(timeout=300)[1], run.returncode) == ("", 0)
    run = start("--set", "trackers.ekf.motion=broken", environment=environment)
    _, err = run.communicate(timeout=300)
    if raised.startswith("os."):
        assert (run.returncode, err.count("\n")) == (70, 1)
    else:
        assert run.returncode == 2
        assert "broken" in err
        assert "Traceback" not in err
