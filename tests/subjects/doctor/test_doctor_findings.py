"""How sure a name is, what is no fault, and how a check is added by one file."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from benchmarks.faults.bases.plain_ekf import Tracker as PlainEkf
from click.testing import CliRunner
from tests.support.doctor import looped, tracker_of

from trackbench.cli.commands import cli
from trackbench.subjects.doctor import checks, traffic_checks
from trackbench.subjects.doctor.drives import drive_configs
from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.findings import CheckResult, Finding
from trackbench.subjects.doctor.report import (
    Examination,
    examination_document,
    examination_text,
)
from trackbench.subjects.doctor.subject import SENSORS
from trackbench.subjects.doctor.traffic import TrafficDoctor

EXACT = Finding("ego_motion_wrong", 0.95, "it moves", sensor="radar")
GAIN = Finding("r_too_small", 0.9, "the gains are large", sensor="radar")
FAR = Finding("too_far_off", 0.85, "far")


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
) -> None:
    examination = Examination("mine", findings, checks)
    assert examination.certainty() == (word, explained, besides)


def test_a_consequence_of_another_root_is_not_explained() -> None:
    other = replace(EXACT, fault="doppler_sign")
    found = Examination("mine", [EXACT, other, caused(FAR, EXACT)], [failed("a", FAR.fault)])
    assert found.certainty(other) == ("unclear", 0, ("a",))


#: They take long, and are not needed here.
DRIVES = tuple(drive_configs())
#: A check of trackers of one object, and one of several.
ONE = """
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check


@doctor_check(
    Question("hand", "Is it left-handed?"),
    place=5,
    faults={
        "right_handed": KnownFault(
            "the hand is the wrong one", "At the wrist.", "Turn it round.", Role(rank=1)
        )
    },
)
def handedness(tracker):
    text = "it is right-handed"
    return PartResult().add("hand", False, text, Finding("right_handed", 0.99, text))
"""
SEVERAL = """
from trackbench.subjects.doctor.findings import KnownFault, PartResult, Question, doctor_check


@doctor_check(
    Question("hands", "Are they left-handed?"),
    place=5,
    faults={"hands_wrong": KnownFault("the hands are wrong", "At the wrists.", "Turn them round.")},
)
def hands(make, site):
    return PartResult().note("hands", False, "they are right-handed", "hands_wrong")
"""


@pytest.fixture
def added(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    modules = []
    for package, source in ((checks, ONE), (traffic_checks, SEVERAL)):
        folder = tmp_path / package.__name__
        folder.mkdir()
        (folder / "added.py").write_text(source, encoding="utf-8")
        monkeypatch.setattr(package, "__path__", [*package.__path__, str(folder)])
        modules.append(f"{package.__name__}.added")
    yield
    for module in modules:
        sys.modules.pop(module, None)


@pytest.mark.usefixtures("added")
def test_a_check_is_listed_made_reported_and_skipped() -> None:
    listed = CliRunner().invoke(cli, ["list", "checks"])
    assert "Is it left-handed?" in listed.output
    found = Doctor(SENSORS, skip=DRIVES).examine("mine", PlainEkf)
    assert (found.checks[0].name, found.checks[0].passed) == ("hand", False)
    assert [finding.fault for finding in found.findings] == ["right_handed"]
    assert found.json()["findings"][0]["advice"] == "At the wrist. Turn it round."
    assert "1. the hand is the wrong one" in examination_text(found)
    assert "1. the hand is the wrong one" in str(examination_document(found))
    left_out = Doctor(SENSORS, skip=(*DRIVES, "hand")).examine("mine", PlainEkf)
    assert left_out.healthy
    assert next(check.name for check in left_out.checks if check.skipped) == "hand"


@pytest.mark.usefixtures("added")
def test_a_check_of_several_objects_is_made_and_reported() -> None:
    found = TrafficDoctor({"lidar": SENSORS["lidar"]}).examine("mine", looped(tracker_of("gnn")))
    assert (found.checks[0].name, found.checks[0].question) == ("hands", "Are they left-handed?")
    # The filter of its tracks is examined as a tracker of one object.
    assert [finding.fault for finding in found.findings] == ["right_handed", "hands_wrong"]
    assert found.findings[1].consequence_of == "right_handed"
