"""All mutants: every fault in every subject to which it applies."""

from __future__ import annotations

from collections.abc import Iterator

from . import builtin, people_faults, step_faults, wrapper_faults
from . import method_faults as methods
from .cholesky_ukf import CholeskyUkf
from .correct import CORRECT, ONE_SENSOR
from .filterpy_ekf import FilterPyEkf, FilterPyUkf
from .mutant import ExaminedTracker, Mutant
from .plain_ekf import PlainEkf
from .plain_kf import PlainKf
from .plain_ukf import PlainUkf

__all__ = ["CORRECT", "MUTANTS", "ONE_SENSOR", "Mutant"]

PLAIN_EKF = ExaminedTracker("plain_ekf", PlainEkf)
PLAIN_UKF = ExaminedTracker("plain_ukf", PlainUkf, turning=True)
PLAIN_KF = ExaminedTracker("plain_kf", PlainKf, uses_rate=False)
CHOLESKY_UKF = ExaminedTracker("cholesky_ukf", CholeskyUkf)
FILTERPY_EKF = ExaminedTracker("filterpy_ekf", FilterPyEkf)
FILTERPY_UKF = ExaminedTracker("filterpy_ukf", FilterPyUkf, turning=True)

SUBJECTS = {
    PLAIN_EKF: (
        methods.predictions,
        methods.linearised,
        methods.motion_jacobians,
        methods.starts,
        methods.divisions,
    ),
    PLAIN_UKF: (
        methods.predictions,
        methods.unscented,
        methods.sigma_points,
        methods.innovation,
        methods.starts,
        methods.divisions,
    ),
    PLAIN_KF: (methods.starts, methods.divisions),
    # FilterPy's EKF refuses to invert what is not finite, so that it raises where the others answer.
    FILTERPY_EKF: (methods.predictions, methods.linearised, methods.starts),
    FILTERPY_UKF: (methods.predictions, methods.unscented, methods.sigma_points, methods.starts, methods.divisions),
    builtin.EKF: (builtin.any_filter, builtin.predictions, builtin.linearised),
    builtin.UKF: (builtin.any_filter, builtin.predictions, builtin.turning),
    builtin.KF: (builtin.any_filter,),
}


def _mutants() -> Iterator[Mutant]:
    for subject, parts in SUBJECTS.items():
        yield from wrapper_faults.mutants(subject)
        for part in parts:
            yield from part(subject)
    for subject in (PLAIN_EKF, PLAIN_UKF, PLAIN_KF):
        yield from methods.corrections(subject)
    yield methods.raising(CHOLESKY_UKF)
    for subject in (PLAIN_EKF, PLAIN_UKF, PLAIN_KF, FILTERPY_EKF, FILTERPY_UKF):
        yield from step_faults.steps(subject)
    for subject in (PLAIN_EKF, PLAIN_UKF, PLAIN_KF):
        yield from people_faults.mutants(subject)
    for subject in (PLAIN_UKF, FILTERPY_UKF):
        yield from people_faults.sigma_points(subject)
    yield from people_faults.motion(people_faults.TURNING_EKF)


MUTANTS: list[Mutant] = list(_mutants())
