"""Scores of hand-made estimates, and of blocks that are merged."""

import numpy as np
import pytest
from tests.support.scenes import TRACKERS, block_of, random_walk, scan, truth, values, work

from trackbench.base.types import Estimate
from trackbench.metrics import Fault, Scorer, Target, health, scorer
from trackbench.metrics.estimates import ESTIMATES
from trackbench.metrics.evaluate import independent_scores
from trackbench.metrics.sums import ERROR, merge
from trackbench.models.sensors import Lidar, Radar
from trackbench.sensing.scans import sense_known
from trackbench.trackers.answers import NOT_DEFINITE, NOT_FINITE
from trackbench.trackers.config import FilterConfig, PluginConfig

SENSORS = {
    "radar": Radar(rate_hz=10, phase_s=0.05, range_sigma_m=0.3, azimuth_sigma_deg=1, range_rate_sigma_mps=0.2),
    "lidar": Lidar(rate_hz=10, position_sigma_m=0.15, detection_probability=0.9),
}


def target(state, runs, *, alive=None, start=0.0, divergence=10.0, reference=(0.0, 0.0)):
    """Of a truth ``(4, instants, objects)`` that is the same in every run."""
    state = np.asarray(state, dtype=float)[..., None]
    _, instants, objects, _ = state.shape
    there = np.ones((instants, objects), dtype=bool) if alive is None else np.asarray(alive)
    late = np.arange(instants)[:, None] >= start
    return Target(
        time=np.arange(instants) * 1.0,
        state=state,
        alive=there,
        due=np.broadcast_to((there & late)[..., None], (instants, objects, runs)),
        starting=np.zeros((instants, objects, runs), dtype=bool),
        divergence=divergence,
        reference=np.broadcast_to(np.reshape(reference, (2, 1, 1, 1)), (2, instants, objects, 1)),
    )


def estimate(mean, covariance=None, **more):
    """With the batch last."""
    mean = np.asarray(mean, dtype=float)
    identity = np.broadcast_to(np.eye(4)[..., None], (4, 4, mean.shape[1]))
    return Estimate(mean, identity if covariance is None else covariance, **more)


def scored(of, estimates, sensors=None):
    """Of estimates after each instant, each with the scans that led to it."""
    return scored_together(of, {"tracker": estimates}, sensors)["tracker"]


def scored_together(of, estimates, sensors=None):
    """Of several trackers, by name.

    Raises:
        Fault: one gave what cannot be scored.
    """
    classes = np.zeros((*of.alive.shape, 1), dtype=np.int8)
    nowhere = np.zeros((2, len(of.time), of.due[0].size))
    options = {"measured": lambda here: nowhere[:, here]}
    made = {name: Scorer(of, classes, sensors or {}, tracker=name, **options) for name in estimates}
    for k in range(len(of.time)):
        for name, each in estimates.items():
            scans, given = each[k]
            for seen in scans:
                made[name].scan(k, seen, given, seconds=0.002)
            made[name].estimate(given)
    return {name: item.close()[ESTIMATES.name] for name, item in made.items()}


def test_errors_by_hand():
    # One object moving east at 10 m/s, two instants, two runs; errors in px of 3 and 0, in py of 4 and 0, and so on.
    state = np.zeros((4, 2, 1))
    state[2] = 10.0
    first = np.array([[3, 0], [4, 0], [10, 10], [0, 10]])
    second = np.array([[0, 1], [0, 0], [12, 10], [0, 0]])
    scores = scored(target(state, 2), [([], estimate(first)), ([], estimate(second))])
    found = values(scores)
    assert found["position_rmse"].value == pytest.approx(np.sqrt((25 + 0 + 0 + 1) / 4))
    assert found["velocity_rmse"].value == pytest.approx(np.sqrt((0 + 100 + 4 + 0) / 4))
    axes = {name: found[f"rmse.{name}"].value for name in ("px", "py", "vx", "vy")}
    assert axes == pytest.approx(
        {"px": np.sqrt(10 / 4), "py": np.sqrt(16 / 4), "vx": np.sqrt(4 / 4), "vy": np.sqrt(100 / 4)}
    )
    # With unit covariances the NEES is the sum of squares.
    assert found["nees"].mean == pytest.approx((25 + 100 + 4 + 1) / 4)
    # Two runs of 62.5 and 2.5: an interval that says nothing, and a sum beyond chi-square of 8 degrees of freedom.
    assert found["nees"].verdict == "optimistic"
    assert found["coverage"].value == 1.0
    np.testing.assert_allclose(scores.per_run[1:3].sum(axis=0), [25, 1])
    np.testing.assert_allclose(scores.per_step[1:3].sum(axis=0), [25, 1])


def test_what_is_not_there_or_not_yet_due_is_not_scored():
    state = np.zeros((4, 3, 2))
    alive = [[True, False], [True, True], [False, True]]
    mean = np.full((4, 2), 2.0)
    scores = scored(target(state, 1, alive=alive, start=1.0), [([], estimate(mean))] * 3)
    # The settling time cuts the first instant; then both objects, then the second one alone.
    np.testing.assert_array_equal(scores.per_step[0], [0, 2, 1])
    assert scores.due[0] == scores.per_run[0, 0] == 3


