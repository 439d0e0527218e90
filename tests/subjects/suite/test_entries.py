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
from trackbench.scenario.truth import truths_of
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
    assert cli("suite", "verify", entry).out.endswith(": verified, but no run was made again\n")


@pytest.mark.parametrize(
    "name",
    ["entry.json", *(f"{DRAWN}/{name}" for name in ("result.json", "report.md", "runs.parquet", "estimates.parquet"))],
)
def test_one_altered_digit_fails(name: str, entry: Path, cli: Cli) -> None:
    content = bytearray((entry / name).read_bytes())
    place = next(at for at in range(len(content) // 2, len(content)) if chr(content[at]) in "0123456789")
    content[place] = ord("0") + (content[place] + 1 - ord("0")) % 10
    (entry / name).write_bytes(bytes(content))
    done = cli("suite", "verify", entry, "--quiet")
    assert (done.status, f"failed    files     {name}: " in done.out) == (1, True), done.out


@pytest.mark.parametrize(
    "key",
    [
        "trackers.0.metrics.position_rmse.value",
        "score.margin.position_m",
        "truth.duration_s",
        "sensors.roof_lidar.rate_hz",
    ],
)
def test_a_forged_value_is_named(key: str, entry: Path, cli: Cli) -> None:
    file = entry / DRAWN / "result.json"
    result = values = json.loads(file.read_text(encoding="utf-8"))
    *path, last = key.split(".")
    for name in path:
        values = values[int(name) if name == "0" else name]
    values[last] *= 0.999
    file.write_text(json.dumps(result), encoding="utf-8")
    sealed(entry)
    done = cli("suite", "verify", entry, "--quiet")
    assert (done.status, f"{DRAWN}/result.json: {key}: " in done.out) == (1, True), done.out


def test_of_many_problems_a_few_are_printed(entry: Path, cli: Cli) -> None:
    rewritten(entry, lambda rows: rows.assign(px_m=rows.px_m + 0.1))
    problems = [line for line in cli("suite", "verify", entry, "--quiet").out.splitlines() if " scores " in line]
    assert (len(problems), problems[-1].split()[2]) == (6, "and")


def test_better_estimates_than_the_tracker_gives_do_not_come_again(entry: Path, cli: Cli) -> None:
    rewritten(entry, lambda rows: rows.assign(px_m=rows.px_m + 1e-3))
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
        return rows[["run"]].drop_duplicates().merge(rows[rows.run == 0].drop(columns="run"), how="cross")

    rewritten(entry, copied)
    done = cli("suite", "verify", entry, "--quiet")
    assert done.status == 1
    assert "estimates.parquet: scene 0, runs 0 and 1: the same estimates, though their noise differs" in done.out


def test_a_beaten_bound_is_found_in_tracks_of_a_closed_tracker(entry: Path, cli: Cli) -> None:
    loaded = find_suite(SUITE).scenarios[DRAWN].plain
    truth, own_runs = truths_of(loaded)[0].truth, tb.run(loaded).summary.fingerprints
    rows, random = pq.read_table(entry / DRAWN / "estimates.parquet").to_pandas(), np.random.default_rng(1)
    rows["fingerprint"] = [own_runs[run] for run in rows.run]
    for run, own in rows.groupby("run"):
        step, item = np.searchsorted(truth.time, own.time_s - 1e-6), [truth.ids.index(name) for name in own.object]
        states = truth.state_of_run(run)[:, step, item].T + random.normal(0, 0.01, (len(own), 4))
        rows.loc[own.index, ["px_m", "py_m", "vx_mps", "vy_mps"]] = states
    Path("tracks").mkdir()
    pq.write_table(pa.Table.from_pandas(rows, preserve_index=False), Path("tracks") / f"{DRAWN}.parquet")
    Path("theirs.yaml").write_text("name: theirs\ntracks: tracks\n", encoding="utf-8")
    assert cli("suite", "run", SUITE, "theirs.yaml", "--no-recording").status == 1
    done = cli("suite", "verify", "entries/theirs")
    assert done.status == 1
    assert f"failed    bound     {DRAWN}: its position RMSE beats the Cramér-Rao bound" in done.out
    assert "on trust  rerun     the tracks were made by a program that is not here" in done.out


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
    again = "has the same name 'mine'; rename one of them"
    assert again in cli("suite", "merge", entry, entry).err
    for name in ("ekf_cv", "kf_cv"):
        shutil.move(elsewhere / name, entry.parent)
    assert cli("suite", "page", entry.parent).status == 0
    page = (entry.parent / "index.md").read_text(encoding="utf-8")
    assert f"| {DRAWN} | ekf_cv | 0." in page
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
        ({"LidarKalman": "LidarKalmann"}, "mine.yaml: single.use: "),
        ({"roof_lidar": "roof_lider"}, "mine.yaml: single.sensors.0: the scenario has no sensor 'roof_lider'"),
        ({"single": "traffic"}, "mine.yaml: has no key single, and the chosen scenarios are of that kind"),
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
    names, digests = (DRAWN, "motorway-recorded"), []
    for place, where in {"here": (), "there": ("--cluster", "local:2")}.items():
        only = ("--only", ",".join(names), "--no-recording", "--quiet")
        assert cli("suite", "run", SUITE, "mine.yaml", *only, "--out", place, *where).status == 0
        digests.append([sha256(Path(place) / "mine" / name / "estimates.parquet") for name in names])
    assert digests[0] == digests[1]
