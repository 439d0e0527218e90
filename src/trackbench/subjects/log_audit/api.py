"""Auditing a log."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any, Self

from trackbench import results
from trackbench.api.result import Report
from trackbench.api.scenario import Named, loaded_scenario
from trackbench.base.errors import counted
from trackbench.base.types import Progress, no_progress
from trackbench.document.html import to_html
from trackbench.document.markdown import to_markdown
from trackbench.scenario import Scenario
from trackbench.scenario.load import own_modules
from trackbench.subjects.log_audit.as_json import to_json
from trackbench.subjects.log_audit.audit import LogAudit, audit_log
from trackbench.subjects.log_audit.corrections import corrected
from trackbench.subjects.log_audit.report import log_audit_document, log_audit_summary

#: The file by which the folder of an audit is known.
AUDIT = "audit.json"


class ReportableAudit(LogAudit):
    """What is wrong with a log. A notebook shows it as a page, ``print`` as text."""

    @classmethod
    def of(cls, audit: LogAudit) -> Self:
        """The same audit, as one that shows itself."""
        return cls(**{field.name: getattr(audit, field.name) for field in fields(audit)})

    def json(self) -> dict[str, Any]:
        """All that was found, as in ``audit.json``."""
        return to_json(self)

    def report(self) -> Report:
        """The report, as ``trackbench audit`` writes it."""
        return Report(log_audit_document(self))

    def save(self, folder: Path | str) -> list[str]:
        """Write the report, the numbers, and the scenario with the findings put in; returns the names of the files.

        Raises:
            TrackbenchError: the folder cannot be written, or holds something else.
        """
        place, document = Path(folder), log_audit_document(self)
        results.require_replaceable(place, AUDIT)
        files: dict[str, Callable[[Path], object]] = {
            AUDIT: partial(results.write_file, results.to_json(self.json())),
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
    found = ReportableAudit.of(audit_log(loaded_scenario(scenario), progress))
    if out is not None:
        found.save(out)
    return found
