"""Members of a batch for which a trace does not hold: they get what NumPy gives, and no other member notices."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from tests.engine import agreement
from tests.engine.agreement import LIMIT, drive
from tests.support.steps import step_of

from trackbench.base.types import Array, Gaussian, Scan
from trackbench.engine.arithmetic import LARGEST_ANGLE
from trackbench.engine.filters import FusedFilter
from trackbench.engine.kernels import Kernels
from trackbench.filters import AnyBelief, Belief, MultiModelBelief, Update, compact, select

BATCH, TROUBLED = 21, 13
YAW = 3


def of_each(change: Callable[[Array, Array], None]) -> Callable[[AnyBelief, Scan], tuple[AnyBelief, Scan]]:
    """Changes the mean and the covariance of one member, under each motion model."""

    def changed(belief: AnyBelief, scan: Scan) -> tuple[AnyBelief, Scan]:
        if isinstance(belief, MultiModelBelief):
            modes = [changed(mode, scan)[0] for mode in belief.modes]
            return belief._replace(modes=tuple(modes)), scan
        mean, covariance = belief.mean.copy(), belief.covariance.copy()
        change(mean[:, TROUBLED], covariance[..., TROUBLED])
        return Belief(mean, covariance), scan

    return changed


def measured(value: float, component: int = 1) -> Callable[[AnyBelief, Scan], tuple[AnyBelief, Scan]]:
    """A measurement that is said to be valid."""

    def changed(belief: AnyBelief, scan: Scan) -> tuple[AnyBelief, Scan]:
        measurement, valid = scan.measurement.copy(), scan.valid.copy()
        measurement[component, TROUBLED], valid[TROUBLED] = value, True
        return belief, scan._replace(measurement=measurement, valid=valid)

    return changed


def _set(place: Any, value: float) -> Callable[[Array, Array], None]:
    def change(mean: Array, covariance: Array) -> None:
        (mean if isinstance(place, int) else covariance)[place] = value
        if not isinstance(place, int):
            covariance[place[::-1]] = value

    return change


TROUBLE: Mapping[str, Callable[[AnyBelief, Scan], tuple[AnyBelief, Scan]]] = {
    "a negative variance": of_each(_set((0, 0), -1.0)),
    "a correlation above one": of_each(_set((0, 1), 1e3)),
    "a variance of zero": of_each(_set((2, 2), 0.0)),
    "an infinite variance": of_each(_set((YAW, YAW), np.inf)),
    "a variance that is unknown": of_each(_set((YAW, YAW), np.nan)),
    "an enormous yaw": of_each(_set(YAW, 3.0 * LARGEST_ANGLE)),
    "an infinite yaw": of_each(_set(YAW, np.inf)),
    "a place out of this world": of_each(_set(0, 1e300)),
    "an unknown place": of_each(_set(0, np.nan)),
    "on the sensor itself": of_each(lambda mean, covariance: mean.__setitem__(slice(0, 2), (0.0, 0.0))),
    "an unknown measurement": measured(np.nan),
    "an infinite measurement": measured(np.inf),
    "an enormous measurement": measured(1e200, 0),
}
#: Those whose member a kernel may get right as well.
HARMLESS = [
    ("", "a variance of zero"),
    ("", "on the sensor itself"),
    ("", "an enormous measurement"),
    ("kf-ca", "an enormous yaw"),
    ("kf-ca", "a place out of this world"),
]


@pytest.mark.parametrize("trouble", TROUBLE)
@pytest.mark.parametrize("name", ["kf-ca", "ekf-ctrv", "ukf-ctrv", "ekf-imm"])
def test_a_member_in_trouble_gets_what_numpy_gives(name: str, trouble: str, kernels: Kernels) -> None:
    of = drive(8, BATCH, ["radar", "lidar"])
    tracker, state = of.tracker(name), None
    for scan in of.scans[:-1]:
        state, _ = tracker.step(state, scan)
    assert state is not None
    # The noise of the lidar covers the case of another radar.
    scan = of.scans[-2]._replace(time=0.7)
    sound = compact(state.belief), scan
    troubled = TROUBLE[trouble](*sound)
    fused = FusedFilter(tracker.filter, kernels)
    with np.errstate(all="ignore"):
        expected = operations(tracker.filter, *alone(*troubled))
        untroubled, said = operations(fused, *sound), operations(fused, *troubled)
    if (name, trouble) not in HARMLESS and ("", trouble) not in HARMLESS:
        assert fused.used[:2] == ("fused and numpy", "")
    others = np.arange(BATCH) != TROUBLED
    for what, value in said.items():
        assert bits(value, others) == bits(untroubled[what], others), what
        same(what, member(value, TROUBLED), member(expected[what], 0), LIMIT)


def operations(filter: Any, belief: AnyBelief, scan: Scan) -> dict[str, Any]:
    """What a filter makes of a belief and a scan."""
    updated = filter.update(belief, scan)
    stepped = step_of(filter, belief, 0.1, scan)
    return {
        "prediction": filter.predict(belief, 0.1),
        "prediction of no time": filter.predict(belief, 0.0),
        "expectation": filter.predict_measurement(belief, scan)[:2],
        "update": updated.belief,
        "what it says": _said(updated, scan),
        "step": stepped.update.belief,
        "what that says": _said(stepped.update, scan),
        "position": filter.cartesian(belief),
        "position after": stepped.cartesian,
    }


def alone(belief: AnyBelief, scan: Scan) -> tuple[AnyBelief, Scan]:
    """The member in trouble without the others; twice, since NumPy sums one alone in another order."""
    where = np.array([TROUBLED, TROUBLED])
    return select(belief, where), scan._replace(measurement=scan.measurement[:, where], valid=scan.valid[where])


def _said(update: Update[Any], scan: Scan) -> Gaussian:
    """The innovation, of nothing where there is no measurement."""
    size = len(update.innovation_covariance)
    covariance = np.broadcast_to(update.innovation_covariance, (size, size, *scan.valid.shape))
    return Gaussian(np.where(scan.valid, update.innovation, 0.0), covariance)


def member(value: Any, number: int) -> Any:
    """That of one member, with its marks."""
    where = np.array([number])
    if isinstance(value, Belief | MultiModelBelief):
        repaired = None if value.repaired is None else value.repaired[where]
        return select(value, where)._replace(repaired=repaired)
    return Gaussian(*(part[..., where] for part in value))


def bits(value: Any, where: Array) -> list[bytes]:
    """All numbers of some members, and their marks."""
    if isinstance(value, MultiModelBelief):
        modes = [part for mode in value.modes for part in bits(mode, where)]
        return [value.probability[..., where].tobytes(), *modes, _marked(value.repaired, where)]
    if isinstance(value, Belief):
        return [*bits(value[:2], where), _marked(value.repaired, where)]
    return [part[..., where].tobytes() for part in value]


def _marked(repaired: Any, where: Array) -> bytes:
    return np.broadcast_to(False if repaired is None else repaired, BATCH)[where].tobytes()


def same(what: str, one: Any, other: Any, limit: float) -> None:
    """Numbers alike where they are finite, and the same where they are not."""
    if isinstance(one, MultiModelBelief):
        assert agreement.marks(one.repaired) == agreement.marks(other.repaired), what
        _alike(what, one.probability, other.probability, limit)
        for pair in zip(one.modes, other.modes, strict=True):
            same(what, *pair, limit)
        return
    if isinstance(one, Belief):
        assert agreement.marks(one.repaired) == agreement.marks(other.repaired), what
    for a, b in zip(one[:2], other[:2], strict=True):
        _alike(what, a, b, limit)


def _alike(what: str, one: Array, other: Array, limit: float) -> None:
    finite = np.abs(other[np.isfinite(other)]).max(initial=0.0)
    # Of a member in trouble rounding counts for more.
    np.testing.assert_allclose(one, other, rtol=limit, atol=10 * limit * finite, err_msg=what)
