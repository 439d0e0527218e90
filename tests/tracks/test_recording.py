"""The recording of a run of hidden identities, and what reads it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from tests.support.recordings import ReadRecording
from tests.support.results import with_tables

from trackbench.base.errors import InputError
from trackbench.metrics.function_events import events_of
from trackbench.results import Result
from trackbench.subjects.recording import thinning
from trackbench.subjects.recording.data import read
from trackbench.subjects.recording.focus import Opening, costly_events, focus_of, moment_of, worst_moments
from trackbench.subjects.recording.writer import costs


@pytest.fixture(scope="module")
def recording(traffic_folder: Path) -> ReadRecording:
    return ReadRecording(traffic_folder / "recording.rrd")


def lengths(recording: ReadRecording, entity: str, component: str) -> list[int]:
    """How many there are at each instant."""
    return [len(cell or []) for cell in recording(entity, component).values()]


def test_the_tables_come_back(traffic_folder: Path, traffic_result: Result) -> None:
    tables = read(traffic_folder / "recording.rrd").result.tables
    for name in ("truth", "tracks", "due", "objects"):
        ours, theirs = (source[name].to_pandas() for source in (traffic_result.tables, tables))
        assert len(ours) == len(theirs), name
        for column in ours.select_dtypes("number"):
            np.testing.assert_array_equal(
                np.sort(ours[column].to_numpy(float)),
                np.sort(theirs[column].to_numpy(float)),
                err_msg=f"{name} {column}",
            )
    recorded = read(traffic_folder / "recording.rrd").result
    assert events_of(recorded) == events_of(traffic_result, run=0)


def test_every_track_is_drawn_at_every_instant(recording: ReadRecording, traffic_result: Result) -> None:
    tracks = traffic_result.to_pandas("tracks")
    for tracker in ("gnn", "pmb"):
        drawn = lengths(recording, f"/world/tracks/{tracker}", "Points2D:positions")
        assert len(drawn) == 61
        assert sum(drawn) == (tracks["tracker"] == tracker).sum()
        outlines = lengths(recording, f"/world/covariances/{tracker}", "LineStrips2D:strips")
        assert sum(outlines) == sum(drawn)


def test_a_due_object_without_a_track_is_ringed(recording: ReadRecording, traffic_result: Result) -> None:
    objects = traffic_result.to_pandas("objects")
    own = objects[(objects["tracker"] == "gnn") & objects["state"].isin(["waiting", "lost"])]
    instants = round(float((own["until_s"] - own["time_s"]).sum() / 0.1))
    assert sum(lengths(recording, "/world/misses/gnn", "Ellipses2D:half_sizes")) == instants > 0


def test_events_are_listed_by_cost_and_starts_of_tracks_last(traffic_result: Result) -> None:
    rows = traffic_result.tables.events.to_pylist()
    own = [row for row in rows if (row["tracker"], row["run"]) == ("pmb", 0)]
    for row, kind, cost, time in zip(
        own, ("lost", "false", "confirmed"), (50.0, 80.0, 99.0), (3.0, 2.0, 0.1), strict=False
    ):
        row.update(kind=kind, cost_m2=cost, time_s=time)
    changed = with_tables(traffic_result, events=pa.Table.from_pylist(own[:3]))
    rows = [line.split("|")[1:7] for line in costs(changed, ["pmb"]).splitlines() if "pmb" in line]
    assert [row[5].strip() for row in rows] == ["80.00", "50.00", "99.00"]
    assert moment_of(changed).time_s == 2.0


def test_the_worst_is_the_costliest_event(traffic_result: Result) -> None:
    events = [event for event in events_of(traffic_result, "naive", 0) if event.cost_m2 > 0]
    for number in (1, 2):
        focus = focus_of(traffic_result, Opening(worst=number, tracker="naive"))
        assert (focus.time_s, focus.tracker) == (events[number - 1].time_s, "naive")
        assert focus.vehicle in ("slow", "fast", "leaving", "observer")
    with pytest.raises(InputError, match=f"has {len(events)} such moments"):
        focus_of(traffic_result, Opening(worst=len(events) + 1, tracker="naive"))
    with pytest.raises(InputError, match="did you mean 'naive'"):
        focus_of(traffic_result, Opening(worst=1, tracker="naiv"))


def test_of_a_long_run_the_costliest_events_are_drawn(traffic_result: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(thinning, "MOST", 20)
    drawn = thinning.instants(thinning.thin_tables(traffic_result))
    assert 20 <= len(drawn) < len(thinning.instants(traffic_result.tables))
    costly = [event.time_s for event in costly_events(traffic_result, None, None)[: thinning.WORST]]
    assert costly
    assert {*np.round(costly, 9)} <= {*np.round(drawn, 9)}


def test_inspect_names_the_worst_events(cli: Callable[..., Any], traffic_folder: Path, traffic_result: Result) -> None:
    # The oracle is no competitor.
    expected = [event for event in events_of(traffic_result, run=0) if event.tracker != "oracle"][:2]
    assert worst_moments(traffic_result, Opening(worst=2)) == expected
    done = cli("inspect", traffic_folder, "--worst", "2")
    assert done.status == 0
    assert expected[0].kind in done.out
    assert f"trackbench view {traffic_folder} --worst\n" in done.out


def test_inspect_shows_a_moment(cli: Callable[..., Any], traffic_folder: Path) -> None:
    missed, tracks = cli("inspect", traffic_folder, "--at", "0").out.split("Tracks:")
    states = [line.split() for line in missed.splitlines() if line.startswith("slow")]
    assert {("slow", name, "waiting") for name in ("gnn", "pmb", "naive")} <= {tuple(state) for state in states}
    # The oracle alone confirms at once.
    assert {line.split()[0] for line in tracks.splitlines()[2:] if line.strip()} == {"oracle"}
    later = cli("inspect", traffic_folder, "--at", "5.04").out
    assert "At 5.000 s" in later
    tracks = later.partition("Tracks:")[2]
    assert {line.split()[0] for line in tracks.splitlines()[2:] if line.strip()} == {"gnn", "pmb", "oracle", "naive"}
    done = cli("inspect", traffic_folder, "--at", "99")
    assert (done.status, done.err) == (2, "--at: 99 s is not in the recording, which goes from 0 s to 6 s\n")


def test_a_tracker_that_failed_says_so(cli: Callable[..., Any], failing_folder: Path) -> None:
    for arguments, words in (
        ((), "FAILED failing"), (("--worst", "2"), "failing failed"), (("--at", "1"), "failing failed")
    ):  # fmt: skip
        done = cli("inspect", failing_folder, *arguments)
        assert done.status == 0
        assert f"\n{words}: ValueError: out of order" in done.out
    for command in (("inspect", failing_folder), ("snapshot", failing_folder, "worst.png")):
        done = cli(*command, "--worst", "1", "--tracker", "failing")
        assert (done.status, done.out) == (2, "")
        assert done.err.startswith("--tracker: failing failed, so it has no tracks: ValueError: out of order")


def test_inspect_reads_a_folder_without_a_recording(
    cli: Callable[..., Any], traffic_folder: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(traffic_folder, copy, ignore=shutil.ignore_patterns("*.rrd"))
    done = cli("inspect", copy)
    assert done.status == 0
    assert "GOSPA m" in done.out


@pytest.mark.viewer
@pytest.mark.slow
def test_a_picture_of_the_worst(cli: Callable[..., Any], traffic_folder: Path, tmp_path: Path) -> None:
    done = cli("snapshot", traffic_folder, tmp_path / "worst.png", "--worst")
    assert done.status == 0
    assert (tmp_path / "worst.png").stat().st_size > 20_000


def test_live_is_refused_with_one_message(cli: Callable[..., Any], traffic_text: str, tmp_path: Path) -> None:
    (tmp_path / "three_cars.yaml").write_text(traffic_text, encoding="utf-8")
    done = cli("run", "three_cars.yaml", "--live")
    message = "a run with hidden identities is not shown as it goes; leave --live out and `trackbench view` it"
    assert done.status == 2
    assert done.err.startswith("three_cars.yaml:")
    assert done.err.endswith(f" sensing.identities: {message}\n")
    assert not (tmp_path / "results").exists()
