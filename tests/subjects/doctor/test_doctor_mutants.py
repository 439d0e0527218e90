"""The trackers that the doctor is measured on, and a filter with several faults that is mended by what it says."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from copy import deepcopy
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.doctor.builtin import ekf_cv, kf_cv, ukf_ctrv
from benchmarks.doctor.faults import CORRECT, MUTANTS, ONE_SENSOR, SUBJECTS, Mutant
from benchmarks.doctor.filterpy_ekf import FilterPyEkf, FilterPyUkf
from benchmarks.doctor.method_faults import SIGMA_POINTS
from benchmarks.doctor.plain_ekf import PlainEkf
from benchmarks.doctor.plain_kf import PlainKf
from benchmarks.doctor.plain_ukf import PlainUkf
from benchmarks.doctor.traffic.subject import looped
from benchmarks.faults.corpus import Fault, Program, base, faults, replaced
from benchmarks.faults.harm import measured

from trackbench.base.types import Array, Scan
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.report import Examination
from trackbench.subjects.doctor.subject import SENSORS
from trackbench.subjects.doctor.traffic import TrafficDoctor
from trackbench.testing import TrackerCheckError, check_tracker, drive
from trackbench.testing.tracker import NOISE
from trackbench.trackers.answers import is_random

SIGMA_POINT_FAULTS = {fault for fault, *_ in SIGMA_POINTS} | {"sigma_points_not_redrawn"}
FAULTS = {
    *(
        "azimuth_not_wrapped",
        "angle_mean_not_circular",
        "exception_raised",
        "arctan_quadrant",
        "jacobian_wrong",
        "doppler_sign",
        "speed_for_range_rate",
    ),
    *("degrees_for_radians", "wrong_dt", "q_too_small", "q_too_large", "r_too_small", "r_too_large"),
    *("overconfident_start", "polar_start", "covariance_asymmetric", "covariance_not_psd", "sensor_bias"),
    *("predicted_covariance_asymmetric", "predicted_covariance_not_psd"),
    *("velocity_unit", *SIGMA_POINT_FAULTS),
    *("axis_swapped", "axis_mirrored", "ego_motion_ignored", "measurement_ignored", "nonfinite", "not_deterministic"),
    *("covariance_not_reduced", "velocity_not_kept", "course_not_wrapped", "second_measurement_dropped"),
    *("gate_never_reopens", "missed_scan_not_predicted", "time_offset", "process_noise_twice", "q_constant_per_step"),
    *("integer_state_matrix", "scale_error", "q_wrong_power_of_dt"),
    *("covariance_constant", "covariance_diagonal", "covariance_order"),
}
#: Not of all trackers that can have it.
SOME_FAULTS = {
    *("update_not_kept", "gate_too_small", "ego_motion_wrong", "predicted_covariance_wrong"),
    *("wrong_covariance_returned", "q_depends_on_state", "covariance_update_wrong"),
}
#: In an update that is written out in plain NumPy.
PLAIN_FAULTS = {"predicted_covariance_asymmetric", "predicted_covariance_not_psd", "exception_raised"}
#: Of a process noise that depends on the time step alone.
POWER_FAULTS = {"q_wrong_power_of_dt"}
MEAN_FAULTS = {"angle_mean_not_circular"}
RADAR_FAULTS = {"azimuth_not_wrapped", "arctan_quadrant", "doppler_sign", "speed_for_range_rate", "jacobian_wrong"}
LIDAR_FIRST = drive(["lidar", "radar"] * 60, [0.05 * i for i in range(120)], missed=[7, 40, 41])
LIDAR_ALONE = drive(["lidar"] * 60, [0.05 * i for i in range(60)])


def behind_the_sensor() -> list[Scan]:
    """A target that falls back behind a moving sensor and crosses the line on which the azimuth jumps; uneven steps,
    some of no time, and two missed measurements, one of them at a time of its own."""
    random = np.random.default_rng(5)
    own, yaw = np.array([5.0, 3.0]), 0.4
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    scans = []
    for number in range(40):
        kind, time = ("radar", "lidar")[number % 2], 0.08 * (number // 3) ** 1.2
        pose = np.array([4.0 + own[0] * time, -3.0 + own[1] * time, yaw])
        position = pose[:2] + turn @ [-16.0 - 10.0 * time, 0.4 - 0.6 * time]
        noise = NOISE[kind]
        measurement = SENSOR_MODELS[kind].measure(np.array([*position, *(own + turn @ [-10.0, -0.6])]), pose, own)
        measurement = measurement + np.sqrt(np.diag(noise)) * random.standard_normal(len(measurement))
        valid = np.array(number not in (20, 21))
        scans.append(Scan(time, kind, kind, np.where(valid, measurement, np.nan), valid, noise, pose, own, time))
    return scans


def elsewhere() -> list[Scan]:
    """The same, and after a gap of 2 s a lidar that measures the target 60 m away from where it was going."""
    scans = behind_the_sensor()
    last = next(scan for scan in reversed(scans) if scan.kind == "lidar" and scan.valid)
    away = last.measurement + np.array([60.0, 20.0])
    return [*scans, *(last._replace(time=last.time + 2.0 + 0.1 * k, measurement=away) for k in range(20))]


def meeting_the_sensor(measurements: int = 2) -> list[Scan]:
    """A target that a lidar sees exactly where a radar stands, which then sees it at the same instant."""
    pose, own = np.zeros(3), np.zeros(2)
    kinds = [*["lidar"] * measurements, "radar"]
    times = [*(0.5 * number for number in range(measurements)), 0.5 * (measurements - 1)]
    return [
        Scan(time, kind, kind, np.zeros(len(NOISE[kind])), np.array(True), NOISE[kind], pose, own, time)
        for kind, time in zip(kinds, times, strict=True)
    ]


def follow(tracker: Any, scans: Sequence[Scan]) -> tuple[Array, Array]:
    """``(scans, 4)`` and ``(scans, 4, 4)``, NaN before the track starts."""
    batched = getattr(tracker, "batched", False)
    state: Any = None
    means, covariances = np.full((len(scans), 4), np.nan), np.full((len(scans), 4, 4), np.nan)
    for number, scan in enumerate(scans):
        if batched:
            scan = scan._replace(measurement=scan.measurement[:, None], valid=np.array([scan.valid]))
        state, answer = tracker.step(state, scan)
        if answer is not None:
            means[number] = np.reshape(answer[0], 4)
            covariances[number] = np.reshape(answer[1], (4, 4))
    return means, covariances


def assert_same(one: Any, other: Any, scans: Sequence[Scan], tolerance: float) -> None:
    for a, b in zip(follow(one, scans), follow(other, scans), strict=True):
        assert np.isfinite(a[2:]).all()
        np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance)


def of(subject: str) -> list[Mutant]:
    return [mutant for mutant in MUTANTS if mutant.subject == subject]


SUBJECT_NAMES = [subject.name for subject in SUBJECTS]


@pytest.mark.slow
def test_every_fault_is_there_in_all_that_can_have_it() -> None:
    assert {mutant.fault for mutant in MUTANTS} == FAULTS | SOME_FAULTS
    assert len({mutant.name for mutant in MUTANTS}) == len(MUTANTS)
    for name in SUBJECT_NAMES:
        missing = FAULTS - {mutant.fault for mutant in of(name)}
        if not name.startswith("plain_"):
            assert missing >= PLAIN_FAULTS
            missing -= PLAIN_FAULTS
        if name not in ("plain_ukf", "filterpy_ukf"):
            assert missing >= MEAN_FAULTS
            missing -= MEAN_FAULTS
        if name.startswith("builtin") or name.endswith("ukf"):
            assert missing >= POWER_FAULTS
            missing -= POWER_FAULTS
        if name.startswith("builtin"):
            missing -= {"process_noise_twice", "integer_state_matrix"}
        # Its mean can be moved by another gain.
        of_points = SIGMA_POINT_FAULTS - {"gain_inconsistent"} if name.startswith("plain_") else SIGMA_POINT_FAULTS
        if name.endswith("_kf"):
            assert missing == {"course_not_wrapped"} | RADAR_FAULTS | of_points
        elif "ekf" in name:
            assert missing == {"course_not_wrapped"} | of_points
        else:
            assert missing == {"jacobian_wrong", *(SIGMA_POINT_FAULTS if name == "builtin_ukf" else ())}
    for mutant in MUTANTS:
        assert (mutant.factor is not None) == mutant.fault.startswith("r_too_")


#: What they know beside the state: an object of FilterPy, a generator of random numbers, an adapted tuning.
IN_THE_INSTANCE = ("FilterPy", "particles", "ensemble", "square-root ensemble", "adaptive")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [name for name in [*CORRECT, *ONE_SENSOR] if "calm" not in name and "lively" not in name]
)
def test_the_correct_keep_the_contract(name: str) -> None:
    make = CORRECT[name] if name in CORRECT else ONE_SENSOR[name][1]
    if not name.startswith(IN_THE_INSTANCE):
        check_tracker(make)
        return
    if is_random(make()):
        # Of the rules those are left out that chance breaks.
        check_tracker(make)
        return
    with pytest.raises(TrackerCheckError) as broken:
        check_tracker(make)
    message = str(broken.value)
    assert "remembers something beside it" in message
    assert message.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize("start", ["first_measurement", "two_measurements"])
def test_the_ekf_agrees(start: str) -> None:
    # With a lidar measurement first, since the built-in start takes the bias of a polar measurement off.
    scans = LIDAR_FIRST if start == "first_measurement" else [*LIDAR_ALONE[:10], *LIDAR_FIRST[10:]]
    assert_same(PlainEkf(start), ekf_cv(start), scans, 1e-9)
    assert_same(FilterPyEkf(start=start), ekf_cv(start), scans, 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("start", ["first_measurement", "two_measurements"])
def test_the_kf_agrees(start: str) -> None:
    assert_same(PlainKf(start), kf_cv(start), LIDAR_ALONE, 1e-9)
    # The plain one converts a radar's measurement to first order.
    plain, built_in = follow(PlainKf(start), LIDAR_FIRST)[0], follow(kf_cv(start), LIDAR_FIRST)[0]
    np.testing.assert_allclose(plain[10:], built_in[10:], atol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("start", ["first_measurement", "two_measurements"])
def test_the_ukf_agrees(start: str) -> None:
    scans = LIDAR_FIRST if start == "first_measurement" else [*LIDAR_ALONE[:10], *LIDAR_FIRST[10:]]
    built_in = follow(ukf_ctrv(start, augmented=False), scans)[0]
    for make in (PlainUkf, FilterPyUkf):
        np.testing.assert_allclose(follow(make(start=start), scans)[0], built_in, rtol=1e-6, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("make", [FilterPyEkf, FilterPyUkf])
def test_a_copy_of_a_filterpy_tracker_goes_on_by_itself(make: Callable[[], Any]) -> None:
    tracker = make()
    follow(tracker, LIDAR_FIRST[:20])
    copy = deepcopy(tracker)
    alone = follow(copy, LIDAR_FIRST[20:])
    np.testing.assert_array_equal(follow(tracker, LIDAR_FIRST[20:])[0], alone[0])


@cache
def _correct(make: Callable[[], Any]) -> tuple[Array, Array]:
    return follow(make(), elsewhere())


def differs(mutant: Mutant) -> bool:
    right = _correct(mutant.correct)
    try:
        wrong = follow(mutant.make(), elsewhere())
    except np.linalg.LinAlgError:
        # With wrong weights the covariance of the innovation can become singular.
        return True
    return any(not np.allclose(a, b, rtol=1e-6, atol=1e-6, equal_nan=True) for a, b in zip(right, wrong, strict=True))


def repeats(mutant: Mutant) -> bool:
    one, two = (follow(mutant.make(), behind_the_sensor())[0] for _ in range(2))
    return np.allclose(one, two, rtol=1e-6, atol=1e-6, equal_nan=True)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", SUBJECT_NAMES)
def test_each_mutant_differs_from_its_correct_tracker(name: str) -> None:
    of_other_scans = ("nonfinite", "not_deterministic", "exception_raised")
    mutants = [mutant for mutant in of(name) if mutant.fault not in of_other_scans]
    assert [mutant.name for mutant in mutants if not differs(mutant)] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", SUBJECT_NAMES)
def test_each_chance_mutant_differs_from_itself(name: str) -> None:
    mutants = [mutant for mutant in of(name) if mutant.fault == "not_deterministic"]
    assert [mutant.name for mutant in mutants if repeats(mutant)] == []


CIRCUMSTANCES: dict[str, Callable[[], list[Scan]]] = {
    "missed_measurement": behind_the_sensor,
    "dt_in_noise": behind_the_sensor,
    "dt_in_start": behind_the_sensor,
    "yaw_rate": behind_the_sensor,
    "speed": behind_the_sensor,
    "range": meeting_the_sensor,
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("mutant", [mutant for mutant in MUTANTS if mutant.fault == "nonfinite"], ids=lambda m: m.name)
def test_each_nonfinite_mutant_is_so_under_its_circumstance(mutant: Mutant) -> None:
    scans = CIRCUMSTANCES[mutant.variant]()
    tracker = mutant.make()
    batched = getattr(tracker, "batched", False)
    # A batched tracker says NaN before its track starts.
    begun = np.flatnonzero(np.isfinite(follow(mutant.correct(), scans)[0]).all(axis=1))[0] if batched else 0
    state: Any = None
    for number, scan in enumerate(scans):
        if batched:
            scan = scan._replace(measurement=scan.measurement[:, None], valid=np.array([scan.valid]))
        state, answer = tracker.step(state, scan)
        if answer is not None and number >= begun and not np.isfinite(np.sum(answer[0]) + np.sum(answer[1])):
            return
    pytest.fail("every answer is finite")


SET = "seen"
#: Error over that of the sound filter, or mean NEES (4 is right), from which on a run shows that something is wrong.
WORSE, OPTIMISTIC = 1.2, 6.0


def with_faults(kind: Fault, entries: Sequence[Fault], name: str) -> Program:
    """The base of a fault with some faults, as a module of its own."""
    joined = kind._replace(name=name, replace=[piece for entry in entries for piece in entry.replace])
    text = base(SET, kind.base)
    return Program(joined, *replaced(text, joined)) if entries else Program(joined, text)


def examined(program: Program) -> Examination:
    tracker = import_module(program.module).Tracker
    if program.identities == "hidden":
        return TrafficDoctor(SENSORS).examine(program.module, looped(tracker))
    return Doctor(SENSORS, 0).examine(program.module, tracker)


@pytest.mark.parametrize(
    "names",
    [
        ("innovation_angle_plain", "process_noise_not_added", "updated_covariance_not_kept", "range_rate_of_the_actor"),
        ("time_never_moves_on", "white_noise_dt_4", "first_velocity_variance_per_dt"),
        ("transition_jacobian_sign", "wrapped_on_one_side"),
        ("mixed_mean_in_the_same_loop", "likelihood_after_the_update"),
        ("transition_matrix_transposed", "bank_with_plain_angles"),
        ("distance_against_its_square", "ids_given_again"),
    ],
    ids=lambda names: names[0],
)
def test_from_the_symptom_to_the_sound_filter(
    names: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    known = {program.entry.name: program.entry for program in faults(SET) if isinstance(program.entry, Fault)}
    left = [known[name] for name in names]
    sound = with_faults(left[0], [], f"sound_{names[0]}")
    program = with_faults(left[0], left, f"faulty_{names[0]}_{len(left)}")
    errors = measured([sound, program], SET)
    # One that does not get to the end has none.
    error, nees = errors.get(program.module, (float("inf"), float("inf")))
    assert error > WORSE * errors[sound.module][0] or nees > OPTIMISTIC
    while left:
        program.write(tmp_path)
        first, *_ = examined(program).findings
        named = [entry for entry in left if first.fault in entry.accept]
        assert named, f"{first.fault}, of {[entry.name for entry in left]}: {first.evidence}"
        left.remove(named[0])
        program = with_faults(named[0], left, f"faulty_{names[0]}_{len(left)}")
        sys.modules.pop(program.module, None)
    program.write(tmp_path)
    assert program.text == sound.text
    assert examined(program).healthy
