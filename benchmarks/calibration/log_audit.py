"""The audit of a log"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from tests.support.recorded_log import OBJECTS, WALKERS, Errors, write_log

from trackbench.scenario import load_scenario
from trackbench.subjects.log_audit.audit import LogAudit, audit_log
from trackbench.subjects.log_audit.blocks import blocks_of

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
    truly={
        "range_bias_m": WRONG["bias_range"],
        "range_rate_bias_mps": WRONG["bias_range_rate"],
        "range_sigma_m": SIGMA["range"],
        "detection_probability": DETECTED,
    },
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


#: Logs with a reference that is noisy, from this seed on: others served for the design.
NOISY, FROM = 200, 5000
#: What is wrong with the radar of half of them: 30 ms, 1 degree, and every sigma by a half.
SMALL = Errors(
    time_offset_s=0.03,
    mount={"yaw_deg": 1.0},
    truly={"range_sigma_m": 0.45, "azimuth_sigma_deg": 0.75, "range_rate_sigma_mps": 0.15},
)


def noisy_reference() -> Iterator[Claim]:
    """Logs with up to 10 cm of noise in the reference, whose rows are at the radar's stamps or between them."""
    clean = [_noisy(seed, radar=Errors(), lidar=Errors()) for seed in range(FROM, FROM + NOISY)]
    wrong = [_noisy(seed, radar=SMALL) for seed in range(FROM, FROM + NOISY)]
    within = "reference with 0 to 10 cm of noise"
    yield rate(
        f"{within}: a log without errors has any finding (radar, lidar)", [bool(a.findings) for a in clean], 0, 0.05
    )
    for kind, what in (("time_offset", "30 ms"), ("mount_yaw", "1 degree")):
        yield rate(f"{within}: a {kind} of {what} is found", [_finds(a, kind) for a in wrong], 0.95, 1)
    for name in ("range", "azimuth", "range_rate"):
        hits = [_finds(a, "sigma", name) for a in wrong]
        yield rate(f"{within}: 1.5 times the stated sigma of {name} is found", hits, 0.95, 1)
    covers = [
        _covers(estimate.interval.bounds(), 0.0)
        for a in clean
        for item in a.sensors.values()
        if item.fit is not None
        for estimate in item.fit.estimates.values()
    ]
    yield rate(f"{within}: an error of time, mount or bias within its 95 % interval", covers, 0.93, 0.97)


def _noisy(seed: int, **errors: Errors) -> LogAudit:
    """Every other log with stamps between those of the radar; two with fast objects, two with slow ones."""
    objects, moving = ((OBJECTS, True), (WALKERS, False))[seed // 2 % 2]
    sigma = float(np.random.default_rng(seed).uniform(0, 0.1))
    hz = (20, 10)[seed // 4 % 2]
    settings = {
        "objects": objects,
        "moving": moving,
        "truth_hz": hz,
        "truth_sigma_m": sigma,
        "truth_from": 2 * (seed % 2),
    }
    return _audit(seed, **errors, **settings)


def _finds(audit: LogAudit, kind: str, component: str | None = None) -> bool:
    return any(
        finding.sensor == "radar" and finding.kind == kind and component in (None, finding.component)
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
