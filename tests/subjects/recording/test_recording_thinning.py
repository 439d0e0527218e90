"""The recording of a long run leaves out instants, but no end, no peak and no worst moment, and says so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.compute as pc
import pytest
from tests.support.recordings import ReadRecording

from trackbench.results import Result
from trackbench.results.columns import split
from trackbench.subjects.recording import thinning
from trackbench.subjects.recording import writer as recording
from trackbench.subjects.recording.data import read as read_run
from trackbench.subjects.recording.focus import Opening, moment_of, worst_moments

MOST, WORST = 40, 3


@pytest.fixture
def thin(result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The recording of the run of 401 instants, as if that were long."""
    monkeypatch.setattr(thinning, "MOST", MOST)
    monkeypatch.setattr(thinning, "WORST", WORST)
    recording.write(result, tmp_path / "thinned.rrd")
    return tmp_path / "thinned.rrd"


def test_ends_the_moment_worth_seeing_and_the_worst_moments_are_kept(thin: Path, result: Result) -> None:
    kept, every = (thinning.instants(run.tables) for run in (read_run(thin).result, result))
    moment = moment_of(result).time_s
    assert moment is not None
    around = every[np.abs(every - moment) <= thinning.AROUND_S]
    assert {every[0], every[-1], *around} <= {*kept}
    assert MOST <= len(kept) <= MOST + len(around) + WORST * (len([*result]) + len(result.summary.truth.objects))
    assert set(ReadRecording(thin)("/world/tracks/ekf_cv", "Points2D:positions")) == {*np.round(kept, 9)}
    for opening in (Opening(worst=WORST, tracker="ukf_ctrv"), Opening(worst=WORST, vehicle="v3")):
        assert worst_moments(read_run(thin).result, opening) == worst_moments(result, opening)


def test_each_instant_has_the_latest_scan_of_every_sensor(thin: Path, result: Result) -> None:
    kept = thinning.instants(read_run(thin).result.tables)
    detected = result.tables.measurements.filter(pc.equal(result.tables.measurements["valid"], True))
    for (sensor,), rows in split(detected, "sensor").items():
        scans = np.unique(rows["time_s"])
        latest = [scans[scans <= time + 1e-9].max(initial=scans[0]) for time in kept]
        drawn = ReadRecording(thin)(f"/world/measurements/{sensor}", "Points2D:positions")
        assert {*np.round(latest, 9)} == {*drawn}


def test_a_line_keeps_its_ends_its_peaks_and_its_gaps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(thinning, "MOST", MOST)
    values = np.random.default_rng(5).normal(size=1003)
    values[500:502] = np.nan
    values[[17, 1002]] = 9.0, -9.0
    places = thinning.extremes(values)
    assert {0, 17, 500, 1002} <= {*places}
    assert len(places) <= MOST + 3
    for stretch in np.split(np.arange(1003), range(51, 1003, 51)):
        own = values[places[np.isin(places, stretch)]]
        assert (np.nanmin(own), np.nanmax(own)) == (np.nanmin(values[stretch]), np.nanmax(values[stretch]))
    assert len(thinning.extremes(values[:MOST])) == MOST


def test_the_file_says_what_is_left_out(thin: Path, read: ReadRecording) -> None:
    (text,) = ReadRecording(thin)("/about", "TextDocument:text")[None]
    assert "Of 401 instants " in text
    assert "The folder of the run has every instant." in text
    assert "instants" not in read("/about", "TextDocument:text")[None][0]
