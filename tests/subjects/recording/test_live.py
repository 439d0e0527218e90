"""A run is shown while it goes on, and does not notice what becomes of the viewer."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr
from tests.support.recordings import ReadRecording

from trackbench.api.plan import Prepared
from trackbench.base.types import Gaussian
from trackbench.document.palette import tracker_colours
from trackbench.runner.recorded import RecordedInstant
from trackbench.runner.run import run_scenario
from trackbench.scenario import Scenario, load_scenario
from trackbench.scenario.truth import truth_of
from trackbench.subjects.recording import live
from trackbench.subjects.recording.live import Live, LiveRun, LiveRuns
from trackbench.truth import LoadedTruth


@pytest.fixture
def scene(tiny: Path) -> tuple[Scenario, LoadedTruth]:
    loaded = load_scenario(tiny)
    return loaded, truth_of(loaded)


@pytest.fixture
def deaf() -> Iterator[str]:
    """A viewer that takes connections and reads nothing."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"rerun+http://127.0.0.1:{server.getsockname()[1]}/proxy"


ABSENT = "rerun+http://127.0.0.1:9/proxy"


def stop(viewer: Live) -> None:
    viewer._process.kill()
    viewer._process.join()


@pytest.mark.parametrize("url", [None, ABSENT])
def test_a_run_hands_over_what_it_finds_and_never_waits(
    scene: tuple[Scenario, LoadedTruth], deaf: str, url: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "PATIENCE", 2)
    loaded, truth = scene
    viewer = Live(url or deaf)
    try:
        viewer.begin(Prepared(loaded, [truth]))
        instant = RecordedInstant(0, {"ekf": Gaussian(np.zeros((4, 500)), np.zeros((4, 4, 500)))})
        # Six hundred megabytes, which no pipe and no connection takes: a call that waits for it waits for ever.
        for _ in range(10_000):
            viewer.observe(instant)
        result = run_scenario(loaded, [truth], on_recorded_run=viewer.observe)
        viewer.end(result)
        viewer.close()
    finally:
        stop(viewer)


def test_a_process_that_dies_is_noticed_and_no_error(scene: tuple[Scenario, LoadedTruth]) -> None:
    loaded, truth = scene
    viewer = Live(ABSENT)
    stop(viewer)
    viewer.begin(Prepared(loaded, [truth]))
    result = run_scenario(loaded, [truth], on_recorded_run=viewer.observe)
    viewer.end(result)
    viewer.close()
    assert viewer.lost
    assert result.summary.trackers[0].failed is None


def test_a_viewer_that_takes_nothing_is_given_up(
    scene: tuple[Scenario, LoadedTruth], deaf: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rerun itself would wait for ever."""
    assert live.PATIENCE > 3
    monkeypatch.setattr(live, "PATIENCE", 3)
    viewer = Live(deaf)
    viewer.begin(Prepared(scene[0], [scene[1]]))
    viewer.end(run_scenario(scene[0], [scene[1]]))
    viewer.close()
    assert viewer.lost
    assert not viewer._process.is_alive()


def test_what_is_drawn_while_a_run_goes_on_is_what_its_recording_holds(
    scene: tuple[Scenario, LoadedTruth], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded, truth = scene
    monkeypatch.setattr(rr.RecordingStream, "connect_grpc", lambda self, url: self.save(tmp_path / f"{url}.rrd"))
    seen: list[Any] = []
    result = run_scenario(loaded, [truth], on_recorded_run=seen.append)

    def draw(name: str, batches: list[list[Any]]) -> Any:
        drawing = LiveRuns(name)
        for batch in batches:
            drawing.draw(batch)
        drawing.finish()
        return ReadRecording(tmp_path / f"{name}.rrd")

    colours = tracker_colours({"raw": 0, "ekf": 1})
    about = LiveRun("tiny", colours, ["radar", "lidar"], truth.truth)
    going = draw("going", [[about, seen[0]], *(seen[i : i + 5] for i in range(1, len(seen), 5))])
    half = draw("half", [[about, *seen[:6]]])
    whole = draw("whole", [[about, result]])
    entities = [
        ("/world/vehicles/v1", "Boxes2D:half_sizes"),
        ("/world/measurements/radar", "Points2D:positions"),
        ("/world/covariances/ekf", "LineStrips2D:strips"),
        ("/series/recorded_run/position_error/ekf", "Scalars:scalars"),
    ]
    for entity, component in entities:
        expected = {time: value for time, value in whole(entity, component).items() if value}
        assert {time: value for time, value in going(entity, component).items() if value} == expected
    for drawn in (going, whole):
        assert {*drawn("/world/tracks/ekf", "Points2D:colors")[1.0]} == {int(colours["ekf"][1:] + "FF", 16)}
    times = {time for time in half("/world/vehicles/v1", "Boxes2D:half_sizes") if time is not None}
    assert max(times) == pytest.approx(0.4), "vehicles are drawn as far as the trackers have come"
    dots = half("/world/tracks/raw", "Points2D:positions")
    assert max(time for time in dots if time is not None) == pytest.approx(0.4)
    assert len(dots[0.4]) == 2, "at the latest time, which the viewer shows, the first tracker is there"
    assert "/data" not in half.entities()


def test_a_tracker_that_fails_leaves_the_picture_and_the_others_stay(
    scene: tuple[Scenario, LoadedTruth], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rr.RecordingStream, "connect_grpc", lambda self, url: self.save(tmp_path / f"{url}.rrd"))
    seen: list[Any] = []
    run_scenario(scene[0], [scene[1]], on_recorded_run=seen.append)
    for item in seen[1:]:
        if "ekf" in item.estimates and item.number > 2:
            item.estimates["ekf"] = Gaussian(*(np.full_like(part, np.nan) for part in item.estimates["ekf"]))
    drawing = LiveRuns("failing")
    drawing.draw([LiveRun("tiny", tracker_colours({"raw": 0, "ekf": 1}), ["radar", "lidar"], scene[1].truth), *seen])
    drawing.finish()
    read = ReadRecording(tmp_path / "failing.rrd")
    raw, ekf = (read(f"/world/tracks/{name}", "Points2D:positions") for name in ("raw", "ekf"))
    assert [len(ekf[round(0.1 * i, 9)]) for i in range(1, 5)] == [2, 2, 0, 0]
    assert [len(raw[round(0.1 * i, 9)]) for i in range(1, 5)] == [2, 2, 2, 2]
