"""Can what the tracker says be a distribution, and is it the same every time?"""

from __future__ import annotations

import numpy as np

from trackbench.doctor.bench import Bench, approach
from trackbench.doctor.findings import Check, Finding, Outcome
from trackbench.doctor.session import Broken, Session
from trackbench.doctor.stations import Station
from trackbench.doctor.vitals import Symptom, Vitals

#: Asymmetry that rounding does not explain, relative to the variances.
ASYMMETRY = 1e-6
#: Measurements within which a track begins.
BEGUN = 4
#: Share of the covariances that are indefinite, below which something else has probably brought it about.
SELDOM = 0.02
#: The same, below which it is no fault: sigma points that start from two measurements close together lose one now and
#: then.
RARE = 1e-3


def vital_signs(bench: Bench) -> Outcome:
    """What all natural answers of the examination had to be."""
    for station in (bench.stations.at_rest, bench.stations.at_sensor):
        for by in bench.kinds():
            bench.followed(station, by)
        for name in bench.sensors:
            _meet(bench, station, name)
    vitals, outcome = bench.vitals, Outcome()
    bad = vitals.not_finite
    text = (
        f"all of {vitals.answers} answers"
        if bad is None
        else f"not at {bad.time:g} s of {bad.where}, after {bad.sensor}"
    )
    outcome.checks.append(Check("finite", "Is every number of every answer finite?", bad is None, text))
    if bad is not None:
        said = f"the estimate is not finite at {bad.time:g} s of {bad.where}, after a measurement of {bad.sensor}"
        outcome.findings.append(Finding("nonfinite", 0.98, said, station=bad.where))
    outcome.checks += [_symmetric(vitals, outcome.findings), _definite(vitals, outcome.findings)]
    return outcome


def _symmetric(vitals: Vitals, findings: list[Finding]) -> Check:
    question, worst = "Is every covariance symmetric?", vitals.asymmetry
    if worst is None:
        return Check("symmetric", question, None, "there was none")
    said = (
        f"mirrored entries differ by up to {worst.size:.2g} of the standard deviations that belong to them{_at(worst)}"
    )
    if worst.size >= ASYMMETRY:
        findings.append(Finding("covariance_asymmetric", 0.95, said, station=worst.where))
    return Check("symmetric", question, worst.size < ASYMMETRY, said)


def _definite(vitals: Vitals, findings: list[Finding]) -> Check:
    question, worst = "Is every covariance positive definite?", vitals.indefinite
    if worst is None:
        return Check("definite", question, None, "there was none")
    share = vitals.indefinite_answers / vitals.answers
    said = (
        f"{vitals.indefinite_answers} of {vitals.answers} are not; scaled to unit variances the least eigenvalue is "
        f"{-worst.size:.2g}{_at(worst)}"
    )
    if share >= RARE:
        findings.append(Finding("covariance_not_psd", 0.6 if share < SELDOM else 0.95, said, station=worst.where))
    return Check("definite", question, share < RARE, said)


def _at(worst: Symptom) -> str:
    return f" (at {worst.time:g} s of {worst.where}, after {worst.sensor})"


def _meet(bench: Bench, station: Station, first: str) -> None:
    """Begin a track with one sensor, and have each other read the target at once, from exactly where it began."""
    session = Session(bench.make)
    try:
        for k in range(BEGUN):
            answer = session.step(station.scan(first, bench.sensors[first], 0.1 * k))
            if answer is not None:
                break
        for name, sensor in bench.sensors.items():
            scan = station.scan(name, sensor, 0.1 * k)
            bench.vitals.note(session.ahead().step(scan), scan, station.name)
    except Broken as broken:
        bench.broken.append((station.name, broken))


def repeatability(bench: Bench) -> Outcome:
    """The same measurements to three fresh trackers."""
    question = "Do fresh trackers say the same of the same measurements?"
    station, by = bench.stations.open[0], bench.kinds()[-1]
    scans = approach(station, {name: bench.sensors[name] for name in by})
    random = np.random.default_rng([bench.seed, 1])
    noisy = [
        scan._replace(
            measurement=scan.measurement
            + np.sqrt(np.diag(scan.noise_covariance)) * random.standard_normal(len(scan.measurement))
        )
        for scan in scans
    ]
    try:
        runs = []
        for _ in range(3):
            session = Session(bench.make)
            answers = [session.step(scan) for scan in noisy]
            runs.append(np.array([np.full(4, np.nan) if a is None else a.mean for a in answers]))
    except Broken as broken:
        bench.broken.append((station.name, broken))
        return Outcome([Check("repeatable", question, None, f"it broke: {broken}")])
    gap = max(float(np.nanmax(np.abs(runs[0] - run), initial=0.0)) for run in runs[1:])
    same = all(np.array_equal(runs[0], run, equal_nan=True) for run in runs[1:])
    if same:
        return Outcome([Check("repeatable", question, True, "three fresh trackers agree to the last bit")])
    text = f"three fresh trackers differ by up to {gap:.3g} m or m/s on the same {len(noisy)} measurements"
    return Outcome(
        [Check("repeatable", question, False, text)], [Finding("not_deterministic", 0.99, text, station=station.name)]
    )
