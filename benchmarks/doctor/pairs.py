"""Two independent faults in one tracker: both are to be main findings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from . import altered_scans as scans
from . import filter_faults as filtering
from . import jacobian_faults as jacobian
from . import sensor_faults as sensing
from .mutant import Make
from .plain_ekf import PlainEkf
from .plain_ukf import PlainUkf
from .wrappers import AlteredScans, WrongClock


@dataclass(frozen=True)
class Part:
    """One fault: in a method, in an option or outside of the tracker."""

    fault: str
    sensor: str | None = None
    """The kind of the only sensor that it concerns."""
    mixin: type = object
    options: tuple[tuple[str, float], ...] = ()
    behind: Callable[[Any], Any] | None = None

    def around(self, tracker: Any) -> Any:
        return tracker if self.behind is None else self.behind(tracker)


def _altered(alter: scans.Alter) -> Callable[[Any], Any]:
    return lambda tracker: AlteredScans(tracker, alter)


PARTS = {
    "asymmetric": Part("covariance_asymmetric", mixin=filtering.UnsymmetricUpdate),
    "asymmetric_q": Part("predicted_covariance_asymmetric", mixin=filtering.OneSidedNoise),
    "lidar_bias": Part("sensor_bias", "lidar", behind=_altered(scans.offset("lidar", 0, 2.0))),
    "lidar_mirrored": Part("axis_mirrored", "lidar", behind=_altered(scans.component("lidar", 1, np.negative))),
    "lidar_not_turned": Part("jacobian_wrong", "lidar", mixin=jacobian.LidarNotTurned),
    "lidar_swapped": Part("axis_swapped", "lidar", behind=_altered(scans.lidar_axes_swapped)),
    "mean": Part("angle_mean_not_circular", "radar", mixin=sensing.BareMean),
    "not_wrapped": Part("azimuth_not_wrapped", "radar", mixin=sensing.BareResidual),
    "own_velocity": Part("ego_motion_ignored", "radar", behind=_altered(scans.velocity_ignored)),
    "own_yaw": Part("ego_motion_ignored", behind=_altered(scans.pose(2, np.zeros_like))),
    "per_second": Part("nonfinite", mixin=filtering.NoisePerSecond),
    "q_large": Part("q_too_large", options=(("acceleration_sigma", 90.0),)),
    "q_small": Part("q_too_small", options=(("acceleration_sigma", 0.03),)),
    "r_lidar": Part("r_too_small", "lidar", behind=_altered(scans.scaled_noise(1 / 16, "lidar"))),
    "r_radar": Part("r_too_large", "radar", behind=_altered(scans.scaled_noise(16.0, "radar"))),
    "rate_sign": Part("doppler_sign", "radar", behind=_altered(scans.component("radar", 2, np.negative))),
    "sigma_degrees": Part(
        "degrees_for_radians", "radar", behind=_altered(scans.scaled_noise(np.degrees(1.0) ** 2, "radar", 1))
    ),
    "speed": Part("speed_for_range_rate", "radar", mixin=sensing.SpeedOverGround),
    "step": Part("wrong_dt", behind=lambda tracker: WrongClock(tracker, lambda now, _before, _time: now + 0.1)),
}
#: Of these the first trackers are made, with two of `PARTS` each.
IN_BOTH = (
    ("rate_sign", "q_small"),
    ("not_wrapped", "step"),
    ("r_lidar", "rate_sign"),
    ("not_wrapped", "q_large"),
    ("not_wrapped", "own_velocity"),
    ("not_wrapped", "own_yaw"),
    ("not_wrapped", "lidar_swapped"),
    ("lidar_mirrored", "r_radar"),
    ("sigma_degrees", "q_small"),
    ("lidar_bias", "rate_sign"),
    ("asymmetric", "rate_sign"),
    ("asymmetric_q", "not_wrapped"),
    ("per_second", "rate_sign"),
    ("r_lidar", "q_large"),
)
IN_EKF = (
    ("speed", "r_lidar"),
    ("speed", "q_small"),
    ("lidar_not_turned", "not_wrapped"),
    ("lidar_not_turned", "q_large"),
)
IN_UKF = (("mean", "q_large"), ("mean", "step"), ("mean", "r_lidar"))


@dataclass(frozen=True)
class Pair:
    """A tracker with two faults."""

    name: str
    parts: tuple[Part, Part]
    make: Make


def _pair(tracker: type, names: tuple[str, str]) -> Pair:
    first, second = PARTS[names[0]], PARTS[names[1]]
    mixins = tuple(part.mixin for part in (first, second) if part.mixin is not object)
    made = type("Paired", (*mixins, tracker), {})
    options = dict((*first.options, *second.options))
    make = partial(_made, made, options, (first, second))
    return Pair(f"{tracker.__name__}/{'+'.join(names)}", (first, second), make)


def _made(tracker: type, options: dict[str, float], parts: tuple[Part, Part]) -> Any:
    return parts[1].around(parts[0].around(tracker(**options)))


PAIRS = [
    _pair(tracker, names)
    for tracker, some in ((PlainEkf, (*IN_BOTH, *IN_EKF)), (PlainUkf, (*IN_BOTH, *IN_UKF)))
    for names in some
]
