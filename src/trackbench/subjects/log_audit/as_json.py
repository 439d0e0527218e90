"""An audit of a log as JSON values."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from trackbench.subjects.log_audit.audit import LogAudit
from trackbench.subjects.log_audit.blocks import BlockInterval
from trackbench.subjects.log_audit.noise import Band
from trackbench.subjects.log_audit.sensor_audit import SensorAudit

SCHEMA_VERSION = 1


def to_json(audit: LogAudit) -> dict[str, Any]:
    """All that was found, in SI units and radians; null where there is no number."""
    found = {
        "schema_version": SCHEMA_VERSION,
        "scenario": audit.name,
        "file": str(audit.scenario.path),
        "duration_s": audit.duration_s,
        "findings": [asdict(finding) for finding in audit.findings],
        "changes": audit.changes,
        "sensors": {name: _sensor(item) for name, item in audit.sensors.items()},
        "clocks": [{key: value for key, value in asdict(clock).items() if key != "time"} for clock in audit.clocks],
        "truth_velocity": [
            {
                "object": check.name,
                "difference_mps": check.difference,
                "scale": check.scale,
                "fits_unit": check.unit,
                "jumps": check.jumps,
                "contradicts": check.contradicts,
            }
            for check in audit.velocities
        ],
    }
    plain: dict[str, Any] = _plain(found)
    return plain


def _sensor(item: SensorAudit) -> dict[str, Any]:
    fit, detections = item.fit, item.detections
    found: dict[str, Any] = {
        "kind": item.log.config.type,
        "measurements": len(item.log.log.time),
        "mean_square": {"as_logged": item.square_before, "with_findings": item.square_after},
        "rate_hz": detections.rate_hz,
        "detections": {
            **_interval(detections.share),
            "chances": detections.chances,
            "bands": [_band(band) for band in detections.bands],
            "largest_azimuth_rad": detections.seen_half_angle,
            "largest_range_m": detections.seen_range_m,
        },
        "wrong_units": [asdict(wrong) for wrong in item.units],
    }
    if fit is None:
        return {**found, "reason": "too few measurements to estimate anything"}
    return {
        **found,
        "outliers": int(fit.outlier.sum()),
        "errors": {
            name: {
                **_interval(estimate.interval),
                "unit": estimate.unit,
                "effect_sigma": estimate.effect,
                "or_else": list(estimate.or_else),
                "same_as": estimate.same_as,
                "correlated_with": None if estimate.correlated is None else list(estimate.correlated),
            }
            for name, estimate in fit.estimates.items()
        },
        "not_identifiable": {name: list(others) for name, others in fit.unidentified.items()},
        "condition": fit.condition,
        "components": {
            noise.name: {
                "unit": noise.unit,
                "mean": _interval(noise.mean),
                "sigma": _interval(noise.sigma),
                "stated_sigma": noise.stated,
                "range_exponent": None if noise.exponent is None else _interval(noise.exponent),
                "bands": [_band(band) for band in noise.bands],
            }
            for noise in item.noise
        },
        "covariance": item.covariance,
    }


def _interval(interval: BlockInterval) -> dict[str, Any]:
    return {"value": interval.value, "ci95": list(interval.bounds())}


def _band(band: Band) -> dict[str, Any]:
    return {"from_m": band.from_m, "to_m": band.to_m, "count": band.count, **_interval(band.interval)}


def _plain(value: Any) -> Any:
    """Without arrays, NaN and infinity."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value
