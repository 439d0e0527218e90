"""The audit of a log as a call, and its JSON values."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from trackbench import results
from trackbench.api.result import Report
from trackbench.api.scenario import Named, loaded_scenario
from trackbench.base.errors import counted
from trackbench.base.types import Progress, no_progress
from trackbench.document.html import to_html
from trackbench.document.markdown import to_markdown
from trackbench.metrics.blocks import BlockInterval
from trackbench.scenario import Scenario
from trackbench.scenario.load import own_modules
from trackbench.subjects.log_audit.audit import LogAudit, audit_log, corrected
from trackbench.subjects.log_audit.findings import SensorAudit
from trackbench.subjects.log_audit.noise import GATE_M, Band, Unlabelled
from trackbench.subjects.log_audit.report import log_audit_document, log_audit_summary

SCHEMA_VERSION = 1


def audit_content(audit: LogAudit) -> dict[str, Any]:
    """All that was found, in SI units and radians; null where there is no number."""
    values: dict[str, Any] = _plain(
        {
            "schema_version": SCHEMA_VERSION,
            "scenario": audit.name,
            "file": str(audit.scenario.path),
            "duration_s": audit.duration_s,
            "findings": [asdict(finding) for finding in audit.findings],
            "changes": audit.changes,
            "sensors": {name: _sensor(item) for name, item in audit.sensors.items()},
            "clocks": [asdict(clock) for clock in audit.clocks],
            "truth_velocity": [
                {
                    "object": check.name,
                    "noise_m": check.noise,
                    "difference_mps": check.difference,
                    "scale": check.scale,
                    "fits_unit": check.unit,
                    "jumps": check.jumps,
                    "contradicts": check.contradicts,
                }
                for check in audit.velocities
            ],
        }
    )
    return values


def _sensor(item: SensorAudit) -> dict[str, Any]:
    fit, detections = item.fit, item.detections
    values: dict[str, Any] = {
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
        "unlabelled": item.unlabelled and _unlabelled(item.unlabelled),
    }
    if fit is None:
        return {**values, "reason": "too few measurements to estimate anything"}
    return {
        **values,
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


def _unlabelled(item: Unlabelled) -> dict[str, Any]:
    return {
        "gate_m": GATE_M,
        "scans": item.scans,
        "detections_per_scan": _interval(item.per_scan),
        "near_share": _interval(item.near),
        "others_per_scan": _interval(item.others),
        "stated_false_alarms_per_scan": item.stated_others,
        "bands": [_band(band) for band in item.bands],
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


#: The file by which the folder of an audit is known.
AUDIT = "audit.json"


class ReportableAudit(LogAudit):
    """What is wrong with a log. A notebook shows it as a page, ``print`` as text."""

    def json(self) -> dict[str, Any]:
        """All that was found, as in ``audit.json``."""
        return audit_content(self)

    def report(self) -> Report:
        """The report, as ``trackbench audit`` writes it."""
        return Report(log_audit_document(self))

    def save(self, folder: Path | str) -> list[str]:
        """Write the report, the numbers, and the scenario with the findings put in; returns the names of the files.

        Raises:
            TrackbenchError: the folder cannot be written, or holds something else.
        """
        place, document = Path(folder), log_audit_document(self)
        files: dict[str, Callable[[Path], object]] = {
            AUDIT: partial(results.write_file, results.json_text(self.json())),
            "report.html": partial(results.write_file, to_html(document)),
            "report.md": partial(results.write_file, to_markdown(document)),
            "scenario.yaml": partial(results.write_file, corrected(self.scenario, self.findings, place)),
        }
        # Trackers are looked for beside the scenario that names them.
        for module in own_modules(self.scenario):
            files[module.name] = partial(shutil.copyfile, module)
        results.save_files(files, place, AUDIT)
        return list(files)

    def __repr__(self) -> str:
        sensors = counted(len(self.sensors), "sensor")
        return f"<audit of {self.name}: {sensors}, {counted(len(self.findings), 'finding')}>"

    def __str__(self) -> str:
        return str(Report(log_audit_summary(self)))

    def _repr_html_(self) -> str:
        return self.report()._repr_html_()


def audit(
    scenario: Scenario | Named, *, out: Path | str | None = None, progress: Progress = no_progress
) -> ReportableAudit:
    """Find what is wrong with a log: biases, noise, time offsets, mounts, units, missing detections, clocks, truth.

    Args:
        scenario: what :func:`load` gave or takes, whose truth is recorded with measurements of at least one sensor.
        out: the folder of the report and of the scenario with the findings put in; nothing is written unless given.
        progress: called with the number of sensors done and of all.

    Raises:
        InputError: the scenario has no recorded measurements, or a file is damaged.
        TrackbenchError: the folder cannot be written.
    """
    reportable = ReportableAudit(**vars(audit_log(loaded_scenario(scenario), progress)))
    if out is not None:
        reportable.save(out)
    return reportable
