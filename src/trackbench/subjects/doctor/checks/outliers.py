"""Does the tracker use measurements that its own covariance makes likely, and recover from a wildly wrong one?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from trackbench.base.types import Array, Estimate, Scan
from trackbench.driving.drive import empty_scan
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.inside.interaction import find_bank, models_of
from trackbench.subjects.doctor.probes import Probe, probe_rate
from trackbench.subjects.doctor.samples import has_samples
from trackbench.subjects.doctor.session import TrackerSession, finite, largest_difference, position_sigma
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest, after_gap

#: Gap after which the prediction is uncertain, s, and distance of a measurement from it, in standard deviations.
GAP, ASIDE = 1.0, 1.5
#: Change of an estimate that is only rounding, in standard deviations; least share and least number of the trials.
NONE, MOST, LEAST = 1e-9, 0.7, 3
#: Errors of one wild measurement: of lengths, m, and of angles, rad.
LENGTHS, TURNS = ((25.0, "m"), (1000.0, "m")), ((np.pi, "rad"),)
#: Time of right measurements after a wild one, s; largest share of its distance from the target that is left then; and
#: largest change of a model's probability. Sound filters without a gate have up to 0.06 and 0.25.
RECOVERY, LEFT, CHANGED = 3.0, 0.1, 0.5
#: Time for which measurements are rejected, s.
AFTER = 1.0
#: Distance of the measurements that are rejected, m, and share of it up to which the estimate counts as unmoved.
FAR, REJECTED = 100.0, 0.1
#: Largest standard deviation behind a gate that stays shut, relative to the one without measurements.
SHUT = 0.5


@doctor_check(
    Question("gate", "Are measurements used that are likely by the tracker's own covariance?", misses=True),
    place=160,
    of_filters=True,
    faults={
        "gate_never_reopens": KnownFault(
            "the gate never opens again",
            "Where a measurement is rejected.",
            "Keep the prediction of the mean and of the covariance where a measurement is rejected, as at a missed "
            "one: the gate then widens until it lets the target in.",
            Role(rank=6, drive="manoeuvre"),
        ),
    },
)
def gate(tracker: TrackerUnderTest) -> PartResult:
    """Try a likely measurement after a gap, which must count, and far ones for 1 s, after which the gate must widen."""
    narrow = [finding for name in tracker.sensors if (finding := _rejects_likely(tracker, name)) is not None]
    if narrow:
        finding = narrow[0] if len(narrow) < len(tracker.sensors) else replace(narrow[0], sensor=None)
    else:
        finding = None if has_samples(tracker) else _stays_shut(tracker)
    return PartResult().add_evidence("gate", finding, "likely measurements move the estimate")


@doctor_check(
    Question("outliers", "Does the tracker recover from one wild measurement?"),
    place=165,
    faults={
        "imm_likelihood_underflow": KnownFault(
            "the likelihoods of the models underflow to 0",
            "Where the likelihoods of the models are computed, multiplied and divided by their sum.",
            "Add logarithms, l_j = log c_j + log N(y_j; 0, S_j), and take mu_j = exp(l_j - max l), divided by their "
            "sum: the largest is 1 then, however wild the measurement.",
            Role("exact", rank=5, drive="manoeuvre"),
        ),
        "lost_after_outlier": KnownFault(
            "one wild measurement loses the target",
            "Where the innovation is gated or weighed, and where memory of it is kept beside the estimate.",
            "Reject what is beyond the gate as if it were missed, let the covariance grow until the gate opens again, "
            "and keep nothing of one measurement for good.",
            Role("driven", rank=48, drive="manoeuvre"),
        ),
    },
)
def outliers(tracker: TrackerUnderTest) -> PartResult:
    """Try one wild measurement and right ones after it, and look whether the estimate comes back to the target."""
    lost = next((lost for name in tracker.sensors if (lost := _lost_after(tracker, name)) is not None), None)
    text = f"{RECOVERY:g} s after one wild measurement the estimate is at the target again"
    return PartResult().add_evidence("outliers", lost, text)


def _rejects_likely(tracker: TrackerUnderTest, name: str) -> Finding | None:
    """Report that a measurement 1.5 sigma from the prediction changes nothing, while the predicted measurement does."""
    unused = []
    for probe in tracker.probes.general:
        session = tracker.session_of_most(probe)
        trial = None if session is None else after_gap(tracker, probe, name, session, GAP)
        if trial is None or not trial.usable:
            continue
        model, scan, likely = SENSOR_MODELS[trial.scan.kind], trial.scan, _likely_state(trial.prediction)
        aside = trial.posterior(model.measure(likely, scan.sensor_pose, scan.sensor_velocity))
        centre = trial.posterior(trial.predicted_measurement)
        if aside is not None and centre is not None and largest_difference(centre, trial.prediction) > NONE:
            unused.append(largest_difference(aside, trial.prediction) < NONE)
    if len(unused) < LEAST or np.mean(unused) < MOST:
        return None
    text = (
        f"{GAP:g} s after the last one, a measurement of {name} that is {ASIDE:g} standard deviations of the predicted "
        f"covariance off leaves the estimate as it is ({sum(unused)} of {len(unused)} trials), and one that is not "
        "off changes it"
    )
    return Finding("gate_too_small", 0.96, text, sensor=name, shown_by="long_gap")


def _likely_state(prediction: Estimate) -> Array:
    """Return the state 1.5 standard deviations off the predicted one, where its position is least certain."""
    variances, axes = np.linalg.eigh(prediction.covariance[:2, :2])
    position = ASIDE * np.sqrt(max(variances[1], 0.0)) * axes[:, 1]
    of_position = prediction.covariance[:, :2] @ np.linalg.pinv(prediction.covariance[:2, :2])
    return np.asarray(prediction.mean + of_position @ position)


def _scans_after(tracker: TrackerUnderTest, probe: Probe, duration: float = AFTER) -> list[Scan]:
    """Return all sensors' noise-free scans of a probe (test target) for ``duration`` s after its time 0."""
    scans = [
        tracker.scan(probe, name, k / probe_rate(sensor))
        for name, sensor in tracker.sensors.items()
        for k in range(1, int(duration * probe_rate(sensor)) + 1)
    ]
    return sorted(scans, key=lambda scan: scan.time)


