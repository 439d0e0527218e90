"""Export, a program that knows nothing of the bench, and its tracks back: the same bits, the same scores, paired."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from tests.support.mcap_files import write_tracks
from tests.support.places import DOCS

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.report.sentences import external_tracks
from trackbench.truth.formats.tables import Csv

PAGE = (DOCS / "export.md").read_text(encoding="utf-8")
SCENARIO = re.search(r"```yaml\n(name: two_cars\n.*?)```", PAGE, re.DOTALL)[1]  # type: ignore[index]
PROGRAM = (DOCS / "examples" / "nearest_cars.py").read_text(encoding="utf-8")


def result_of(file: Path, runs: int) -> tb.Result:
    entry = {"use": "tracks", "path": str(file)}
    return tb.run(tb.load(SCENARIO, {"trackers.theirs": entry}, runs=runs))


def written(rows: pd.DataFrame, file: Path) -> Path:
    if file.suffix == ".parquet":
        rows.to_parquet(file)
        return file
    table = file.with_suffix(".csv")
    rows.to_csv(table, index=False)
    if file.suffix == ".mcap":
        pytest.importorskip("mcap", reason="needs trackbench[mcap]")
        write_tracks(Csv().rows(table).ordered(table), file)
    return file


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    """What the program of the page writes of three runs."""
    folder = tmp_path_factory.mktemp("elsewhere")
    tb.export(tb.load(SCENARIO, runs=3), folder / "scans")
    (folder / "program.py").write_text(PROGRAM)
    subprocess.run([sys.executable, "program.py"], cwd=folder, check=True)
    return pd.read_csv(folder / "tracks.csv", dtype={"fingerprint": str})


@pytest.mark.parametrize("ending", ["csv", "parquet", "mcap"])
def test_estimates_that_come_back_score_alike_to_the_last_bit(tmp_path: Path, ending: str) -> None:
    own = tb.run(tb.load(SCENARIO, runs=1))
    rows = own.to_pandas("tracks").drop(columns="tracker")
    rows = rows.assign(scene=0, run=0, fingerprint=own.summary.fingerprints[0])
    both = result_of(written(rows, tmp_path / f"tracks.{ending}"), 1)
    ours, theirs = both["gnn"].metrics, both["theirs"].metrics
    kept = [path for path in ours if path != "step_time" and not path.startswith("association")]
    assert ours["tgospa"].value > 0.1
    assert ours["nees"].value > 0
    assert {path: theirs[path].value for path in kept} == {path: ours[path].value for path in kept}
    assert both["theirs"].paired


def test_the_runs_of_tracks_are_those_of_the_scans(elsewhere: pd.DataFrame, tmp_path: Path) -> None:
    """Tracks of a run held against the truth with other noise are worse than those of its own."""
    whole = result_of(written(elsewhere, tmp_path / "tracks.csv"), 3)
    part = elsewhere[elsewhere["run"] == 0].sample(frac=1, random_state=1)
    alone = result_of(written(part, tmp_path / "one.csv"), 1)
    assert whole.summary.fingerprints[0] == alone.summary.fingerprints[0]
    sums = whole.to_pandas("runs").query("tracker == 'theirs' and run == 0")
    other = alone.to_pandas("runs").query("tracker == 'theirs'")
    assert sums["tgospa_total"].iloc[0] == other["tgospa_total"].iloc[0]


def test_without_fingerprints_they_are_scored_and_not_paired(elsewhere: pd.DataFrame, tmp_path: Path) -> None:
    unsaid = result_of(written(elsewhere.drop(columns="fingerprint"), tmp_path / "unsaid.csv"), 3)
    said = result_of(written(elsewhere, tmp_path / "said.csv"), 3)
    assert unsaid["theirs"].tgospa.value == said["theirs"].tgospa.value
    assert not unsaid["theirs"].paired
    assert not unsaid.differences
    assert said.differences


@pytest.mark.parametrize(
    ("change", "runs", "message"),
    [
        ({"fingerprint": "0123456789abcdef"}, 3, "scene 0, run 0: the tracks have the fingerprint '0123456789abcdef'"),
        ({"run": 0}, 3, "the tracks have the fingerprint|has two rows"),
    ],
)
def test_tracks_of_other_scans_are_refused(
    elsewhere: pd.DataFrame, tmp_path: Path, change: dict[str, object], runs: int, message: str
) -> None:
    with pytest.raises(InputError, match=message) as raised:
        result_of(written(elsewhere.assign(**change), tmp_path / "tracks.csv"), runs)
    assert "\n" not in str(raised.value)


def test_a_run_without_a_track_is_missed_and_named(elsewhere: pd.DataFrame, tmp_path: Path) -> None:
    file = written(elsewhere, tmp_path / "tracks.csv")
    three, four = (result_of(file, runs) for runs in (3, 4))
    assert three["theirs"].filed.silent_runs == 0
    assert (four["theirs"].filed.silent_runs, four["theirs"].filed.outside) == (1, 0)
    (said,) = (text for text in external_tracks(four) if "every object counts as missed" in text)
    assert said.startswith("theirs: 0 of ")
    assert said.endswith(
        "rows outside the time of the truth are left out; there is no track in 1 run, where every object counts as "
        "missed"
    )
    # Three runs of four have what they had.
    share = 0.75 * three["theirs"].matched_share.value
    assert four["theirs"].matched_share.value == pytest.approx(share, rel=0.02)
    assert four["gnn"].gospa.value is not None
