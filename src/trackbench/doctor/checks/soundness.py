"""Can what the tracker says be a distribution, and is it the same every time?"""

from __future__ import annotations

import numpy as np

from trackbench.doctor.bench import Bench, approach
from trackbench.doctor.findings import Check, Finding, Outcome
from trackbench.doctor.session import Broken, Session
from trackbench.doctor.vitals import NEGATIVE

#: Asymmetry that rounding does not explain, relative to the variances.
ASYMMETRY = 1e-6
#: Share of the covariances that are indefinite, below which something else has probably brought it about.
SELDOM = 0.02


def vital_signs(bench: Bench) -> Outcome:
    """What all natural answers of the examination had to be."""
    for station in (bench.stations.at_rest, bench.stations.at_sensor):
        for by in bench.kinds():
            bench.followed(station, by)
    vitals, outcome = bench.vitals, Outcome()
    bad = vitals.not_finite
    text = (
        f"all of {vitals.answers} answers"
        if bad is None
        else f"not at {bad.time:g} s of {bad.where}, after {bad.sensor}"
    )
    outcome.checks.append(Check("finite", "Is every number of every answer finite?", bad is None, text))
    if bad is not None:
        said = f"the estimate is not finite at {bad.time:g} s of {bad.where}, after a reading of {bad.sensor}"
        outcome.findings.append(Finding("nonfinite", 0.98, said, station=bad.where))
    for fault, symptom, limit, question, words in (
        (
            "covariance_asymmetric",
            vitals.asymmetry,
            ASYMMETRY,
            "Is every covariance symmetric?",
            "mirrored entries differ by up to {0:.2g} of the standard deviations that belong to them",
        ),
        (
            "covariance_not_psd",
            vitals.indefinite,
            NEGATIVE,
            "Is every covariance positive definite?",
            "scaled to unit variances, a covariance has the eigenvalue {0:.2g}",
        ),
    ):
        if symptom is None:
            continue
        passed = symptom.size < limit
        size = -symptom.size if fault == "covariance_not_psd" else symptom.size
        said = words.format(size)
        if fault == "covariance_not_psd" and symptom.size >= limit:
            said += f", and {vitals.indefinite_answers} of {vitals.answers} are indefinite"
        said += f" (at {symptom.time:g} s of {symptom.where}, after {symptom.sensor})"
        outcome.checks.append(Check(fault.removeprefix("covariance_"), question, passed, said))
        if not passed:
            seldom = fault == "covariance_not_psd" and vitals.indefinite_answers < SELDOM * vitals.answers
            outcome.findings.append(Finding(fault, 0.6 if seldom else 0.95, said, station=symptom.where))
    return outcome


def repeatability(bench: Bench) -> Outcome:
    """The same readings to three fresh trackers."""
    question = "Do fresh trackers say the same of the same readings?"
    station, by = bench.stations.open[0], bench.kinds()[-1]
    scans = approach(station, {name: bench.sensors[name] for name in by})
    random = np.random.default_rng([bench.seed, 1])
    noisy = [
        scan._replace(reading=scan.reading + np.sqrt(np.diag(scan.noise)) * random.standard_normal(len(scan.reading)))
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
    text = f"three fresh trackers differ by up to {gap:.3g} m or m/s on the same {len(noisy)} readings"
    return Outcome(
        [Check("repeatable", question, False, text)], [Finding("not_deterministic", 0.99, text, station=station.name)]
    )
