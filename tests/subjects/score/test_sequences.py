"""Several sequences in one call of ``trackbench score``: pairs by name, pooled values, and intervals over sequences."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from tests.support.trackeval_scores import RATE, as_kitti, as_motchallenge, by_trackeval, drawn

import trackbench as tb
from trackbench.base.errors import InputError

Pair = tuple[pd.DataFrame, pd.DataFrame]


def drawn_sequences(number: int) -> list[Pair]:
    """Sequences of different lengths and numbers of objects."""
    pairs = []
    for seed in range(number):
        truth, tracks = drawn(seed)
        last, objects = 40 + 8 * seed, 1 + seed % 3
        pairs.append((truth[(truth.frame < last) & (truth.id <= objects)], tracks[tracks.frame < last]))
    return pairs


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning:trackeval")
@pytest.mark.parametrize("number", [2, 6])
def test_pooled_values_are_those_of_trackeval_and_of_all_instants(tmp_path: Path, number: int) -> None:
    """Folders as TrackEval has them for KITTI: labels and, in ``data``, one file of tracks for each sequence."""
    sequences = drawn_sequences(number)
    for folder in ("label_02", "mine/data"):
        (tmp_path / folder).mkdir(parents=True)
    for k, (truth, tracks) in enumerate(sequences):
        as_kitti(truth, tmp_path / "label_02" / f"{k:04d}.txt")
        as_kitti(tracks, tmp_path / "mine" / "data" / f"{k:04d}.txt")
    options = {"format": "kitti", "rate_hz": RATE}
    result = tb.score(tmp_path / "mine", tmp_path / "label_02", **options)
    assert [tracker.name for tracker in result.summary.trackers] == ["mine"]
    theirs = by_trackeval(sequences)
    # MOTA and IDF1 are ratios of sums, as TrackEval combines them. HOTA is the mean of the sequences'.
    theirs["HOTA"] = float(np.mean([by_trackeval([pair])["HOTA"] for pair in sequences]))
    assert {name: result["mine"].metrics[name.lower()].value for name in theirs} == pytest.approx(theirs, abs=1e-9)
    each = [
        tb.score(tmp_path / "mine" / "data" / f"{k:04d}.txt", tmp_path / "label_02" / f"{k:04d}.txt", **options)
        for k in range(number)
    ]
    squares = [own.summary.trackers[0].metrics["gospa"].value ** 2 for own in each]
    instants = [truth.frame.nunique() for truth, _ in sequences]
    pooled = np.sqrt(np.average(squares, weights=instants))
    assert result["mine"].gospa.value == pytest.approx(pooled, rel=1e-12)
    # Six sequences are what is independent; two are not enough, and too short to be cut.
    assert (result["mine"].gospa.ci95 is None) == (number < 5)
    assert len(result.summary.truth.scenes) == number


def test_folders_of_motchallenge_have_the_boxes_of_a_sequence_in_a_folder_of_its_own(tmp_path: Path) -> None:
    for k, (truth, tracks) in enumerate(drawn_sequences(2)):
        (tmp_path / "gt" / f"S{k}" / "gt").mkdir(parents=True)
        (tmp_path / "mine").mkdir(exist_ok=True)
        as_motchallenge(truth, tmp_path / "gt" / f"S{k}" / "gt" / "gt.txt")
        as_motchallenge(tracks, tmp_path / "mine" / f"S{k}.txt")
    result = tb.score(tmp_path / "mine", tmp_path / "gt", format="motchallenge", rate_hz=RATE)
    listed = tb.score(
        [tmp_path / "mine" / f"S{k}.txt" for k in (1, 0)],
        [tmp_path / "gt" / f"S{k}" / "gt" / "gt.txt" for k in (0, 1)],
        format="motchallenge",
        rate_hz=RATE,
    )
    assert [scene.name for scene in result.summary.truth.scenes] == ["S0", "S1"]
    # Files pair by name, in whatever order they are given.
    assert listed["mine"].gospa.value == result["mine"].gospa.value


def with_errors(folder: Path, sigmas: np.ndarray, bias: float, seed: int, seconds: float = 8.0) -> None:
    """Write sequences of three cars, and tracks with an error of its own size in each sequence."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, seconds, 0.1)
    for name in ("gt", "a", "b"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    for k, sigma in enumerate(sigmas):
        rows = pd.DataFrame({"time": np.tile(time, 3), "id": np.repeat(np.arange(3), len(time))})
        rows = rows.assign(x=10.0 * rows.time, y=20.0 * rows.id)
        rows.to_csv(folder / "gt" / f"s{k}.csv", index=False)
        for name, more in (("a", 1.0), ("b", bias)):
            error = rng.normal(0.0, sigma * more, (2, len(rows)))
            rows.assign(x=rows.x + error[0], y=rows.y + error[1]).to_csv(folder / name / f"s{k}.csv", index=False)


@pytest.fixture
def five(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    with_errors(tmp_path, np.full(5, 0.3), 1.5, 0)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_each_tracker_is_a_folder_and_the_scenario_runs_again(five: Path, cli) -> None:
    done = cli("score", "a", "b", "--truth", "gt", "--gate", "gospa:2%", "--no-recording")
    assert done.status == 1
    assert "gt: over 5 sequences a is best: T-GOSPA" in done.out
    assert done.err.splitlines()[-1] == "1 of 1 limit broken: exit status 1 (0: all kept)"
    again = cli("run", "results/gt.yaml", "--no-recording", "--out", "again", "--quiet")
    assert again.status == 0
    same = cli("compare", "results/gt", "again/gt", "--fail-on-regression", "gospa:0", "--quiet")
    assert same.status == 2
    assert cli("compare", "results/gt", "again/gt", "--fail-on-regression", "gospa:0").status == 0


def test_a_sequence_that_changed_is_no_baseline(five: Path, cli) -> None:
    """Not only the recorded scene counts."""
    assert cli("score", "a", "--truth", "gt", "--no-recording", "--out", "one").status == 0
    rows = pd.read_csv(five / "gt" / "s3.csv")
    rows.assign(y=rows.y + 0.1).to_csv(five / "gt" / "s3.csv", index=False)
    assert cli("score", "a", "--truth", "gt", "--no-recording", "--out", "two").status == 0
    done = cli("compare", "one/gt", "two/gt", "--fail-on-regression", "gospa:5")
    assert done.status == 2
    assert "the same scenario moved differently" in done.err


@pytest.mark.parametrize(
    ("tracks", "truth", "message"),
    [
        ([], ["gt/s0.csv", "gt/s0.csv"], "gt/s0.csv: gt/s0.csv is a sequence already"),
        (["a/s0.csv"], ["gt/s0.csv", "gt/s1.csv"], "--truth: 1 file of tracks and 2 of boxes"),
        (["a/s0.csv", "a/s4.csv"], ["gt/s0.csv", "gt/s1.csv"], "a: no tracks of the sequence s1; did you mean 's4'?"),
        (["a", "b/s0.csv"], ["gt"], "a: a folder of tracks is a tracker"),
        (["a", "less"], ["gt"], "less: no tracks of the sequence s0 and 1 more; did you mean 's_0'?"),
        (["more"], ["gt"], "gt: no boxes of the sequence s9; did you mean"),
        (["a"], ["gone"], "gone: there is no such file"),
        (["a"], ["empty"], "empty: a folder that is no bag of ROS 2, and no file in it ends in .bag"),
        (["other"], ["gt"], "other/s3.csv: its format or its columns are not those of other/s0.csv"),
    ],
)
def test_files_without_a_partner_are_named_with_the_nearest(
    five: Path, tracks: list[str], truth: list[str], message: str
) -> None:
    for name in ("less", "more", "other", "empty"):
        (five / name).mkdir()
    for k in range(5):
        text = (five / "a" / f"s{k}.csv").read_text()
        for folder in ("more", "other") if k in (0, 1) else ("more", "other", "less"):
            (five / folder / f"s{k}.csv").write_text(
                text.replace("x,y", "pos_x,y") if (folder, k) == ("other", 3) else text
            )
    (five / "less" / "s_0.csv").write_text(text)
    (five / "more" / "s9.csv").write_text(text)
    with pytest.raises(InputError) as error:
        tb.score(tracks or ["a/s0.csv", "a/s1.csv"], truth)
    assert str(error.value).startswith(message)


def test_a_scenario_has_one_file_of_tracks_for_each_scene(five: Path) -> None:
    text = """
name: listed
truth: {source: recorded-boxes, format: csv, path: [gt/s0.csv, gt/s1.csv]}
sensing: {identities: hidden}
trackers:
  a: {use: tracks, path: [a/s0.csv, a/s1.csv, a/s2.csv]}
"""
    with pytest.raises(InputError, match=r"trackers\.a\.path: 3 files for 2 scenes; name one for each"):
        tb.load(text)
    with pytest.raises(InputError, match=r"gt/s0\.csv is there already"):
        tb.load(text.replace("gt/s1", "gt/s0").replace(", a/s2.csv", ""))
