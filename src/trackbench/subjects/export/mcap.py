"""The scans in MCAP, as JSON with a schema: a message for each scan, in the order in which a tracker gets them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from trackbench.base.errors import InputError
from trackbench.base.types import Scan
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.results import json_text
from trackbench.subjects.export.scans import RunKey, RunScans, ScanSource, component_columns
from trackbench.truth.formats.mcap import SCAN


class ScanRow(BaseModel):
    """Measurement with a key for each of its components, such as ``range_m``."""

    model_config = ConfigDict(extra="allow")

    valid: bool
    object: str | None = None
    detection: int | None = None


class ScanMessage(BaseModel):
    """Message with one scan: sensor, times, pose, noise and measurements, as a tracker gets them."""

    scene: int
    run: int
    fingerprint: str
    scan: int
    sensor: str
    time_s: float
    arrival_time_s: float
    sensor_pose: tuple[float, float, float] = Field(description="x m, y m, yaw rad in the fixed frame")
    sensor_velocity: tuple[float, float] = Field(description="vx, vy in the fixed frame, m/s")
    noise_covariance: list[list[float]]
    rows: list[ScanRow]
    detection_probability: float | None = None
    clutter_density: float | None = None


def mcap_scan_files(source: ScanSource) -> dict[str, Callable[[Path], object]]:
    """Return the functions that write the MCAP file of each run, by file name."""
    return {f"{key.stem}.mcap": partial(_write_scans, source, key) for key in source.keys}


def _write_scans(source: ScanSource, key: RunKey, path: Path) -> None:
    """Write the scans of one run; the log time of a message is its arrival.

    Raises:
        InputError: the Python package ``mcap`` is missing.
    """
    try:
        from mcap.writer import Writer
    except ImportError:
        raise InputError("MCAP needs one more package: pip install 'trackbench[mcap]'", file=path.name) from None
    run_scans = source.scans(key)
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(library="trackbench")
        content = ScanMessage.model_json_schema() | {"title": SCAN}
        schema = writer.register_schema(SCAN, "jsonschema", json_text(content).encode())
        channels = {
            name: writer.register_channel(f"/{name}/scan", "json", schema) for name in source.loaded.config.sensors
        }
        for number, scan in enumerate(run_scans.scans):
            data = _message(run_scans, number, scan).model_dump_json(exclude_none=True).encode()
            nanoseconds = round(scan.arrival_time * 1e9)
            writer.add_message(channels[scan.sensor], nanoseconds, data, nanoseconds)
        writer.finish()  # type: ignore[no-untyped-call]


def _message(run_scans: RunScans, number: int, scan: Scan) -> ScanMessage:
    columns, objects = component_columns(SENSOR_MODELS[scan.kind]), run_scans.objects
    rows = []
    for place, (valid, measured) in enumerate(zip(scan.valid.tolist(), scan.measurement.T.tolist(), strict=True)):
        named = {"detection": place} if objects is None else {"object": objects[place]}
        components = dict(zip(columns, measured, strict=True)) if valid else {}
        rows.append({**named, "valid": valid, **components})
    hidden = objects is None
    return ScanMessage.model_validate(
        {
            **run_scans.key._asdict(),
            "fingerprint": run_scans.fingerprint,
            "scan": number,
            "sensor": scan.sensor,
            "time_s": scan.time,
            "arrival_time_s": scan.arrival_time,
            "sensor_pose": scan.sensor_pose.tolist(),
            "sensor_velocity": scan.sensor_velocity.tolist(),
            "noise_covariance": scan.noise_covariance.tolist(),
            "rows": rows,
            "detection_probability": scan.detection_probability if hidden else None,
            "clutter_density": scan.clutter_density if hidden else None,
        }
    )
