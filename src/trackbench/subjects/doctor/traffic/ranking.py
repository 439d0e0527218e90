"""Which finding is the cause of which."""

from __future__ import annotations

from dataclasses import replace

from trackbench.subjects.doctor.findings import Finding

#: What each fault also looks like; a cause stands before what it causes.
CONSEQUENCES = {
    "gate_too_small": (
        "double_tracks",
        "pd_misstated",
        "clutter_misstated",
        "confirms_too_late",
        "confirms_too_soon",
        "never_deletes",
        "empty_scan_not_predicted",
    ),
    "order_dependent": (
        "gate_too_large",
        "double_tracks",
        "ids_reused",
        "confirms_too_late",
        "confirms_too_soon",
        "never_deletes",
        "empty_scan_not_predicted",
    ),
    "empty_scan_not_predicted": ("never_deletes", "pd_misstated", "ids_reused"),
    "pd_misstated": ("never_deletes", "double_tracks", "confirms_too_late", "clutter_misstated"),
    "clutter_misstated": ("gate_too_large", "confirms_too_soon", "confirms_too_late", "double_tracks"),
    "gate_too_large": ("double_tracks", "never_deletes", "ids_reused", "confirms_too_soon"),
    "double_tracks": ("confirms_too_soon",),
    "confirms_too_soon": ("double_tracks",),
}


def ranked(findings: list[Finding]) -> list[Finding]:
    """The causes, then their consequences, which name them."""
    order = {fault: place for place, fault in enumerate(CONSEQUENCES)}
    left = sorted(findings, key=lambda finding: order.get(finding.fault, len(order)))
    causes: list[Finding] = []
    after: list[Finding] = []
    for finding in left:
        cause = next((one.fault for one in causes if finding.fault in CONSEQUENCES.get(one.fault, ())), None)
        (causes if cause is None else after).append(replace(finding, consequence_of=cause))
    return [*causes, *after]
