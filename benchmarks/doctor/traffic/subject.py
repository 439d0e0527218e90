"""What a subject is: a tracker of several objects, and the fault that was put into it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from trackbench.driving.steppers import ForeignTracker
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi import build_multi

Make = Callable[[], Any]
BOTH = ("lidar", "radar")


@dataclass(frozen=True)
class TrafficSubject:
    """A tracker of several objects."""

    fault: str
    """Empty for a sound one."""
    tracker: str
    """Which tracker, a column of the table."""
    variant: str
    make: Make
    sensors: tuple[str, ...] = BOTH
    """Kinds of the sensors that it is examined with."""

    @property
    def name(self) -> str:
        return f"{self.fault or 'sound'}/{self.tracker}/{self.variant}"


def looped(tracker: Callable[..., Any], **options: Any) -> Make:
    """Of a class that follows one run."""
    return partial(ForeignTracker, partial(tracker, **options), 1, several=True)


def config(method: str, filter: str = "ekf", motion: str = "cv", sigma: float = 3.0, **associate: Any) -> FilterConfig:
    """Of a built-in tracker; ``sigma`` is the driving noise, m/s^2."""
    more = {} if motion == "cv" else {"yaw_acceleration_sigma_radps2": 1.0}
    noise = {"filter": filter, "motion": motion, "acceleration_sigma_mps2": sigma, **more}
    return FilterConfig.model_validate({**noise, "associate": {"method": method, **associate}})


def built_in(method: str, *arguments: Any, **associate: Any) -> Make:
    """A built-in tracker; arguments as those of :func:`config`."""
    return partial(build_multi, config(method, *arguments, **associate))
