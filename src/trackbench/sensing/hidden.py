"""Scans that do not say which detection stems from which object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from trackbench.models.sensors import Sensor
from trackbench.streams import stream
from trackbench.types import FieldOfView, Scan


def hide_identities(
    scans: Sequence[Scan], sensors: Mapping[str, Sensor], seed: int, scenario: str, run: int
) -> list[Scan]:
    """The detections of one run in an order that means nothing, with what each sensor states of its detections.

    Args:
        scans: of one run, with known identities: ``measurement`` ``(m, objects)``, ``valid`` ``(objects,)``.
        sensors: by name.
        seed, scenario, run: the order is drawn by ``stream(seed, scenario, run, "order of <sensor>")``, so that it
            changes no other draw.

    Returns:
        Scans with ``measurement`` ``(m, D)`` and ``valid`` ``(D,)``, all True; D may be 0.
    """
    random = {name: stream(seed, scenario, run, f"order of {name}") for name in sensors}
    hidden = []
    for scan in scans:
        order = random[scan.sensor].permutation(np.flatnonzero(scan.valid))
        measurement, valid = scan.measurement[:, order], np.ones(len(order), dtype=bool)
        for shared in (measurement, valid):
            shared.setflags(write=False)
        sensor = sensors[scan.sensor]
        hidden.append(
            scan._replace(
                measurement=measurement,
                valid=valid,
                detection_probability=sensor.detection_probability,
                clutter_density=0.0,
                field_of_view=field_of_view(sensor),
            )
        )
    return hidden


def field_of_view(sensor: Sensor) -> FieldOfView:
    """Where a sensor can detect anything."""
    limit = np.inf if sensor.max_range_m is None else sensor.max_range_m
    return FieldOfView(float(np.deg2rad(sensor.fov_deg) / 2), float(limit))
