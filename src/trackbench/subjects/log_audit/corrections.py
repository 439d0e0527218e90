"""The keys of a scenario that put findings right, and the scenario with them."""

from __future__ import annotations

import copy
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from trackbench.scenario import Scenario
from trackbench.scenario.overrides import set_value
from trackbench.scenario.source import Origin
from trackbench.subjects.log_audit.findings import LogFinding
from trackbench.subjects.log_audit.sensor_log import SensorLog
from trackbench.truth.config.columns import COMPONENT_QUANTITIES


def error_changes(log: SensorLog, errors: Mapping[str, float]) -> dict[str, dict[str, Any]]:
    """By error, the key that takes it out, with its new value."""
    mount, entry = log.config.mount, log.truth.measurements.get(log.name)
    found: dict[str, dict[str, Any]] = {}
    for name, value in errors.items():
        if name.startswith("mount_"):
            key = "yaw_deg" if name == "mount_yaw" else f"{name.removeprefix('mount_')}_m"
            change = float(np.rad2deg(value)) if name == "mount_yaw" else value
            found[name] = {f"sensors.{log.name}.mount.{key}": _rounded(getattr(mount, key) + change, change)}
        elif entry is None:
            found[name] = {}
        elif name == "time_offset":
            key = f"truth.readings.{log.name}.time_offset_s"
            found[name] = {key: _rounded(entry.time_offset_s + value, value)}
        else:
            component = name.removeprefix("bias_")
            i = log.components.index(component)
            quantity = COMPONENT_QUANTITIES.get(log.config.units[i])
            factor = log.truth.units.factor(quantity, entry.units.get(component)) * log.factors[i]
            # In the unit of the column, before which one that was found wrong is put right.
            known = entry.bias.get(component, 0.0)
            found[name] = {
                f"truth.readings.{log.name}.bias.{component}": _rounded(known + value / factor, value / factor)
            }
    return found


def sigma_keys(log: SensorLog) -> dict[str, list[int]]:
    """The keys that state a sensor's noise, with the components that each is for."""
    found: dict[str, list[int]] = {}
    for i, key in enumerate(log.config.sigma_options):
        found.setdefault(key, []).append(i)
    return found


def corrected(loaded: Scenario, findings: Iterable[LogFinding], folder: Path | None = None) -> str:
    """The scenario with the findings put in, as the text of a file in a folder.

    Args:
        loaded: the scenario that was audited.
        findings: of the audit.
        folder: the new file's; that of the scenario unless given. Relative paths lead from it to the same files.
    """
    tree = copy.deepcopy(loaded.document.value)
    for finding in findings:
        for key, value in finding.changes.items():
            set_value(tree, key.split("."), value, Origin("the audit"))
    if folder is not None:
        truth = tree["truth"]
        places = [truth, *(truth.get("readings") or {}).values(), (truth.get("columns") or {}).get("observer")]
        for place in places:
            if isinstance(place, dict) and isinstance(place.get("path"), str):
                place["path"] = _seen_from(place["path"], loaded.path.resolve().parent, folder)
    lines = [f"# {finding.title}." + ("" if finding.changes else " Not put in.") for finding in findings]
    head = [f"# {loaded.path.name} with the findings of `trackbench audit` put in:", *(lines or ["# none."])]
    return "\n".join(head) + "\n" + yaml.safe_dump(tree, sort_keys=False, allow_unicode=True, width=100)


def _seen_from(path: str, old: Path, new: Path) -> str:
    if "$" in path or path.startswith("~") or not (old / path).is_file() or Path(path).is_absolute():
        return path
    return os.path.relpath(old / path, new.resolve())


def _rounded(value: float, change: float) -> float:
    """With four digits of what changed."""
    digits = 3 - int(np.floor(np.log10(abs(change)))) if change else 6
    return round(float(value), max(digits, 0))
