"""Effects of sensors: geometry by hand, statistics by closed forms, and bits that stay where there is none."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from tests.support.scenes import fixed_observer, truth

from trackbench.base.types import Observer
from trackbench.models.sensors import Lidar, Radar
from trackbench.models.sensors.detection import FALSE_ALARM_PROBABILITY, signal_ratio
from trackbench.models.sensors.effects import gauss_markov
from trackbench.models.sensors.effects.processes import CORRELATION_TIME, smooth_process
from trackbench.models.sensors.effects.signal import SignalRange, received_power
from trackbench.sensing.detections import draw_false_alarms, sense_hidden
from trackbench.sensing.scans import affected, ideal_sensors, sense_known

RADAR = {"rate_hz": 10, "range_sigma_m": 0.3, "azimuth_sigma_deg": 1.0, "range_rate_sigma_mps": 0.2}
LIDAR = {"rate_hz": 10, "position_sigma_m": 0.15}
EXACT = {"rate_hz": 10, "range_sigma_m": 1e-6, "azimuth_sigma_deg": 1e-7, "range_rate_sigma_mps": 1e-6}


def ideal(config, position=(50.0, 0.0), velocity=(0.0, 0.0), steps=400, heading=0.0, yaw_rate=0.0, dt=0.1):
    """A sensor at the origin that looks along x, and one object, 4 m by 2 m."""
    shape = (steps, 1, 1)
    time = np.arange(steps) * dt
    px, py = (p + v * time[:, None, None] for p, v in zip(position, velocity, strict=True))
    vx, vy = (np.full(shape, v) for v in velocity)
    of = truth(time, px, py, vx, vy, observer=fixed_observer(steps))
    one = {"heading": np.full(shape, heading), "yaw_rate": np.full(shape, yaw_rate)}
    size = {"length": np.array([4.0]), "width": np.array([2.0])}
    return ideal_sensors(replace(of, **one, **size), {"sensor": config})[0]


def runs(sensor, count):
    """``(m, instants, runs)`` measurements of the object."""
    return np.stack([scan.measurement for scan in sense_known([sensor], 1, "effects", range(count)).scans], axis=1)


def detections(sensor, count):
    """``(instants, runs)`` whether the object is detected."""
    return np.stack([scan.valid for scan in sense_known([sensor], 1, "effects", range(count)).scans])


def alarms_of(sensor, run):
    """Those of the first effect that makes any, in one run."""
    one = range(run, run + 1)
    ((alarms,),) = draw_false_alarms(sensor, 1, "effects", one, affected(sensor, 1, "effects", one))
    return alarms


def test_a_gauss_markov_process_is_the_recursion_of_textbooks():
    time, white = np.arange(30) * 0.1, np.random.default_rng(2).standard_normal((30, 3))
    a = np.exp(-0.1 / 0.5)
    expected = [white[0]]
    for draw in white[1:]:
        expected.append(a * expected[-1] + np.sqrt(1 - a * a) * draw)
    np.testing.assert_allclose(gauss_markov(time, 0.5, white), expected, rtol=0, atol=1e-13)


def test_a_process_of_second_order_has_the_law_of_gelb_at_any_instants():
    """White draws of one for each instant give the factor of the covariance."""
    even, uneven = np.arange(40) * 0.1, np.cumsum(np.random.default_rng(0).uniform(0.01, 0.3, 40))
    for time, time_s in itertools.product((even, uneven), (0.1, 0.5, 60.0)):
        factor = gauss_markov(time, time_s, np.eye(40), order=2)
        apart = CORRELATION_TIME * np.abs(time[:, None] - time) / time_s
        np.testing.assert_allclose(factor @ factor.T, (1 + apart) * np.exp(-apart), rtol=0, atol=1e-13)
    assert (1 + CORRELATION_TIME) * np.exp(-CORRELATION_TIME) == pytest.approx(np.exp(-1), rel=1e-12)


@pytest.mark.parametrize(("order", "scale"), [(1, 1.0), (2, CORRELATION_TIME)])
def test_a_process_stays_over_no_step_and_forgets_all_over_an_endless_one(order, scale):
    """White draws of one give the factor of the covariance: of 36 instants after which all is forgotten, and 4 more."""
    steps = np.tile([0.0, 0.3, 2.0, 0.01, 15.0], 8)[:39]
    steps[35] = np.inf
    path = np.concatenate([[0.0], np.cumsum(np.where(np.isinf(steps), 1e3, steps))])
    apart = scale * np.abs(path[:, None] - path)
    expected = np.exp(-apart) * (1.0 if order == 1 else 1 + apart)
    factor = gauss_markov(path, 1.0, np.eye(40)) if order == 1 else smooth_process(steps[:, None], np.eye(40))
    np.testing.assert_allclose(factor @ factor.T, expected, rtol=0, atol=1e-13)


def test_what_is_to_come_does_not_change_a_process():
    white, steps = np.random.default_rng(3).standard_normal((40, 2, 3)), np.full((39, 1, 1), 0.4)
    known = smooth_process(steps, white)
    steps[20:] = np.nan
    assert smooth_process(steps, white)[:21].tobytes() == known[:21].tobytes()


@pytest.mark.parametrize("effects", [[], "ideal"])
def test_without_effects_every_bit_is_that_of_a_sensor_that_knows_none(effects):
    with_none, stated = ideal(Radar(**RADAR)), ideal(Radar(effects=effects, **RADAR))
    assert runs(with_none, 3).tobytes() == runs(stated, 3).tobytes()


def test_effects_leave_the_white_noise_and_the_detections_as_they_were():
    config = {**RADAR, "detection_probability": 0.8}
    plain, moved = ideal(Radar(**config)), ideal(Radar(effects=[{"type": "reflection", "along_m": 0.5}], **config))
    a, b = runs(plain, 2), runs(moved, 2)
    np.testing.assert_array_equal(np.isnan(a), np.isnan(b))
    # The object is straight ahead and points away: its wandering along changes the range alone.
    np.testing.assert_allclose(a[1:], b[1:], atol=1e-12)
    assert np.nanstd(b[0] - a[0]) > 0.3


def test_the_point_nearest_to_the_sensor_by_hand():
    # From straight behind: the middle of the rear. From 30 m to its left and 2.5 m behind its centre: the corner.
    near = [{"type": "reflection", "toward_sensor": 1.0}]
    behind = affected(ideal(Radar(effects=near, **RADAR)), 1, "effects", range(1))
    np.testing.assert_allclose(behind.bodies.target[:2, 0, 0, 0], [48, 0])
    beside = affected(ideal(Radar(effects=near, **RADAR), position=(2.5, -30.0)), 1, "effects", range(1))
    np.testing.assert_allclose(beside.bodies.target[:2, 0, 0, 0], [0.5, -29])
    half = affected(
        ideal(Radar(effects=[{"type": "reflection", "toward_sensor": 0.5}], **RADAR)), 1, "effects", range(1)
    )
    np.testing.assert_allclose(half.bodies.target[:2, 0, 0, 0], [49, 0])


def test_the_range_rate_is_that_of_the_point_when_the_body_turns():
    # Heading north at x = 50, turning left at 1 rad/s: the right side, 1 m nearer to the sensor at the origin, moves
    # north with the turn; the corner in front of it, 2 m ahead, away from the axis of the turn: to the west.
    sensor = ideal(
        Radar(effects=[{"type": "reflection", "toward_sensor": 1.0}], **RADAR),
        position=(50.0, -2.0),
        heading=np.pi / 2,
        yaw_rate=1.0,
    )
    sensed = affected(sensor, 1, "effects", range(1))
    # Nearest to the origin is the corner (49, 0), at (-1, 2) from the centre: its velocity is that of a rotation.
    np.testing.assert_allclose(sensed.bodies.target[:, 0, 0, 0], [49, 0, -2, -1], atol=1e-12)
    np.testing.assert_allclose(sensed.ideal()[:, 0, 0, 0], [49, 0, -2], atol=1e-12)


def test_the_wandering_has_its_standard_deviations_and_its_time_constant():
    effects = [{"type": "reflection", "along_m": 0.4, "across_m": 0.3, "time_s": 1.0}]
    sensor = ideal(Radar(effects=effects, **RADAR), heading=0.5, steps=200)
    points = affected(sensor, 1, "effects", range(800)).bodies.target[:2, :, 0]
    c, s = np.cos(0.5), np.sin(0.5)
    offset = points - np.array([50.0, 0.0])[:, None, None]
    along, across = c * offset[0] + s * offset[1], c * offset[1] - s * offset[0]
    # Effective number of independent draws: 800 runs of 20 s, each of 10 s per time constant of the square.
    free = 800 * 20
    for values, sigma in ((along, 0.4), (across, 0.3)):
        low, high = stats.chi2.ppf([1e-4, 1 - 1e-4], free) / free
        assert low < np.mean(values**2) / sigma**2 < high
        lag = np.mean(values[10:] * values[:-10]) / sigma**2
        assert lag == pytest.approx(np.exp(-1), abs=5 / np.sqrt(free))


def test_the_faces_that_a_lidar_sees_by_hand():
    faces = [{"type": "faces"}]
    behind = affected(ideal(Lidar(effects=faces, **LIDAR)), 1, "effects", range(1))
    np.testing.assert_allclose(behind.bodies.target[:2, 0, 0, 0], [48, 0])
    beside = affected(ideal(Lidar(effects=faces, **LIDAR), position=(0.0, 30.0)), 1, "effects", range(1))
    np.testing.assert_allclose(beside.bodies.target[:2, 0, 0, 0], [0, 29])
    # At 45 degrees a face looks as wide as it is: 2 m of rear and 4 m of side.
    both = affected(ideal(Lidar(effects=faces, **LIDAR), position=(30.0, 30.0)), 1, "effects", range(1))
    np.testing.assert_allclose(both.bodies.target[:2, 0, 0, 0], [30 - 2 / 3, 30 - 2 / 3])
    inside = affected(ideal(Lidar(effects=faces, **LIDAR), position=(0.5, 0.0)), 1, "effects", range(1))
    np.testing.assert_allclose(inside.bodies.target[:2, 0, 0, 0], [0.5, 0])


SIGNAL = {"type": "signal_to_noise", "half_range_m": 100.0, "stated_at_m": 60.0}


@pytest.mark.parametrize("distance", [60.0, 100.0, 150.0])
def test_detections_follow_the_curve_of_swerling(distance):
    sensor = ideal(Radar(effects=[SIGNAL], **RADAR), position=(distance, 0.0), steps=1)
    detected = detections(sensor, 20_000)
    expected = FALSE_ALARM_PROBABILITY ** (1 / (1 + float(signal_ratio(np.array(distance), 100.0))))
    low, high = stats.binom.ppf([1e-4, 1 - 1e-4], detected.shape[1], expected)
    assert low <= detected[0].sum() <= high


@pytest.mark.parametrize("ratio", [5.0, 18.93, 100.0])
def test_the_noise_of_a_scan_is_drawn_anew_while_the_reflection_of_a_frozen_target_stays(ratio):
    """By Marcum's Q: of the power of a known reflection in noise, whose mean over reflections is the joint one."""
    level = -np.log(FALSE_ALARM_PROBABILITY)
    white = np.random.default_rng(2).standard_normal((2, 4, 1, 200_000))
    detected = received_power(np.full((2, 1, 1), ratio), np.zeros((1, 1, 1)), white)[:, 0] > level
    # Twice the power has a noncentral chi-squared distribution with two degrees of freedom.
    reflections = stats.expon.ppf((np.arange(2000) + 0.5) / 2000)
    given = stats.ncx2.sf(2 * level, 2, 2 * ratio * reflections)
    missed = 1 - given.mean()
    hit_after_miss = np.mean(given * (1 - given)) / missed
    count = (~detected[0]).sum()
    low, high = stats.binom.ppf([1e-4, 1 - 1e-4], count, hit_after_miss)
    assert low <= (~detected[0] & detected[1]).sum() <= high
    assert 0.03 < hit_after_miss < 0.3


