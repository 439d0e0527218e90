"""Faults that people made, each named by the check that looks for it; the sound trackers they are put into by none."""

from __future__ import annotations

import pickle
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from benchmarks.faults.bases.plain_ekf import Tracker as PlainEkf
from benchmarks.faults.corpus import Program, bases, entries, examined, is_right, with_faults
from tests.support.doctor import SITES, Part, looped, program_under_test, tracker_of, under_test

from trackbench.subjects.doctor.checks.drives import drives
from trackbench.subjects.doctor.checks.equations import equations
from trackbench.subjects.doctor.checks.expectation import expectation
from trackbench.subjects.doctor.checks.gain import gain
from trackbench.subjects.doctor.checks.instants import late_measurements, same_instant
from trackbench.subjects.doctor.checks.modes import modes
from trackbench.subjects.doctor.checks.motion import course, no_time
from trackbench.subjects.doctor.checks.outliers import gate, outliers
from trackbench.subjects.doctor.checks.prediction import motion_prediction
from trackbench.subjects.doctor.checks.process_noise import growth_by_noise
from trackbench.subjects.doctor.checks.start import confidence, first_position
from trackbench.subjects.doctor.checks.stated_covariance import stated_covariance
from trackbench.subjects.doctor.checks.validity import repeatability, validity
from trackbench.subjects.doctor.checks.wrapping import wrapping
from trackbench.subjects.doctor.drives import drive_configs
from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.findings import CHECKS, checks_of, faults_of
from trackbench.subjects.doctor.subject import SENSORS
from trackbench.subjects.doctor.traffic_checks.association import (
    allowed_pair,
    missed_among_others,
    nearer_of_two,
    predicted_place,
)
from trackbench.subjects.doctor.traffic_checks.detections import gate_limits
from trackbench.subjects.doctor.traffic_checks.tracks import tracks_at_empty_scans, tracks_of_false_alarms
from trackbench.subjects.doctor.traffic_checks.weights import weights

#: Faults of one object by the check that names them.
FOUND_BY: dict[Part, list[str]] = {
    course: ["seventeen_numbers"],
    confidence: ["first_velocity_variance_per_dt"],
    equations: [
        "covariance_never_stored",
        "variance_in_degrees",
        "noise_of_the_first_entry",
        "white_noise_dt_4",
        "noise_of_another_order",
        "covariance_overwritten_in_its_update",
        "covariances_overwritten_before_use",
        "gain_kept_from_first_update",
        "product_of_entries",
        "predicted_covariance_about_old_mean",
        "update_with_points_before_noise",
        "sign_of_one_derivative_by_the_turn_rate",
        "turn_noise_over_the_interval",
    ],
    expectation: ["range_rate_is_speed", "left_handed_points", "sign_of_the_speed", "arctan_of_the_quotient"],
    first_position: ["start_without_own_velocity"],
    gate: ["gate_of_five_percent"],
    growth_by_noise: ["first_process_noise_kept"],
    modes: [
        "imm_transitions_read_by_columns",
        "imm_mixing_left_out",
        "likelihood_after_the_update",
        "likelihood_of_a_precision",
    ],
    motion_prediction: ["milliseconds_of_milliseconds", "time_never_moves_on", "mean_not_predicted"],
    repeatability: ["noise_drawn_for_none"],
    stated_covariance: ["noise_given_as_covariance"],
    wrapping: ["remainder_of_negative_angles", "azimuths_of_points_averaged", "gated_before_wrapped"],
}
#: Faults of several objects by the check that names them.
SEEN_BY: dict[Any, list[str]] = {
    allowed_pair: ["gated_after_the_assignment"],
    gate_limits: ["distance_against_its_square"],
    missed_among_others: ["filtered_out_and_not_missed"],
    nearer_of_two: ["farthest_detection_assigned"],
    predicted_place: ["matched_before_predicted"],
    tracks_at_empty_scans: ["predicted_after_matching"],
    tracks_of_false_alarms: ["hits_of_every_scan"],
    weights: ["detection_probability_of_clutter"],
}


