"""What is not met, as lines that GitHub Actions shows beside a file."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.support.past_results import SCENE, past

from trackbench.report.junit import Case, Suite, to_annotations

Cli = Callable[..., Any]
EXPECT = """\
expect:
  - {tracker: kf, metric: position_rmse, below: 5}
  - {tracker: kf, metric: position_rmse, below: 0.001}
"""


def test_a_failed_expectation_stands_at_its_line(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(SCENE + EXPECT, encoding="utf-8")
    line = len(SCENE.splitlines()) + 3
    done = cli("run", "scene.yaml", "--no-recording", "--quiet", "--github")
    (annotation,) = [text for text in done.out.splitlines() if text.startswith("::")]
    assert done.status == 1
    assert re.fullmatch(
        rf"::error file=scene\.yaml,line={line},title=scene::kf position_rmse below 0\.001: failed: .*", annotation
    )
    set_over = cli("run", "scene.yaml", "--no-recording", "--github", "--json", "--set", "expect.1.below=0.002")
    assert set_over.err.startswith("::error file=scene.yaml,line=16,title=scene::kf position_rmse below 0.002: ")
    assert set_over.out.startswith("{")


def test_a_failed_tracker_stands_at_its_entry(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "bad.py").write_text("class T:\n    def step(self, state, scan): raise ValueError('5%: a\\nb')\n")
    (tmp_path / "scene.yaml").write_text(SCENE.replace("{use: raw}", "{use: bad:T}"), encoding="utf-8")
    done = cli("run", "scene.yaml", "--no-recording", "--quiet", "--github")
    (annotation,) = [text for text in done.out.splitlines() if text.startswith("::")]
    number = next(i for i, text in enumerate(SCENE.splitlines(), 1) if "raw:" in text)
    assert done.status == 3
    assert annotation.startswith(f"::error file=scene.yaml,line={number},title=scene::raw runs to the end: ")
    assert "5%25" in annotation


def test_regressions_stand_at_the_result(cli: Cli, tmp_path: Path) -> None:
    for number, error in enumerate((0.1, 0.2)):
        past(number, {"raw": 0.3, "kf": error}, seed=1).save(tmp_path / "nights" / str(number) / "scene")
    limit = "position_rmse:5"
    done = cli("compare", "nights/0", "nights/1", "--fail-on-regression", limit, "--github")
    assert done.status == 1
    assert "\n::error file=nights/1/scene/result.json,title=" in f"\n{done.out}"


def test_without_a_limit_there_is_nothing_to_annotate(cli: Cli, tmp_path: Path) -> None:
    past(0, {"raw": 0.3, "kf": 0.1}, seed=1).save(tmp_path / "scene")
    done = cli("compare", "scene", "--github")
    assert done.status == 2
    assert done.err.startswith("--github: says which ")
    assert len(done.err.splitlines()) == 1


def test_what_would_end_a_line_or_a_property_is_escaped() -> None:
    case = Case("a", "g", "undecided", "50 %\r\nmore: x, y", "dir,1/x:y.yaml", 3)
    passed = Case("b", "g")
    assert [*to_annotations([Suite("s,t", [case, passed])])] == [
        "::warning file=dir%2C1/x%3Ay.yaml,line=3,title=s%2Ct::a: 50 %25%0D%0Amore: x, y"
    ]
