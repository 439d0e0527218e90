"""The call ``trackbench.audit``, and the audit's JSON values and files."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from dataclasses import fields, is_dataclass
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
from trackbench.subjects.log_audit.report import log_audit_document, log_audit_summary

SCHEMA_VERSION = 1


def audit_content(audit: LogAudit) -> dict[str, Any]:
    """Return all results of an audit for JSON, in SI units and radians; null where there is no number."""
    content = {
        "schema_version": SCHEMA_VERSION,
        "scenario": audit.name,
        "file": str(audit.scenario.path),
        "duration_s": audit.duration_s,
        "findings": audit.findings,
        "changes": audit.changes,
        "unexplained": audit.unexplained,
        "sensors": {name: _sensor(item) for name, item in audit.sensors.items()},
        "clocks": audit.clocks,
        "truth_velocity": audit.velocities,
    }
    return {key: _plain(value) for key, value in content.items()}


def _sensor(item: SensorAudit) -> dict[str, Any]:
    values = {
        "kind": item.log.config.type,
        "measurements": len(item.log.log.time),
        "mean_square": {"as_logged": item.square_before, "with_findings": item.square_after},
        "detections": item.detections,
        "wrong_units": item.units,
        "unlabelled": item.unlabelled,
    }
    if item.fit is None:
        return {**values, "reason": "too few measurements to estimate anything"}
    return {
        **values,
        "outliers": int(item.fit.outlier.sum()),
        "errors": item.fit.estimates,
        "not_identifiable": item.fit.unidentified,
        "components": {noise.name: noise for noise in item.noise},
    }


def _plain(value: Any) -> Any:
    """Return a value for JSON: fields by name, intervals with their bounds, null for NaN and infinity."""
    if isinstance(value, BlockInterval):
        return _plain({"value": value.value, "ci95": value.bounds()})
    if is_dataclass(value):
        return _plain({entry.name: getattr(value, entry.name) for entry in fields(value)})
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


#: File that marks a folder as an audit's.
AUDIT = "audit.json"


class ReportableAudit(LogAudit):
    """Audit of a log. A notebook shows it as a page, ``print`` as text."""

    def json(self) -> dict[str, Any]:
        """Return all results as a dictionary, with the keys of ``audit.json``."""
        return audit_content(self)

    def report(self) -> Report:
        """Return the report that ``trackbench audit`` writes."""
        return Report(log_audit_document(self))

    def save(self, folder: Path | str) -> list[str]:
        """Write the report, the numbers and the corrected scenario; return the names of the files.

        The scenario is left out where :attr:`unexplained` has a reason against its use.

        Raises:
            TrackbenchError: the folder cannot be written, or has other contents.
        """
        path, document = Path(folder), log_audit_document(self)
        files: dict[str, Callable[[Path], object]] = {
            AUDIT: partial(results.write_file, results.json_text(self.json())),
            "report.html": partial(results.write_file, to_html(document)),
            "report.md": partial(results.write_file, to_markdown(document)),
        }
        if not self.unexplained:
            scenario = corrected(self.scenario, self.findings, path)
            files["scenario.yaml"] = partial(results.write_file, scenario)
            # A scenario's plug-in modules must lie beside it.
            for module in own_modules(self.scenario):
                files[module.name] = partial(shutil.copyfile, module)
        results.save_files(files, path, AUDIT)
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
        scenario: scenario, loaded or by its path or name, with recorded truth and recorded measurements.
        out: folder for the report and the corrected scenario; None writes nothing.
        progress: called with the number of finished sensors and of all sensors.

    Raises:
        InputError: the scenario has no recorded measurements, or a file is damaged.
        TrackbenchError: the folder cannot be written.
    """
    reportable = ReportableAudit(**vars(audit_log(loaded_scenario(scenario), progress)))
    if out is not None:
        reportable.save(out)
    return reportable
