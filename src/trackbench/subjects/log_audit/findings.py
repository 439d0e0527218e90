"""What was found in a log, in words and as changes to its scenario."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trackbench.subjects.log_audit.blocks import BlockInterval
from trackbench.subjects.log_audit.joint_fit import ErrorEstimate

#: A finding changes a measurement by at least this share of the standard deviation of its noise.
EFFECT = 0.1
#: A standard deviation is off if it is wrong by at least this factor.
SIGMA_OFF = 1.1
#: The noise depends on the range if it changes by at least this factor over the middle 80 % of the ranges.
SHAPE = 1.25
#: Probability with which a log without errors gives no finding of an error, a noise or a shape.
FAMILY = 0.95


@dataclass(frozen=True)
class LogFinding:
    """Something that is wrong."""

    kind: str
    """Such as ``time_offset``, ``mount_yaw``, ``bias_range``, ``sigma``, ``unit``, ``sign``, ``gaps``."""
    sensor: str | None
    """None: the truth."""
    title: str
    evidence: str
    fix: str
    value: float | None = None
    """In SI units and radians."""
    ci95: tuple[float, float] | None = None
    unit: str | None = None
    or_else: tuple[str, ...] = ()
    """Errors from which this log does not tell it."""
    component: str | None = None
    changes: dict[str, Any] = field(default_factory=dict)
    """What puts it right in the scenario, by dotted key; empty where the log itself has to be changed."""


#: The units in which angles and times are read.
_READ = {"rad": (180 / np.pi, "°"), "s": (1e3, " ms")}
_WORDS = {
    "time_offset": ("time stamps are {} late", "time stamps are {} early"),
    "mount_yaw": (
        "mount is turned {} to the right of what is stated",
        "mount is turned {} to the left of what is stated",
    ),
    "mount_x": ("mount is {} behind where it is stated", "mount is {} in front of where it is stated"),
    "mount_y": ("mount is {} to the right of where it is stated", "mount is {} to the left of where it is stated"),
}


def spelt(name: str) -> str:
    """An error's name as it is read: "time offset", "bias of range rate"."""
    if name.startswith("bias_"):
        return f"bias of {name.removeprefix('bias_').replace('_', ' ')}"
    return name.replace("_", " ")


def shown(value: float, unit: str, *, signed: bool = False) -> str:
    """A value in the unit in which it is read: degrees for angles, ms for times."""
    factor, name = _READ.get(unit, (1.0, f" {unit}"))
    return f"{value * factor:{'+' if signed else ''}.3g}{name}"


def between(interval: BlockInterval, unit: str) -> str:
    """The 95 % interval in words."""
    return f"95 %: {bounds_shown(interval.bounds(), unit)}"


def bounds_shown(bounds: tuple[float, float], unit: str) -> str:
    """ "0.48 to 0.52 m"."""
    factor, name = _READ.get(unit, (1.0, f" {unit}"))
    low, high = (bound * factor for bound in bounds)
    width = abs(high - low)
    places = int(np.clip(1 - np.floor(np.log10(width)), 0, 6)) if np.isfinite(width) and width > 0 else 3
    return f"{low:.{places}f} to {high:.{places}f}{name}"


def describe_error(estimate: ErrorEstimate) -> str:
    """What an error of time, mount or a component amounts to."""
    value, unit = estimate.interval.value, estimate.unit
    size = shown(abs(value), unit)
    if estimate.name in _WORDS:
        return _WORDS[estimate.name][int(value > 0)].format(size)
    component = estimate.name.removeprefix("bias_").replace("_", " ")
    return f"{component} reads {size} too {'much' if value > 0 else 'little'}"


def error_finding(sensor: str, estimate: ErrorEstimate, changes: Mapping[str, Any]) -> LogFinding:
    """That a sensor has an error of time, mount or a bias."""
    title = f"{sensor}: its {describe_error(estimate)}"
    evidence = (
        f"{spelt(estimate.name)} {shown(estimate.interval.value, estimate.unit, signed=True)} "
        f"({between(estimate.interval, estimate.unit)}); it moves a measurement by {estimate.effect:.2g} sigma (RMS)."
    )
    if estimate.or_else:
        others = " and ".join(spelt(name) for name in estimate.or_else)
        title += f", or it is its {others}"
        evidence += f" This log cannot tell it from {others}: the value holds if there is none of that."
    for name, value in estimate.same_as.items():
        unit = "rad" if estimate.unit == "rad" else "m"
        evidence += f" A {spelt(name)} of {shown(value, unit, signed=True)} would be the same in any log."
    setting = "; ".join(f"{key}: {value}" for key, value in changes.items())
    fix = f"Set {setting}" if changes else "Correct the log: this format has no key for it"
    return LogFinding(
        kind=estimate.name,
        sensor=sensor,
        title=title,
        evidence=evidence,
        fix=f"{fix}.",
        value=estimate.interval.value,
        ci95=estimate.interval.bounds(),
        unit=estimate.unit,
        or_else=estimate.or_else,
        changes=dict(changes),
    )
