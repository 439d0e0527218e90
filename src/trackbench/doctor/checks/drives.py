"""How does the tracker do on drives with noise, beside a reference?"""

from __future__ import annotations

import numpy as np

from trackbench.doctor.bench import Bench
from trackbench.doctor.drives import Course
from trackbench.doctor.findings import Check, Outcome
from trackbench.doctor.following import Track, follow
from trackbench.doctor.session import Broken

#: Scans after the first that are left out of the errors, s.
SETTLE = 1.0
#: RMS position error of a tracker that has lost its target, m.
LOST = 20.0


def drives(bench: Bench) -> Outcome:
    """Take the tracker through every drive of the battery, on the measurements that the reference had."""
    outcome = Outcome()
    for course, theirs in bench.courses:
        question = f"Does it keep {course.drive.purpose}?"
        try:
            own = follow(bench.make, course.scans, bench.vitals, course.name)
        except Broken as broken:
            bench.broken.append((course.name, broken))
            outcome.checks.append(Check(course.name, question, False, f"it broke at {broken.scan.time:g} s: {broken}"))
            continue
        mine, other = _scores(own, course), _scores(theirs, course)
        passed = bool(mine[0] < LOST)
        text = (
            f"position RMSE {mine[0]:.3g} m, reference {other[0]:.3g} m; NEES of position and velocity {mine[1]:.3g} "
            f"and {mine[2]:.3g} of 2 each, reference {other[1]:.3g} and {other[2]:.3g}"
        )
        outcome.checks.append(Check(course.name, question, passed, text))
    return outcome


def _scores(track: Track, course: Course) -> tuple[float, float, float]:
    """RMS position error, and mean normalised squares of the errors of position and velocity."""
    late = course.time > SETTLE
    error = (track.mean - course.target)[:, late]
    covariance = np.moveaxis(track.covariance[:, :, late], (0, 1), (-2, -1))
    known = np.isfinite(error).all(axis=0) & np.isfinite(covariance).all(axis=(-2, -1))
    if not known.any():
        return np.inf, np.inf, np.inf
    e, p = error[:, known].T, covariance[known]
    squares = [
        np.einsum("ni,nij,nj->n", e[:, part], np.linalg.pinv(p[:, part, part]), e[:, part])
        for part in (slice(0, 2), slice(2, 4))
    ]
    return (
        float(np.sqrt(np.mean(np.sum(e[:, :2] ** 2, axis=1)))),
        float(np.mean(squares[0])),
        float(np.mean(squares[1])),
    )
