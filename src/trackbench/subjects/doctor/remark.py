"""What an examination says of a tracker of a scenario, in a sentence."""

from __future__ import annotations

import sys
import warnings
from contextlib import redirect_stdout

import numpy as np

from trackbench.base.errors import InputError
from trackbench.driving.faults import TrackFault
from trackbench.scenario import Scenario
from trackbench.subjects.doctor.checks.steps import CannotRun
from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.report import Examination, examination_verdict
from trackbench.subjects.doctor.subject import subject_in
from trackbench.subjects.doctor.traffic import TrafficDoctor


def remark(loaded: Scenario, tracker: str) -> str | None:
    """The verdict on a tracker with the evidence of its first cause; None where it is healthy or cannot be examined.

    Args:
        loaded: the scenario, whose sensors and observer are used.
        tracker: its name.
    """
    with redirect_stdout(sys.stderr), warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)
        try:
            examination = _examined(loaded, tracker)
        except (InputError, CannotRun, TrackFault):
            return None
    if examination.healthy:
        return None
    causes = examination.causes
    if not causes:
        return examination_verdict(examination)
    return f"{examination_verdict(examination)}: {causes[0].fault}, {causes[0].evidence.partition(';')[0]}"


def _examined(loaded: Scenario, tracker: str) -> Examination:
    examined = subject_in(loaded, tracker)
    if examined.multi_object:
        return TrafficDoctor(examined.sensors).examine(examined.name, examined.make)
    return Doctor(examined.sensors, observer=examined.observer).examine(examined.name, examined.make)
