"""Which findings are root causes, and which are their consequences."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from trackbench.subjects.doctor.findings import CHECKS, Finding, KnownFault, faults_of
from trackbench.subjects.doctor.output_checks import SINGULAR

#: Confidence from which on a finding can be the cause of others.
SURE = 0.8
#: Confidence from which on an exact finding is the consequence of no other.
CERTAIN = 0.9


def rank(findings: Iterable[Finding], package: str = CHECKS) -> list[Finding]:
    """One finding for each fault and sensor: root causes first, then consequences, each by falling confidence.

    Args:
        findings: in the order in which they were found.
        package: of the checks that found them.
    """
    faults = faults_of(package)
    unique: dict[tuple[str, str | None], Finding] = {}
    for finding in findings:
        key = (finding.fault, finding.sensor)
        if key not in unique or finding.confidence > unique[key].confidence:
            unique[key] = finding
    ordered = sorted(
        unique.values(),
        key=lambda one: (one.confidence < SURE, "driven" in faults[one.fault].kinds, faults[one.fault].rank),
    )
    ranked: list[Finding] = []
    for finding in ordered:
        roots = (root for root in ranked if root.consequence_of is None)
        cause = next((root.fault for root in roots if _causes(faults, root, finding)), None)
        ranked.append(replace(finding, consequence_of=cause))
    return sorted(ranked, key=lambda one: (one.consequence_of is not None, _at_sensor(one), -one.confidence))


def _at_sensor(finding: Finding) -> bool:
    """Whether it arises only where the range is 0, as in no drive that is judged."""
    return finding.shown_by in SINGULAR


def _causes(faults: Mapping[str, KnownFault], root: Finding, finding: Finding) -> bool:
    """Whether a finding can be the consequence of a root cause, in its sensor and place."""
    cause, fault = faults[root.fault], faults[finding.fault]
    if root.confidence < SURE or root.fault == finding.fault:
        return False
    if "driven" in fault.kinds and "driven" not in cause.kinds:
        return not _at_sensor(root)
    if cause.always_causes(finding.fault, fault):
        return True
    if not cause.causes(finding.fault, fault) or ("exact" in fault.kinds and finding.confidence >= CERTAIN):
        return False
    if "motion" in fault.kinds or (finding.fault == "jacobian_wrong" and finding.sensor is None):
        return root.sensor is None
    return root.sensor is None or finding.sensor is None or root.sensor == finding.sensor
