"""Several scenes of one scenario: which there are, that they are the same however they are made, and kept."""

from __future__ import annotations

import json
import multiprocessing
import subprocess
from pathlib import Path

import pytest

from trackbench.base.errors import InputError
from trackbench.base.execution import executor
from trackbench.scenario import Scenario, load_scenario
from trackbench.scenario.truth import truth_of, truths_of
from trackbench.truth import LoadedTruth
from trackbench.truth.sources import HighwayTruth

PLAIN = HighwayTruth(env="u-turn-v1", duration_s=1, rate_hz=10, seed=13)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def options(**changed: object) -> HighwayTruth:
    given = {**PLAIN.model_dump(exclude={"seed"}), **changed}
    return HighwayTruth.model_validate(given)


def scenario(file: Path, *settings: str) -> Scenario:
    return load_scenario(file, ["truth.duration_s=1", *settings])


def positions(found: list[LoadedTruth]) -> list[bytes]:
    return [scene.truth.px.tobytes() + scene.truth.py.tobytes() for scene in found]


def test_the_scenes_are_counted_from_the_seed_or_listed() -> None:
    assert PLAIN.scenes() == (PLAIN,)
    assert [scene.seed for scene in options(seed=7, seeds=3).scenes()] == [7, 8, 9]
    assert [scene.seed for scene in options(seeds=2).scenes()] == [0, 1]
    assert [scene.seed for scene in options(seeds=[9, 4]).scenes()] == [9, 4]


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("seeds=0", "0 is not possible: it must be at least 1"),
        ("seeds=2.5", "a whole number is needed, not 2.5"),
        ("seeds=[]", "must not be empty"),
        ("seeds={a: 1}", "write a number of scenes, such as 20, or a list of seeds, such as [3, 5]"),
    ],
)
def test_a_wrong_number_of_scenes_is_refused_in_one_line(tiny: Path, setting: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        scenario(tiny, f"truth.{setting}")
    assert str(caught.value) == f"--set truth.{setting}: truth.seeds: {message}"


@pytest.mark.parametrize(
    ("seeds", "key", "line", "message"),
    [
        ("seed: 1\n  seeds: [3, 5]", "truth.seed", 7, "not used with a list of seeds"),
        ("seeds: [3, 5, 3]", "truth.seeds", 7, "3 is there already"),
        (f"seeds: [{', '.join(map(str, range(1001)))}]", "truth.seeds", 7, "at most 1000 entries are needed, not 1001"),
        ("seed: 4294967295\n  seeds: 2", "truth.seeds", 8, "the last of them would be above 4294967295"),
    ],
)
def test_wrong_seeds_are_refused_where_they_are_written(
    tiny: Path, tiny_text: str, seeds: str, key: str, line: int, message: str
) -> None:
    tiny.write_text(tiny_text.replace("seed: 1", seeds, 1), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_scenario(tiny)
    assert (caught.value.key, caught.value.line) == (key, line)
    assert message in caught.value.message


@pytest.mark.parametrize("workers", [1, 2])
def test_scenes_are_the_same_to_the_last_bit_for_any_number_of_processes(
    tiny: Path, folder: Path, workers: int
) -> None:
    steps: list[tuple[float, float]] = []
    with executor(workers) as chosen:
        found = truths_of(scenario(tiny, "truth.seeds=3"), lambda done, total: steps.append((done, total)), chosen)
    assert not any(scene.cached for scene in found)
    assert steps[-1] == (33, 33)
    assert sorted(steps) == steps
    for file in folder.iterdir():
        file.unlink()
    apart = [truth_of(scenario(tiny, f"truth.seed={seed}")) for seed in (1, 2, 3)]
    assert positions(found) == positions(apart)
    assert len(set(positions(apart))) == 3


@pytest.mark.parametrize("workers", [1, 2])
def test_a_scene_that_cannot_be_had_is_named(tiny: Path, folder: Path, workers: int) -> None:
    loaded = scenario(tiny, "truth.seeds=2", "truth.targets={ids: [v99]}")
    with executor(workers) as chosen, pytest.raises(InputError) as caught:
        truths_of(loaded, executor=chosen)
    assert caught.value.key == "truth.targets.ids"
    assert "scene 1 of 2: there is no vehicle 'v99'" in str(caught.value)
    assert "--set truth.targets=" in str(caught.value)
    assert not multiprocessing.active_children()


def test_scenes_on_the_command_line_are_seeds_of_the_truth(tiny: Path, trackbench: str) -> None:
    command = [trackbench, "run", str(tiny), "--scenes", "2", "--runs", "2", "--no-recording", "--json"]
    done = subprocess.run([*command, "--out", str(tiny.parent)], capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    assert "truth.seeds=2" in found["scenario"]["overrides"]
    assert [scene["name"] for scene in found["truth"]["scenes"]] == ["seed 1", "seed 2"]
    assert all(scene["audit"]["velocity_jumps"]["limit_mps2"] == 20 for scene in found["truth"]["scenes"])
