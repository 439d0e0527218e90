"""Every operation of every filter by kernels, held against the same by NumPy."""

from __future__ import annotations

import pytest
from tests.engine import agreement
from tests.engine.agreement import KINDS, LIMIT, Drive, drive
from tests.support.steps import step_of

from trackbench.engine.filters import FusedFilter
from trackbench.engine.kernels import Kernels
from trackbench.filters import AnyBelief

BATCH = 21


@pytest.fixture(scope="module")
def of_each_kind() -> dict[str, Drive]:
    return {kind: drive(4, BATCH, [kind]) for kind in KINDS}


@pytest.mark.parametrize("name", agreement.CASES)
def test_each_operation(name: str, kernels: Kernels, of_each_kind: dict[str, Drive]) -> None:
    for of in of_each_kind.values():
        own = of.tracker(name).filter
        fused = FusedFilter(own, kernels)
        angular = tuple(motion.angular for motion in own.motions)
        belief, scan = _under_way(of, name), of.scans[-1]

        def near(one: AnyBelief, other: AnyBelief) -> bool:
            return agreement.apart(one, other, angular) < LIMIT  # noqa: B023

        for dt in (0.1, 0.0):
            assert near(fused.predict(belief, dt), own.predict(belief, dt))
        predicted = own.predict(belief, 0.1)
        expected = own.predict_measurement(predicted, scan)
        assert agreement.of_predictions(fused.predict_measurement(predicted, scan), expected, predicted) < LIMIT
        assert agreement.of_updates(fused.update(predicted, scan), own.update(predicted, scan), scan, angular) < LIMIT
        stepped, by_numpy = fused.step(belief, 0.1, scan), step_of(own, belief, 0.1, scan)
        assert agreement.of_updates(stepped.update, by_numpy.update, scan, angular) < LIMIT
        for one in (stepped.cartesian, fused.cartesian(by_numpy.update.belief)):
            assert agreement.of_gaussians(one, by_numpy.cartesian) < LIMIT
        later = by_numpy.update.belief
        assert near(fused.smooth(belief, later, 0.1), own.smooth(belief, later, 0.1))
        # NumPy smooths.
        assert fused.used.engine == "fused and numpy"


def _under_way(of: Drive, name: str) -> AnyBelief:
    """What NumPy believes before the last scan."""
    tracker, state = of.tracker(name), None
    for scan in of.scans[:-1]:
        state, _ = tracker.step(state, scan)
    assert state is not None
    return state.belief
