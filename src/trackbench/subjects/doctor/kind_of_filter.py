"""What kind of filter a tracker is, as far as its checks depend on it: asked of its estimates alone."""

from __future__ import annotations

import numpy as np

from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.probes import Probe
from trackbench.subjects.doctor.session import TrackerSession, finite
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.subjects.doctor.trial import Trial

#: Difference by it from which on a tracker has samples, in standard deviations of its estimate. Filters without samples
#: differ by less, because nearly the same motion is predicted in one step or in two.
SAMPLED = 3e-3
#: Difference beyond that of any useful number of samples: an estimate that diverges.
DIVERGED = 0.5
#: Gap after which the predictions are uncertain enough for the second order, s.
GAP = 1.0
#: Second-order term that is large enough to be looked for, in standard deviations of the measurement.
CLEAR = 0.3
#: Difference of the predicted measurement from that of the predicted mean which an EKF does not have, in standard
#: deviations: 0.00 with linearisation, 0.1 and more with sigma points or samples, however wrong their weights are.
NONE = 0.03
#: Offset of the measurements for a tracker that may learn it, in their standard deviations; and for how long, s.
OFFSET, LEARNING = 3.0, 4.0


def sampling_noise(tracker: TrackerUnderTest) -> float:
    """The largest difference between two answers with other samples, in standard deviations; 0 without samples."""
    probe, sensor_set = tracker.probes.general[0], tracker.sensor_sets()[0]
    scan = probe.scan(sensor_set[0], tracker.sensors[sensor_set[0]], 0.0)
    one, other = (
        tracker.predict(tracker.session_at(probe, sensor_set, replica=replica), scan, probe.name)
        for replica in (False, True)
    )
    if one is None or other is None or not (finite(one) and finite(other)):
        return 0.0
    sigma = np.sqrt(np.abs(np.diag(one.covariance)))
    noise = float(np.max(np.abs(one.mean - other.mean) / np.maximum(sigma, 1e-12)))
    return noise if SAMPLED < noise < DIVERGED else 0.0


def linearises(tracker: TrackerUnderTest) -> bool | None:
    """Whether the predicted measurement is that of the predicted mean, as an EKF has it; None where unknown.

    Sigma points and samples add a term of second order, ``tr(A P) / 2`` with the second derivative A of the model from
    the filter's own state (Bar-Shalom, Li and Kirubarajan 2001, section 10.3.2).
    """
    offsets = []
    for probe in (*tracker.probes.general, tracker.probes.tangential):
        session = tracker.session_at(probe, tracker.sensor_sets()[-1])
        for name in (name for name, sensor in tracker.sensors.items() if sensor.type != "lidar"):
            trial = None if session is None else after_gap(tracker, probe, name, session, GAP)
            if trial is not None and trial.usable and np.abs(trial.second_order / trial.sigma).max() > CLEAR:
                offset = trial.offset()
                if offset is not None:
                    offsets.append(float(np.linalg.norm(offset / trial.sigma)))
    return float(np.median(offsets)) < NONE if len(offsets) >= 3 else None


def after_gap(tracker: TrackerUnderTest, probe: Probe, name: str, session: TrackerSession, gap: float) -> Trial | None:
    """A trial of a sensor some time after the last measurement."""
    scan = probe.scan(name, tracker.sensors[name], gap)
    prediction = tracker.predict(session, scan, probe.name)
    return None if prediction is None else Trial(probe.name, probe.description, scan, prediction, session)


def learned_offsets(tracker: TrackerUnderTest, sensor: str) -> list[str]:
    """The components of a sensor whose constant errors the tracker estimates, besides what it returns."""
    probe, sensor_set = tracker.probes.general[0], tracker.sensor_sets()[-1]
    model = SENSOR_MODELS[tracker.sensors[sensor].type]
    found = []
    for i, component in enumerate(model.components):
        last = probe.scan(sensor, tracker.sensors[sensor], 0.0)
        error = np.zeros(len(last.measurement))
        error[i] = OFFSET * np.sqrt(last.noise_covariance[i, i])
        session = TrackerSession(tracker.make)
        with tracker.recording_failures(probe.name):
            for scan in tracker.approach(probe, sensor_set, LEARNING):
                session.step(scan._replace(measurement=scan.measurement + error) if scan.sensor == sensor else scan)
            trial = after_gap(tracker, probe, sensor, session, 0.0)
            offset = None if trial is None or not trial.usable else trial.offset()
            if offset is not None and offset[i] > error[i] / 2:
                found.append(component.replace("_", " "))
    return found
