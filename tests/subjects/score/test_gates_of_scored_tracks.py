"""Limits on results of ``trackbench score``: two versions of a tracker, each scored into a folder of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.support.udacity import data_folder

Score = Callable[..., str]


@pytest.fixture(scope="module")
def versions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of `reported/gate`: boxes of 60 s, and tracks with errors of 0.3 m and of 0.9 m."""
    folder = tmp_path_factory.mktemp("gate")
    make = data_folder() / "reported" / "gate" / "make.py"
    if not make.is_file():
        pytest.skip("needs the folder data/reported")
    subprocess.run([sys.executable, make], cwd=folder, check=True)
    return folder


@pytest.fixture
def score(versions: Path, cli) -> Score:
    """Score a version's rows up to some second; the folder of the result, which lies as deep as its name says."""

    def scored(version: str, out: str, until_s: float = 60.0) -> str:
        for file, name in ((f"tracks_{version}.csv", "tracks.csv"), ("boxes.csv", "boxes.csv")):
            head, *rows = (versions / file).read_text().splitlines()
            kept = [head, *(row for row in rows if float(row.partition(",")[0]) <= until_s)]
            Path(out).mkdir(parents=True, exist_ok=True)
            Path(out, name).write_text("\n".join(kept) + "\n")
        done = cli("score", f"{out}/tracks.csv", "--truth", f"{out}/boxes.csv", "--out", out, "--no-recording", "-q")
        assert done.status == 0, done.err
        return f"{out}/boxes"

    return scored


@pytest.mark.parametrize(("seconds", "how"), [(60.0, "95 %"), (12.0, "values as they are")])
def test_a_worse_version_fails_the_gate(score: Score, cli, seconds: float, how: str) -> None:
    """Over ten stretches of time, and of a sequence that is too short for an interval."""
    option = "--fail-on-regression"
    good, bad = score("v1", "first", seconds), score("v2", "deeper/second", seconds)
    again = score("v1", "third", seconds)
    done = cli("compare", good, bad, option, "gospa:5", "--json")
    (gate,) = json.loads(done.out)["gates"]
    assert (done.status, gate["outcome"]) == (1, "failed")
    assert how in gate["text"]
    assert done.err.splitlines()[-1] == "0 of 1 limit kept, 1 broken: exit status 1 (0: all shown kept)"
    kept = cli("compare", good, again, option, "gospa:0")
    assert kept.status == 0
    assert kept.err.splitlines()[-1] == "1 of 1 limit kept: exit status 0 (0: all shown kept)"


def test_another_truth_is_no_baseline(score: Score, versions: Path, cli) -> None:
    """The same file in another folder may be compared; another one may not, and its gate is not open."""
    good = score("v1", "first")
    moved = Path("moved")
    moved.mkdir()
    text = (versions / "boxes.csv").read_text().replace(",0.000\n", ",0.500\n")
    (moved / "boxes.csv").write_text(text)
    assert cli("score", "first/tracks.csv", "--truth", "moved/boxes.csv", "--out", "moved", "-q").status == 0
    done = cli("compare", good, "moved/boxes", "--fail-on-regression", "gospa:5")
    assert done.status == 2
    assert "cannot be compared with first/boxes: another scenario: truth.path is boxes.csv" not in done.err
    assert "cannot be compared with first/boxes" in done.err
