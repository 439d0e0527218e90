"""An entry is made, checked and merged; whatever is altered in it is found, with its place."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from tests.subjects.suite.conftest import MINE, SUITE

import trackbench as tb
from trackbench.results.folder import sha256
from trackbench.subjects.suite.entry import digests_in, entry_digest
from trackbench.subjects.suite.suite import FOLDER, find_suite

Cli = Callable[..., Any]
DRAWN = "drawn-ideal"


def sealed(folder: Path, **changes: Any) -> None:
    """Give an entry the digests of its files, as a forger would."""
    values = json.loads((folder / "entry.json").read_text(encoding="utf-8"))
    values |= {**changes, "files": digests_in(folder)}
    (folder / "entry.json").write_text(json.dumps({**values, "sha256": entry_digest(values)}), encoding="utf-8")


def rewritten(folder: Path, change: Callable[[Any], Any]) -> None:
    """Change the estimates of the drawn scenario, and seal the entry."""
    file = folder / DRAWN / "estimates.parquet"
    pq.write_table(pa.Table.from_pandas(change(pq.read_table(file).to_pandas()), preserve_index=False), file)
    sealed(folder)


def test_an_outsiders_entry_is_verified(entry: Path, cli: Cli) -> None:
    done = cli("suite", "verify", entry)
    assert done.status == 0, done.out
    assert "mine in trackbench-road-1: verified" in done.out
    words = [line.split()[:2] for line in done.out.splitlines()[:-1]]
    assert [what for outcome, what in words if outcome == "checked"] == [
        "files", "suite", "truth", "scans", "scores", "bound", "noise", "code", "rerun",
    ]  # fmt: skip
    stated = json.loads((entry / "entry.json").read_text(encoding="utf-8"))
    assert stated["tracker"]["licence"] == "MIT"
    assert stated["tracker"]["code"]["single"] == sha256(entry.parents[1] / "lidar_kalman.py")
    assert stated["command"] == f"trackbench suite run {SUITE} mine.yaml --only {DRAWN}"


def test_it_is_taken_on_trust_where_the_tracker_is_not(entry: Path, cli: Cli) -> None:
    (entry.parents[1] / "lidar_kalman.py").unlink()
    done = cli("suite", "verify", entry, "--json")
    checks = {check["what"]: check["outcome"] for check in json.loads(done.out)["checks"]}
    assert (done.status, checks["scores"], checks["rerun"]) == (0, "checked", "on trust")


@pytest.mark.parametrize("name", ["entry.json", "drawn-ideal/result.json", "drawn-ideal/report.md"])
def test_one_altered_digit_fails(name: str, entry: Path, cli: Cli) -> None:
    text = (entry / name).read_text(encoding="utf-8")
    place = next(at for at in range(len(text) // 2, len(text)) if text[at].isdigit())
    other = text[:place] + str((int(text[place]) + 1) % 10) + text[place + 1 :]
    (entry / name).write_text(other, encoding="utf-8")
    done = cli("suite", "verify", entry, "--quiet")
    assert done.status == 1
    assert f"failed    files     {name}: " in done.out


@pytest.mark.parametrize("name", ["estimates", "runs", "truth"])
def test_one_altered_byte_of_a_table_fails(name: str, entry: Path, cli: Cli) -> None:
    file = entry / DRAWN / f"{name}.parquet"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(bytes(content))
    done = cli("suite", "verify", entry, "--quiet")
    assert (done.status, f"{DRAWN}/{name}.parquet: " in done.out) == (1, True)


def test_a_forged_score_is_named(entry: Path, cli: Cli) -> None:
    file = entry / DRAWN / "result.json"
    result = json.loads(file.read_text(encoding="utf-8"))
    result["trackers"][0]["metrics"]["position_rmse"]["value"] *= 0.999
    file.write_text(json.dumps(result), encoding="utf-8")
    sealed(entry)
    done = cli("suite", "verify", entry, "--quiet")
    assert done.status == 1
    assert f"{DRAWN}/result.json: trackers.0.metrics.position_rmse.value: " in done.out


def test_better_estimates_than_the_tracker_gives_do_not_come_again(entry: Path, cli: Cli) -> None:
    """Scores are made again of forged estimates; the tenth that is run again shows them."""
    rewritten(entry, lambda rows: rows.assign(px_m=rows.px_m + 1e-6))
    done = cli("suite", "verify", entry, "--quiet")
    assert done.status == 1
    assert f"failed    rerun     {DRAWN}/estimates.parquet: scene 0: row 0, px_m: " in done.out


def test_a_changed_tracker_is_named(entry: Path, cli: Cli) -> None:
    file = entry.parents[1] / "lidar_kalman.py"
    file.write_text(file.read_text(encoding="utf-8").replace("+ 9 * G", "+ 8 * G"), encoding="utf-8")
    done = cli("suite", "verify", entry, "--quiet")
    assert (done.status, "entry.json: tracker.code.single: " in done.out) == (1, True)


def test_another_version_of_the_suite_is_named(entry: Path, cli: Cli) -> None:
    text = (FOLDER / f"{SUITE}.yaml").read_text(encoding="utf-8")
    Path("other.yaml").write_text(text.replace("version: 1", "version: 2"), encoding="utf-8")
    done = cli("suite", "verify", entry, "--suite", "other.yaml", "--quiet")
    assert done.status == 1
    assert "entry.json: suite.version: 1 in the entry, 2 here" in done.out
    values = json.loads((entry / "entry.json").read_text(encoding="utf-8"))
    sealed(entry, suite={**values["suite"], "id": "trackbench-rood-1"})
    assert "did you mean 'trackbench-road-1'?" in cli("suite", "verify", entry).out


def test_estimates_that_vary_with_nothing_are_found(entry: Path, cli: Cli) -> None:
    def copied(rows: Any) -> Any:
        states = [name for name in rows if name[:2] in ("px", "py", "vx", "vy", "p_")]
        first = rows[rows.run == 0].set_index(["time_s", "object"])[states]
        kept = rows.set_index(["time_s", "object"])
        kept.update(first)
        kept = kept.reset_index()
        return kept[kept.set_index(["time_s", "object"]).index.isin(first.index)]

    rewritten(entry, copied)
    done = cli("suite", "verify", entry, "--quiet")
    assert done.status == 1
    assert "estimates.parquet: scene 0, runs 0 and 1: the same estimates, though their noise differs" in done.out


def of_truth(suite: Any, sigma: float) -> Any:
    """Estimates that a tracker could only have of the truth, with errors of its own."""
    loaded = suite.scenarios[DRAWN].plain
    made = tb.run(loaded)
    from trackbench.scenario.truth import truths_of

    truth, random = truths_of(loaded)[0].truth, np.random.default_rng(1)
    parts = []
    for run, fingerprint in enumerate(made.summary.fingerprints):
        for number, name in enumerate(truth.ids):
            state = truth.state_of_run(run)[:, :, number]
            noisy = state + random.normal(0, sigma, state.shape)
            columns = dict(zip(("px_m", "py_m", "vx_mps", "vy_mps"), noisy, strict=True))
            columns |= {f"p_{a}{b}": sigma**2 * float(a == b) for a in range(4) for b in range(a, 4)}
            keys = {"scene": 0, "run": run, "fingerprint": fingerprint, "time_s": truth.time, "object": name}
            parts.append(
                pa.table({key: np.broadcast_to(value, len(truth.time)) for key, value in (keys | columns).items()})
            )
    return pa.concat_tables(parts)


def test_a_beaten_bound_is_found_in_tracks_of_a_closed_tracker(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "tracks").mkdir()
    pq.write_table(of_truth(find_suite(SUITE), 0.01), tmp_path / "tracks" / f"{DRAWN}.parquet")
    (tmp_path / "theirs.yaml").write_text("name: theirs\ntracks: tracks\n", encoding="utf-8")
    done = cli("suite", "run", SUITE, "theirs.yaml", "--no-recording")
    assert done.status == 1
    assert "beats the Cramér-Rao bound" in done.out
    done = cli("suite", "verify", "entries/theirs")
    assert done.status == 1
    assert f"failed    bound     {DRAWN}: its position RMSE beats the Cramér-Rao bound" in done.out
    assert "on trust  rerun     a program that is not here made the tracks" in done.out


def test_entries_of_several_machines_merge_paired(entry: Path, cli: Cli) -> None:
    elsewhere = entry.parents[1] / "elsewhere"
    only = ("--only", DRAWN, "--no-recording", "--quiet")
    assert cli("suite", "run", SUITE, "ekf_cv", "gnn", *only, "--out", elsewhere).status == 2
    assert cli("suite", "run", SUITE, "ekf_cv", "kf_cv", *only, "--out", elsewhere).status == 0
    done = cli("suite", "merge", entry, elsewhere / "ekf_cv", "--out", "both.json")
    assert done.status == 0, done.err
    (difference,) = json.loads(Path("both.json").read_text(encoding="utf-8"))["differences"]
    assert difference["paired_runs"] == 60
    assert {difference["verdict"]} <= {"better", "worse"}
    again = "has the same name 'mine'; name one otherwise"
    assert again in cli("suite", "merge", entry, entry).err
    for name in ("ekf_cv", "kf_cv"):
        shutil.move(elsewhere / name, entry.parent)
    assert cli("suite", "page", entry.parent).status == 0
    page = (entry.parent / "index.md").read_text(encoding="utf-8")
    assert "| a | **[ekf_cv](ekf_cv/entry.json)** | [0." in page
    assert "](ekf_cv/drawn-ideal/report.html)" in page
    assert f"trackbench suite run {SUITE} mine.yaml --only {DRAWN}" in page
    assert "<html" in (entry.parent / "index.html").read_text(encoding="utf-8")
    cited = yaml.safe_load((entry.parent / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["title"].startswith(SUITE)
    assert (entry.parent / "suite.bib").read_text(encoding="utf-8").startswith(f"@misc{{{SUITE},")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"licence": "license"}, "mine.yaml:3: license: unknown key; did you mean 'licence'?"),
        ({"LidarKalman": "LidarKalmann"}, "mine.yaml: use: "),
        ({"roof_lidar": "roof_lider"}, "mine.yaml: sensors.0: the scenario has no sensor 'roof_lider'"),
        ({"single": "traffic"}, "mine.yaml: mine has traffic, and the chosen scenarios are of single"),
        ({"name: mine": "name: my.own"}, "mine.yaml:1: name: "),
    ],
)
def test_a_mistake_in_the_file_is_one_message(changes: dict[str, str], message: str, entry: Path, cli: Cli) -> None:
    text = MINE
    for word, other in changes.items():
        text = text.replace(word, other)
    Path("mine.yaml").write_text(text, encoding="utf-8")
    done = cli("suite", "run", SUITE, "mine.yaml", "--only", DRAWN, "--out", "new")
    assert (done.status, message in done.err, done.err.count("\n")) == (2, True, 1), done.err
    assert not [*Path("new").iterdir()] if Path("new").exists() else True


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("run", "trackbench-rood-1", "ekf_cv"), "did you mean 'trackbench-road-1'?"),
        (("run", SUITE, "ekf_vc"), "TRACKER: there is no tracker 'ekf_vc'; did you mean 'ekf_cv'?"),
        (("run", SUITE, "ekf_cv", "--only", "drawn"), "--only: no scenario 'drawn'"),
        (("run", SUITE, "absent.yaml"), "absent.yaml: there is no such file"),
        (("verify", "entries/mime"), "did you mean 'entries/mine'?"),
        (("verify", "mine.yaml"), "mine.yaml: this is a file; name the folder of an entry"),
        (("merge", "entries/mine"), "nothing to compare: no scenario is in two entries"),
        (("page", "entries/mine"), "name the folder that holds it"),
    ],
)
def test_a_mistake_on_the_command_line_is_one_message(
    arguments: tuple[str, ...], message: str, entry: Path, cli: Cli
) -> None:
    done = cli("suite", *arguments)
    assert (done.status, message in done.err, done.err.count("\n")) == (2, True, 1), done.err


def test_a_tracker_that_fails_leaves_nothing(entry: Path, cli: Cli) -> None:
    code = "class Failing:\n    def step(self, state, scan):\n        raise RuntimeError('no more')\n"
    Path("failing.py").write_text(code, encoding="utf-8")
    done = cli("suite", "run", SUITE, "failing:Failing", "--only", DRAWN, "--out", "new")
    assert (done.status, [*Path("new").iterdir()]) == (3, [])
    assert "failing could not go on in drawn-ideal: RuntimeError: no more" in done.err


@pytest.mark.slow
def test_it_is_the_same_on_a_cluster(entry: Path, cli: Cli) -> None:
    pytest.importorskip("distributed", reason="needs trackbench[cluster]")
    only = ("--only", f"{DRAWN},motorway-recorded", "--no-recording", "--quiet")
    for place, where in {"here": (), "there": ("--cluster", "local:2")}.items():
        assert cli("suite", "run", SUITE, "mine.yaml", *only, "--out", place, *where).status == 0
    for name in (DRAWN, "motorway-recorded"):
        here, there = (sha256(Path(place) / "mine" / name / "estimates.parquet") for place in ("here", "there"))
        assert here == there
