"""The interacting multiple model estimator."""

import numpy as np
import pytest
from scipy import stats
from scipy.linalg import expm
from tests.support.scenes import LIDAR_NOISE, MOTIONS, NOISE, RADAR_NOISE, member, scan

from trackbench.base import linalg
from trackbench.base.types import Gaussian
from trackbench.filters import (
    CUBATURE,
    Belief,
    ExtendedKalmanFilter,
    InteractingMultipleModel,
    KalmanFilter,
    MultiModelBelief,
    SigmaPointFilter,
    SymmetricSet,
)
from trackbench.filters.imm import in_state_of, transition_probabilities
from trackbench.models.motion import (
    MOTION_MODELS,
    ConstantVelocity,
    InitialSigmas,
    Kinematics,
    process_noise_covariance,
)
from trackbench.models.sensors import SENSOR_MODELS

MODELS = {name: cls(**NOISE[name]) for name, cls in MOTION_MODELS.loaded().items()}
QUIET, LIVELY = ConstantVelocity(acceleration_sigma_mps2=0.3), ConstantVelocity(acceleration_sigma_mps2=8.0)
KINDS = {
    "ekf": ExtendedKalmanFilter,
    "ukf": lambda motion: SigmaPointFilter(motion, SymmetricSet(1.0, 2.0, 0.0)),
    "additive ukf": lambda motion: SigmaPointFilter(motion, SymmetricSet(1.0, 2.0, 0.0), augmented=False),
    "ckf": lambda motion: SigmaPointFilter(motion, CUBATURE, augmented=False),
}
every_kind = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
START = Kinematics(*(np.array(value) for value in (40.0, 20.0, 12.0, 0.4, 0.5, 0.1)))
POSE, OWN = (-5.0, 3.0, 0.4), (6.0, -1.0)


def imm(kind, *motions, stay=None, initial=None) -> InteractingMultipleModel:
    size = len(motions)
    return InteractingMultipleModel(
        tuple(kind(motion) for motion in motions), stay or (2.0,) * size, initial or (1 / size,) * size
    )


def begun(filter, batch=(), seed=7) -> Belief:
    """Where a vehicle may be that moves at 12 m/s, some 45 m ahead."""
    random = np.random.default_rng(seed)
    error = random.normal(size=(4, *batch))
    root = random.normal(size=(4, 4)) * np.array([0.6, 0.6, 0.9, 0.7])[:, None]
    covariance = np.zeros((4, 4, *batch)) + (root @ root.T + 0.01 * np.eye(4)).reshape(4, 4, *(1 for _ in batch))
    exact = MODELS["cv"].from_kinematics(START).reshape(4, *(1 for _ in batch))
    cartesian = Gaussian(exact + 0.3 * error, covariance)
    return filter.begin(lambda motion: motion.from_cartesian(cartesian, InitialSigmas(1.0, 0.2)))


def scans(batch=(), steps=25, dt=0.1, seed=11, detection=1.0):
    """Alternating radar and lidar measurements of a vehicle on a bend."""
    random, motion = np.random.default_rng(seed), MODELS["ctra"]
    x = motion.from_kinematics(START)
    for k in range(1, steps + 1):
        x = motion.transition(x, dt)
        kind, noise = ("radar", RADAR_NOISE) if k % 2 else ("lidar", LIDAR_NOISE)
        exact = SENSOR_MODELS[kind].measure(motion.to_cartesian(x), np.array(POSE), np.array(OWN))
        errors = np.moveaxis(random.multivariate_normal(np.zeros(len(noise)), noise, batch), -1, 0)
        measurement = exact.reshape(-1, *(1 for _ in batch)) + errors
        yield scan(kind, k * dt, measurement, valid=random.random(batch) < detection, pose=POSE, velocity=OWN)


def run(filter, belief, seen, dt=0.1):
    updates = []
    for one in seen:
        updates.append(filter.update(filter.predict(belief, dt), one))
        belief = updates[-1].belief
    return updates


