"""A tracker of several objects that is examined as one of a single object, or the other way round."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from trackbench.driving.isolation import Isolation
from trackbench.subjects.doctor.session import TrackerSession
from trackbench.subjects.doctor.subject import subject
from trackbench.subjects.doctor.traffic.scenes import Follower
from trackbench.testing.kinds import answers
from trackbench.testing.tracker import drive
from trackbench.testing.tracks import hidden_drive


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
        follower = Follower(subject(target, options, None, isolation, "hidden").make)
        return (len(follower.step(scan).ids) > 0 for scan in hidden_drive())

    if hidden:
        return f"{target} follows one object: choose known" if answers(of_one) else ""
    return f"{target} follows several objects: choose hidden" if answers(of_several) else ""