def test_the_power_is_exponential_and_its_correlation_is_that_of_the_aspect():
    turned = np.abs(np.random.default_rng(0).normal(0, 0.4, (39, 1, 1)))
    white = np.random.default_rng(1).standard_normal((40, 4, 1, 40_000))
    power = received_power(np.full((40, 1, 1), 4.0), turned, white)[:, 0]
    for instant in (0, 19, 39):
        assert stats.kstest(power[instant] / 5.0, "expon").pvalue > 1e-3
    path = np.concatenate([[0.0], np.cumsum(turned)])
    apart = CORRELATION_TIME * np.abs(path[:, None] - path)
    # Of the amplitude 4/5 of the power is the vehicle's, the rest noise.
    amplitude = 0.8 * (1 + apart) * np.exp(-apart) + 0.2 * np.eye(40)
    # The correlation of 40,000 pairs of exponential variables has a standard error of at most 0.01.
    assert np.abs(np.corrcoef(power) - amplitude**2).max() < 0.05


@pytest.mark.parametrize("rate_hz", [10, 50])
def test_the_amplitude_has_the_autocorrelation_of_the_aspect_change_at_any_scan_rate(rate_hz):
    """A line of sight that turns ever faster, 5 mrad in 3 s; white draws of one give the factor of the covariance."""
    time = np.arange(3 * rate_hz + 1) / rate_hz
    aspect = 5e-3 * (time / 3) ** 2 / (299_792_458.0 / (2 * 1.8 * 77e9))
    factor = smooth_process(np.diff(aspect)[:, None], np.eye(len(time)))
    apart = CORRELATION_TIME * np.abs(aspect[:, None] - aspect)
    np.testing.assert_allclose(factor @ factor.T, (1 + apart) * np.exp(-apart), rtol=0, atol=1e-12)


