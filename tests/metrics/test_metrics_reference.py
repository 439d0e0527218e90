"""The reference: the Cramer-Rao bound where it is known in closed form, and what it assumes."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.places import SCENARIOS
from tests.support.scenes import LIDAR_NOISE, RADAR_NOISE, fixed_observer, scan, truth

from trackbench.engine.choice import compute_by
from trackbench.engine.equations import by_numpy
from trackbench.filters import Belief, ExtendedKalmanFilter, KalmanFilter
from trackbench.metrics.reference import (
    BoundStart,
    ConditionalBound,
    entry_velocity,
    information,
    typical_acceleration,
)
from trackbench.models.motion import ConstantVelocity
from trackbench.models.sensors import SENSOR_MODELS, Lidar, Mount, Radar
from trackbench.runner.run import run_scenario
from trackbench.runner.work import work_of
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of
from trackbench.sensing.scans import ideal_sensors
from trackbench.truth.scripted import script
from trackbench.truth.sources import ScriptedTruth

OWN_MODEL = SCENARIOS / "scripted" / "own_model.yaml"
LIDAR = Lidar(rate_hz=10, position_sigma_m=0.15)
RADAR = Radar(
    rate_hz=10,
    phase_s=0.05,
    range_sigma_m=0.3,
    azimuth_sigma_deg=float(np.rad2deg(0.02)),
    range_rate_sigma_mps=0.2,
    mount=Mount(x_m=2, yaw_deg=20),
)
PRIOR = BoundStart(velocity_sigma=3.0, position_sigma=1.0)


def moving(steps=41, dt=0.05, alive=None):
    """Two objects that move evenly past a fixed observer."""
    time = np.arange(steps) * dt
    px = np.stack([20 + 10 * time, 5 - 3 * time], axis=1)[..., None]
    py = np.stack([4 - 2 * time, 15 + 8 * time], axis=1)[..., None]
    vx = np.broadcast_to(np.array([10.0, -3.0])[:, None], px.shape)
    vy = np.broadcast_to(np.array([-2.0, 8.0])[:, None], px.shape)
    return truth(time, px, py, vx, vy, observer=fixed_observer(steps, 1.0, 2.0, 0.3), alive=alive)


def bound(of, sensors, prior=PRIOR, sigma=2.0, valid=None, drawn=None, compute=by_numpy):
    """Of what is visible, or valid ``(measurements, objects, runs)``."""
    ideal = ideal_sensors(of, sensors)
    given = {s.name: s.visible if valid is None else valid for s in ideal}
    instants = np.unique(np.concatenate([s.steps for s in ideal]))
    told = {s.name: information(s, of) for s in ideal}
    return ConditionalBound(of, told, sigma, prior, instants, drawn).of_runs(given, compute), ideal, instants


def both(covariance):
    """Variances of position and velocity, of the covariance of one target."""
    variance = np.diag(covariance)
    return [variance[:2].sum(), variance[2:].sum()]


@pytest.mark.parametrize("engine", ["numpy", "fused"])
def test_in_each_run_it_is_the_covariance_of_the_kalman_filter_that_has_the_same_measurements(engine):
    of = moving()
    valid = np.random.default_rng(1).random((21, 2, 30)) < np.linspace(0.1, 1.0, 30)
    found, _, instants = bound(of, {"lidar": LIDAR}, valid=valid, compute=compute_by(engine))
    assert found.shape == (2, 21, 2, 30)
    kalman = KalmanFilter(ConstantVelocity(acceleration_sigma_mps2=2.0))
    for i, number in np.ndindex(2, 30):
        belief = Belief(np.zeros(4), np.diag([1.0, 1.0, 9.0, 9.0]))
        for row, step in enumerate(instants):
            if row > 0:
                belief = kalman.predict(belief, of.time[step] - of.time[instants[row - 1]])
            belief = kalman.update(belief, scan("lidar", of.time[step], np.zeros(2), valid[row, i, number])).belief
            np.testing.assert_allclose(found[:, row, i, number], both(belief.covariance), rtol=1e-9)


def test_of_nonlinear_measurements_it_is_the_covariance_of_an_extended_filter_that_knows_the_truth():
    of = moving()
    found, ideal, instants = bound(of, {"radar": RADAR, "lidar": LIDAR})
    extended = ExtendedKalmanFilter(ConstantVelocity(acceleration_sigma_mps2=2.0))
    state = np.stack([of.px, of.py, of.vx, of.vy])[..., 0]
    for i in range(2):
        covariance, before = np.diag([1.0, 1.0, 9.0, 9.0]), 0
        for row, step in enumerate(instants):
            belief = extended.predict(Belief(state[:, before, i], covariance), of.time[step] - of.time[before])
            belief, before = belief._replace(mean=state[:, step, i]), step
            for sensor in ideal:
                for k in np.flatnonzero(sensor.steps == step):
                    pose, own = sensor.pose[:, k], sensor.velocity[:, k]
                    exact = SENSOR_MODELS[sensor.name].measure(belief.mean, pose, own)
                    seen = scan(sensor.name, 0.0, exact, pose=tuple(pose), velocity=tuple(own))
                    np.testing.assert_allclose(
                        sensor.noise_covariance, RADAR_NOISE if sensor.name == "radar" else LIDAR_NOISE
                    )
                    belief = extended.update(belief, seen).belief
            covariance = belief.covariance
            np.testing.assert_allclose(found[:, row, i, 0], both(covariance), rtol=1e-8)


def test_before_the_first_measurement_there_is_no_bound_and_then_that_of_the_measurement():
    valid = np.ones((21, 2, 2), dtype=bool)
    valid[:5, 1, 1] = False
    found, _, _ = bound(moving(), {"lidar": LIDAR}, BoundStart(velocity_sigma=20.0), valid=valid)
    assert (found[:, :5, 1, 1] == 0.0).all()
    assert np.isfinite(found[:, :, 0]).all()
    assert np.isfinite(found[:, :, 1, 0]).all()
    np.testing.assert_allclose(found[:, 5, 1, 1], [2 * 0.15**2, 2 * 20.0**2], rtol=1e-6)


def test_from_the_truth_it_begins_when_the_target_is_there():
    alive = np.ones((41, 2), dtype=bool)
    alive[:10, 1] = False
    valid = np.zeros((21, 2, 1), dtype=bool)
    found, _, _ = bound(moving(alive=alive), {"lidar": LIDAR}, valid=valid)
    assert (found[:, :5, 1] == 0.0).all()
    assert np.isfinite(found[:, 5:, 1]).all()
    np.testing.assert_allclose(found[:, 5, 1, 0], [2.0, 18.0])
    np.testing.assert_allclose(found[:, 0, 0, 0], [2.0, 18.0])


def test_from_the_truth_it_begins_at_the_tracker_s_own_instants():
    """The target comes at step 5, at which only another sensor measures."""
    alive = np.ones((41, 2), dtype=bool)
    alive[:5, 1] = False
    of = moving(alive=alive)
    (lidar,) = ideal_sensors(of, {"lidar": LIDAR})
    told, seen = {"lidar": information(lidar, of)}, {"lidar": np.zeros((21, 2, 1), dtype=bool)}
    found = ConditionalBound(of, told, 2.0, PRIOR, np.arange(41)).of_runs(seen)
    assert (found[:, :6, 1] == 0.0).all()
    np.testing.assert_allclose(found[:, 6, 1, 0], [2.0, 18.0])


def test_an_acceleration_that_is_drawn_at_every_step_of_the_truth_moves_a_target_less():
    """Over two steps of 0.05 s: (dt^2/2)^2 + (3 dt^2/2)^2 and 2 dt^2 in place of (2 dt)^4/4 and (2 dt)^2."""
    of, valid = moving(), np.zeros((21, 2, 1), dtype=bool)
    each, dt = bound(of, {"lidar": LIDAR}, valid=valid, drawn=np.arange(41))[0][:, 1, 0, 0], 0.05
    coarse = bound(of, {"lidar": LIDAR}, valid=valid)[0][:, 1, 0, 0]
    straight = np.array([2 * (1 + 9 * (2 * dt) ** 2), 18.0])
    np.testing.assert_allclose(each - straight, 2 * 4.0 * np.array([10 * dt**4 / 4, 2 * dt**2]), rtol=1e-9)
    np.testing.assert_allclose(coarse - straight, 2 * 4.0 * np.array([(2 * dt) ** 4 / 4, (2 * dt) ** 2]), rtol=1e-9)


def test_between_its_measurements_the_bound_is_that_of_a_prediction_from_the_latest():
    """Instants at which only another sensor measures: nothing is added up there."""
    of = moving()
    (lidar,) = ideal_sensors(of, {"lidar": LIDAR})
    told, seen = {"lidar": information(lidar, of)}, {"lidar": lidar.visible}
    at_all = ConditionalBound(of, told, 2.0, PRIOR, np.arange(41)).of_runs(seen)
    at_its_own = ConditionalBound(of, told, 2.0, PRIOR, lidar.steps).of_runs(seen)
    np.testing.assert_allclose(at_all[:, ::2], at_its_own, rtol=1e-12)
    motion, belief = ConstantVelocity(acceleration_sigma_mps2=2.0), Belief(np.zeros(4), np.diag([1.0, 1.0, 9.0, 9.0]))
    kalman = KalmanFilter(motion)
    belief = kalman.predict(kalman.update(belief, scan("lidar", 0.0, np.zeros(2))).belief, 0.05)
    np.testing.assert_allclose(at_all[:, 1, 0, 0], both(belief.covariance), rtol=1e-9)


@pytest.mark.parametrize(("runs", "share"), [(1, 0.7), (3, 0.7), (30, 0.7), (30, 1.0)])
@pytest.mark.parametrize("prior", [PRIOR, BoundStart(velocity_sigma=20.0)])
def test_kernels_give_the_bound_that_numpy_gives(prior, runs, share):
    """Of two sensors, also at instants at which neither measures; for few runs, and where all runs are alike."""
    alive = np.ones((41, 2), dtype=bool)
    alive[:9, 1] = False
    of = moving(alive=alive)
    ideal = ideal_sensors(of, {"radar": RADAR, "lidar": LIDAR})
    draw = np.random.default_rng(1)
    seen = {s.name: s.visible & (draw.random((len(s.steps), 2, runs)) < share) for s in ideal}
    made = ConditionalBound(of, {s.name: information(s, of) for s in ideal}, 2.0, prior, np.arange(41))
    by_kernels = made.of_runs(seen, compute_by("fused"))
    assert by_kernels.shape == (2, 41, 2, runs if share < 1.0 else 1)
    np.testing.assert_allclose(by_kernels, made.of_runs(seen), rtol=1e-9)


def test_a_target_that_starts_at_the_sensor_leaves_the_bound_finite():
    objects = {"car": {"pieces": [{"white": {"motion": "cv", "acceleration_sigma_mps2": 1.0}}]}}
    config = ScriptedTruth.model_validate({"duration_s": 2.0, "rate_hz": 10, "objects": objects})
    radar = Radar(rate_hz=10, range_sigma_m=0.3, azimuth_sigma_deg=0.5, range_rate_sigma_mps=0.1)
    found = bound(script(config, 1, "test", 1), {"radar": radar}, BoundStart(velocity_sigma=1.0), sigma=1.0)[0]
    assert np.all(found[:, 1:] > 0.0)
    assert np.all(found[0, 1:] < 2 * 0.3**2)


def scripted(rate_hz=20, **piece):
    """10 s of a target that starts at 10 m/s, repeated in 400 runs where its motion is drawn."""
    start = {"speed_mps": 10.0, "course_deg": 30.0}
    objects = {"car": {"start": start, "pieces": [piece]}}
    config = ScriptedTruth.model_validate({"duration_s": 10.0, "rate_hz": rate_hz, "objects": objects})
    return script(config, 1, "test", 400)


def test_the_typical_acceleration_of_a_turn_is_that_of_its_velocity_vector():
    """Speed times turn rate is 4 m/s^2; over a step the velocity turns by 0.4 / 20 rad, along the chord."""
    turn = scripted(turn_rate_degps=float(np.rad2deg(0.4)))
    chord = 2 * 10.0 * np.sin(0.4 / 20 / 2) * 20
    assert typical_acceleration([turn]) == pytest.approx(chord / np.sqrt(2), rel=1e-9)
    assert typical_acceleration([turn]) == pytest.approx(4.0 / np.sqrt(2), rel=1e-4)


def test_the_typical_acceleration_is_that_of_the_living():
    """The second object leaves at 0.2 s: its change of speed until then counts, and its leap afterwards does not."""
    time = np.array([0.0, 0.1, 0.2, 0.4])
    vx = np.array([[10.0, 5.0], [10.3, 5.0], [10.6, 5.8], [11.2, 99.0]])[..., None]
    alive = np.array([[True, True], [True, True], [True, True], [True, False]])
    of = truth(time, 0.0 * vx, 0.0 * vx, vx, 0.0 * vx, alive=alive)
    expected = (0.4 * 3.0**2 + 0.1 * 8.0**2) / (0.4 + 0.2)
    assert typical_acceleration([of]) == pytest.approx(np.sqrt(expected / 2))
    assert typical_acceleration([replace(of, alive=np.zeros((4, 2), dtype=bool))]) == 0.0


def test_the_entry_velocity_is_that_at_which_targets_appear():
    """3 and 4 m/s of one that is there at first; 12 m/s of one that comes when it has slowed down from 30."""
    alive = np.array([[True, False, False], [True, True, False]])
    vx, vy = np.array([[[3.0], [30.0], [50.0]], [[9.0], [12.0], [50.0]]]), np.array([[[4.0], [0.0], [0.0]]] * 2)
    of = truth(np.arange(2) / 10, 0.0 * vx, 0.0 * vx, vx, vy, alive=alive)
    assert entry_velocity([of]) == pytest.approx(np.sqrt((5.0**2 + 12.0**2) / 2 / 2))
    assert entry_velocity([replace(of, speed=0.0 * of.speed)]) == 1.0
    assert entry_velocity([of, scripted()]) == pytest.approx(np.sqrt((5.0**2 + 12.0**2 + 10.0**2) / 3 / 2))


def two_runs(second):
    """A target at (40, 0) in one run and at ``second`` in the other, at rest."""
    place = np.broadcast_to(np.array([[40.0, second[0]], [0.0, second[1]]])[:, None, None], (2, 2, 1, 2))
    return truth(np.arange(2) / 10, *place, 0.0, 0.0, observer=fixed_observer(2))


def along(sensor, place):
    h = SENSOR_MODELS[sensor.config.type].jacobian(np.array([*place, 0, 0]), sensor.pose[:, 0], sensor.velocity[:, 0])
    return h.T @ np.linalg.inv(sensor.noise_covariance) @ h


def of_first(sensor, of):
    root = information(sensor, of).root[:, :, 0, 0]
    return root.T @ root


def test_the_information_is_the_mean_over_the_runs():
    of = two_runs((0.0, 20.0))
    (radar,) = ideal_sensors(of, {"sensor": RADAR})
    mean = (along(radar, (40.0, 0.0)) + along(radar, (0.0, 20.0))) / 2
    np.testing.assert_allclose(of_first(radar, of), mean, atol=1e-9)


def test_a_run_out_of_range_has_no_part_in_it():
    of = two_runs((0.0, 200.0))
    (radar,) = ideal_sensors(of, {"sensor": RADAR.model_copy(update={"max_range_m": 100.0})})
    np.testing.assert_allclose(of_first(radar, of), along(radar, (40.0, 0.0)), atol=1e-9)


@pytest.mark.parametrize(
    ("settings", "drawn"),
    [
        (("score.reference.acceleration_sigma_mps2=null",), True),
        ((), True),
        (("score.reference.acceleration_sigma_mps2=2.1",), False),
        (("truth.objects.left.pieces=[{white: {motion: cv, acceleration_sigma_mps2: 3}}]",), False),
    ],
)
def test_the_bound_s_acceleration_is_as_drawn_only_where_it_is_that_of_every_object(settings, drawn):
    loaded = load_scenario(OWN_MODEL, [*settings, "monte_carlo.runs=40"])
    work = work_of(loaded, truths_of(loaded))
    assert work.reference is not None
    assert work.reference.as_drawn is drawn
    if drawn:
        assert work.reference.acceleration == 2.0
    assert work.reference.velocity_sigma == pytest.approx(np.sqrt((5**2 + 10**2) / 2 / 2))


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ((), ("bound", "truth", "Cramér-Rao bound")),
        (("score.reference.acceleration_sigma_mps2=3",), ("reference", "scenario", "reference")),
        (
            ("truth.objects.left.pieces=[{turn_rate_degps: 9}]",),
            ("reference", "truth", "reference"),
        ),
    ],
)
def test_a_result_calls_it_a_bound_only_where_it_is_one(settings, expected):
    loaded = load_scenario(OWN_MODEL, [*settings, "monte_carlo.runs=2", "truth.duration_s=1", "expect=[]"])
    found = run_scenario(loaded, truths_of(loaded)).summary.reference
    assert (found.kind, found.acceleration_from, found.label) == expected
    assert ("no tracker can be expected" in found.meaning) == (found.kind == "bound")
    assert ("a tracker can be below it" in found.meaning) == (found.kind == "reference")
    assert ("the RMS of the true one" in found.meaning) == (expected[:2] == ("reference", "truth"))