def test_a_lane_without_an_estimate_costs_coverage():
    state = np.zeros((4, 4, 1))
    nothing = estimate(np.full((4, 2), np.nan))
    half = estimate(np.array([[1.0, np.nan]] * 4))
    whole = estimate(np.ones((4, 2)))
    scores = scored(target(state, 2), [([], nothing), ([], half), ([], whole), ([], whole)])
    assert scores.per_run[[ERROR["count"], ERROR["given"]]].tolist() == [[4, 4], [3, 2]]
    assert values(scores)["coverage"].value == pytest.approx(5 / 8)
    # The measured positions are those of the truth: what is missing costs nothing here.
    assert values(scores)["position_rmse"].value == pytest.approx(np.sqrt(2 * 5 / 8))
    assert (values(scores)["position_rmse"].charged_share, values(scores)["nees"].verdict) == (0.0, "undecided")


def test_a_run_diverges_once_an_error_exceeds_the_limit():
    state = np.zeros((4, 2, 1))
    far = np.zeros((4, 3))
    far[0] = [9.9, 10.1, 0.0]
    scores = scored(target(state, 3, divergence=10.0), [([], estimate(far)), ([], estimate(np.zeros((4, 3))))])
    np.testing.assert_array_equal(scores.diverged, [0, 1, 0])
    assert health(scores).diverged_runs == 1


@pytest.mark.parametrize(
    ("bad", "cause"),
    [
        (estimate([[1, np.nan], [0, 0], [0, 0], [0, 0]]), NOT_FINITE),
        (estimate([[1, np.inf], [0, 0], [0, 0], [0, 0]]), NOT_FINITE),
        (estimate(np.zeros((4, 2)), np.stack([np.eye(4), np.diag([1.0, 1, 1, -1])], axis=-1)), NOT_DEFINITE),
    ],
    ids=["nan", "inf", "indefinite"],
)
@pytest.mark.parametrize("batch", [2, 4, 8000], ids=["one by one", "in twos", "all at once"])
def test_an_estimate_that_cannot_be_one_is_a_fault_with_its_place(bad, cause, batch, monkeypatch):
    monkeypatch.setattr(scorer, "BATCH", batch)
    good = estimate(np.zeros((4, 2)))
    with pytest.raises(Fault, match=cause) as fault:
        scored(target(np.zeros((4, 5, 1)), 2), [([], good), ([], good), ([], bad), ([], good), ([], good)])
    assert (fault.value.instant, fault.value.member) == (2, 1)


@pytest.mark.parametrize("batch", [2, 8000], ids=["one by one", "all at once"])
def test_a_track_that_ends_is_charged_the_worse_of_its_last_estimate_and_the_measured_position(batch, monkeypatch):
    monkeypatch.setattr(scorer, "BATCH", batch)
    state = np.zeros((4, 4, 1))
    state[0, :, 0] = [0.0, 1.0, 2.0, 3.0]
    state[2] = 1.0
    # The first run states 5 m at the second instant and nothing more; the second never an estimate.
    first, none = estimate(np.array([[5.0, np.nan], [0, np.nan], [0.5, np.nan], [0, np.nan]])), np.full((4, 2), np.nan)
    scores = scored(target(state, 2), [([], estimate(none)), ([], first), ([], estimate(none)), ([], estimate(none))])
    # Measured is 0 m at all instants: at 2 m the estimate of 5 m is worse, at 3 m the measured position.
    assert scores.per_run[ERROR["px"]].tolist() == [0 + 16 + 9 + 9, 0 + 1 + 4 + 9]
    assert scores.charged[ERROR["px"]].tolist() == [0 + 9 + 9, 0 + 1 + 4 + 9]
    # No velocity at all is worse than .5 m/s.
    assert scores.per_run[ERROR["vx"]].tolist() == [1 + 0.25 + 1 + 1, 4.0]
    assert scores.per_run[ERROR["given"]].tolist() == [1, 0]
    assert scores.per_run[ERROR["nees"]].tolist() == [16.25, 0]
    assert health(scores).missing_estimates == 7


