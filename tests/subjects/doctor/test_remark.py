"""What an examination says of a tracker, in a sentence, for other subjects."""

from __future__ import annotations

import pytest

import trackbench as tb
from trackbench.base.subjects import offered, resolve
from trackbench.subjects.doctor.remark import remark


def test_the_doctor_is_offered_to_other_subjects() -> None:
    assert resolve(dict(offered("examiners"))["doctor"]) is remark


@pytest.mark.slow
def test_nothing_is_said_of_a_healthy_tracker() -> None:
    assert remark(tb.load("highway"), "ekf_cv") is None


@pytest.mark.slow
def test_a_process_noise_that_is_far_too_small_is_named_with_its_evidence() -> None:
    said = remark(tb.load("highway", {"trackers.ekf_cv.acceleration_sigma_mps2": 0.01}), "ekf_cv")
    assert said is not None
    assert said.startswith("ekf_cv: ")
    assert "q_too_small" in said


def test_nothing_is_said_of_what_cannot_be_examined() -> None:
    loaded = tb.load("highway", {"trackers.ekf_cv.smoother": "rts"})
    assert remark(loaded, "ekf_cv") is None
