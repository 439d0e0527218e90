"""The examination of one tracker of several objects."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping

import numpy as np

from trackbench.doctor.examine import Examination, simplified
from trackbench.doctor.failures import CannotRun
from trackbench.doctor.findings import PartResult
from trackbench.doctor.traffic.checks import (
    empty_scan,
    false_alarms,
    following,
    gate,
    leaving,
    order,
    stated_figures,
)
from trackbench.doctor.traffic.ranking import ranked
from trackbench.doctor.traffic.scenes import Site
from trackbench.errors import InputError
from trackbench.execution import one_blas_thread
from trackbench.models.sensors import Sensor
from trackbench.stepping.tracks import TracksStepper
from trackbench.types import Progress, no_progress

PARTS = (following, gate, false_alarms, leaving, order, empty_scan, stated_figures)


class TrafficDoctor:
    """Examines trackers of several objects with one sensor, mounted at the origin, that sees all around.

    Args:
        sensors: by name; the first whose field of view has a volume is used, its kind and noise.

    Raises:
        InputError: none has.
    """

    def __init__(self, sensors: Mapping[str, Sensor]) -> None:
        usable = {name: sensor for name, sensor in sensors.items() if type(sensor).volume is not Sensor.volume}
        if not usable:
            raise InputError("no sensor of it has a field of view with a volume, which clutter needs", key="sensors")
        name, sensor = next(iter(usable.items()))
        self._site = Site(name, simplified(sensor))

    @one_blas_thread()
    def examine(self, name: str, make: Callable[[], TracksStepper], progress: Progress = no_progress) -> Examination:
        """Make all checks of a tracker.

        Args:
            name: what it is called in the results.
            make: gives a fresh tracker.
            progress: called after each part with the number of parts done and of all parts.

        Raises:
            CannotRun: the tracker fails in a scene.
        """
        results: list[PartResult] = []
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for done, part in enumerate(PARTS, start=1):
                try:
                    results.append(part(make, self._site))
                except Exception as error:
                    raise CannotRun(f"in the scene {part.__name__}: {error or type(error).__name__}") from error
                progress(done, len(PARTS))
        findings = [finding for result in results for finding in result.findings]
        return Examination(name, ranked(findings), [check for result in results for check in result.checks])
