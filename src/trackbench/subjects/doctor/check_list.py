"""The checks of a tracker of one object: their names, what they need, and what they find."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from difflib import get_close_matches
from typing import NamedTuple

from trackbench.base.errors import InputError
from trackbench.subjects.doctor.drives import drive_configs


class KnownCheck(NamedTuple):
    """What is known of a check before it is made."""

    part: str
    """The function that makes it."""
    asks: str
    each_sensor: bool = False
    """Whether it is made for each sensor: its name is followed by a dot and that of the sensor."""
    misses: bool = False
    """Whether it needs scans without a detection."""
    motion: bool = False
    """Whether it needs an observer that moves."""
    finds: tuple[str, ...] = ()
    """The faults that it alone finds, where its part makes several checks."""


_CHECKS = {
    "repeatable": KnownCheck("repeatability", "Do three fresh trackers give the same estimates?"),
    "output": KnownCheck("output", "Is the estimate px, py, vx, vy in the fixed frame?"),
    "start": KnownCheck("first_position", "Do tracks start at the target?", each_sensor=True),
    "stated_covariance": KnownCheck(
        "stated_covariance", "Is the covariance computed, whole, and in the order of the estimate?", misses=True
    ),
    "start_confidence": KnownCheck("confidence", "Is the first covariance as large as the first errors?"),
    "integers": KnownCheck("integers", "Are the estimates fractions, as the measurements are?"),
    "no_time": KnownCheck("no_time", "Does a prediction over no time leave the estimate as it is?", misses=True),
    "prediction": KnownCheck(
        "prediction", "Is the estimate predicted by its velocity times the time step?", misses=True
    ),
    "velocity": KnownCheck(
        "velocity", "Does the velocity stay as it is where nothing says that it changed?", misses=True
    ),
    "spreading": KnownCheck("spreading", "Does the uncertainty of the velocity spread to the position?", misses=True),
    "process_noise": KnownCheck(
        "process_noise",
        "Is the process noise that of a road vehicle?",
        misses=True,
        finds=("q_too_small", "q_too_large", "process_noise_omitted"),
    ),
    "noise_per_step": KnownCheck(
        "process_noise",
        "Does the process noise of a step depend on its length?",
        misses=True,
        finds=("q_constant_per_step",),
    ),
    "noise_powers": KnownCheck(
        "noise_powers", "Do the entries of the process noise go with the same powers of the time step?", misses=True
    ),
    "expectation": KnownCheck(
        "expectation", "Is the right measurement predicted for the own estimate?", each_sensor=True
    ),
    "ego_motion": KnownCheck(
        "expectation",
        "Do the measurements of a moving observer count for where it is and how it moves?",
        motion=True,
        finds=("ego_motion_ignored",),
    ),
    "one_gain": KnownCheck(
        "one_gain", "Do the mean and the covariance change by one gain?", each_sensor=True, misses=True
    ),
    "gain": KnownCheck("gain", "Do the gains fit the geometry and the stated noise?", each_sensor=True, misses=True),
    "covariance_update": KnownCheck(
        "covariance_update", "Does a measurement reduce the predicted covariance?", each_sensor=True, misses=True
    ),
    "same_instant": KnownCheck(
        "instants",
        "Do two sensors' measurements of one instant both count?",
        finds=("second_measurement_dropped",),
    ),
    "same_time": KnownCheck(
        "instants",
        "Is the estimate of one instant the same, whichever sensor's scan asks for it?",
        misses=True,
        finds=("time_offset",),
    ),
    "models": KnownCheck("models", "Are the Jacobians that the tracker provides right?"),
    "azimuth_wrapping": KnownCheck(
        "wrapping",
        "Is the update of a target with the azimuth pi the same as with any other?",
        finds=("azimuth_not_wrapped", "angle_mean_not_circular"),
    ),
    "course_wrapping": KnownCheck(
        "wrapping",
        "Is the update of a target with the course pi the same as with any other?",
        finds=("course_not_wrapped",),
    ),
    "gate": KnownCheck("gate", "Is a target that is elsewhere after a gap taken up again?"),
    "innovations": KnownCheck("innovations", "Are all angles in the innovations wrapped?", each_sensor=True),
    "late": KnownCheck(
        "late", "Are late measurements held against where the target was?", each_sensor=True, misses=True
    ),
}
STEPS_ASKED = "Does every step return an estimate?"
_LAST = {
    "finite": KnownCheck("validity", "Is every number of every estimate finite?", finds=("nonfinite",)),
    "symmetric": KnownCheck(
        "validity",
        "Is every covariance symmetric?",
        finds=("covariance_asymmetric", "predicted_covariance_asymmetric"),
    ),
    "definite": KnownCheck(
        "validity",
        "Is every covariance positive definite?",
        finds=("covariance_not_psd", "predicted_covariance_not_psd"),
    ),
    "predicted_definite": KnownCheck(
        "validity",
        "Does a prediction over 1 s leave the covariance positive definite?",
        misses=True,
        finds=("predicted_covariance_not_psd",),
    ),
    "steps": KnownCheck("steps", STEPS_ASKED),
}


def checks() -> dict[str, KnownCheck]:
    """All checks by name, in the order in which they are made."""
    driven = {
        name: KnownCheck(
            "drives",
            f"Is the tracker as near to its target as it states ({drive.description})?",
            motion=drive.carrier.moves,
        )
        for name, drive in drive_configs().items()
    }
    return {**_CHECKS, **driven, **_LAST}


def require_known(names: Iterable[str], sensors: Iterable[str], key: str = "skip") -> None:
    """Refuse a name that is no check's.

    Args:
        names: of checks, or of one of a sensor: ``gain.radar``.
        sensors: their names.
        key: what is said to have the wrong name.

    Raises:
        InputError: one is none; the nearest that is one is named.
    """
    valid = list(_valid(list(sensors)))
    for name in names:
        if name not in valid:
            (close,) = get_close_matches(name, valid, n=1, cutoff=0.0)
            said = f"there is no check {name!r}: did you mean {close!r}? `trackbench list checks` shows all"
            raise InputError(said, key=key)


def _valid(sensors: list[str]) -> Iterator[str]:
    for name, check in checks().items():
        yield name
        if check.each_sensor:
            yield from (f"{name}.{sensor}" for sensor in sensors)


def listed_checks() -> Iterator[tuple[str, str]]:
    """Name and question of every check, for ``trackbench list``."""
    for name, check in checks().items():
        yield name, check.asks + (" For each sensor." if check.each_sensor else "")