def test_a_signal_decorrelates_over_the_aspect_of_its_carrier_and_of_the_width():
    """By the noise, which follows the power: over the aspect of 1.8 m at 77 GHz, and of one half of that at 154 GHz."""
    for carrier_ghz in (77.0, 154.0):
        # At 100 m the signal is 190,000 times the noise.
        signal = SIGNAL | {"half_range_m": 1000.0, "carrier_ghz": carrier_ghz}
        still, aspect = np.zeros((2, 1, 1)), 299_792_458.0 / (2 * 1.8 * carrier_ghz * 1e9)
        assert aspect == pytest.approx(1.1e-3 * 77 / carrier_ghz, rel=0.02)
        of = truth(np.arange(2) * 0.1, 100 + still, still, still, still, observer=fixed_observer(2))
        heading = np.array([0.0, aspect])[:, None, None]
        of = replace(of, heading=heading, length=np.array([4.5]), width=np.array([1.8]))
        (sensor,) = ideal_sensors(of, {"sensor": Radar(**RADAR, effects=[signal])})
        scale = affected(sensor, 1, "effects", range(20_000)).scale[0, :, 0]
        power = scale[:, (scale > 0).all(axis=0)] ** -2.0
        assert np.corrcoef(power)[0, 1] == pytest.approx(np.exp(-2), abs=0.03)


