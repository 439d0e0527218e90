"""The doctor of trackers of several objects: every fault by its name and check, and sound trackers without any."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from benchmarks.faults.bases.gnn import Tracker as NearestGlobal
from click.testing import CliRunner
from tests.support.doctor import SITES, Make, built_in, examine_filters_once, looped, tracker_of

from trackbench.base.errors import InputError
from trackbench.cli.commands import cli
from trackbench.subjects.doctor.subject import SENSORS, find_tracker
from trackbench.subjects.doctor.traffic import TrafficDoctor
from trackbench.subjects.doctor.traffic_checks.association import (
    allowed_pair,
    ended_alone,
    missed_among_others,
    nearer_of_two,
    predicted_place,
)
from trackbench.subjects.templates.plug_in import new
from trackbench.testing.rules import Identities


def first_fault(sensor: str, make: Make) -> str:
    findings = TrafficDoctor({sensor: SENSORS[sensor]}).examine("tracker", make).findings
    return findings[0].fault if findings else ""


@pytest.mark.parametrize("sensor", ["radar", "lidar"])
@pytest.mark.parametrize("method", ["gnn", "pmb"])
def test_a_sound_tracker_has_no_fault(sensor: str, method: str) -> None:
    assert first_fault(sensor, built_in(method)) == ""


@pytest.fixture
def filters_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """All of these have the filter of `NearestGlobal`."""
    examine_filters_once(monkeypatch)


class ByColumn(NearestGlobal):
    """Gives each track the detection in its own column."""

    def assign(self, detections):
        return [(k, k) for k in range(min(len(self.tracks), len(detections)))]


class Silent(NearestGlobal):
    def output(self):
        return None


@pytest.mark.usefixtures("filters_once")
def test_a_column_taken_for_an_object_depends_on_the_order() -> None:
    findings = TrafficDoctor({"lidar": SENSORS["lidar"]}).examine("tracker", looped(ByColumn)).findings
    assert findings[0].fault == "order_dependent"
    assert {finding.consequence_of for finding in findings[1:]} <= {"order_dependent"}


def test_a_tracker_without_a_track_is_said_to_have_none() -> None:
    finding, *_ = TrafficDoctor(SENSORS).examine("tracker", looped(Silent)).findings
    assert (finding.fault, finding.evidence) == ("confirms_too_late", "The object has no track in 3 s.")


@pytest.mark.usefixtures("filters_once")
def test_a_sensor_that_the_tracker_does_not_read_is_left_out() -> None:
    class LidarAlone(NearestGlobal):
        def step(self, state, scan):
            return super().step(state, scan) if scan.kind == "lidar" else (None, None)

    found = TrafficDoctor(SENSORS).examine("tracker", looped(LidarAlone))
    assert found.findings == []
    assert [check.name for check in found.checks if check.passed is None] == ["confirmation.radar", "same_instant"]


@pytest.mark.usefixtures("filters_once")
def test_a_fault_of_one_sensor_names_it() -> None:
    class RadarAnywhere(NearestGlobal):
        def assign(self, detections):
            self.gates[3] = 1e4
            return super().assign(detections)

    found = TrafficDoctor(SENSORS).examine("tracker", looped(RadarAnywhere))
    assert (found.findings[0].fault, found.findings[0].sensor) == ("gate_too_large", "radar")


def test_a_tracker_of_a_scenario_and_a_class_are_examined(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    new("multi-tracker", "nearest_of_several", tmp_path)
    slow = "from nearest_of_several import NearestOfSeveral\n\n\nclass Slow(NearestOfSeveral):\n"
    (tmp_path / "mine.py").write_text(f"{slow}    def __init__(self):\n        super().__init__(confirm=(40, 45))\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    for arguments, fault in (
        (["traffic/dense_highway#naive"], "order_dependent"),
        (["mine:Slow", "--identities", "hidden", "--in-process"], "confirms_too_late"),
        (["mine:Slow", "--identities", "hidden"], "confirms_too_late"),
    ):
        done = CliRunner().invoke(cli, ["doctor", *arguments, "--json", "--out", str(tmp_path / "out")])
        assert done.exit_code == 1, done.output
        assert json.loads(done.stdout)["findings"][0]["fault"] == fault
    assert (tmp_path / "out" / "report.html").exists()


@pytest.mark.parametrize("more", [[], ["--in-process"]])
def test_a_tracker_of_the_other_kind_is_known_as_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, more: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    runner = CliRunner()
    for kind, name in (("multi-tracker", "several_cars"), ("tracker", "one_car")):
        assert runner.invoke(cli, ["new", kind, name]).exit_code == 0
    done = runner.invoke(cli, ["doctor", "several_cars:SeveralCars", *more])
    assert str(done.exception) == "--identities: several_cars:SeveralCars follows several objects: choose hidden"
    assert isinstance(done.exception, InputError)
    done = runner.invoke(cli, ["doctor", "one_car:OneCar", "--identities", "hidden", *more])
    assert str(done.exception) == "--identities: one_car:OneCar follows one object: choose known"
    assert isinstance(done.exception, InputError)


@pytest.mark.parametrize(
    ("target", "identities", "own"),
    [("highway#ekf_cv", "hidden", "known"), ("traffic/dense_highway#naive", "known", "hidden")],
)
def test_a_scenario_says_which_identities_its_trackers_have(target: str, identities: Identities, own: str) -> None:
    with pytest.raises(InputError, match=f"the scenario's identities are {own}: leave --identities out"):
        find_tracker(target, {}, identities=identities)


def test_the_oracle_is_not_examined() -> None:
    with pytest.raises(InputError, match="told the true origins"):
        find_tracker("traffic/dense_highway#oracle", {})


CHECKS = (nearer_of_two, predicted_place, allowed_pair, missed_among_others, ended_alone)


@pytest.mark.parametrize("make", [built_in("jpda"), built_in("pmb"), looped(tracker_of("sort_like"))])
def test_sound_trackers_pass(make: Make) -> None:
    results = [check(make, SITES["lidar"]) for check in CHECKS]
    assert [(check.name, check.passed) for result in results for check in result.checks if not check.passed] == []


def test_a_tracker_without_a_track_is_asked_nothing() -> None:
    assert [check(looped(Silent), SITES["lidar"]).checks for check in CHECKS] == [[]] * len(CHECKS)
