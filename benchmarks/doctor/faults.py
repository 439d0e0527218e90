"""All mutants: every fault in every subject to which it applies."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from . import filter_faults as filtering
from . import inside, outside
from .mutant import Mutant, Subject
from .plain_ekf import PlainEkf

PLAIN_EKF = Subject("plain_ekf", PlainEkf)


def _plain_ekf() -> Iterator[Mutant]:
    for part in (outside.mutants, inside.predictions, inside.jacobians, inside.motion_jacobians, inside.starts):
        yield from part(PLAIN_EKF)
    yield from inside.corrections(PLAIN_EKF)
    at_rest, at_sensor = ("speed", filtering.NoiseAlongCourse), ("range", filtering.UnguardedRange)
    yield from inside.divisions(PLAIN_EKF, at_rest, at_sensor)


MUTANTS: list[Mutant] = [*_plain_ekf()]
CORRECT = {
    "plain_ekf": PlainEkf,
    "plain_ekf two_readings": partial(PlainEkf, start="two_readings"),
}
