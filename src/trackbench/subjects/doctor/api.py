"""The function ``trackbench.doctor``, which examines a tracker from Python."""

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
from trackbench.subjects.doctor.subject import find_tracker, find_tracker_in, gets_own_process
from trackbench.subjects.doctor.traffic import MultiObjectSession, TrafficDoctor
from trackbench.testing.drives import drive, hidden_drive
from trackbench.testing.rules import Identities, gives_reports


def hint_at_identities(target: str, options: Mapping[str, Any], isolation: Isolation, *, hidden: bool) -> str:
    """Return a hint to set ``identities`` to ``known`` or ``hidden``, if the class works only so; else an empty text.

    Args:
        target: ``module:Class`` or a published name.
        options: arguments of the class.
        isolation: whether the class gets a process of its own.
        hidden: whether the class was examined as a tracker of several objects.
    """

    def answers_of_one_object() -> Iterator[bool]:
        session = TrackerSession(find_tracker(target, options, None, isolation).make)
        scans = drive(["lidar", "radar"] * 10, [0.05 * number for number in range(20)])
        return (session.step(scan) is not None for scan in scans)

    def answers_of_several_objects() -> Iterator[bool]:
        session = MultiObjectSession(find_tracker(target, options, None, isolation, "hidden").make)
        return (len(session.step(scan).ids) > 0 for scan in hidden_drive())

    if hidden:
        return f"{target} follows one object: choose known" if gives_reports(answers_of_one_object) else ""
    return f"{target} follows several objects: choose hidden" if gives_reports(answers_of_several_objects) else ""


def _examine_in_own_process(
    tracker: str, request: Mapping[str, Any], isolation: Isolation, progress: Progress
) -> Examination | None:
    """Examine a tracker within a process of its own; return None if it gets no such process, or if the process dies.

    The caller then examines the tracker from this process, which finds the step that ends the tracker's process.
    """
    if not gets_own_process(tracker, isolation):
        return None
    process = None
    try:
        process = TrackerProcess(isolation, *host_command(tracker))
        answer = process.work(f"{__name__}:examine_here", {"tracker": tracker, **request}, progress)
    except TrackFault:
        return None
    finally:
        if process is not None:
            process.close()
    if isinstance(answer, TrackbenchError):
        raise answer
    return answer if isinstance(answer, Examination) else None


def examine_here(tracker: str, progress: Progress, **request: Any) -> Examination | TrackbenchError:
    """Examine a tracker in this process; return the error if it cannot be examined.

    Args:
        tracker: ``module:Class`` or a published name.
        progress: called with the number of steps done and the estimated number of all steps.
        **request: further arguments of :func:`doctor`.
    """
    try:
        return doctor(tracker, in_process=True, progress=progress, **request)
    except TrackbenchError as error:
        return error


@contextmanager
def _redirect_prints() -> Iterator[None]:
    """Send what the tracker prints to stderr, and drop its numeric warnings: the checks find their causes."""
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
        scenario: file whose sensors and observer are used. By default those of the tracker's own scenario, or else a
            radar and a lidar that stand still and move.
        identities: ``hidden`` for a class that follows several objects.
        static_sensors: whether no sensor moves; then nothing is tried with moving sensors.
        no_misses: whether every scan has a detection; then the tracker is given no scan without a
            detection.
        skip: checks to leave out, by name or by name and sensor: ``gain``, ``gain.radar``.
        in_process: whether a tracker that is not built in runs in this process, for a debugger.
        tracker_timeout: longest time that a tracker that is not built in may take to answer a scan, s.
        tracker_memory: most memory of a tracker that is not built in, GB; by default a quarter of the machine's memory.
        out: folder for the findings, the report and the replay; nothing is written by default.
        progress: called with the number of steps done and the estimated number of all steps.

    Raises:
        InputError: there is no such scenario, tracker, module or check, or it does not take the options.
        CannotRun: the tracker cannot process one scan of any sensor, or gives no estimate at any scan.
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
    if (examination := _examine_in_own_process(tracker, request, isolation, progress)) is not None:
        if out is not None:
            examination.save(out)
        return examination
    with _redirect_prints():
        try:
            file = None if scenario is None else Path(scenario)
            examined = find_tracker(tracker, values, file, isolation, identities)
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
                examiner = Doctor(
                    examined.sensors,
                    observer=examined.observer,
                    static_sensors=static_sensors,
                    no_misses=no_misses,
                    skip=skip,
                )
                examination = examiner.examine(examined.name, examined.make, progress)
                evidence = examiner.evidence(examination, examined.make, progress)
                examination = replace(examination, evidence=tuple(evidence))
        except (CannotRun, TrackFault) as error:
            hidden = examined.multi_object
            hint = "" if "#" in tracker else hint_at_identities(tracker, values, isolation, hidden=hidden)
            if hint:
                raise InputError(hint, key="identities") from error
            raise
    examination = replace(examination, notes=examined.notes)
    if out is not None:
        examination.save(out)
    return examination


def remark(loaded: Scenario, tracker: str) -> str | None:
    """Return the verdict on a tracker with the evidence of its first root cause.

    None where the tracker is healthy or cannot be examined.

    Args:
        loaded: scenario with the tracker, its sensors and its observer.
        tracker: name of the tracker.
    """
    with _redirect_prints():
        try:
            examined = find_tracker_in(loaded, tracker)
            sensors, observer = examined.sensors, examined.observer
            examiner = TrafficDoctor(sensors) if examined.multi_object else Doctor(sensors, observer=observer)
            examination = examiner.examine(examined.name, examined.make)
        except (InputError, CannotRun, TrackFault):
            return None
    if examination.healthy:
        return None
    causes = examination.causes
    if not causes:
        return examination_verdict(examination)
    return f"{examination_verdict(examination)}: {causes[0].fault}, {causes[0].evidence.partition(';')[0]}"