def _stays_shut(tracker: TrackerUnderTest) -> Finding | None:
    """Report that the covariance stays small while measurements are rejected, and grows where there are none."""
    shut: list[tuple[float, float]] = []
    for probe in tracker.probes.general:
        session, px = tracker.session_of_most(probe), probe.target[0] + FAR
        if session is None:
            continue
        with tracker.recording_failures(probe.name):
            rejected = session.copy().follow(_scans_after(tracker, probe._replace(target=(px, *probe.target[1:]))))[-1]
            unmeasured = session.copy().follow([empty_scan(scan) for scan in _scans_after(tracker, probe)])[-1]
            if rejected is not None and unmeasured is not None:
                moved = np.hypot(*(rejected.mean - unmeasured.mean)[:2])
                sigmas = position_sigma(rejected), position_sigma(unmeasured)
                shut += [sigmas] if moved < REJECTED * FAR and sigmas[0] < SHUT * sigmas[1] else []
    if len(shut) < LEAST:
        return None
    text = (
        f"after {AFTER:g} s of measurements {FAR:g} m off, which are rejected, the standard deviation of the position "
        f"is {shut[0][0]:.3g} m, and after {AFTER:g} s without any {shut[0][1]:.3g} m ({len(shut)} targets)"
    )
    return Finding("gate_never_reopens", 0.96, text, shown_by="manoeuvre")


def _lost_after(tracker: TrackerUnderTest, name: str) -> Finding | None:
    """Report the first wild measurement of a sensor from which the tracker does not recover."""
    probe = tracker.probes.general[0]
    session, right = tracker.session_of_most(probe), tracker.scan(probe, name, 0.0)
    after = _scans_after(tracker, probe, RECOVERY)
    if session is None:
        return None
    with tracker.recording_failures(probe.name):
        usual, expected = _estimate_after(tracker, session, [right, *after])
        for words, wild in _wild_scans(right):
            estimate, probabilities = _estimate_after(tracker, session, [wild, *after])
            if usual is None or estimate is None or not finite(usual):
                continue
            positions = [SENSOR_MODELS[scan.kind].position(scan).mean for scan in (wild, right)]
            error, distance = (np.hypot(*(pair[0] - pair[1])[:2]) for pair in ((estimate.mean, usual.mean), positions))
            if expected is not None and probabilities is not None and not _nearly_equal(probabilities, expected):
                values = ", ".join(f"{value:.2g}" for value in probabilities)
                fault, result = "imm_likelihood_underflow", f"the probabilities of the models at {values}"
            elif not finite(estimate):
                fault, result = "nonfinite", "an estimate that is not finite"
            elif error > LEFT * distance:
                fault, result = "lost_after_outlier", f"the estimate {error:.3g} m off {RECOVERY:g} s later"
            else:
                continue
            text = f"one {words}, of {name}, leaves {result}"
            # A wrong gain or covariance loses the target too.
            confidence = 0.85 if fault == "lost_after_outlier" else 0.97
            return Finding(fault, confidence, text, sensor=name, shown_by="manoeuvre")
    return None


def _nearly_equal(probabilities: Array, expected: Array) -> bool:
    return bool(np.abs(probabilities - expected).max() < CHANGED)


def _estimate_after(
    tracker: TrackerUnderTest, session: TrackerSession, scans: Sequence[Scan]
) -> tuple[Estimate | None, Array | None]:
    """Step a copy until an estimate is not finite; return the last estimate and model probabilities ``(m,)``."""
    twin, estimate = session.copy(), None
    for scan in scans:
        estimate = twin.step(scan)
        if estimate is not None and not finite(estimate):
            break
    bank = tracker.once(find_bank)
    models = None if bank is None else models_of(twin, bank[0])
    return estimate, None if models is None else models.probability


def _wild_scans(scan: Scan) -> Iterator[tuple[str, Scan]]:
    """Yield pairs of an error in words, and the scan with this large error in one measurement component."""
    model = SENSOR_MODELS[scan.kind]
    for i, component in enumerate(model.components[:2]):
        for size, unit in TURNS if i in model.angular else LENGTHS[: 2 - i]:
            measurement = scan.measurement.copy()
            measurement[i] += size
            yield f"{component.replace('_', ' ')} that is {size:.4g} {unit} off", scan._replace(measurement=measurement)
