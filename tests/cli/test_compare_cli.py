"""``trackbench compare`` and JUnit files, as their user meets them."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
import xmlschema
from tests.support.places import DATA

from trackbench.compare.comparison import GateOutcome
from trackbench.report.junit import Case, Suite, to_xml
from trackbench.results import Result

Cli = Callable[..., Any]

SCHEMA = xmlschema.XMLSchema(DATA / "junit.xsd")
WORSE = "trackers.ekf.acceleration_sigma_mps2=30"


@pytest.fixture(scope="session")
def saved(run_tiny: Callable[..., Result], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folders base and new, each with two scenarios; the EKF of new/tiny is worse."""
    folder = tmp_path_factory.mktemp("saved")
    for version, overrides in (("base", []), ("new", [WORSE])):
        run_tiny("monte_carlo.runs=12", *overrides).save(folder / version / "tiny")
        run_tiny("monte_carlo.runs=12", "name=other").save(folder / version / "other")
    return folder


@pytest.fixture
def two(saved: Path, tiny: Path) -> Path:
    """The folder with the runs base/tiny and new/tiny, of which the second has a worse EKF."""
    for version in ("base", "new"):
        shutil.copytree(saved / version / "tiny", tiny.parent / version / "tiny")
    return tiny.parent


def cases(file: Path) -> dict[str, str]:
    """The test cases of a JUnit file by name, each with the element in it or "passed"; checked against the schema."""
    SCHEMA.validate(file)
    root = ET.parse(file).getroot()
    for suite in root:
        found = [case[0].tag if len(case) else "passed" for case in suite.iter("testcase")]
        counts = {"tests": len(found), "failures": found.count("failure"), "errors": found.count("error")}
        assert {key: int(suite.attrib[key]) for key in counts} == counts
    return {
        f"{suite.attrib['name']}: {case.attrib['name']}": case[0].tag if len(case) else "passed"
        for suite in root
        for case in suite.iter("testcase")
    }


def test_two_runs_in_a_terminal(cli: Cli, two: Path) -> None:
    done = cli("compare", "base/tiny", "new/tiny/result.json")
    assert (done.status, done.err) == (0, "")
    lines = done.out.splitlines()
    assert max(map(len, lines)) <= 80
    assert "\x1b" not in done.out
    assert "(paired: the fingerprints of all measurements are equal)" in " ".join(done.out.split())
    rows = {line.split()[0]: line for line in lines if line.split()[1:3] == ["B", "A"]}
    assert " worse " in rows["ekf"]
    assert " same " in rows["raw"]
    assert "0 in every run" in rows["raw"]


def test_one_run_in_a_terminal(cli: Cli, two: Path) -> None:
    done = cli("compare", "base/tiny", "--metric", "position_rmse", "--metric", "rmse.px")
    assert done.status == 0
    assert [line.split()[:2] for line in done.out.splitlines() if "  worse  " in line] == [
        ["raw", "ekf"],
        ["raw", "ekf"],
    ]
    assert "By position RMSE: ekf has the smallest, " in done.out


def test_a_regression_fails_the_build(cli: Cli, two: Path) -> None:
    limits = ("--fail-on-regression", "position_rmse:5", "--junit", "junit.xml")
    done = cli("compare", "base/tiny", "new/tiny", *limits)
    assert done.status == 1
    assert "FAILED: ekf B, position_rmse: +" in done.out
    assert "1 of 2 limits broken" in done.out
    assert cases(two / "junit.xml") == {
        "new/tiny against base/tiny: ekf position_rmse not worse by more than 5 %": "failure",
        "new/tiny against base/tiny: raw position_rmse not worse by more than 5 %": "passed",
    }
    done = cli("compare", "base/tiny", "base/tiny", *limits, "--fail-on-regression", "velocity_rmse:0")
    assert done.status == 0
    assert set(cases(two / "junit.xml").values()) == {"passed"}
    assert len(cases(two / "junit.xml")) == 4


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["base/tiny", "gone"], "gone: there is no such folder"),
        (["tiny.yaml"], "tiny.yaml: not the folder of a run, nor its result.json"),
        (["empty"], "empty: no result.json in this folder: it is not the folder of a run"),
        (["base/tiny", "--trackers", "ekv"], "--trackers: no tracker 'ekv' in these results; did you mean 'ekf'?"),
        (
            ["base/tiny", "--baseline", "ekv"],
            "--baseline: no tracker 'ekv' among the compared ones; did you mean 'ekf'",
        ),
        (["base/tiny", "new/tiny", "--baseline", "ekf"], "--baseline: of several results the first is the baseline"),
        (["base/tiny", "tiny.yaml", "empty", "new/tiny"], "leave out what is no result: tiny.yaml, empty\n"),
        (["base/tiny", "--metric", "position"], "--metric: 'position' has no values by run to compare; did you mean"),
        (["base/tiny", "--metric", "step_time"], "--metric: 'step_time' has no values by run to compare; "),
        (["base/tiny", "--trackers", "ekf"], "base/tiny: nothing to compare: only one tracker"),
        (["base/tiny", "--fail-on-regression", "position_rmse:5"], "--fail-on-regression: needs two results"),
        (["base/tiny", "new/tiny", "--junit", "x.xml"], "--junit: lists the limits of --fail-on-regression"),
        (
            ["base/tiny", "new/tiny", "--fail-on-regression", "nees.mean:5"],
            "--fail-on-regression: nees.mean has no better",
        ),
        (["base/tiny", "new/tiny", "--fail-on-regression", "x:5"], "--fail-on-regression: 'x' has no values by run"),
        (["base/tiny", "--out", "folder.md"], "--out: folder.md is a folder; name a file"),
        (
            ["base/tiny", "--out", "x.docx"],
            "--out: x.docx ends in none of .md, .html, .txt, .tex",
        ),
        (["base/tiny", "--out", "tiny.yaml/x.md"], "--out: cannot write to tiny.yaml: it is a file, not a folder"),
    ],
)
def test_bad_input_is_one_line(cli: Cli, two: Path, arguments: list[str], message: str) -> None:
    for folder in ("empty", "folder.md"):
        (two / folder).mkdir()
    done = cli("compare", *arguments)
    assert (done.status, done.out) == (2, "")
    assert done.err.startswith(message)
    assert done.err.count("\n") == 1
    assert not (two / "x.xml").exists()


