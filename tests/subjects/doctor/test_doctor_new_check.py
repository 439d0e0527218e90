"""A check is added by one file."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from benchmarks.doctor.plain_ekf import PlainEkf
from benchmarks.doctor.traffic.sound import SOUND
from click.testing import CliRunner

from trackbench.base.errors import InputError
from trackbench.cli.commands import cli
from trackbench.subjects.doctor import checks, traffic_checks
from trackbench.subjects.doctor.drives import drive_configs
from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.findings import Finding, rank_findings
from trackbench.subjects.doctor.report import examination_document, examination_text
from trackbench.subjects.doctor.subject import SENSORS
from trackbench.subjects.doctor.traffic import TrafficDoctor

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
            "the hand is the wrong one", "At the wrist.", "Turn it round.", Role(rank=1, causes="gain")
        )
    },
)
def handedness(tracker):
    text = "it is right-handed"
    return PartResult().add("hand", False, text, Finding("right_handed", 0.99, text))
"""
SEVERAL = """
from trackbench.subjects.doctor.findings import KnownFault, PartResult, Question, doctor_check
from trackbench.subjects.doctor.traffic import note


@doctor_check(
    Question("hands", "Are they left-handed?"),
    place=5,
    faults={"hands_wrong": KnownFault("the hands are wrong", "At the wrists.", "Turn them round.")},
)
def hands(make, site):
    result = PartResult()
    note(result, "hands", False, "they are right-handed", "hands_wrong")
    return result
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
    assert [one.fault for one in found.findings] == ["right_handed"]
    assert found.json()["findings"][0]["advice"] == "At the wrist. Turn it round."
    assert "1. the hand is the wrong one" in examination_text(found)
    assert "1. the hand is the wrong one" in str(examination_document(found))
    left_out = Doctor(SENSORS, skip=(*DRIVES, "hand")).examine("mine", PlainEkf)
    assert left_out.healthy
    assert next(check.name for check in left_out.checks if check.skipped) == "hand"


@pytest.mark.usefixtures("added")
def test_its_fault_has_consequences() -> None:
    found = rank_findings([Finding("gain_inconsistent", 0.95, ""), Finding("right_handed", 0.99, "")])
    assert [(one.fault, one.consequence_of) for one in found] == [
        ("right_handed", None),
        ("gain_inconsistent", "right_handed"),
    ]


@pytest.mark.usefixtures("added")
def test_a_check_of_several_objects_is_made_and_reported() -> None:
    found = TrafficDoctor({"lidar": SENSORS["lidar"]}).examine("mine", SOUND["nearest global"])
    assert (found.checks[0].name, found.checks[0].question) == ("hands", "Are they left-handed?")
    assert [one.fault for one in found.findings] == ["hands_wrong"]
    assert "1. the hands are wrong" in examination_text(found)


def test_without_the_file_it_is_unknown() -> None:
    with pytest.raises(InputError, match="there is no check 'hand'"):
        Doctor(SENSORS, skip=("hand",))
