"""When and of which code a result was made."""

from __future__ import annotations

import hashlib
import subprocess
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

import trackbench as tb
from trackbench.api import provenance
from trackbench.api.provenance import provenance_of

SCENE = """\
name: scene
truth:
  source: scripted
  duration_s: 2
  rate_hz: 10
  observer: {x: 0, y: 0, yaw_deg: 0}
  objects: {car: {start: {x: 20, y: -3, speed_mps: 8, course_deg: 10}, pieces: [{for_s: 2}]}}
sensors: {lidar: {type: lidar, rate_hz: 10, position_sigma_m: 0.15}}
trackers: {raw: {use: raw}}
monte_carlo: {runs: 2, seed: 7}
"""
TRACKER = "import numpy as np\nclass T:\n    def step(self, state, scan): return 1, (np.ones(4), np.eye(4))\n"


def git(folder: Path, *arguments: str) -> str:
    identity = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    done = subprocess.run(["git", *identity, "-C", folder, *arguments], check=True, capture_output=True, text=True)
    return done.stdout.strip()


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    file = tmp_path / "scene.yaml"
    file.write_text(SCENE, encoding="utf-8")
    return file


@pytest.fixture
def commit(scene: Path) -> str:
    """The commit that holds the scene."""
    git(scene.parent, "init", "-q")
    git(scene.parent, "add", ".")
    git(scene.parent, "commit", "-qm", "scene")
    return git(scene.parent, "rev-parse", "HEAD")


def test_a_result_says_when_and_by_which_commit(scene: Path, commit: str) -> None:
    before = datetime.now(UTC)
    result = tb.run(scene, out=scene.parent / "results", recording=False)
    made = result.summary.provenance
    assert made is not None
    assert (made.commit, made.changed, made.no_commit, made.code) == (commit, False, "", {})
    assert before - timedelta(milliseconds=1) <= made.made_at <= datetime.now(UTC)
    assert made.made_at.utcoffset() == timedelta(0)
    assert tb.Result.load(scene.parent / "results" / "scene").summary.provenance == made


def test_a_changed_work_tree_is_said_to_be_changed(scene: Path, commit: str) -> None:
    scene.write_text(SCENE + "score: {settle_s: 0}\n", encoding="utf-8")
    made = provenance_of(tb.load(scene))
    assert (made.commit, made.changed) == (commit, True)
    assert made.commit_in_words == f"{commit[:10]} (changed)"


def test_without_a_commit_the_reason_stands_there(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert provenance_of(tb.load(scene)).no_commit.startswith("git: not a git repository")
    assert provenance_of(tb.load("highway")).no_commit == "the scenario comes with trackbench"
    git(scene.parent, "init", "-q")
    assert provenance_of(tb.load(scene)).no_commit == "git: Needed a single revision"
    git(scene.parent, "commit", "-q", "--allow-empty", "-m", "none")
    made = provenance_of(tb.load(scene))
    assert (made.commit, made.changed, made.no_commit) == (None, None, "scene.yaml is not in its git repository")
    monkeypatch.setenv("PATH", "")
    assert provenance_of(tb.load(scene)).no_commit == "git cannot be run: No such file or directory"
    monkeypatch.undo()
    monkeypatch.setattr(provenance, "PATIENCE", 1e-9)
    assert "gave no answer within" in provenance_of(tb.load(scene)).no_commit


def test_the_code_of_an_own_tracker_is_that_of_its_file(scene: Path) -> None:
    (scene.parent / "mine.py").write_text(TRACKER, encoding="utf-8")
    made = provenance_of(tb.load(scene, {"trackers.mine.use": "mine:T"}))
    assert made.code == {"mine": hashlib.sha256(TRACKER.encode()).hexdigest()}
    (scene.parent / "mine.py").write_text(TRACKER + "# another\n", encoding="utf-8")
    assert provenance_of(tb.load(scene, {"trackers.mine.use": "mine:T"})).code != made.code
    assert provenance_of(tb.load(scene, {"trackers.mine.use": "nothing_there:T"})).code == {"mine": None}


@pytest.mark.parametrize("marked", [True, False])
def test_the_code_in_a_package_is_found_without_importing_it(scene: Path, marked: bool) -> None:
    package = scene.parent / "pack" / "inner"
    package.mkdir(parents=True)
    if marked:
        (package.parent / "__init__.py").write_text("raise SystemExit\n", encoding="utf-8")
        (package / "__init__.py").write_text("", encoding="utf-8")
    (package / "mine.py").write_text(TRACKER, encoding="utf-8")
    made = provenance_of(tb.load(scene, {"trackers.mine.use": "pack.inner.mine:T"}))
    assert made.code == {"mine": hashlib.sha256(TRACKER.encode()).hexdigest()}
