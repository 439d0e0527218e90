"""Sound trackers, in the shapes that people write, are accused of nothing."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest
from tests.support.sound import SOUND

from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.subject import SENSORS

#: Trackers that keep their belief at the last update, or before it, and predict on demand: the fast ones of them.
ON_DEMAND = ("last_update", "pure_belief", "lazy_by_one")


@pytest.fixture(scope="module")
def doctor() -> Doctor:
    return Doctor(SENSORS, seed=0)


def accusations(doctor: Doctor, name: str) -> list[str]:
    """Return the findings and failed checks of a sound tracker."""
    module, cls = SOUND[name].split(":")
    with np.errstate(all="ignore"):
        examination = doctor.examine(name, getattr(import_module(module), cls))
    findings = [f"{finding.fault}: {finding.evidence}" for finding in examination.findings]
    return findings + [check.name for check in examination.checks if check.passed is False]


@pytest.mark.parametrize("name", ON_DEMAND)
def test_a_belief_at_an_earlier_time_is_no_fault(doctor: Doctor, name: str) -> None:
    assert accusations(doctor, name) == []


@pytest.mark.parametrize("name", [name for name in SOUND if name not in ON_DEMAND])
def test_a_sound_tracker_is_accused_of_nothing(doctor: Doctor, name: str) -> None:
    assert accusations(doctor, name) == []
