"""The recording of a run of hidden identities, and what reads it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackbench.errors import InputError
from trackbench.metrics.track_events import events_of
from trackbench.recording.chunks import read_chunks
from trackbench.recording.focus import Opening, focus_of
from trackbench.recording.reader import read
from trackbench.results import Result


@pytest.fixture(scope="module")
def entities(traffic_folder: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    for chunk in read_chunks(traffic_folder / "recording.rrd"):
        if not chunk.static:
            found.setdefault(chunk.entity, []).append(chunk.rows)
    return found


def test_the_tables_come_back(traffic_folder: Path, traffic_result: Result) -> None:
    tables = read(traffic_folder / "recording.rrd").result.tables
    for name in ("truth", "measurements", "tracks", "taken", "due", "steps", "objects", "association", "existence"):
        ours, theirs = (source[name].to_pandas() for source in (traffic_result.tables, tables))
        assert len(ours) == len(theirs), name
        for column in ours.select_dtypes("number"):
            np.testing.assert_array_equal(
                np.sort(ours[column].to_numpy(float)),
                np.sort(theirs[column].to_numpy(float)),
                err_msg=f"{name} {column}",
            )
    found = read(traffic_folder / "recording.rrd").result
    assert events_of(found) == events_of(traffic_result, run=0)


def test_every_track_is_drawn_at_every_instant(entities: dict[str, list[Any]], traffic_result: Result) -> None:
    tracks = traffic_result.to_pandas("tracks")
    for tracker in ("gnn", "pmb"):
        rows = entities[f"/world/tracks/{tracker}"]
        drawn = [len(cell or []) for chunk in rows for cell in chunk.column("Points2D:positions").to_pylist()]
        assert len(drawn) == 61
        assert sum(drawn) == (tracks["tracker"] == tracker).sum()
        assert sum(
            len(cell or []) for chunk in entities[f"/world/track_covariances/{tracker}"]
            for cell in chunk.column("LineStrips2D:strips").to_pylist()
        ) == sum(drawn)  # fmt: skip


def test_existence_is_opacity(entities: dict[str, list[Any]], traffic_result: Result) -> None:
    tracks = traffic_result.to_pandas("tracks")
    own = tracks[tracks["tracker"] == "pmb"].sort_values("time_s", kind="stable")
    colours = [
        colour
        for chunk in entities["/world/tracks/pmb"]
        for cell in chunk.column("Points2D:colors").to_pylist()
        for colour in cell or []
    ]
    alpha = np.array(colours) & 0xFF
    np.testing.assert_allclose(alpha, 255 * (0.2 + 0.8 * own["existence"].to_numpy()), atol=0.51)
    assert alpha.min() < 250


def test_a_due_object_without_a_track_is_ringed(entities: dict[str, list[Any]], traffic_result: Result) -> None:
    objects = traffic_result.to_pandas("objects")
    own = objects[(objects["tracker"] == "gnn") & objects["state"].isin(["waiting", "lost"])]
    instants = round(float((own["until_s"] - own["time_s"]).sum() / 0.1))
    rings = [
        len(cell or [])
        for chunk in entities["/world/misses/gnn"]
        for cell in chunk.column("Ellipses2D:half_sizes").to_pylist()
    ]
    assert sum(rings) == instants > 0


def test_events_are_a_log(entities: dict[str, list[Any]], traffic_result: Result) -> None:
    for tracker in ("gnn", "naive"):
        events = events_of(traffic_result, tracker, 0)
        texts = [
            cell[0] for chunk in entities[f"/events/{tracker}"] for cell in chunk.column("TextLog:text").to_pylist()
        ]
        assert len(texts) == len(events)
        assert sum(text.startswith(f"{tracker}: born") for text in texts) == sum(
            event.kind == "born" for event in events
        )


def test_a_line_leads_to_each_detection_taken(entities: dict[str, list[Any]], traffic_result: Result) -> None:
    taken = traffic_result.to_pandas("taken")
    lines = [
        len(cell or [])
        for chunk in entities["/world/associations/oracle"]
        for cell in chunk.column("LineStrips2D:strips").to_pylist()
    ]
    assert 0 < sum(lines) <= (taken["tracker"] == "oracle").sum()


def test_the_worst_is_the_costliest_event(traffic_result: Result) -> None:
    events = [event for event in events_of(traffic_result, "naive", 0) if event.cost_m2 > 0]
    for number in (1, 2):
        focus = focus_of([traffic_result], Opening(worst=number, tracker="naive"))
        assert (focus.time_s, focus.tracker) == (events[number - 1].time_s, "naive")
        assert focus.vehicle in ("slow", "fast", "leaving", "observer")
    with pytest.raises(InputError, match=f"only {len(events)} such events"):
        focus_of([traffic_result], Opening(worst=len(events) + 1, tracker="naive"))
    with pytest.raises(InputError, match="did you mean 'naive'"):
        focus_of([traffic_result], Opening(worst=1, tracker="naiv"))


def test_inspect_names_the_worst_events(cli: Callable[..., Any], traffic_folder: Path, traffic_result: Result) -> None:
    done = cli("inspect", traffic_folder, "--worst", "2", "--json")
    assert done.status == 0
    found = json.loads(done.out)["worst"]
    expected = events_of(traffic_result, run=0)[:2]
    assert [(event["tracker"], event["kind"], event["time_s"]) for event in found] == [
        (event.tracker, event.kind, event.time_s) for event in expected
    ]
    printed = cli("inspect", traffic_folder, "--worst", "2").out
    assert expected[0].kind in printed
    assert f"--worst --tracker {expected[0].tracker}" in printed


def test_inspect_shows_a_moment(cli: Callable[..., Any], traffic_folder: Path) -> None:
    moment = json.loads(cli("inspect", traffic_folder, "--at", "0", "--json").out)["at"]
    assert [vehicle["name"] for vehicle in moment["vehicles"]] == ["slow", "fast", "leaving"]
    assert moment["tracks"] == []
    states = moment["vehicles"][0]["states"]
    assert states == dict.fromkeys(("gnn", "pmb", "oracle", "naive"), "waiting")
    later = json.loads(cli("inspect", traffic_folder, "--at", "5.04", "--json").out)["at"]
    assert later["time_s"] == pytest.approx(5.0)
    assert {track["tracker"] for track in later["tracks"]} == {"gnn", "pmb", "oracle", "naive"}
    done = cli("inspect", traffic_folder, "--at", "99")
    assert (done.status, done.err) == (2, "--at: 99 s is not in the recording, which goes from 0 s to 6 s\n")


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
    done = cli("snapshot", traffic_folder, "--worst", tmp_path / "worst.png")
    assert done.status == 0
    assert (tmp_path / "worst.png").stat().st_size > 20_000


@pytest.mark.parametrize("option", [("--live",), ("--serve",), ("--connect", "rerun+http://localhost:9876/proxy")])
def test_live_is_refused_with_one_message(
    cli: Callable[..., Any], traffic_text: str, tmp_path: Path, option: tuple[str, ...]
) -> None:
    (tmp_path / "three_cars.yaml").write_text(traffic_text, encoding="utf-8")
    done = cli("run", "three_cars.yaml", *option)
    message = "a run with hidden identities is not shown as it goes; leave --live out and `trackbench view` it"
    assert done.status == 2
    assert done.err.startswith("three_cars.yaml:")
    assert done.err.endswith(f" sensing.identities: {message}\n")
    assert not (tmp_path / "results").exists()
