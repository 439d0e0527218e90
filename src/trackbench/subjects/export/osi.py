"""Scans as traces of OSI SensorData, truths as traces of OSI GroundTruth.

Sources: ASAM OSI 3.7, ``osi_sensordata.proto``, ``osi_featuredata.proto``, ``osi_groundtruth.proto``,
``osi_object.proto``, ``osi_common.proto``; Protocol Buffers documentation, "Encoding".
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import Scan, Truth
from trackbench.models.sensors import Lidar, Radar, Sensor
from trackbench.subjects.export.scans import RunKey, ScanSource
from trackbench.truth.formats import osi

#: Of the interface: major, minor, patch.
VERSION = (3, 7, 0)
#: Numbers of fields beside those that are read.
HOST_LOCATION, SENSOR_ID, MEASURED_AT, FEATURE_DATA = 3, 5, 9, 26
RADARS, LIDARS = 2, 3
HEADER, DETECTION = 1, 2
#: Of a detection, and of the velocity of a radar's.
DETECTED_ID, DETECTED_AT, DETECTED_RMSE, RADIAL_VELOCITY, RADIAL_VELOCITY_RMSE = 2, 3, 4, 5, 6
#: ``TYPE_VEHICLE`` and ``TYPE_MEDIUM_CAR``.
VEHICLE, CAR = 2, 4


def osi_scan_files(source: ScanSource) -> dict[str, Callable[[Path], object]]:
    """A file for each run and sensor.

    Raises:
        InputError: a sensor is one of which OSI has no detections.
    """
    for name, sensor in source.loaded.config.sensors.items():
        if not isinstance(sensor, Radar | Lidar) or not sensor.measures_position():
            message = f"OSI has no detections of a {sensor.type}; choose another format"
            raise InputError(message, key=f"sensors.{name}.type", file=source.loaded.path)
    names = [*source.loaded.config.sensors]
    return {
        f"{key.stem}_{name}_sd.osi": partial(_write_scans, source, key, name, number)
        for key in source.keys
        for number, name in enumerate(names)
    }


def osi_truth_files(source: ScanSource) -> dict[str, Callable[[Path], object]]:
    """A file for each scene; where motion is drawn anew, one for each run."""
    return {f"{name}_gt_.osi": partial(_write_truth, truth, run) for name, truth, run in source.truth_runs()}


def _write_scans(source: ScanSource, key: RunKey, name: str, number: int, path: Path) -> None:
    sensor = source.loaded.config.sensors[name]
    scans = [scan for scan in source.scans(key).scans if scan.sensor == name]
    _write(path, (_sensor_data(scan, sensor, number) for scan in scans))


def _write_truth(truth: Truth, run: int, path: Path) -> None:
    steps = range(len(truth.time))
    _write(path, (_ground_truth(truth, step, run) for step in steps))


def _write(path: Path, messages: Iterable[bytes]) -> None:
    """Each message after its length as four bytes, little-endian."""
    with path.open("wb") as stream:
        for message in messages:
            stream.write(len(message).to_bytes(4, "little") + message)


def _sensor_data(scan: Scan, sensor: Sensor, number: int) -> bytes:
    """A SensorData message: its time stamp is that of arrival; detections are in the sensor's own frame.

    The location of the host vehicle is that of the sensor, which then has no mounting position.
    """
    sigma = np.sqrt(np.diag(scan.noise_covariance)).tolist()
    header = _message(1, _stamp(scan.time)) + _message(7, _whole(1, number))
    detections, radar = [], isinstance(sensor, Radar)
    for place in np.flatnonzero(scan.valid).tolist():
        measured = scan.measurement[:, place].tolist()
        labelled = b"" if scan.detection_probability is not None else _message(DETECTED_ID, _whole(1, place + 1))
        if radar:
            position = _message(DETECTED_AT, _doubles(measured[0], measured[1], 0.0))
            position += _message(DETECTED_RMSE, _doubles(sigma[0], sigma[1], 0.0))
            rate = b""
            if sensor.measures_velocity():
                rate = _double(RADIAL_VELOCITY, measured[2]) + _double(RADIAL_VELOCITY_RMSE, sigma[2])
            detections.append(labelled + position + rate)
        else:
            polar = float(np.hypot(*measured)), float(np.arctan2(measured[1], measured[0]))
            detections.append(labelled + _message(DETECTED_AT, _doubles(*polar, 0.0)))
    data = _message(HEADER, header) + b"".join(_message(DETECTION, item) for item in detections)
    features = _message(1, _version()) + _message(RADARS if radar else LIDARS, data)
    stamps = _message(osi.TIMESTAMP, _stamp(scan.arrival_time)), _message(MEASURED_AT, _stamp(scan.time))
    x, y, yaw = scan.sensor_pose
    location = _message(osi.POSITION, _doubles(x, y, 0.0)) + _message(osi.ORIENTATION, _doubles(0.0, 0.0, yaw))
    location += _message(osi.VELOCITY, _doubles(*scan.sensor_velocity, 0.0))
    carrier = _message(HOST_LOCATION, location) + _message(SENSOR_ID, _whole(1, number))
    return _message(1, _version()) + stamps[0] + carrier + stamps[1] + _message(FEATURE_DATA, features)


def _ground_truth(truth: Truth, step: int, run: int) -> bytes:
    content = _message(1, _version()) + _message(osi.TIMESTAMP, _stamp(float(truth.time[step])))
    for body in np.flatnonzero(truth.alive[step]).tolist():
        at = step, body, run
        base = _message(osi.DIMENSION, _doubles(truth.length[body], truth.width[body], 0.0))
        base += _message(osi.POSITION, _doubles(truth.px[at], truth.py[at], 0.0))
        base += _message(osi.ORIENTATION, _doubles(0.0, 0.0, truth.heading[at]))
        base += _message(osi.VELOCITY, _doubles(truth.vx[at], truth.vy[at], 0.0))
        item = _message(osi.OBJECT_ID, _whole(1, body + 1)) + _message(osi.OBJECT_BASE, base)
        item += _whole(osi.OBJECT_TYPE, VEHICLE) + _message(osi.CLASSIFICATION, _whole(1, CAR))
        content += _message(osi.MOVING_OBJECT, item)
    return content


def _version() -> bytes:
    return b"".join(_whole(number, value) for number, value in enumerate(VERSION, 1))


def _stamp(time: float) -> bytes:
    seconds, nanoseconds = divmod(round(time * 1e9), 10**9)
    return _whole(1, seconds) + _whole(2, nanoseconds)


def _doubles(*values: float) -> bytes:
    return b"".join(_double(number, value) for number, value in enumerate(values, 1))


def _double(number: int, value: float) -> bytes:
    return _varint(number << 3 | 1) + struct.pack("<d", value)


def _whole(number: int, value: int) -> bytes:
    return _varint(number << 3) + _varint(value)


def _message(number: int, content: bytes) -> bytes:
    return _varint(number << 3 | 2) + _varint(len(content)) + content


def _varint(value: int) -> bytes:
    parts = bytearray()
    while value > 127:
        parts.append(value & 127 | 128)
        value >>= 7
    return bytes([*parts, value])
