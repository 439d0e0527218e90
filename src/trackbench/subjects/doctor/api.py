"""Examining a tracker from Python."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from trackbench import results
from trackbench.base.errors import InputError, TrackbenchError
from trackbench.base.notebook_classes import reference_to
from trackbench.base.types import Progress, no_progress
from trackbench.driving.faults import TrackFault
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.driving.process import TrackerProcess
from trackbench.driving.program import host_command
from trackbench.results import EXAMINATION
from trackbench.scenario import Scenario
from trackbench.subjects.doctor.assumptions import require_known_checks
from trackbench.subjects.doctor.checks.steps import CannotRun
from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.report import Examination, examination_verdict
from trackbench.subjects.doctor.session import TrackerSession
from trackbench.subjects.doctor.subject import lives_elsewhere, subject, subject_in
from trackbench.subjects.doctor.traffic import MultiObjectSession, TrafficDoctor
from trackbench.testing.drives import drive, hidden_drive
from trackbench.testing.rules import Identities, gives_reports


def other_kind(target: str, options: Mapping[str, Any], isolation: Isolation, *, hidden: bool) -> str:
    """What to say of a class that failed, if it bears scans of the other kind; else nothing.

    Args:
        target: ``module:Class`` or a published name.
        options: its arguments.
        isolation: whether it gets a process of its own.
        hidden: whether it was examined as a tracker of several objects.
    """

    def of_one() -> Iterator[bool]:
        session = TrackerSession(subject(target, options, None, isolation).make)
        scans = drive(["lidar", "radar"] * 10, [0.05 * number for number in range(20)])
        return (session.step(scan) is not None for scan in scans)

    def of_several() -> Iterator[bool]:
        session = MultiObjectSession(subject(target, options, None, isolation, "hidden").make)
        return (len(session.step(scan).ids) > 0 for scan in hidden_drive())

    if hidden:
        return f"{target} follows one object: choose known" if gives_reports(of_one) else ""
    return f"{target} follows several objects: choose hidden" if gives_reports(of_several) else ""


def _examined_there(
    tracker: str, request: Mapping[str, Any], isolation: Isolation, progress: Progress
) -> Examination | None:
    """Examine a tracker within the process that it gets; None where it gets none, or where that process ends.

    A tracker whose process ends is then examined from here, which finds the step at which it ends.

    Raises:
        TrackbenchError: it cannot be examined.
    """
    if not lives_elsewhere(tracker, isolation):
        return None
    process = None
    try:
        process = TrackerProcess(isolation, *host_command(tracker))
        answer = process.work(f"{__name__}:examined_here", {"tracker": tracker, **request}, progress)
    except TrackFault:
        return None
    finally:
        if process is not None:
            process.close()
    if isinstance(answer, TrackbenchError):
        raise answer
    return answer if isinstance(answer, Examination) else None


def examined_here(tracker: str, progress: Progress, **request: Any) -> Examination | TrackbenchError:
    """Examine a tracker in this process; return the error of one that cannot be examined.

    Args:
        tracker: ``module:Class`` or a published name.
        progress: as of :func:`doctor`.
        request: further arguments of :func:`doctor`.
    """
    try:
        return doctor(tracker, in_process=True, progress=progress, **request)
    except TrackbenchError as error:
        return error


@contextmanager
def _set_aside() -> Iterator[None]:
    """What the tracker prints goes to stderr, and its warnings are dropped: the checks look for the same faults."""
    with redirect_stdout(sys.stderr), warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)
        yield


def doctor(
    tracker: str | Callable[..., Any],
    *,
    options: Mapping[str, Any] | None = None,
    scenario: Path | str | None = None,
    identities: Identities | None = None,
    static_sensors: bool = False,
    no_misses: bool = False,
    skip: Sequence[str] = (),
    in_process: bool = False,
    tracker_timeout: float = ISOLATED.timeout,
    tracker_memory: float | None = None,
    out: Path | str | None = None,
    progress: Progress = no_progress,
) -> Examination:
    """Find the faults of a tracker, with evidence.

    Args:
        tracker: ``SCENARIO#NAME``, ``module:Class``, a published name, or the class itself.
        options: arguments of the class; not with ``SCENARIO#NAME``.
        scenario: the file whose sensors and observer are used, instead of those of the tracker's own scenario, or else
            of a radar and a lidar that stand still and move.
        identities: ``hidden`` of a class that follows several objects.
        static_sensors: whether no sensor moves: nothing is tried with moving ones.
        no_misses: whether every scan has a detection: no others are given.
        skip: checks that are left out, by name or by name and sensor: ``gain``, ``gain.radar``.
        in_process: whether a tracker that is not built in gets no process of its own: for a debugger.
        tracker_timeout: longest time that one may take to answer a scan, s.
        tracker_memory: most memory that one may take, GB; a quarter of the machine's or container's unless given.
        out: the folder of the findings, the report and the replay; nothing is written unless given.
        progress: called with the number of steps done and of all, about, of the examination and then of its evidence.

    Raises:
        InputError: there is no such scenario, tracker, module or check, or it does not take the options.
        CannotRun: the tracker cannot process one scan of any sensor, or gives no estimate at any.
        TrackFault: the tracker's process ended before anything could be asked.
        TrackbenchError: the folder cannot be written.
    """
    if not isinstance(tracker, str):
        tracker = reference_to(tracker)
    values, isolation = dict(options or {}), Isolation(in_process, tracker_timeout, tracker_memory)
    request = {
        "options": values,
        "scenario": None if scenario is None else str(scenario),
        "identities": identities,
        "static_sensors": static_sensors,
        "no_misses": no_misses,
        "skip": list(skip),
    }
    if out is not None:
        results.require_replaceable(Path(out), EXAMINATION)
        results.require_writable(Path(out).parent)
    if (there := _examined_there(tracker, request, isolation, progress)) is not None:
        if out is not None:
            there.save(out)
        return there
    with _set_aside():
        try:
            examined = subject(tracker, values, None if scenario is None else Path(scenario), isolation, identities)
        except TrackFault as fault:
            raise InputError(f"{tracker!r} does not start: {fault}") from fault
        if not examined.multi_object:
            require_known_checks(skip, examined.sensors)
        elif no_misses or skip:
            key = "no_misses" if no_misses else "skip"
            raise InputError("only for a tracker of one object; this one follows several", key=key)
        try:
            if examined.multi_object:
                examination = TrafficDoctor(examined.sensors).examine(examined.name, examined.make, progress)
            else:
                ready = Doctor(
                    examined.sensors,
                    observer=examined.observer,
                    static_sensors=static_sensors,
                    no_misses=no_misses,
                    skip=skip,
                )
                examination = ready.examine(examined.name, examined.make, progress)
                evidence = ready.evidence(examination, examined.make, progress)
                examination = replace(examination, evidence=tuple(evidence))
        except (CannotRun, TrackFault) as error:
            hint = "" if "#" in tracker else other_kind(tracker, values, isolation, hidden=examined.multi_object)
            if hint:
                raise InputError(hint, key="identities") from error
            raise
    examination = replace(examination, notes=examined.notes)
    if out is not None:
        examination.save(out)
    return examination


def remark(loaded: Scenario, tracker: str) -> str | None:
    """The verdict on a tracker with the evidence of its first cause; None where it is healthy or cannot be examined.

    Args:
        loaded: the scenario, whose sensors and observer are used.
        tracker: its name.
    """
    with _set_aside():
        try:
            of = subject_in(loaded, tracker)
            own = TrafficDoctor(of.sensors) if of.multi_object else Doctor(of.sensors, observer=of.observer)
            examination = own.examine(of.name, of.make)
        except (InputError, CannotRun, TrackFault):
            return None
    if examination.healthy:
        return None
    causes = examination.causes
    if not causes:
        return examination_verdict(examination)
    return f"{examination_verdict(examination)}: {causes[0].fault}, {causes[0].evidence.partition(';')[0]}"
