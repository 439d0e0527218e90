"""What is shown of how sure a name is, and what is no fault."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from trackbench.subjects.doctor.certainty import Certainty, certainty
from trackbench.subjects.doctor.findings import CheckResult, Finding, PartResult, check_named
from trackbench.subjects.doctor.report import STANDING, Examination, examination_text, examination_verdict

EXACT = Finding("ego_motion_ignored", 0.95, "it moves", sensor="radar")
GAIN = Finding("r_too_small", 0.9, "the gains are large", sensor="radar")
FAR = Finding("too_far_off", 0.85, "far")
MOTION = CheckResult("ego_motion", "Why?", True, "")


def failed(name: str, *faults: str) -> CheckResult:
    return CheckResult(name, "Why?", False, "off", faults=faults)


def caused(finding: Finding, cause: Finding) -> Finding:
    return replace(finding, consequence_of=cause.fault)


@pytest.mark.parametrize(
    ("findings", "checks", "word", "explained", "besides"),
    [
        ([EXACT], [failed("a", EXACT.fault)], "shown", 1, ()),
        ([EXACT, caused(FAR, EXACT)], [failed("a", EXACT.fault), failed("b", FAR.fault)], "shown", 2, ()),
        ([EXACT], [failed("a", EXACT.fault), failed("b")], "likely", 1, ("b",)),
        ([replace(EXACT, confidence=0.89)], [failed("a", EXACT.fault)], "likely", 1, ()),
        ([GAIN], [failed("a", GAIN.fault)], "likely", 1, ()),
        ([GAIN], [failed("a", GAIN.fault), failed("b"), failed("c", FAR.fault)], "unclear", 1, ("b", "c")),
        ([replace(GAIN, confidence=0.79)], [failed("a", GAIN.fault)], "unclear", 1, ()),
        ([FAR], [failed("a", FAR.fault)], "unclear", 1, ()),
        ([], [failed("a")], "unclear", 0, ("a",)),
    ],
)
def test_the_word_follows_from_what_is_explained(
    findings: list[Finding],
    checks: list[CheckResult],
    word: str,
    explained: int,
    besides: tuple[str, ...],
    tmp_path: Path,
) -> None:
    examination = Examination("mine", findings, checks)
    assert certainty(examination) == (word, explained, besides)
    # What is saved has no number, and the same word.
    file = tmp_path / "examination.json"
    file.write_text(json.dumps(examination.json()))
    assert certainty(Examination.load(file)) == certainty(examination)


def test_a_consequence_of_another_root_is_not_explained() -> None:
    other = replace(EXACT, fault="doppler_sign")
    found = Examination("mine", [EXACT, other, caused(FAR, EXACT)], [failed("a", FAR.fault)])
    assert certainty(found, other) == ("unclear", 0, ("a",))


def test_the_words_are_counted() -> None:
    assert str(Certainty("shown", 1, ())) == "shown, explains 1 failed check"
    assert str(Certainty("shown", 3, ())) == "shown, explains all 3 failed checks"
    assert str(Certainty("likely", 5, ("a", "b"))) == "likely, explains 5 of 7 failed checks"
    assert str(Certainty("shown", 0, ())) == "shown"


def test_an_unclear_name_is_no_verdict() -> None:
    said = examination_text(Examination("mine", [GAIN], [failed("a", GAIN.fault), failed("b"), failed("c")]))
    assert said.startswith("mine: something is wrong, and its name is unclear\n")
    assert "besides   not explained by it: b, c" in said


def test_a_failed_check_has_the_faults_of_its_question_and_sensor() -> None:
    lidar = replace(GAIN, fault="r_too_large", sensor="lidar")
    checks = [failed("gain.radar"), failed("gain.lidar"), CheckResult("gain.other", "", True, "")]
    found = check_named("gain").with_faults(checks, [GAIN, lidar, replace(GAIN, fault="jacobian_wrong", sensor=None)])
    assert [check.faults for check in found] == [
        ("r_too_small", "jacobian_wrong"),
        ("r_too_large", "jacobian_wrong"),
        (),
    ]
    growth = [Finding("q_too_small", 0.9, ""), Finding("q_constant_per_step", 0.9, "")]
    found = check_named("growth_by_noise").with_faults([failed("process_noise"), failed("noise_per_step")], growth)
    assert [check.faults for check in found] == [("q_too_small",), ("q_constant_per_step",)]
    wrapped = Finding("azimuth_not_wrapped", 0.9, "", sensor="radar")
    found = check_named("drive_innovations").with_faults(
        [failed("innovations.radar"), failed("innovations.lidar")], [], [GAIN, wrapped]
    )
    assert [check.faults for check in found] == [("azimuth_not_wrapped",), ()]
    (own,) = PartResult().add("a", False, "", GAIN).checks
    assert own.faults == ("r_too_small",)


def test_what_is_fragile_is_no_fault_and_stands_after_the_findings() -> None:
    at_zero = Finding("nonfinite", 0.98, "not finite where the range is 0", shown_by="at_sensor")
    alone = Examination("mine", [], [MOTION], (at_zero,))
    assert alone.healthy
    assert examination_verdict(alone) == "mine: healthy; fragile at range 0"
    assert alone.json()["fragile"][0]["fault"] == "nonfinite"
    assert alone.json()["findings"] == []
    both = examination_text(
        replace(alone, findings=[GAIN], checks=[failed("a", GAIN.fault), replace(MOTION, passed=None)])
    )
    assert both.startswith("mine: 1 fault found; fragile at range 0\n")
    places = [both.index(words) for words in ("r_too_small", "Fragile at:\n  range 0 (nonfinite)", "not made:")]
    assert places == sorted(places)


@pytest.mark.parametrize(("passed", "said"), [(True, True), (None, False)])
def test_where_the_observer_moves_the_fix_says_how_to_state_that_it_stands(passed: bool | None, said: bool) -> None:
    found = Examination("mine", [EXACT, GAIN], [replace(MOTION, passed=passed)])
    ego, other = (finding["advice"] for finding in found.json()["findings"])
    assert (STANDING in ego) == said
    assert STANDING not in other
