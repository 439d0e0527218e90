"""Runs laid over each other, and what is given to the viewer."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.support.recordings import ReadRecording, shown_views

from trackbench.base.errors import InputError
from trackbench.metrics.recorded_run import load_recorded_run, worst
from trackbench.results import Result
from trackbench.subjects.recording import writer as recording
from trackbench.subjects.recording.contents import labels, laid_over, same_traffic
from trackbench.subjects.recording.data import read
from trackbench.subjects.recording.focus import Focus, Opening, focus_of
from trackbench.subjects.recording.viewer import playable
from trackbench.subjects.recording.writer import write_overlay


@pytest.fixture(scope="module")
def pair(run_tiny: Callable[..., Result]) -> dict[str, Result]:
    return {"old": run_tiny("trackers.ekf.acceleration_sigma_mps2=9"), "new": run_tiny("monte_carlo.runs=6")}


def test_runs_are_called_by_what_tells_their_paths_apart() -> None:
    assert labels([Path("a/highway"), Path("b/highway")]) == ["a", "b"]
    assert labels([Path("r/highway/recording.rrd"), Path("r/merge/recording.rrd")]) == ["highway", "merge"]
    assert labels([Path("x.rrd"), Path("y.rrd")]) == ["x", "y"]
    assert len(set(labels([Path("x.rrd"), Path("x.rrd")]))) == 2


def test_the_trackers_of_both_are_in_one_scene(pair: dict[str, Result], tmp_path: Path) -> None:
    write_overlay(laid_over(pair), tmp_path / "both.rrd", Focus())
    read_back = ReadRecording(tmp_path / "both.rrd")
    drawn = {entity for entity in read_back.entities() if entity.startswith("/series/all_runs/nees/")}
    names = {f"{name}\\ \\({label}\\)" for name in ("raw", "ekf") for label in pair}
    assert names <= {entity.removeprefix("/series/all_runs/nees/") for entity in drawn}
    (ranking,) = read_back("/ranking", "TextDocument:text")[None]
    assert "All 4 and 6 runs" in ranking
    assert "ekf (old)" in ranking
    (about,) = read_back("/about", "TextDocument:text")[None]
    assert "**old**: run 0 of 4, seed 7" in about
    assert "**new**: run 0 of 6, seed 7" in about
    assert "over different measurements" in about
    # The recorded run has the same measurements in both, so they are drawn once.
    assert {e for e in read_back.entities() if e.startswith("/world/measurements/")} == {
        "/world/measurements/radar",
        "/world/measurements/lidar",
    }


def test_runs_on_the_same_measurements_say_nothing_of_others(run_tiny: Callable[..., Result]) -> None:
    both = laid_over({"old": run_tiny("trackers.ekf.acceleration_sigma_mps2=9"), "new": run_tiny()})
    assert "All 4 runs" in both.ranking
    # The panel is narrow: what comes after the covariance is cut off.
    assert "| tracker | RMSE m | covariance |" in both.ranking
    assert "different measurements" not in both.about


def test_a_tracker_that_failed_is_ranked_last_and_named(run_tiny: Callable[..., Result], tmp_path: Path) -> None:
    (tmp_path / "broken.py").write_text("class Broken:\n    batched = True\n", encoding="utf-8")
    failing = run_tiny("trackers.broken.use=broken:Broken", folder=tmp_path)
    both = laid_over({"old": failing, "new": run_tiny()})
    rows = [line for line in both.ranking.splitlines() if line.startswith("| ")]
    assert rows[-1] == "| broken (old) | failed | | | |"
    assert "**broken (old)**: 'broken:Broken' is no tracker" in both.ranking


def test_other_measurements_are_drawn_beside(pair: dict[str, Result], run_tiny: Callable[..., Result]) -> None:
    both = laid_over({"old": pair["old"], "new": run_tiny("monte_carlo.seed=8")})
    assert set(both.sensors) == {f"{s} ({label})" for s in ("radar", "lidar") for label in ("old", "new")}


def test_other_traffic_is_not_laid_over(pair: dict[str, Result], run_tiny: Callable[..., Result]) -> None:
    assert same_traffic(list(pair.values()))
    assert not same_traffic([pair["old"], run_tiny("truth.seed=5")])


def test_what_the_viewer_gets(pair: dict[str, Result], run_tiny: Callable[..., Result], tmp_path: Path) -> None:
    everything = {**pair, "other": run_tiny("truth.seed=5")}
    for name, result in everything.items():
        writers = {} if name == "new" else {"recording.rrd": lambda path, result=result: recording.write(result, path)}
        result.save(tmp_path / name, writers)
    old, new, other = (tmp_path / name for name in everything)
    with playable([old], Opening()) as ready:
        assert (ready.files, ready.notes) == ([old / "recording.rrd"], [])
    with playable([old, new], Opening()) as ready:
        (file,) = ready.files
        assert "tables" in ready.notes[0]
        drawn = ReadRecording(file).entities()
        assert {f"/world/estimates/ekf\\ \\({label}\\)/v1" for label in ("old", "new")} <= drawn
        with pytest.raises(InputError, match="several that are laid over each other"):
            read(file)
    assert not file.exists()
    with playable([old, other], Opening()) as ready:
        assert ready.files == [old / "recording.rrd", other / "recording.rrd"]
        assert "not show the same traffic" in ready.notes[0]
    with pytest.raises(InputError, match="goes from"), playable([old], Opening(at_s=3.0)):
        pass


def test_a_recording_opens_where_the_error_is(pair: dict[str, Result], tmp_path: Path) -> None:
    result = pair["old"]
    recording.write(result, tmp_path / "run.rrd")
    run = load_recorded_run(result)
    # raw filters nothing, so it is not what --worst looks for.
    (first, second) = worst(run, ["ekf"], 2)
    for number, moment in enumerate((first, second), start=1):
        with playable([tmp_path / "run.rrd"], Opening(worst=number)) as ready:
            assert ready.time_s == moment.time_s
            assert f"Seen from above, around {moment.object}" in shown_views(ready.files[0])
            assert ReadRecording(ready.files[0]).entities() == ReadRecording(tmp_path / "run.rrd").entities()
    (of_ekf,) = worst(run, ["ekf"], 1, "v2")
    with playable([tmp_path / "run.rrd"], Opening(worst=1, vehicle="v2", tracker="ekf")) as ready:
        assert ready.time_s == of_ekf.time_s
        assert "Seen from above, around v2" in shown_views(ready.files[0])
    with playable([tmp_path / "run.rrd"], Opening(vehicle="v2")) as ready:
        assert ready.time_s is None
        assert "Seen from above, around v2" in shown_views(ready.files[0])


def test_the_worst_moment_of_runs_that_are_laid_over_is_that_of_any(
    pair: dict[str, Result], run_tiny: Callable[..., Result], tmp_path: Path
) -> None:
    for name, result in pair.items():
        result.save(tmp_path / name, {})
    moments = [worst(load_recorded_run(result), ["ekf"], 1)[0] for result in pair.values()]
    largest = max(moments, key=lambda moment: moment.position_error_m or 0.0)
    with playable([tmp_path / name for name in pair], Opening(worst=1)) as ready:
        assert ready.time_s == largest.time_s
    run_tiny("truth.seed=5").save(tmp_path / "other", {})
    with (
        pytest.raises(InputError, match="do not show the same traffic"),
        playable([tmp_path / "old", tmp_path / "other"], Opening(worst=1)),
    ):
        pass


def test_a_vehicle_that_is_not_there_yet_is_said(result: Result) -> None:
    with pytest.raises(InputError, match="v4 is not there at 2 s: it is there from 5 s to 20 s"):
        focus_of([result], Opening(at_s=2.0, vehicle="v4"))


def test_an_examination_is_opened_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "examination.json").write_text("{}", encoding="utf-8")
    (tmp_path / "recording.rrd").write_bytes(b"RRF2")
    for path in (tmp_path, tmp_path / "recording.rrd"):
        with playable([path], Opening()) as ready:
            assert ready.files == [tmp_path / "recording.rrd"]
    with pytest.raises(InputError, match="one target"), playable([tmp_path], Opening(worst=1)):
        pass
