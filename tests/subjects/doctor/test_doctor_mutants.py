"""The trackers that the doctor is measured on, and a filter with several faults that is mended by what it says."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import pytest
from benchmarks.doctor.faults import MUTANTS, Mutant
from benchmarks.doctor.traffic.subject import looped
from benchmarks.faults.corpus import Fault, Program, base, faults, replaced
from benchmarks.faults.harm import measured

from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.report import Examination
from trackbench.subjects.doctor.subject import SENSORS
from trackbench.subjects.doctor.traffic import TrafficDoctor


def of(subject: str) -> list[Mutant]:
    return [mutant for mutant in MUTANTS if mutant.subject == subject]


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
