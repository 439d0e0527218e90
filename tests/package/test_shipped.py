"""The scenarios that come with the package, and how they are named."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.support.places import SCENARIOS
from tests.support.udacity import data_folder

from trackbench.base.errors import InputError
from trackbench.scenario import load_scenario
from trackbench.scenario.check import check
from trackbench.scenario.shipped import FOLDER, find_scenario, shipped

SHORT = ("--runs", "2", "--set", "truth.duration_s=2", "--no-recording")

Cli = Callable[..., Any]


def test_the_names_are_those_of_the_files() -> None:
    assert set(shipped()) >= {"highway", "scripted/own_model", "published/range_3km_a", "recorded/udacity_fusion"}
    assert all(file.is_file() for file in shipped().values())
    assert (SCENARIOS).resolve() == FOLDER


@pytest.mark.parametrize("name", sorted(set(shipped()) - {name for name in shipped() if name.startswith("recorded/")}))
def test_every_one_is_valid_from_anywhere(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    check(load_scenario(name))


def test_run_by_name(cli: Cli, tmp_path: Path) -> None:
    done = cli("run", "highway", *SHORT, "--trackers", "raw,ekf_cv")
    assert done.status in (0, 1), done.err
    command = json.loads((tmp_path / "results" / "highway" / "result.json").read_text(encoding="utf-8"))["command"]
    assert command.startswith("trackbench run highway --set ")


def test_a_folder_of_the_package_stands_for_its_scenarios(cli: Cli) -> None:
    names = ["air_traffic", "constant_acceleration", *(f"range_3km_{case}" for case in "abcd")]
    assert cli("check", "published").out.splitlines() == [f"published/{name}: ok" for name in names]


@pytest.mark.parametrize("own", ["highway", "scripted/own_model"])
def test_a_file_or_folder_of_ones_own_wins(
    own: str, cli: Cli, tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / own).parent.mkdir(exist_ok=True)
    shutil.copy(tiny, tmp_path / own)
    assert cli("run", own, "--no-recording", "--runs", "2").status == 0
    assert (tmp_path / "results" / "tiny").is_dir()
    (tmp_path / own).unlink()
    (tmp_path / own).mkdir()
    # A folder without a scenario, such as that of a run, stands for none.
    assert find_scenario(own) == FOLDER / f"{own}.yaml"
    shutil.copy(tiny, tmp_path / own)
    assert find_scenario(own) == Path(own)
    (tmp_path / "empty").mkdir()
    assert "there is no scenario file (*.yaml) in this folder" in cli("run", "empty").err


@pytest.mark.parametrize(
    ("named", "message"),
    [
        ("higway", "higway: there is no such file; did you mean 'highway'?"),
        ("tny", "tny: there is no such file; did you mean 'tiny.yaml'?"),
        ("own_model", "did you mean 'scripted/own_model'?"),
        ("scenarios/highway.yaml", "did you mean 'highway'?"),
        ("two_wy.yaml", "did you mean 'two_way'?"),
        ("../scenarios/highway", "there is no such file"),
        ("nothing_like_it", "nothing_like_it: there is no such file"),
        ("a" * 5000, "there is no such file"),
    ],
)
def test_an_unknown_name(named: str, message: str, tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "two_w.yaml").touch()
    with pytest.raises(InputError) as caught:
        find_scenario(named)
    assert message in str(caught.value)


def test_lists_those_of_the_package(cli: Cli) -> None:
    lines = cli("list", "scenarios").out.splitlines()
    assert {line.split()[0] for line in lines if not line.startswith(" ")} == set(shipped())


def test_a_link_to_the_folder_of_the_package(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "scenarios").symlink_to(FOLDER)
    assert cli("check", "scenarios/highway.yaml").out == "scenarios/highway.yaml: ok\n"


def test_a_tracker_of_one_is_named_by_the_same_name(cli: Cli) -> None:
    done = cli("doctor", "highway#nobody")
    assert (done.status, done.out) == (2, "")
    assert "there is no tracker 'nobody' in it" in done.err
    assert cli("doctor", "highwy#ekf_cv").err.startswith("highwy: there is no such file; did you mean 'highway'")


def test_the_module_beside_a_shipped_scenario_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the working directory is."""
    from trackbench.subjects.doctor.subject import find_tracker

    if not (data_folder() / "udacity").is_dir():
        pytest.skip("no recording: set TRACKBENCH_DATA to the folder that holds udacity")
    monkeypatch.chdir(tmp_path)
    for name, tracker in load_scenario("recorded/udacity_ukf_tuning").config.trackers.items():
        if getattr(tracker, "use", "").startswith("published_ukf:"):
            assert find_tracker(f"recorded/udacity_ukf_tuning#{name}", {}).make()
            return
    pytest.fail("no scenario of the package has a module beside it")