def test_the_noise_grows_as_the_signal_falls_and_a_broad_side_is_stronger():
    def spread(distance, heading=0.0, **keys):
        effects = [{"type": "signal_to_noise", "half_range_m": 200.0, "stated_at_m": 60.0, **keys}]
        sensor = ideal(Radar(effects=effects, **RADAR), position=(distance, 0.0), heading=heading, steps=1)
        return np.nanmedian(np.abs(runs(sensor, 10_000)[0] - distance)) / 0.3

    # The ratio falls by 16 from 60 to 120 m, so that the standard deviation grows by 4, but for the few undetected.
    assert spread(120.0) / spread(60.0) == pytest.approx(4, rel=0.1)
    assert spread(60.0) / spread(60.0, heading=np.pi / 2, side_db=6.0) == pytest.approx(10**0.3, rel=0.1)
    assert spread(120.0, constant_share=1.0) == pytest.approx(stats.norm.ppf(0.75), rel=0.05)


@pytest.mark.parametrize("order", [1, 2])
def test_correlated_errors_keep_the_variance_and_have_their_time_constant(order):
    effects = [{"type": "correlated_errors", "share": 0.5, "time_s": 2.0, "order": order}]
    sensor = ideal(Radar(effects=effects, **RADAR), steps=100)
    error = (runs(sensor, 2000)[0] - 50.0) / 0.3
    assert np.mean(error**2) == pytest.approx(1, abs=0.04)
    for lag in (1, 10, 30):
        apart = lag * 0.1 / 2 * (CORRELATION_TIME if order == 2 else 1)
        expected = 0.5 * np.exp(-apart) * (1 + apart if order == 2 else 1)
        assert np.mean(error[lag:] * error[:-lag]) == pytest.approx(expected, abs=0.04)


