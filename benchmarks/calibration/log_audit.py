"""The audit of a log"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tests.support.recorded_log import OBJECTS, WALKERS, Errors, write_log

from trackbench.metrics.blocks import blocks_of
from trackbench.scenario import load_scenario
from trackbench.subjects.log_audit.audit import LogAudit, audit_log

from .claim import Claim, rate

LOGS = 100
CORRELATED = 1000
#: What is wrong with the radar of a log, in SI units and radians.
WRONG = {
    "time_offset": -0.06,
    "mount_yaw": float(np.deg2rad(1.2)),
    "mount_x": 0.4,
    "mount_y": -0.3,
    "bias_range": 0.5,
    "bias_range_rate": 0.15,
}
SIGMA = {"range": 0.45, "azimuth": float(np.deg2rad(0.5)), "range_rate": 0.1}
DETECTED = 0.7
RADAR = Errors(
    time_offset_s=WRONG["time_offset"],
    mount={"x_m": WRONG["mount_x"], "y_m": WRONG["mount_y"], "yaw_deg": 1.2},
    truly={"range_sigma_m": SIGMA["range"], "detection_probability": DETECTED},
    biases={"range": WRONG["bias_range"], "range_rate": WRONG["bias_range_rate"]},
)


def claims() -> Iterator[Claim]:
    """Intervals and findings of logs of 30 s with three objects, half of them without and half with known errors."""
    clean = [_audit(seed, radar=Errors(), lidar=Errors()) for seed in range(LOGS)]
    wrong = [_audit(seed, radar=RADAR) for seed in range(LOGS, 2 * LOGS)]
    yield rate("a log without errors has any finding (radar, lidar)", [bool(a.findings) for a in clean], 0, 0.05)
    nothing = dict.fromkeys(WRONG, 0.0)
    truly = {"range": 0.3, "azimuth": SIGMA["azimuth"], "range_rate": 0.1}
    for name, audits, errors, sigmas in (("no errors", clean, nothing, truly), ("known errors", wrong, WRONG, SIGMA)):
        yield from _coverage(name, audits, errors, sigmas)
    shares = [_covers(a.sensors["radar"].detections.share.bounds(), DETECTED) for a in wrong]
    yield rate("known errors: a detection probability of .7 within its 95 % interval", shares, 0.9, 1)
    found = [set(WRONG) <= {finding.kind for finding in a.findings} for a in wrong]
    yield rate("all six errors of a radar are found", found, 0.95, 1)
    after = np.array([a.sensors["radar"].square_after for a in wrong])
    before = np.array([a.sensors["radar"].square_before for a in wrong])
    yield from noisy_reference()
    yield from correlated()
    yield Claim(
        "mean square of the errors over the stated sigmas: with the findings put in",
        f"{after.mean():.3f} (worst {after.max():.3f}), as logged {before.mean():.2f}",
        "0.98 to 1.02",
        bool(0.98 < after.mean() < 1.02),
    )


def _coverage(
    name: str, audits: list[LogAudit], errors: Mapping[str, float], sigmas: Mapping[str, float]
) -> Iterator[Claim]:
    radars = [audit.sensors["radar"] for audit in audits]
    found = [
        _covers(item.fit.estimates[kind].interval.bounds(), value)
        for item in radars
        if item.fit is not None
        for kind, value in errors.items()
    ]
    yield rate(f"{name}: an error of time, mount or bias within its 95 % interval", found, 0.93, 0.97)
    noises = [
        _covers(noise.sigma.bounds(), value)
        for item in radars
        for noise, value in zip(item.noise, sigmas.values(), strict=True)
    ]
    yield rate(f"{name}: a sigma within its 95 % interval", noises, 0.93, 0.97)


#: The kinds of logs, as settings: walkers about a sensor at rest, and cars, a van and a cyclist about a car that turns.
KINDS: dict[str, dict[str, Any]] = {
    "walkers, sensor at rest": {"objects": WALKERS, "moving": False},
    "vehicles, sensor that turns": {"objects": OBJECTS, "moving": True},
}
#: Noise of the reference, m; and the rate of its rows, Hz, with the time of the first, in hundredths of a second.
NOISES = (0.0, 0.05, 0.1)
STAMPS = {"stamps of the radar": ((20, 0), (10, 0)), "stamps between the radar's": ((20, 2), (10, 2))}
#: Logs of each combination, of which none shares its noise with another; others, before these, served for the design.
EACH, FROM = 17, 80_000
#: What is wrong with the radar of half of them: 30 ms, 1 degree, and every sigma by a half.
SMALL = Errors(
    time_offset_s=0.03,
    mount={"yaw_deg": 1.0},
    truly={"range_sigma_m": 0.45, "azimuth_sigma_deg": 0.75, "range_rate_sigma_mps": 0.15},
)


class NoisyLog(NamedTuple):
    """The audit of a log with noise in the reference."""

    kind: str
    noise: str
    stamps: str
    audit: LogAudit


def noisy_reference() -> Iterator[Claim]:
    """Logs with noise in the reference, whose rows are at the radar's stamps or between them.

    A log has a finding where the audit prints any, of whatever kind, sensor, component or object of the truth.
    """
    clean = _noisy(FROM, EACH, radar=Errors(), lidar=Errors())
    any_finding = "a log without errors has any finding (radar, lidar, truth)"
    noises, every = [f"reference noise {100 * sigma:g} cm" for sigma in NOISES], "reference noise 0 to 10 cm"
    yield rate(f"{every}: {any_finding}", [bool(item.audit.findings) for item in clean], 0, 0.05)
    for part in (*KINDS, *STAMPS, *noises):
        hits = [bool(item.audit.findings) for item in clean if part in item]
        yield rate(f"{part}: {any_finding}", hits, 0, 0.05)
    wrong = _noisy(FROM + len(clean), EACH, radar=SMALL)
    errors = [("time_offset", None, "a clock of 30 ms"), ("mount_yaw", None, "a mount of 1 degree")]
    sigmas = [("sigma", name, f"1.5 times the sigma of {name}") for name in ("range", "azimuth", "range_rate")]
    for part, among in ((every, noises), (noises[-1], noises[-1:])):
        logs = [item.audit for item in wrong if item.noise in among]
        for kind, component, what in (*errors, *sigmas):
            yield rate(f"{part}: {what} is found", [_finds(audit, kind, component) for audit in logs], 0.95, 1)
    covers = [
        _covers(estimate.interval.bounds(), 0.0)
        for noisy in clean
        for item in noisy.audit.sensors.values()
        if item.fit is not None
        for estimate in item.fit.estimates.values()
    ]
    yield rate(f"{every}: an error of time, mount or bias within its 95 % interval", covers, 0.93, 0.97)


def _noisy(first: int, each: int, **errors: Errors) -> list[NoisyLog]:
    """Logs of every combination, with seeds from ``first`` on."""
    combinations = [
        (kind, sigma, stamps, hz, start)
        for kind in KINDS
        for sigma in NOISES
        for stamps, rows in STAMPS.items()
        for hz, start in rows
    ]
    logs = []
    for seed, (kind, sigma, stamps, hz, start) in enumerate(each * combinations, first):
        settings = {**KINDS[kind], "truth_hz": hz, "truth_from": start, "truth_sigma_m": sigma, **errors}
        logs.append(NoisyLog(kind, f"reference noise {100 * sigma:g} cm", stamps, _audit(seed, **settings)))
    return logs


def _finds(audit: LogAudit, kind: str, component: str | None = None) -> bool:
    """Whether an error is found, or is one of several of which one is: walkers of a steady speed tell no clock."""
    return any(
        finding.sensor == "radar"
        and kind in (finding.kind, *finding.candidates)
        and component in (None, finding.component)
        for finding in audit.findings
    )


def correlated() -> Iterator[Claim]:
    """The mean of errors that stay alike for a second, of logs of 30 s with few and with many objects."""
    random, rho, rows = np.random.default_rng(7), 0.9, 600
    for objects in (1, 3, 10):
        hits = []
        for _ in range(CORRELATED):
            values = random.normal(size=(rows, objects))
            for k in range(1, rows):
                values[k] = rho * values[k - 1] + np.sqrt(1 - rho**2) * values[k]
            flat = values.reshape(-1)
            time, owner = np.repeat(0.05 * np.arange(rows), objects), np.tile(np.arange(objects), rows)
            blocks = blocks_of(time, owner, (flat - flat.mean())[None])
            terms = np.stack([flat, np.ones_like(flat)])
            hits.append(_covers(blocks.intervals(terms, lambda sums: sums[:1] / sums[1:])[0].bounds(), 0.0))
        what = f"errors correlated by .9 at 20 Hz, {objects} objects: the mean within its 95 % interval"
        yield rate(what, hits, 0.92, 0.98)


def _covers(bounds: tuple[float, float], value: float) -> bool:
    return bounds[0] <= value <= bounds[1]


def _audit(seed: int, **settings: Any) -> LogAudit:
    with tempfile.TemporaryDirectory() as folder:
        return audit_log(load_scenario(write_log(Path(folder), seed=seed, **settings)))
