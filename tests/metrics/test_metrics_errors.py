"""What is computed of each estimate, against NumPy's linear algebra; and what a chunk shows of it to a metric."""

from __future__ import annotations

import numpy as np
import pytest

from trackbench.base.types import Estimate
from trackbench.engine.equations import by_numpy
from trackbench.metrics import BUILT_IN, Metric, Scorer, Target
from trackbench.metrics.consistency import DIRECTIONS
from trackbench.metrics.errors import ERRORS, GIVEN
from trackbench.metrics.sums import ERROR, ERROR_FIELDS

BATCH = 3, 2, 5


def estimates(seed, batch=BATCH):
    """Of objects that move at 5 m/s, or stand still."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(*batch, 4, 4))
    covariance = np.moveaxis(root @ np.swapaxes(root, -1, -2) + 0.5 * np.eye(4), (-2, -1), (0, 1)).copy()
    truth = np.zeros((4, *batch[:2], 1))
    truth[2, :, 0] = -5.0
    mean = truth + random.normal(size=(4, *batch))
    return {
        "mean": mean,
        "covariance": covariance,
        "truth": truth,
        "reference": np.full((2, *batch[:2], 1), 0.25),
        "finite": np.ones(batch, dtype=bool),
        "scored": np.ones(batch, dtype=bool),
    }


def test_rows_agree_with_numpy():
    given = estimates(1)
    given["scored"][1, 0, 2] = False
    found = by_numpy(ERRORS, given)
    assert found["rows"].shape == (len(ERROR_FIELDS), *BATCH)
    assert found["definite"].all()
    assert found["bounded"].all()
    for place in np.ndindex(BATCH):
        e, p = (given["mean"] - given["truth"])[:, *place], given["covariance"][:, :, *place]
        nees = [e[part] @ np.linalg.solve(p[part, part], e[part]) for part in map(slice, (0, 0, 2), (4, 2, 4))]
        # The first object moves against x; the other stands, and is taken to point along it.
        directions = e**2 / np.diag(p)
        expected = np.array([1.0, *e**2, *nees, *directions, 0.25, 0.25, 1.0]) * (place != (1, 0, 2))
        np.testing.assert_allclose(found["rows"][:, *place], expected, rtol=1e-9, err_msg=str(place))


def test_errors_along_and_across_the_motion():
    """With the covariance rotated into the course."""
    given = estimates(4)
    angle = np.random.default_rng(4).uniform(-np.pi, np.pi, given["truth"].shape[1:])
    given["truth"][2:] = 8.0 * np.stack([np.cos(angle), np.sin(angle)])
    found = by_numpy(ERRORS, given)["rows"]
    for place in np.ndindex(BATCH):
        e, p = (given["mean"] - given["truth"])[:, *place], given["covariance"][:, :, *place]
        (c,), (s,) = np.cos(angle[place[:2]]), np.sin(angle[place[:2]])
        turned = np.kron(np.eye(2), np.array([[c, s], [-s, c]]))
        expected = (turned @ e) ** 2 / np.diag(turned @ p @ turned.T)
        rows = [ERROR[name] for name in DIRECTIONS.values()]
        np.testing.assert_allclose(found[rows, *place], expected, rtol=1e-9)


def test_what_is_wrong_with_an_estimate():
    given = estimates(2)
    given["covariance"][3, 3, 0, 0, 0] = -1.0
    given["covariance"][1, 0, 0, 0, 1] = np.nan
    given["mean"][0, 0, 0, 2] = 1e51
    given["mean"][0, 0, 0, 3] = 1e51
    given["scored"][0, 0, 3] = False
    with np.errstate(over="ignore"):
        found = by_numpy(ERRORS, given)
    assert [tuple(place) for place in np.argwhere(~found["definite"])] == [(0, 0, 0), (0, 0, 1)]
    # What is not scored is not summed either.
    assert (0, 0, 2) in map(tuple, np.argwhere(~found["bounded"]))
    assert found["bounded"][0, 0, 3]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_an_estimate_that_is_not_finite_counts_nowhere(bad):
    given = estimates(3)
    given["mean"][2, 1, 1, 4] = given["covariance"][0, 0, 2, 0, 0] = bad
    found = by_numpy(GIVEN, given)
    wrong = [(1, 1, 4), (2, 0, 0)]
    assert [tuple(place) for place in np.argwhere(~found["finite"])] == wrong
    assert found["given"].all()
    given["scored"] = given["finite"] = found["finite"]
    with np.errstate(invalid="ignore"):
        found = by_numpy(ERRORS, given)
    assert found["definite"].all()
    assert found["bounded"].all()
    assert not found["rows"][:, *np.transpose(wrong)].any()


class Seen(Metric):
    """Keeps what it is shown."""

    name, unit, meaning = "seen", "1", "nothing"

    def init(self, scope):
        return []

    def update(self, sums, chunk):
        names = "mean", "error", "nees", "covariance", "values"
        return [*sums, {name: getattr(chunk, name).copy() for name in names}]

    def merge(self, blocks):
        return blocks

    def finish(self, sums):
        return 0.0


def test_what_a_metric_is_shown_agrees_with_what_is_summed():
    given = estimates(4)
    instants, objects, _ = BATCH
    target = Target(
        np.arange(instants) * 1.0,
        given["truth"],
        np.ones((instants, objects), dtype=bool),
        given["scored"],
        np.zeros_like(given["scored"]),
        10.0,
        given["reference"],
    )
    made = Scorer(target, np.zeros((instants, objects, 1), dtype=np.int8), {}, metrics=[*BUILT_IN, Seen()])
    mean, covariance = (given[name].reshape(*given[name].shape[:-2], -1) for name in ("mean", "covariance"))
    for instant in range(instants):
        made.estimate(Estimate(mean[:, instant], covariance[:, :, instant]))
    (seen,) = made.close()["seen"]
    error = (given["mean"] - given["truth"]).reshape(4, instants, -1)
    np.testing.assert_array_equal(seen["mean"], mean)
    np.testing.assert_array_equal(seen["covariance"], covariance)
    np.testing.assert_array_equal(seen["error"], error)
    np.testing.assert_array_equal(
        seen["values"], by_numpy(ERRORS, given)["rows"].reshape(len(ERROR_FIELDS), instants, -1)
    )
    np.testing.assert_array_equal(seen["nees"], seen["values"][ERROR["nees"]])
    whitened = np.linalg.solve(np.moveaxis(covariance, (0, 1), (-2, -1)), np.moveaxis(error, 0, -1)[..., None])
    np.testing.assert_allclose((np.moveaxis(error, 0, -1) * whitened[..., 0]).sum(axis=-1), seen["nees"], rtol=1e-9)