def test_slow_errors_do_not_follow_the_power_of_a_scan_and_the_white_part_does():
    slow = {"type": "correlated_errors", "share": 0.5, "time_s": 2.0}
    sensor = ideal(Radar(effects=[SIGNAL, slow], **RADAR), position=(60.0, 0.0), steps=1)
    sensed = affected(sensor, 1, "effects", range(20_000))
    seen = sensed.probability[0, 0] > 0
    power, error = 1 / sensed.scale[0, 0, 0, seen] ** 2, np.abs(sensed.error[0, 0, 0, seen])
    weak, strong = power < np.median(power), power > np.median(power)
    assert np.mean(error[weak]) / np.mean(error[strong]) == pytest.approx(1, abs=0.04)
    assert np.std(1 / power) > 0
    # At the stated range the variance is that of the options at the mean power, times the mean of 1 / P if detected.
    growth = SignalRange(half_range_m=100.0, stated_at_m=60.0).mean_variance_factor(np.array(60.0))
    assert np.mean(sensed.error[0, 0, 0, seen] ** 2) / 0.3**2 == pytest.approx(0.5 * growth, rel=0.05)


def test_a_bias_is_drawn_once_a_run():
    effects = [{"type": "bias", "sigmas": {"azimuth_deg": 0.5}}]
    azimuth = np.rad2deg(runs(ideal(Radar(effects=effects, **EXACT), steps=5), 2000)[1])
    assert np.ptp(azimuth, axis=0).max() < 1e-5
    low, high = stats.chi2.ppf([1e-4, 1 - 1e-4], 2000) / 2000
    assert low < np.mean(azimuth[0] ** 2) / 0.25 < high


def test_quantised_measurements_are_whole_steps():
    effects = [{"type": "quantised", "steps": {"range_m": 0.25, "azimuth_deg": 0.5}}]
    values = runs(ideal(Radar(effects=effects, **RADAR)), 2)
    np.testing.assert_allclose(values[0] / 0.25, np.rint(values[0] / 0.25), atol=1e-9)
    np.testing.assert_allclose(np.rad2deg(values[1]) / 0.5, np.rint(np.rad2deg(values[1]) / 0.5), atol=1e-9)
    assert len(np.unique(values[2])) == values[2].size
    # Behind the sensor, where the rounded azimuth would leave (-pi, pi].
    config = {**EXACT, "azimuth_sigma_deg": 1.0, "effects": [{"type": "quantised", "steps": {"azimuth_deg": 7.0}}]}
    azimuth = runs(ideal(Radar(**config), position=(-50.0, 0.0)), 1)[1]
    assert {*np.rint(np.rad2deg(azimuth)).ravel().tolist()} == {-178, -175, 175, 178}