def test_a_comparison_that_was_kept_is_shown_again(cli: Cli, two: Path) -> None:
    first = cli("compare", "base/tiny", "new/tiny", "--out", "kept.json")
    assert cli("report", "kept.json").out == first.out
    assert cli("report", "kept.json", "--format", "html", "--out", "again.html").status == 0
    assert "<h1>Comparison: tiny</h1>" in (two / "again.html").read_text(encoding="utf-8")


def test_expectations_and_failed_trackers_of_several_scenarios(cli: Cli, tiny: Path) -> None:
    text = tiny.read_text(encoding="utf-8")
    expect = (
        "expect: [{tracker: ekf, metric: position_rmse, below: 1}, {tracker: ekf, metric: nees.mean, below: 0.1}]\n"
    )
    tiny.write_text(text + expect, encoding="utf-8")
    code = "class T:\n    def step(self, state, scan):\n        raise ValueError('<lost> \\x00\\x1b[1m & gone')\n"
    (tiny.parent / "breaks.py").write_text(code, encoding="utf-8")
    broken = text.replace("name: tiny", "name: broken").replace("  raw: {use: raw}", "  mine: {use: 'breaks:T'}")
    tiny.with_name("broken.yaml").write_text(broken, encoding="utf-8")
    done = cli("run", ".", "--no-recording", "--junit", "deep/junit.xml")
    assert done.status == 3
    assert cases(tiny.parent / "deep" / "junit.xml") == {
        "broken: mine runs to the end": "error",
        "broken: ekf runs to the end": "passed",
        "tiny: raw runs to the end": "passed",
        "tiny: ekf runs to the end": "passed",
        "tiny: ekf position_rmse below 1": "passed",
        "tiny: ekf nees.mean below 0.1": "failure",
    }
    message = ET.parse(tiny.parent / "deep" / "junit.xml").findall(".//error")[0].attrib["message"]
    assert "<lost> " in message
    assert " & gone" in message
    assert [path.name for path in (tiny.parent / "deep").iterdir()] == ["junit.xml"]


def test_a_junit_file_that_cannot_be_written_stops_before_anything_runs(cli: Cli, tiny: Path) -> None:
    (tiny.parent / "taken").mkdir()
    for path, message in (
        ("taken", "--junit: taken is a folder"),
        ("tiny.yaml/x", "--junit: cannot write to tiny.yaml: it is a file, not a folder"),
    ):
        done = cli("run", tiny, "--no-recording", "--junit", path)
        assert (done.status, done.out) == (2, "")
        assert done.err.startswith(message)
    assert not (tiny.parent / "results" / "tiny").exists()


def test_every_outcome_is_valid_junit(tmp_path: Path) -> None:
    outcomes: tuple[GateOutcome, ...] = ("failed", "error", "undecided")
    cases = [Case("a", "g"), *(Case(o, "g", o, "why \x07 \ud800 <&>\n\"'") for o in outcomes)]
    for suites in ([], [Suite("one", [])], [Suite("one", cases), Suite("two", cases)]):
        file = tmp_path / "junit.xml"
        file.write_text(to_xml(suites), encoding="utf-8")
        SCHEMA.validate(file)
    assert [element.tag for element in ET.parse(file).findall(".//testcase/*")] == ["failure", "error", "skipped"] * 2