def pairs(by: dict[Any, list[str]]) -> list[Any]:
    return [pytest.param(check, name, id=f"{check.__name__}-{name}") for check, names in by.items() for name in names]


@pytest.mark.parametrize(("part", "name"), pairs(FOUND_BY))
def test_a_check_names_its_fault_and_nothing_of_the_base(part: Part, name: str) -> None:
    accepted = entries()[name].accept
    assert {finding.fault for finding in part(program_under_test(name)).findings} & set(accepted)
    assert part(program_under_test(entries()[name].base)).findings == []


@pytest.mark.parametrize(("check", "name"), pairs(SEEN_BY))
def test_a_scene_shows_its_fault_and_nothing_of_the_base(check: Any, name: str) -> None:
    found = check(looped(tracker_of(name)), SITES["lidar"]).findings
    assert {finding.fault for finding in found} & set(entries()[name].accept)
    assert check(looped(tracker_of(entries()[name].base)), SITES["lidar"]).findings == []


def test_every_check_of_one_object_has_a_fault_that_it_names() -> None:
    others = {drives.__name__, gain.__name__, outliers.__name__, validity.__name__, "steps"}
    others |= {late_measurements.__name__, no_time.__name__, same_instant.__name__}
    assert {check.name for check in checks_of(CHECKS)} == {part.__name__ for part in FOUND_BY} | others


@pytest.mark.parametrize("name", ["variance_in_degrees", "noise_of_the_first_entry"])
def test_the_gains_of_a_belief_that_is_not_found_imply_the_noise(name: str) -> None:
    tracker = tracker_of(name)

    class Sealed:
        """Keeps its state as bytes."""

        def step(self, state: Any, scan: Any) -> Any:
            after, answer = tracker().step(None if state is None else pickle.loads(state), scan)
            return None if after is None else pickle.dumps(after), answer

    sealed = under_test(Sealed)
    assert equations(sealed).checks == []
    found = {finding.fault for finding in gain(sealed).findings}
    assert found
    assert found <= set(entries()[name].accept)


def test_every_fault_has_a_drive() -> None:
    assert {fault.role.drive for fault in faults_of(CHECKS).values()} <= {*drive_configs(), None}


@pytest.mark.slow
@pytest.mark.parametrize("program", bases(), ids=lambda program: program.name)
def test_a_base_has_no_finding(program: Program) -> None:
    assert is_right(program, examined(program, tracker_of(program.name)))


@pytest.mark.slow
@pytest.mark.parametrize(
    "names",
    [
        ("product_of_entries", "sign_of_the_speed"),
        ("time_never_moves_on", "white_noise_dt_4", "first_velocity_variance_per_dt"),
        ("mixed_mean_in_the_same_loop", "likelihood_after_the_update"),
        ("distance_against_its_square", "ids_given_again"),
    ],
    ids=lambda names: names[0],
)
def test_faults_are_mended_one_after_the_other(
    names: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    left = [entries()[name] for name in names]
    while left:
        program = with_faults(f"{names[0]}_{len(left)}", left)
        program.write(tmp_path)
        sys.modules.pop(program.name, None)
        first, *_ = examined(program, import_module(program.name).Tracker).findings
        named = [fault for fault in left if first.fault in fault.accept]
        assert named, f"{first.fault}, of {[fault.name for fault in left]}: {first.evidence}"
        left.remove(named[0])


def test_a_piece_that_the_base_does_not_have_once_is_refused() -> None:
    fault = entries()["seventeen_numbers"]._replace(replace=[{"old": "no such text", "new": ""}])
    with pytest.raises(ValueError, match=r"seventeen: plain_ekf.py has 0 times: no such text"):
        with_faults("seventeen", [fault])


def test_the_same_seed_gives_the_same_examination() -> None:
    skip = ("long_run", "manoeuvre", "own_model")
    first, second = (Doctor(SENSORS, seed=3, skip=skip).examine("mine", PlainEkf).json() for _ in range(2))
    assert first == second