@every_kind
@pytest.mark.parametrize("motion", MODELS.values(), ids=MODELS)
def test_with_equal_models_it_is_the_filter_of_one(kind, motion):
    several, one = imm(kind, motion, motion, motion, stay=(1.0, 2.0, 3.0), initial=(0.2, 0.3, 0.5)), kind(motion)
    found, expected = (run(each, begun(each), scans(steps=14)) for each in (several, one))
    for a, b in zip(found, expected, strict=True):
        estimate, cartesian = several.cartesian(a.belief), one.cartesian(b.belief)
        np.testing.assert_allclose(estimate.mean, cartesian.mean, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(estimate.covariance, cartesian.covariance, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(a.innovation, b.innovation, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(a.innovation_covariance, b.innovation_covariance, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(a.whitened_innovation, b.whitened_innovation, rtol=1e-11, atol=1e-11)
    # Nothing tells the modes apart, so that their probabilities are those of the chain alone: its stationary ones,
    # by balance in proportion to the stays, from which it is 14 steps away.
    np.testing.assert_allclose(
        found[-1].belief.probability, np.array([0.2, 0.3, 0.5]) @ transition_probabilities((1.0, 2.0, 3.0), 1.4)
    )


def linear_case(steps=40, dt=0.2, seed=3):
    """Two levels of noise; lidar positions of a target that starts to swerve half way."""
    random = np.random.default_rng(seed)
    x = np.array([0.0, 0.0, 10.0, 2.0])
    for k in range(1, steps + 1):
        a = random.normal(0.0, 0.3 if k < steps / 2 else 8.0, 2)
        x = QUIET.transition(x, dt) + QUIET.noise_gain(x, dt) @ a
        yield scan("lidar", k * dt, x[:2] + random.multivariate_normal(np.zeros(2), LIDAR_NOISE))


MEAN, COVARIANCE = np.array([0.0, 0.0, 9.0, 1.0]), np.diag([1.0, 1.0, 4.0, 4.0])


def test_it_is_the_textbook_one_for_two_levels_of_noise():
    dt, chain, h = 0.2, expm(np.array([[-0.5, 0.5], [1.0, -1.0]]) * 0.2), np.eye(2, 4)
    filter = imm(KalmanFilter, QUIET, LIVELY, stay=(2.0, 1.0), initial=(0.6, 0.4))
    updates = run(filter, filter.begin(lambda _: Gaussian(MEAN, COVARIANCE)), linear_case(), dt)
    x, p, mu = [MEAN, MEAN], [COVARIANCE, COVARIANCE], np.array([0.6, 0.4])
    for seen, found in zip(linear_case(), updates, strict=True):
        c = mu @ chain
        w = chain * mu[:, None] / c
        x0 = [w[0, j] * x[0] + w[1, j] * x[1] for j in (0, 1)]
        p0 = [sum(w[i, j] * (p[i] + np.outer(x[i] - x0[j], x[i] - x0[j])) for i in (0, 1)) for j in (0, 1)]
        f = QUIET.jacobian(MEAN, dt)
        x, p, likelihood = [], [], []
        for j, motion in enumerate((QUIET, LIVELY)):
            predicted, spread = f @ x0[j], f @ p0[j] @ f.T + process_noise_covariance(motion, MEAN, dt)
            s = h @ spread @ h.T + LIDAR_NOISE
            gain = spread @ h.T @ np.linalg.inv(s)
            likelihood.append(stats.multivariate_normal.pdf(seen.measurement, h @ predicted, s))
            x.append(predicted + gain @ (seen.measurement - h @ predicted))
            p.append(spread - gain @ s @ gain.T)
        mu = c * likelihood / np.sum(c * likelihood)
        mean = mu @ np.array(x)
        covariance = sum(m * (q + np.outer(y - mean, y - mean)) for m, q, y in zip(mu, p, x, strict=True))
        np.testing.assert_allclose(found.belief.probability, mu, rtol=1e-9)
        estimate = filter.cartesian(found.belief)
        np.testing.assert_allclose(estimate.mean, mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(estimate.covariance, covariance, rtol=1e-9, atol=1e-9)
    quiet = np.array([update.belief.probability[0] for update in updates])
    assert quiet[5:20].mean() > 0.7
    assert quiet[25:].mean() < 0.3


@pytest.mark.parametrize("stay", [(2.0, 5.0), (1.0, 2.0, 8.0)])
def test_the_chain_does_not_depend_on_the_rate_of_scans(stay):
    once = transition_probabilities(stay, 1.0)
    rates = np.array([[-1.0 if i == j else 1 / (len(stay) - 1) for j in range(len(stay))] for i in range(len(stay))])
    np.testing.assert_allclose(once, expm(rates / np.array(stay)[:, None]), atol=1e-14)
    np.testing.assert_allclose(np.linalg.matrix_power(transition_probabilities(stay, 0.05), 20), once, atol=1e-13)
    np.testing.assert_allclose(once.sum(axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(transition_probabilities(stay, 1e6), np.tile(np.array(stay) / sum(stay), (len(stay), 1)))


@every_kind
def test_where_no_time_passes_no_mode_goes_over_to_another(kind):
    filter = imm(kind, *(MODELS[name] for name in MOTIONS), initial=(0.4, 0.3, 0.2, 0.1))
    belief = run(filter, begun(filter, (3,)), scans((3,), steps=2))[-1].belief
    np.testing.assert_array_equal(filter.chain(0.0), np.eye(4))
    found, expected = filter.predict_by(belief, 0.0, filter.chain(0.0)), filter.predict(belief, 0.0)
    np.testing.assert_array_equal(found.probability, expected.probability)
    for one, other in zip(found.modes, expected.modes, strict=True):
        # Each covariance that is computed is rounded up.
        np.testing.assert_allclose(one.mean, other.mean, rtol=1e-15, atol=1e-15)
        np.testing.assert_allclose(one.covariance, other.covariance, rtol=4 * linalg.MARGIN, atol=1e-15)


def test_without_a_measurement_the_modes_are_left_to_the_chain():
    filter = imm(ExtendedKalmanFilter, MODELS["cv"], MODELS["ctrv"], stay=(1.0, 4.0), initial=(0.9, 0.1))
    belief = begun(filter, (2,))
    predicted = filter.predict(belief, 0.5)
    expected = np.array([0.9, 0.1]) @ transition_probabilities((1.0, 4.0), 0.5)
    np.testing.assert_allclose(predicted.probability, np.tile(expected[:, None], 2), rtol=1e-14)
    seen = next(scans((2,)))
    seen = seen._replace(valid=np.array([True, False]), measurement=np.where([True, False], seen.measurement, np.nan))
    update = filter.update(predicted, seen)
    np.testing.assert_array_equal(update.belief.probability[:, 1], predicted.probability[:, 1])
    assert abs(update.belief.probability[0, 0] - expected[0]) > 1e-3
    for after, before in zip(update.belief.modes, predicted.modes, strict=True):
        np.testing.assert_allclose(after.mean[:, 1], before.mean[:, 1], rtol=1e-14)
        np.testing.assert_allclose(after.covariance[..., 1], before.covariance[..., 1], rtol=1e-14, atol=1e-14)
    np.testing.assert_array_equal(update.innovation == 0.0, [[False, True]] * 3)


@every_kind
def test_probabilities_sum_to_one_after_very_unlikely_measurements(kind):
    filter = imm(kind, QUIET, LIVELY, stay=(1e9, 1e9))
    belief = begun(filter)
    for k in range(4):
        belief = filter.predict(belief, 0.1)
        seen = scan("lidar", 0.1 * (k + 1), np.array([[40.0 + 3e3], [20.0 - 3e3 * k]])[:, 0])
        belief = filter.update(belief, seen).belief
        probability = belief.probability
        assert np.all(probability > 0.0)
        np.testing.assert_allclose(probability.sum(axis=0), 1.0, rtol=1e-14)
        assert all(np.isfinite(part).all() for part in filter.cartesian(belief))
    assert probability[1] > 0.99


@every_kind
@pytest.mark.parametrize("names", [("cv", "ctrv"), ("cv", "ca", "ctrv"), ("ctra", "ca")], ids=" ".join)
def test_a_batch_is_the_loop_over_its_members(kind, names):
    filter = imm(kind, *(MODELS[name] for name in names))
    batch = begun(filter, (3,))
    seen = list(scans((3,), steps=12, detection=0.8))
    together = run(filter, batch, seen)
    for i in range(3):
        beliefs = tuple(Belief(mode.mean[:, i], mode.covariance[..., i]) for mode in batch.modes)
        alone = MultiModelBelief(batch.probability[:, i], beliefs)
        for a, b in zip(together, run(filter, alone, [member(one, i) for one in seen]), strict=True):
            whole, one = filter.cartesian(a.belief), filter.cartesian(b.belief)
            np.testing.assert_allclose(whole.mean[:, i], one.mean, rtol=1e-11, atol=1e-11)
            np.testing.assert_allclose(whole.covariance[..., i], one.covariance, rtol=1e-10, atol=1e-11)
            np.testing.assert_allclose(a.belief.probability[:, i], b.belief.probability, rtol=1e-9)
            assert np.linalg.eigvalsh(one.covariance)[0] > 0.0


@pytest.mark.parametrize("target", MODELS)
@pytest.mark.parametrize("source", MODELS)
def test_mixing_conserves_what_both_states_have(source, target):
    """The Cartesian mean stays, the Cartesian covariance to first order; what the source lacks is the target's own."""
    motion, other_motion = MODELS[target], MODELS[source]
    own, other = (begun(ExtendedKalmanFilter(model), seed=seed) for model, seed in ((motion, 1), (other_motion, 2)))
    small = [Gaussian(belief.mean, 1e-4 * belief.covariance) for belief in (own, other)]
    mixed = in_state_of(motion, small[0], other_motion, small[1])
    expected, found = other_motion.cartesian_belief(small[1]), motion.cartesian_belief(mixed)
    np.testing.assert_allclose(found.mean, expected.mean, rtol=1e-12)
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-5, atol=1e-9)
    for i, name in enumerate(motion.components):
        if name in other_motion.components:
            k = other_motion.components.index(name)
            np.testing.assert_allclose(mixed.mean[i], small[1].mean[k], rtol=1e-12)
            np.testing.assert_allclose(mixed.covariance[i, i], small[1].covariance[k, k], rtol=1e-12)
        elif i >= 4:
            np.testing.assert_array_equal(mixed.mean[i], own.mean[i])
            np.testing.assert_array_equal(mixed.covariance[i, i], small[0].covariance[i, i])
    assert np.linalg.eigvalsh(mixed.covariance)[0] > 0.0


def test_a_motion_backwards_is_mixed_as_one():
    """A turning filter may state a motion by a negative speed and the opposite yaw."""
    ctrv = MODELS["ctrv"]
    forwards = begun(ExtendedKalmanFilter(ctrv))
    sign = np.array([1, 1, -1, 1, 1.0])
    backwards = Gaussian(
        sign * forwards.mean + np.array([0, 0, 0, np.pi, 0]), sign[:, None] * sign * forwards.covariance
    )
    for other_motion, other in (
        (ctrv, Gaussian(forwards.mean, forwards.covariance)),
        (MODELS["cv"], ctrv.cartesian_belief(Gaussian(forwards.mean, forwards.covariance))),
    ):
        mixed = in_state_of(ctrv, backwards, other_motion, other)
        assert mixed.mean[2] < 0.0
        assert np.cos(mixed.mean[3] - backwards.mean[3]) > 0.99
        np.testing.assert_allclose(ctrv.to_cartesian(mixed.mean), other_motion.to_cartesian(other.mean), rtol=1e-12)
        exact = ctrv.cartesian_belief(Gaussian(forwards.mean, forwards.covariance)).covariance
        np.testing.assert_allclose(ctrv.cartesian_belief(mixed).covariance[:2, :2], exact[:2, :2], rtol=1e-12)


def test_a_velocity_that_leaves_the_yaw_open_leaves_it_alone():
    """A vehicle that stands still: the filter with vx, vy knows no yaw, and does not take that of the other away."""
    ctrv, cv = MODELS["ctrv"], MODELS["cv"]
    own = Gaussian(np.array([40.0, 20.0, 0.01, 0.8, 0.1]), np.diag([0.1, 0.1, 0.02, 0.01, 0.04]))
    for velocity in ([0.0, 0.0], [-0.05, 0.02]):
        still = Gaussian(np.array([40.2, 19.9, *velocity]), np.diag([0.05, 0.05, 0.03, 0.02]))
        mixed = in_state_of(ctrv, own, cv, still)
        direction = np.array([np.cos(0.8), np.sin(0.8)])
        np.testing.assert_allclose(mixed.mean, [40.2, 19.9, direction @ velocity, 0.8, 0.1], rtol=1e-12)
        along = direction @ np.diag([0.03, 0.02]) @ direction
        np.testing.assert_allclose(mixed.covariance, np.diag([0.05, 0.05, along, 0.01, 0.04]), rtol=1e-12)
