"""A smoother in the bench: a reference that knows all measurements of the run."""

from dataclasses import replace

import numpy as np
import pytest
from tests.filters.test_filters_properties import measurements, through
from tests.support.reference import smoothed
from tests.support.scenes import NOISE, member, scan, tracker

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.report.tables import ranking_table
from trackbench.subjects.doctor.subject import find_tracker
from trackbench.subjects.serve.session import load_served
from trackbench.trackers.filtered import SmoothedTracker

IMM = {"imm": [{"model": "cv", **NOISE["cv"]}, {"model": "ctrv", **NOISE["ctrv"]}], "stay_s": [3, 2]}
KEYS = {
    "kf": {"filter": "kf", "motion": "cv", **NOISE["cv"]},
    "ekf": {"filter": "ekf", "motion": "ctrv", **NOISE["ctrv"]},
    "ukf": {"filter": "ukf", "motion": "ctrv", **NOISE["ctrv"]},
    "imm": {"filter": "ekf", "motion": IMM},
}
every_kind = pytest.mark.parametrize("keys", KEYS.values(), ids=KEYS)
OWN_MODEL = "scripted/own_model"


def distinct(size=4, steps=24, seed=3):
    """Scans at instants of their own, each object detected now and then."""
    seen = measurements(size, steps, seed)
    return [one._replace(time=0.1 * k, arrival_time=0.1 * k) for k, one in enumerate(seen)]


@every_kind
def test_it_is_the_smoother_of_the_filters_beliefs_from_where_each_track_starts(keys):
    made = replace(tracker(**keys, initial="two_measurements"), cartesian_fallback="at_start")
    scans = distinct()
    found = SmoothedTracker(made).estimates(scans)
    for i in range(4):
        state, beliefs, first = None, [], None
        for k, one in enumerate(scans):
            state, _ = made.step(state, member(one, i))
            # While the course is unknown, position and velocity are smoothed.
            if state.started and state.fallback is None:
                first = k if first is None else first
                beliefs.append(state.belief)
        assert first is not None
        assert first > 0
        for k, belief in enumerate(smoothed(made.filter, beliefs, [0.1] * (len(beliefs) - 1)), start=first):
            mean, covariance = made.filter.cartesian(belief)
            np.testing.assert_allclose(found[k].mean[:, i], mean, rtol=1e-7, atol=1e-7)
            np.testing.assert_allclose(found[k].covariance[..., i], covariance, rtol=1e-7, atol=1e-7)
        assert np.isnan(found[0].mean[:, i]).all()


@every_kind
def test_between_the_scans_that_it_reads_the_prediction_is_smoothed_and_changes_nothing_else(keys):
    scans = distinct(steps=30)
    scans = [one if k % 3 == 0 else one._replace(sensor="other") for k, one in enumerate(scans)]
    made = tracker(**keys, sensors=["radar", "lidar"])
    found = SmoothedTracker(made).estimates(scans)
    alone = SmoothedTracker(made).estimates(scans[::3])
    for a, b in zip(found[::3], alone, strict=True):
        np.testing.assert_array_equal(a.mean, b.mean)
    filtered = through(made, scans)
    known = ~np.isnan(filtered[-8].mean[0])
    assert known.any()
    for k in (-8, -7):
        assert np.all(np.trace(found[k].covariance)[known] < np.trace(filtered[k].covariance)[known])


def test_on_truth_of_its_own_model_it_is_consistent_and_no_competitor():
    start = {"from": "truth", "position_sigma_m": 1, "velocity_sigma_mps": 5}
    keys = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 2, "initial": start}
    changes = {"trackers": {"online": keys, "offline": {**keys, "smoother": "rts"}}, "expect": []}
    result = tb.run(tb.load(OWN_MODEL, changes, runs=60))
    online, offline = result["online"], result["offline"]
    assert offline.position_rmse.value < 0.8 * online.position_rmse.value
    assert offline.nees.verdict == "consistent"
    assert result.summary.ranking == ["offline", "online"]
    assert [one.name for one in result.contenders] == ["online"]
    # What is no competitor is in no group.
    rows = [(row[0].text, row[2].text) for row in ranking_table(result).rows]
    assert rows == [("offline", ""), ("online", "a")]
    assert offline.step_time.value is None
    assert "nis.lidar" not in offline.metrics or offline.metrics["nis.lidar"].value is None


def test_what_needs_a_tracker_that_works_step_by_step_says_so(tmp_path):
    sensors = {"lidar": {"type": "lidar", "rate_hz": 20, "position_sigma_m": 0.15}}
    scenario = tb.load(OWN_MODEL, {"trackers.ekf.smoother": "rts", "sensors": sensors, "expect": []}, trackers=["ekf"])
    with pytest.raises(InputError, match="needs all measurements of a run"):
        load_served(scenario, "ekf")
    path = tmp_path / "scenario.yaml"
    path.write_text(scenario.text.replace("ekf: {", "ekf: {smoother: rts, "))
    with pytest.raises(InputError, match="needs all measurements of a run"):
        find_tracker(f"{path}#ekf", {})
    one = {"associate": {"method": "gnn"}, "filter": "kf", "motion": "cv", **NOISE["cv"], "smoother": "rts"}
    with pytest.raises(InputError, match="a smoother follows one object"):
        tb.load("traffic/truck_hides_car", {"trackers": {"one": one}})


def test_before_a_course_is_known_position_and_velocity_are_smoothed():
    random = np.random.default_rng(6)
    scans, truth = [], []
    for k in range(20):
        truth.append(np.array([20.0 + 1.2 * k, 10.0 - 0.5 * k, 12.0, -5.0])[:, None])
        scans.append(scan("lidar", 0.1 * k, truth[-1][:2] + 0.1 * random.normal(size=(2, 200))))
    made = tracker(filter="ukf", motion="ctrv", **NOISE["ctrv"])
    filtered, found = through(made, scans), SmoothedTracker(made).estimates(scans)
    error = [
        [np.sqrt(((one.mean - exact)[2:] ** 2).mean()) for one, exact in zip(each, truth, strict=True)]
        for each in (filtered, found)
    ]
    assert error[0][0] > 5.0
    assert max(error[1]) < 0.5
    for one, exact in zip(found, truth, strict=True):
        off = one.mean - exact
        nees = np.einsum("in,nij,jn->n", off, np.linalg.inv(np.moveaxis(one.covariance, -1, 0)), off)
        assert nees.mean() < 5.0
