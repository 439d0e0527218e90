"""How often the doctor of trackers of several objects is right, as a section of the page."""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.subjects.doctor.subject import SENSORS
from trackbench.subjects.doctor.traffic import TrafficDoctor

from .faults import FAULTY
from .held_out import HELD_OUT
from .sound import SOUND_SUBJECTS
from .subject import TrafficSubject

TITLE = "## Trackers of several objects"
#: The doctor was made with the first ones; the others were kept aside.
MADE_WITH = [*SOUND_SUBJECTS, *FAULTY]
SUBJECTS = [*MADE_WITH, *HELD_OUT]


class TrafficSeen(NamedTuple):
    """The outcome of an examination."""

    number: int
    """Of the subject."""
    found: tuple[str, ...]
    """Names of the faults, the first one first."""
    seconds: float
    """CPU time."""
    words: str

    @property
    def subject(self) -> TrafficSubject:
        return SUBJECTS[self.number]

    @property
    def held_out(self) -> bool:
        return self.number >= len(MADE_WITH)

    @property
    def right(self) -> bool:
        return self.found[:1] == (self.subject.fault,) if self.subject.fault else not self.found


def examine(number: int) -> TrafficSeen:
    """One examination."""
    subject = SUBJECTS[number]
    warnings.simplefilter("ignore")
    begin = time.process_time()
    found = TrafficDoctor({kind: SENSORS[kind] for kind in subject.sensors}).examine(subject.name, subject.make)
    seconds = time.process_time() - begin
    failed = [f"{check.name}: {check.result}" for check in found.checks if check.passed is False]
    return TrafficSeen(number, tuple(finding.fault for finding in found.findings), seconds, "; ".join(failed))


def table(seen: Sequence[TrafficSeen]) -> list[str]:
    """Return a row for each fault: of the trackers that the doctor was made with, and of those held out."""
    faulty = [one for one in seen if one.subject.fault]
    lines = ["| injected fault | named first | held out |", "| --- | ---: | ---: |"]
    for fault in [*sorted({one.subject.fault for one in faulty}), "all"]:
        cells = []
        for held_out in (False, True):
            right = [one.right for one in faulty if one.held_out == held_out and fault in (one.subject.fault, "all")]
            cells.append(f"{sum(right)}/{len(right)}" if right else "")
        lines.append(f"| {f'`{fault}`' if fault != 'all' else 'all'} | " + " | ".join(cells) + " |")
    return lines


def section(seen: Sequence[TrafficSeen]) -> list[str]:
    """The lines of the section."""
    seconds = [one.seconds for one in seen]
    lines = [
        TITLE,
        "",
        "The faults are in built-in trackers and in plain NumPy ones, each with a lidar and a radar. Held out are",
        "those that were not tried before the checks were finished. When first tried, 48 of 50 of their faults (96",
        "%) had the right name first, and nothing was found in 15 of 16 sound ones. The three others changed the",
        "check of the gate, so the counts below are no test of that check any more.",
        "",
        *table(seen),
    ]
    for held_out, words in ((False, "that the checks were made with"), (True, "held out")):
        own = [one for one in seen if one.held_out == held_out]
        faulty = [one for one in own if one.subject.fault]
        sound = [one for one in own if not one.subject.fault]
        hits, silent = sum(one.right for one in faulty), sum(one.right for one in sound)
        lines += [
            "",
            f"Of the trackers {words}, {hits} of {len(faulty)} injected faults ({hits / len(faulty):.1%}) have the "
            f"right name first. In {silent} of {len(sound)} examinations of sound ones nothing was found.",
        ]
    lines += [
        "",
        f"An examination takes {np.median(seconds):.1f} s of CPU time in the median, at most {max(seconds):.0f} s.",
    ]
    missed = [one for one in seen if not one.right]
    if missed:
        lines += ["", "Not named first:", ""]
        lines += [
            f"- {one.subject.name}{' (held out)' if one.held_out else ''}: {', '.join(one.found) or 'nothing'}"
            for one in missed
        ]
    return lines