def test_innovations_by_hand():
    # Two runs, three measurements of a lidar; the second run misses the second one.
    spread = np.broadcast_to((4.0 * np.eye(2))[..., None], (2, 2, 2))
    innovations = [np.array([[2.0, 4], [0, 6]]), np.array([[2.0, np.nan], [2, np.nan]]), np.array([[-4.0, 2], [0, 0]])]
    valid = [[True, True], [True, False], [True, True]]
    scans = [scan("lidar", 1.0 * k, np.zeros((2, 2)), valid=valid[k]) for k in range(3)]
    given = [
        estimate(np.zeros((4, 2)), innovation=innovation, innovation_covariance=spread) for innovation in innovations
    ]
    scores = scored(target(np.zeros((4, 3, 1)), 2), list(zip([[s] for s in scans], given, strict=True)), {"lidar": 3})
    nis = scores.nis["lidar"]
    # Run 0: 1, 2, 4; run 1: 13, missed, 1. Of those 13 alone is above 5.991.
    np.testing.assert_allclose(nis.per_run[:3], [[3, 2], [7, 14], [3, 1]])
    np.testing.assert_allclose(nis.per_step[:3], [[2, 1, 2], [14, 2, 5], [1, 1, 2]])
    found = values(scores)["nis.lidar"]
    assert found.mean == pytest.approx(21 / 5)
    assert found.inside95 == pytest.approx(4 / 5)
    assert found.dof == 2
    # Successive measurements of run 0 alone: (1, 0) . (1, 1) + (1, 1) . (-2, 0), over the squares of the later ones.
    white = values(scores)["whiteness.lidar"]
    assert white.value == pytest.approx((1 - 2) / (2 + 4))


def test_the_error_is_taken_over_that_of_the_reference():
    of = target(np.zeros((4, 1, 1)), 2, reference=(1.5**2, 4.0**2))
    scores = scored(of, [([], estimate([[3, 3], [0, 0], [2, 2], [0, 0]]))])
    found = values(scores)
    assert found["position_over_reference"].value == pytest.approx(2.0)
    assert found["velocity_over_reference"].value == pytest.approx(0.5)
    assert np.sqrt(scores.per_part[ERROR["position_reference"]].sum() / 2) == 1.5


TWO = {
    "ekf": FilterConfig.model_validate(TRACKERS["ekf-cv"]),
    "ukf": FilterConfig.model_validate(
        {**TRACKERS["ukf-ctrv"], "sensors": ["radar"], "initial": {"from": "two_measurements", "least_time_s": 0}}
    ),
    "prior": FilterConfig.model_validate({**TRACKERS["ekf-cv"], "initial": "truth"}),
    "raw": PluginConfig(use="raw"),
}


def same_errors(found, expected):
    """Also what is charged for missing estimates, and of each class."""
    for field in ("per_step", "per_run", "per_part", "charged"):
        a, b = (getattr(scores, field) for scores in (found, expected))
        np.testing.assert_allclose(a, b, rtol=1e-12, err_msg=field)
    moments = [
        independent_scores(scores, np.zeros(len(scores.due), dtype=int)).classes[0][1] for scores in (found, expected)
    ]
    for field in ("total", "square", "product", "parts"):
        a, b = (getattr(item, field) for item in moments)
        np.testing.assert_allclose(a, b, rtol=1e-12, err_msg=field)


@pytest.mark.parametrize("own", [True, False], ids=["another truth in each run", "one truth"])
def test_merged_blocks_are_one_block(own):
    of = random_walk(12, 60, 0.05, 2.0, seed=1, start=np.array([40.0, 10.0, 10.0, 5.0]))
    if not own:
        of = truth(of.time, of.px[..., :1], of.py[..., :1], of.vx[..., :1], of.vy[..., :1])
    whole = work(of, SENSORS, TWO, 12, settle=0.5)
    one = block_of(whole, range(12))
    parts = [block_of(whole, runs) for runs in (range(5), range(5, 6), range(6, 12))]
    for name in TWO:
        single, merged = one.outcomes[name].scores, merge([part.outcomes[name].scores for part in parts])
        assert one.outcomes[name].sums["step_time"][1] == sum(
            part.outcomes[name].sums["step_time"][1] for part in parts
        )
        for field in ("due", "diverged", "repaired"):
            np.testing.assert_allclose(getattr(merged, field), getattr(single, field), rtol=1e-12, err_msg=field)
        same_errors(merged, single)
        for sensor in SENSORS:
            assert single.nis[sensor].dof == merged.nis[sensor].dof
            for field in ("per_step", "per_run"):
                a, b = getattr(merged.nis[sensor], field), getattr(single.nis[sensor], field)
                # The whiteness products cancel, so that they are as exact as their terms.
                np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-11)
    assert one.digests == [digest for part in parts for digest in part.digests]
    for sensor in SENSORS:
        np.testing.assert_array_equal(one.detections[sensor], sum(part.detections[sensor] for part in parts))


def test_scores_begin_when_the_settling_time_after_the_first_detection_is_over():
    of = random_walk(40, 60, 0.05, 2.0, seed=2, start=np.array([40.0, 10.0, 10.0, 5.0]))
    rare = {"lidar": SENSORS["lidar"].model_copy(update={"detection_probability": 0.3})}
    whole = work(of, rare, {"raw": PluginConfig(use="raw")}, 40, settle=1.0)
    scores = block_of(whole, range(40)).outcomes["raw"].scores
    valid = np.stack([seen.valid for seen in sense_known(whole.scenes[0].sensors, 1, "test", range(40)).scans])
    first = np.argmax(valid, axis=0)
    # Thirty measurements, 0.1 s apart.
    np.testing.assert_array_equal(scores.due, np.maximum(30 - (first + 10), 0))