def test_bursts_of_interference_take_their_share_of_the_time():
    effects = [{"type": "interference", "per_minute": 10.0, "duration_s": 2.0, "detection_factor": 0.0}]
    sensor = ideal(Radar(effects=effects, **RADAR), steps=600)
    detected = detections(sensor, 400).T
    # Of a Poisson process the number of bursts at an instant is Poisson with mean rate times duration.
    assert detected.mean() == pytest.approx(np.exp(-10 * 2 / 60), abs=0.02)
    assert detected[:, 0].mean() == pytest.approx(np.exp(-10 * 2 / 60), abs=0.1)


def test_bursts_add_false_alarms_only_while_detections_are_few():
    effects = [
        {"type": "interference", "per_minute": 6.0, "duration_s": 1.0, "detection_factor": 0.0, "alarms_per_scan": 5.0}
    ]
    sensor = ideal(Radar(effects=effects, max_range_m=150.0, **RADAR), steps=600)
    detected = detections(sensor, 4)[:, 3]
    alarms = alarms_of(sensor, 3)
    counts = np.bincount(alarms.instant, minlength=600)
    assert counts[detected].sum() == 0
    assert counts[~detected].mean() == pytest.approx(5, abs=5 * np.sqrt(5 / (~detected).sum()))


def ghosts(wall, probability=0.4, **keys):
    return [{"type": "ghosts", "wall": wall, "probability": probability, **keys}]


def test_a_ghost_is_the_mirror_image_of_its_cause():
    effects = ghosts([[-100.0, 6.0], [100.0, 6.0]], time_s=0.5)
    sensor = ideal(Radar(effects=effects, **EXACT), position=(20.0, 2.0), velocity=(3.0, 0.5), steps=80)
    seen = [alarms_of(sensor, run) for run in range(300)]
    share = np.mean([len(alarms.instant) / 80 for alarms in seen])
    assert share == pytest.approx(0.4, abs=0.05)
    for alarms in seen[:3]:
        time = alarms.instant * 0.1
        x, y = 20 + 3 * time, 12 - (2 + 0.5 * time)
        distance = np.hypot(x, y)
        np.testing.assert_allclose(alarms.measurement[0], distance, atol=1e-4)
        np.testing.assert_allclose(alarms.measurement[1], np.arctan2(y, x), atol=1e-6)
        np.testing.assert_allclose(alarms.measurement[2], (3 * x - 0.5 * y) / distance, atol=1e-4)


def swerving(effects, mount=None):
    """The observer steers and slips, the vehicle brakes and changes lane."""
    time = np.arange(2000) * 1e-3
    turn, swing = 0.4 * np.sin(3 * time), 1.5 * np.cos(2 * time)
    observer = Observer(
        20 * time, 0.75 * np.sin(2 * time), 0.4 / 3 * (1 - np.cos(3 * time)), 0 * time + 20, swing, turn
    )
    px, py = 30 + 15 * time - time**2, 1.2 * np.sin(2.5 * time)
    vx, vy = 15 - 2 * time, 3 * np.cos(2.5 * time)
    of = truth(time, *(values[:, None, None] for values in (px, py, vx, vy)), observer=observer)
    config = Radar(**EXACT | {"rate_hz": 1000, "mount": mount or {}, "effects": effects})
    (sensor,) = ideal_sensors(of, {"sensor": config})
    return sensor, np.stack([px, py])


WALLS = [
    ([[-300.0, -6.0], [300.0, -6.0]], {}),
    ([[-300.0, 5.0], [300.0, 40.0]], {"x_m": 3.0, "y_m": -0.8, "yaw_deg": -70.0}),
]


