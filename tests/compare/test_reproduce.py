"""A comparison says by which commands it is made again."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.support.past_results import SCENE, past

import trackbench as tb
from trackbench.compare import compare_results, find_results
from trackbench.compare.limits import Limit

Cli = Callable[..., Any]


def test_the_printed_commands_make_the_same_comparison_again(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(SCENE, encoding="utf-8")
    for out, sigma in (("a", "1"), ("b b", "2")):
        change = f"trackers.kf.acceleration_sigma_mps2={sigma}"
        assert cli("run", "scene.yaml", "--no-recording", "--runs", "4", "--out", out, "--set", change).status == 0
    options = ["--trackers", "kf", "--metric", "velocity_rmse", "--fail-on-regression", "position_rmse:50"]
    done = cli("compare", "a/scene", "b b/scene", *options, "--json")
    printed = cli("compare", "a/scene", "b b/scene", *options).out
    commands = tb.compare("a/scene", "b b/scene", trackers=["kf"], metrics=["velocity_rmse"]).commands
    assert "Reproduce\n" in printed
    assert commands[-1] == "trackbench compare a/scene 'b b/scene' --metric velocity_rmse --trackers kf"
    assert tb.compare("a/scene", baseline="kf").commands[-1] == "trackbench compare a/scene --baseline kf"
    again = [shlex.split(command)[1:] for command in find_commands(printed)]
    assert [words[0] for words in again] == ["run", "run", "compare"]
    for words in again[:-1]:
        assert cli(*words, "--no-recording").status == 0
    repeated = cli(*again[-1], "--json")
    # The results say when they were made.
    assert re.sub('"made_at": ".*"', "", repeated.out) == re.sub('"made_at": ".*"', "", done.out)


def find_commands(printed: str) -> list[str]:
    lines = printed.splitlines()
    section = [*lines[lines.index("Reproduce") + 1 :], ""]
    text = " ".join(line.strip() for line in section[: section.index("")])
    return [f"trackbench {part.strip()}" for part in text.split("trackbench ")[1:]]


def test_where_the_results_are_is_where_they_are_written_again(tmp_path: Path) -> None:
    result = past(0, {"raw": 0.2, "kf": 0.1}).updated(command="trackbench run scene.yaml --set x=1")
    result.save(tmp_path / "renamed")
    result.save(tmp_path / "several" / "scene")
    result.updated(scenario=result.summary.scenario.model_copy(update={"name": "other"})).save(
        tmp_path / "several" / "other"
    )
    run = "trackbench run scene.yaml --set x=1 --out"
    renamed = tmp_path / "renamed"
    assert compare_results([find_results(renamed)], limits=[]).commands == [
        f"{run} {renamed}",
        f"trackbench compare {renamed / 'scene'}",
    ]
    several = tmp_path / "several"
    assert compare_results([find_results(several)]).commands == [f"{run} {several}", f"trackbench compare {several}"]
    both = compare_results([find_results(renamed / "result.json"), result], limits=[Limit("position_rmse", 5)])
    assert both.commands[-1].endswith("'results 2/scene' --fail-on-regression position_rmse:5")


def test_results_that_do_not_say_how_they_were_made_give_no_commands() -> None:
    result = past(0, {"raw": 0.2, "kf": 0.1}).updated(command="")
    comparison = tb.compare(result)
    assert comparison.commands == []
    assert "Reproduce" not in str(comparison)
    assert "commands" not in comparison.json()
