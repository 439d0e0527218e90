"""What is given to the viewer, and where it opens."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.support.recordings import ReadRecording, shown_views

from trackbench.base.errors import InputError
from trackbench.metrics.recorded_run import recorded_estimates, worst
from trackbench.results import Result
from trackbench.subjects.recording import writer as recording
from trackbench.subjects.recording.focus import Opening, focus_of
from trackbench.subjects.recording.viewer import playable


@pytest.fixture(scope="module")
def folder(run_tiny: Callable[..., Result], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with its recording."""
    result, folder = run_tiny(), tmp_path_factory.mktemp("made") / "run"
    result.save(folder, {"recording.rrd": lambda path: recording.write(result, path)})
    return folder


def test_the_viewer_gets_the_recording_as_it_is_unless_it_is_to_be_centred(folder: Path) -> None:
    for path in (folder, folder / "recording.rrd"):
        with playable(path, Opening(at_s=1.0)) as ready:
            assert ready == (folder / "recording.rrd", 1.0)
    with pytest.raises(InputError, match="goes from"), playable(folder, Opening(at_s=3.0)):
        pass


@pytest.mark.parametrize("head", [None, b"RRF2\x00\x16\x00\x00"], ids=["none", "of another version"])
def test_a_recording_that_cannot_be_opened_is_written_anew(folder: Path, tmp_path: Path, head: bytes | None) -> None:
    copy = tmp_path / "run"
    shutil.copytree(folder, copy)
    content = (copy / "recording.rrd").read_bytes()
    (copy / "recording.rrd").unlink()
    if head is not None:
        (copy / "recording.rrd").write_bytes(head + content[len(head) :])
    with playable(copy, Opening()) as (file, _):
        assert file != copy / "recording.rrd"
        assert ReadRecording(file).entities() == ReadRecording(folder / "recording.rrd").entities()
    assert not file.exists()


def test_a_folder_opens_where_the_error_is(folder: Path) -> None:
    run = recorded_estimates(Result.load(folder))
    # raw filters nothing, so it is not what --worst looks for.
    for number, moment in enumerate(worst(run, ["ekf"], 2), start=1):
        with playable(folder, Opening(worst=number)) as (file, time_s):
            assert time_s == moment.time_s
            assert f"Seen from above, around {moment.object}" in shown_views(file)
            assert ReadRecording(file).entities() == ReadRecording(folder / "recording.rrd").entities()
    (of_ekf,) = worst(run, ["ekf"], 1, "v2")
    with playable(folder, Opening(worst=1, vehicle="v2", tracker="ekf")) as (file, time_s):
        assert time_s == of_ekf.time_s
        assert "Seen from above, around v2" in shown_views(file)
    with playable(folder, Opening(vehicle="v2")) as (file, time_s):
        assert time_s is None
        assert "Seen from above, around v2" in shown_views(file)


def test_a_recording_without_its_folder_opens_at_the_worst_moment(folder: Path, tmp_path: Path) -> None:
    alone = shutil.copy(folder / "recording.rrd", tmp_path / "alone.rrd")
    (moment,) = worst(recorded_estimates(Result.load(folder)), ["ekf"], 1)
    with playable(alone, Opening(worst=1)) as ready:
        assert ready == (alone, moment.time_s)
    with pytest.raises(InputError, match="name the folder of the run"), playable(alone, Opening(1.0, vehicle="v1")):
        pass


def test_a_vehicle_that_is_not_there_yet_is_said(result: Result) -> None:
    with pytest.raises(InputError, match="v4 is not there at 2 s: it is there from 5 s to 20 s"):
        focus_of(result, Opening(at_s=2.0, vehicle="v4"))


def test_an_examination_is_opened_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "examination.json").write_text("{}", encoding="utf-8")
    (tmp_path / "recording.rrd").write_bytes(b"RRF2")
    for path in (tmp_path, tmp_path / "recording.rrd"):
        with playable(path, Opening()) as ready:
            assert ready == (tmp_path / "recording.rrd", None)
    with pytest.raises(InputError, match="no worst moments"), playable(tmp_path, Opening(worst=1)):
        pass