@pytest.mark.parametrize(("wall", "mount"), WALLS)
def test_the_range_rate_of_a_ghost_is_the_derivative_of_its_range(wall, mount):
    sensor, _ = swerving(ghosts(wall, 0.999), mount)
    alarms = alarms_of(sensor, 0)
    distance, _, rate = alarms.measurement
    inside = np.flatnonzero((np.diff(alarms.instant, 2) == 0) & (np.diff(alarms.instant)[1:] == 1)) + 1
    assert len(inside) > 1000
    # The noise of 1e-6 m makes 7e-4 m/s of it.
    central = (distance[inside + 1] - distance[inside - 1]) / 2e-3
    np.testing.assert_allclose(rate[inside], central, rtol=0, atol=5e-3)


def test_a_ghost_is_only_seen_in_the_wall_and_from_the_side_where_its_cause_is():
    behind = ideal(Radar(effects=ghosts([[-100.0, 6.0], [100.0, 6.0]]), **EXACT), position=(20.0, 9.0))
    assert len(alarms_of(behind, 0).instant) == 0
    # From (0, 0) by a wall at y = 6 to (20, 2): the path meets the wall at 20 * 6 / 10 = 12 m.
    for wall, seen in (([[11.0, 6.0], [13.0, 6.0]], True), ([[12.5, 6.0], [50.0, 6.0]], False)):
        sensor = ideal(Radar(effects=ghosts(wall), **EXACT), position=(20.0, 2.0))
        assert (len(alarms_of(sensor, 0).instant) > 0) is seen
    # The image is at 22.4 m and 26.6 degrees.
    for reach, seen in ((23.0, True), (22.0, False)):
        near = Radar(effects=ghosts([[-100.0, 6.0], [100.0, 6.0]]), **{**EXACT, "max_range_m": reach})
        assert (len(alarms_of(ideal(near, position=(20.0, 2.0)), 0).instant) > 0) is seen
    corner = ideal(Radar(effects=ghosts([[11.0, 6.0], [13.0, 6.0], [80.0, 6.0]]), **EXACT), position=(20.0, 2.0))
    alone = ideal(Radar(effects=ghosts([[11.0, 6.0], [13.0, 6.0]]), **EXACT), position=(20.0, 2.0))
    np.testing.assert_array_equal(alarms_of(corner, 0).instant, alarms_of(alone, 0).instant)


EVERY = [
    {"type": "reflection", "toward_sensor": 0.3, "along_m": 0.4, "across_m": 0.3},
    {"type": "faces", "share": 0.5},
    {"type": "signal_to_noise", "half_range_m": 60.0, "stated_at_m": 50.0, "side_db": 5.0},
    {"type": "correlated_errors", "share": 0.7, "time_s": 0.5},
    {"type": "bias", "sigmas": {"azimuth_deg": 0.2}},
    {"type": "interference", "per_minute": 20.0, "duration_s": 1.0, "detection_factor": 0.3, "alarms_per_scan": 3.0},
    {"type": "ghosts", "wall": [[-50.0, 6.0], [50.0, 6.0]], "probability": 0.4},
    {"type": "quantised", "steps": {"range_m": 0.2}},
]


@pytest.mark.parametrize("effects", [*([effect] for effect in EVERY), EVERY], ids=lambda effects: effects[-1]["type"])
def test_a_run_is_the_same_to_the_last_bit_whatever_the_others_are(effects):
    # With so many instants a few runs are made at a time.
    sensor = ideal(Radar(effects=effects, max_range_m=150.0, **RADAR), velocity=(0.1, 0.02), steps=3000)
    together, alone = (sense_known([sensor], 1, "effects", chosen).digests for chosen in (range(12), range(9, 10)))
    assert together[9] == alone[0]
    together, alone = (sense_hidden([sensor], 1, "effects", chosen).digests for chosen in (range(12), range(9, 10)))
    assert together[9] == alone[0]
    assert len(set(together)) == 12
