"""What was simulated once is not simulated again, unless it cannot be trusted."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from trackbench.base.types import Progress, Truth
from trackbench.truth import Draw, LoadedTruth, highway, simulated
from trackbench.truth.sources import HighwayTruth

CONFIG = HighwayTruth(source="highway-env", env="u-turn-v1", seed=1, duration_s=1, rate_hz=10)


def load(config: HighwayTruth) -> LoadedTruth:
    return config.load(Draw(seed=0, scenario="test", runs=1), folder=Path())


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def simulations(monkeypatch: pytest.MonkeyPatch) -> list[HighwayTruth]:
    """The configurations that were simulated."""
    done: list[HighwayTruth] = []
    simulate = highway.simulate

    def counted(config: HighwayTruth, progress: Progress) -> Truth:
        done.append(config)
        return simulate(config, progress)

    monkeypatch.setattr(highway, "simulate", counted)
    return done


def assert_same(a: object, b: object) -> None:
    for field in fields(a):
        one, other = getattr(a, field.name), getattr(b, field.name)
        if field.name == "observer":
            assert_same(one, other)
        elif field.name == "roads":
            assert all(np.array_equal(x, y) for x, y in zip(one, other, strict=True))
        elif isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, other)
            assert one.dtype == other.dtype
        else:
            assert one == other


def test_second_load_gives_the_same_truth_without_simulating(folder: Path, simulations: list[HighwayTruth]) -> None:
    first, second = load(CONFIG), load(CONFIG)
    assert (first.cached, second.cached, len(simulations)) == (False, True, 1)
    assert_same(first.truth, second.truth)
    assert not second.notes
    assert [file.suffix for file in folder.iterdir()] == [".truth"]


@pytest.mark.parametrize(
    "change", [{"seed": 2}, {"rate_hz": 20}, {"ego": "idle"}, {"observer": {"x": 1}}, {"config": {"vehicles": 1}}]
)
def test_key_holds_everything_that_determines_the_truth(change: dict[str, object]) -> None:
    other = HighwayTruth.model_validate({**CONFIG.model_dump(), **change})
    assert simulated.cache_file(other) != simulated.cache_file(CONFIG)


def test_other_version_of_the_simulator_is_another_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    before = simulated.cache_file(CONFIG)
    monkeypatch.setattr(simulated, "version", lambda package: "0")
    assert simulated.cache_file(CONFIG) != before


@pytest.mark.parametrize("changed", ["highway.py", "drivers.py", "environment.py", "audit.py", "streams.py"])
def test_another_source_of_the_motion_is_another_entry(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changed: str
) -> None:
    before = simulated.cache_file(CONFIG)
    copies = [tmp_path / file.name for file in simulated.motion_files()]
    for copy, file in zip(copies, simulated.motion_files(), strict=True):
        copy.write_bytes(file.read_bytes())
    monkeypatch.setattr(simulated, "motion_files", lambda: copies)
    assert simulated.cache_file(CONFIG) == before
    (tmp_path / changed).write_text((tmp_path / changed).read_text().replace("0.5", "0.25", 1) + "\n")
    assert simulated.cache_file(CONFIG) != before


@pytest.mark.parametrize(
    "damage",
    [
        lambda raw: raw[: len(raw) // 2],
        lambda raw: raw[:5000] + bytes([raw[5000] ^ 1]) + raw[5001:],
        lambda raw: b"",
        lambda raw: b"something else\n" * 100,
    ],
    ids=["truncated", "one bit", "empty", "foreign"],
)
@pytest.mark.usefixtures("folder")
def test_damaged_entry_is_simulated_again(
    simulations: list[HighwayTruth], damage: object, caplog: pytest.LogCaptureFixture
) -> None:
    first = load(CONFIG)
    file = simulated.cache_file(CONFIG)
    file.write_bytes(damage(file.read_bytes()))
    again = load(CONFIG)
    assert not again.cached
    assert "simulated again" in caplog.text
    assert_same(first.truth, again.truth)
    assert load(CONFIG).cached
    assert len(simulations) == 2


def test_unwritable_folder_costs_only_the_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path / "file" / "cache"))
    loaded = load(CONFIG)
    assert not loaded.cached
    assert "not kept" in caplog.text


def test_driver_class_of_the_users_own_is_never_cached(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "own_drivers.py").write_text("from highway_env.vehicle.behavior import IDMVehicle as Careful\n")
    monkeypatch.syspath_prepend(tmp_path)
    config = CONFIG.model_copy(update={"config": {"other_vehicles_type": "own_drivers.Careful"}})
    assert not load(config).cached
    assert not load(config).cached
    assert not folder.exists()
