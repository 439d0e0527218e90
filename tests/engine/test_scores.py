"""Scores by kernels: the sums and the faults that NumPy gives."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest
from tests.support.scenes import scan

from trackbench.base.types import Array, Estimate
from trackbench.engine.equations import Compute, by_numpy
from trackbench.engine.kernels import Kernels
from trackbench.metrics import Fault, Scorer, Target
from trackbench.metrics.estimates import ESTIMATES

#: Runs enough that what they share is computed once for all.
INSTANTS, OBJECTS, RUNS = 50, 3, 70
BATCH = OBJECTS * RUNS
#: Of objects and runs that are not there, or have no estimate yet.
START = 12


def scored(compute: Compute, own: bool, change: tuple[str, Array] | None = None):
    """The sums and faults of two trackers, the second of which starts later in some runs; in a scene with holes.

    ``own``: whether each run has a truth of its own. ``change``: what of the first tracker's estimates at instant 30 of
    member 5 is replaced.
    """
    random = np.random.default_rng(1)
    state = random.normal(size=(4, INSTANTS, OBJECTS, RUNS if own else 1)) * np.reshape([50, 50, 2, 2], (4, 1, 1, 1))
    alive = (np.arange(INSTANTS)[:, None] + 9 * np.arange(OBJECTS)) % 25 > 3
    alive[30] = True
    due = np.broadcast_to(alive[:, :, None], (INSTANTS, OBJECTS, RUNS)).copy()
    due[:START, :, ::3] = False
    reference = np.abs(random.normal(size=(2, INSTANTS, OBJECTS, RUNS if own else 1)))
    target = Target(np.arange(INSTANTS) * 0.1, state, alive, due, np.zeros_like(due), 4.0, reference)
    classes = random.integers(0, 5, (INSTANTS, OBJECTS, RUNS if own else 1)).astype(np.int16)
    counts = {"radar": INSTANTS // 2, "lidar": INSTANTS // 2}
    measured = random.normal(size=(2, INSTANTS, BATCH))
    made = [
        Scorer(target, classes, counts, tracker=name, compute=compute, measured=lambda here: measured[:, here])
        for name in ("early", "late")
    ]
    faults = {}
    for instant in range(INSTANTS):
        for scorer in made:
            # A tracker that is left out earlier changes nothing for the other.
            number = ("early", "late").index(scorer.tracker)
            random = np.random.default_rng((instant, number))
            root = random.normal(size=(4, 4, BATCH))
            covariance = np.einsum("ikl,jkl->ijl", root, root) + 0.1 * np.eye(4)[..., None]
            mean = np.broadcast_to(state[:, instant], (4, OBJECTS, RUNS)).reshape(4, -1) + random.normal(
                size=(4, BATCH)
            )
            none = (instant < START) & (np.arange(BATCH) % 3 == 0)
            none |= (instant < START + 5) & (number == 1) & (np.arange(BATCH) % 3 == 0)
            mean[:, none] = covariance[..., none] = np.nan
            if change is not None and (instant, number) == (30, 0):
                replaced = {"mean": mean, "covariance": covariance}[change[0]]
                replaced[..., 5] = change[1]
            kind, size = ("radar", 3) if instant % 2 else ("lidar", 2)
            valid = random.random(BATCH) < 0.8
            white = np.where(valid & ~none, random.normal(size=(size, BATCH)), np.nan)
            given = Estimate(mean, covariance, whitened_innovation=white)
            scorer.scan(instant, scan(kind, 0.1 * instant, np.zeros((size, BATCH)), valid=valid), given)
            try:
                scorer.estimate(given)
            except Fault as fault:
                faults[scorer.tracker] = fault.cause, fault.instant, fault.member
        made = [scorer for scorer in made if scorer.tracker not in faults]
    return {scorer.tracker: asdict(scorer.close()[ESTIMATES.name]) for scorer in made}, faults


def same(found, expected, path=()):
    """To 1e-12 of the largest value of each row."""
    if isinstance(expected, dict):
        assert found.keys() == expected.keys()
        for key in expected:
            same(found[key], expected[key], (*path, key))
    elif isinstance(expected, np.ndarray):
        expected = np.atleast_1d(expected)
        largest = np.nanmax(np.abs(expected), axis=tuple(range(1, expected.ndim)), keepdims=True, initial=0.0)
        scale = np.where(largest > 0.0, largest, 1.0)
        np.testing.assert_allclose(found / scale, expected / scale, rtol=0, atol=1e-12, err_msg=str(path))
    elif isinstance(expected, list | tuple):
        for number, (own, other) in enumerate(zip(found, expected, strict=True)):
            same(own, other, (*path, number))
    elif expected is None:
        assert found is None, path
    else:
        assert found == pytest.approx(expected, rel=1e-12, nan_ok=True), path


@pytest.mark.parametrize("own", [False, True], ids=["one truth", "another truth in each run"])
def test_sums(kernels: Kernels, own: bool) -> None:
    before, untraced = kernels.members_by_numpy, len(kernels.untraced)
    found, faults = scored(kernels, own)
    assert not faults
    same(found, scored(by_numpy, own)[0])
    # What has no estimate, or no measurement, is no reason to compute again.
    assert kernels.members_by_numpy == before
    assert len(kernels.untraced) == untraced


@pytest.mark.parametrize(
    "change",
    [
        ("mean", np.array([0.0, np.nan, 0.0, 0.0])),
        ("mean", np.array([0.0, 0.0, 0.0, -np.inf])),
        ("covariance", np.diag([1.0, 1.0, -1e-3, 1.0])),
        ("covariance", np.diag([1.0, 1.0, 1.0, 1.0]) + np.nan * np.diag([1.0, 0.0, 0.0], k=-1)),
        ("mean", np.array([1e60, 0.0, 0.0, 0.0])),
        ("mean", np.array([0.0, 1e200, 0.0, 0.0])),
        ("covariance", np.diag([1e-320, 1.0, 1.0, 1.0])),
    ],
    ids=["nan", "inf", "indefinite", "no number", "large", "too large to be squared", "tiny"],
)
def test_faults(kernels: Kernels, change: tuple[str, Array]) -> None:
    sums, faults = scored(kernels, False, change)
    expected, expected_faults = scored(by_numpy, False, change)
    assert faults == expected_faults
    assert [(instant, member) for _, instant, member in faults.values()] == [(30, 5)]
    same(sums, expected)
