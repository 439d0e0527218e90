"""A drive through traffic with noise and misses, held against a reference.

There are no false alarms: one track of them more or less would be most of the error, and they have checks of their own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.base.types import Array, Scan, Tracks
from trackbench.metrics.traffic.set_distances import gospa_of_sets
from trackbench.subjects.doctor.findings import PartResult, Question, doctor_check
from trackbench.subjects.doctor.traffic import DETECTION, Make, MultiObjectSession, Site, moved_objects
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.late import LateScans
from trackbench.trackers.multi import build_multi

#: Length of the drive, time at its start that is not judged, and period of the scans, s.
LENGTH, SETTLED, PERIOD = 8.0, 1.5, 0.1
#: px, py m, vx, vy m/s at time 0: two side by side, one that overtakes and cuts in, one that is met, one that crosses.
CARS = np.array(
    [[25.0, 3.5, 17, 0], [25, 0, 17, 0], [-15, -3.5, 22, 0], [120, 10, -15, 0], [60, -50, 11, 6], [-40, 12, 18, 0]]
).T
#: The one that cuts in: its column, when, s, and how far it goes to the side, m.
CUTTING, FROM, TO, ASIDE = 2, 2.5, 6.0, 3.5
#: Speed of the sensor, m/s.
SENSOR_SPEED = 15.0
#: Cut-off of GOSPA, m, and times the reference's from which on it is too large. Sound trackers with other gates, noise
#: and rules of confirmation have 0.8 to 1.8.
CUTOFF, LIMIT = 5.0, 2.5


def cars(time: float) -> Array:
    """``(4, n)`` px, py, vx, vy."""
    state = moved_objects(CARS, time)
    # Half a period of a cosine.
    phase = np.pi * np.clip((time - FROM) / (TO - FROM), 0.0, 1.0)
    state[1, CUTTING] += ASIDE * (1 - np.cos(phase)) / 2
    state[3, CUTTING] += ASIDE * np.sin(phase) * np.pi / (TO - FROM) / 2
    return state


def traffic_scans(site: Site) -> list[Scan]:
    """What the sensor detects on the way."""
    random = np.random.default_rng(8)
    scans = []
    for time in np.arange(0.0, LENGTH, PERIOD):
        pose, velocity = np.array([SENSOR_SPEED * time, 0.0, 0.0]), np.array([SENSOR_SPEED, 0.0])
        ideal = site.sensor.measure(cars(float(time)), pose, velocity)
        detected = ideal[:, random.random(ideal.shape[1]) < DETECTION]
        noise = np.array(site.sensor.sigmas())[:, None] * random.standard_normal(detected.shape)
        scan = site.scan(float(time), detected + noise, random)
        scans.append(scan._replace(sensor_pose=pose, sensor_velocity=velocity))
    return scans


def gospa_of(tracks: Sequence[Tracks], scans: Sequence[Scan]) -> float:
    """Mean GOSPA of the judged scans, m."""
    judged = [(answer, scan.time) for answer, scan in zip(tracks, scans, strict=True) if scan.time >= SETTLED]
    most = max(1, max(len(answer.ids) for answer, _ in judged))
    places = np.full((2, len(judged), most), np.nan)
    for k, (answer, _) in enumerate(judged):
        places[:, k, : len(answer.ids)] = answer.mean[:2]
    objects = np.stack([cars(time)[:2] for _, time in judged], axis=1)
    return float(np.mean(np.sqrt(gospa_of_sets(objects, places, CUTOFF).total)))


def _reference() -> LateScans:
    """A global nearest neighbour with extended Kalman filters."""
    options = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3.0, "associate": {"method": "gnn"}}
    return build_multi(FilterConfig.model_validate(options))


@doctor_check(Question("traffic_drive", "Are the tracks as near to a drive's traffic as the reference's?"), place=90)
def traffic_drive(make: Make, site: Site) -> PartResult:
    """The same scans for the tracker and the reference."""
    scans = traffic_scans(site)
    own, other = (gospa_of(MultiObjectSession(fresh).follow(scans), scans) for fresh in (make, _reference))
    text = f"GOSPA is {own:.3g} m, the reference's {other:.3g} m"
    return PartResult().add("traffic_drive", own <= LIMIT * other, text)
