"""ROS bags, without ROS: tracks of the most usual messages, at the stamps of their headers.

Sources: REP 103, "Standard Units of Measure and Coordinate Conventions"; definitions of ``nav_msgs``,
``visualization_msgs``, ``vision_msgs`` and ``autoware_perception_msgs``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from decimal import Decimal
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from trackbench.base.errors import InputError, shortened_text
from trackbench.base.files import require_regular
from trackbench.base.plugins import one_line
from trackbench.base.types import Array
from trackbench.truth.config.logs import BAG
from trackbench.truth.formats.mcap import chosen_topic
from trackbench.truth.recorded.rows import FROM_ZERO_S
from trackbench.truth.tracks import TrackRows, TrafficFormat

#: ``visualization_msgs/msg/Marker``: a box, and the actions that show it.
CUBE, SHOWN = 1, (0,)
#: ``autoware_perception_msgs/msg/ObjectClassification``
LABELS = {1: "car", 2: "truck", 3: "bus", 4: "trailer", 5: "motorcycle", 6: "bicycle", 7: "pedestrian"}


class TrackedRow(NamedTuple):
    """What a message says of one object."""

    id: str
    stamp: Any
    """Of the header."""
    frame: str
    pose: Any
    """With position and orientation."""
    size: Any = None
    """With x and y, m."""
    twist: Any = None
    """In the object's own frame."""
    covariances: tuple[Any, Any] | None = None
    """``(36,)`` of pose and twist."""
    existence: float = math.nan
    kind: str = ""


def _odometry(message: Any) -> Iterator[TrackedRow]:
    pose, twist = message.pose, message.twist
    of_both = pose.covariance, twist.covariance
    name = message.child_frame_id or "object"
    yield TrackedRow(name, message.header.stamp, message.header.frame_id, pose.pose, None, twist.twist, of_both)


def _markers(message: Any) -> Iterator[TrackedRow]:
    for item in message.markers:
        if item.type == CUBE and item.action in SHOWN:
            name = f"{item.ns}/{item.id}" if item.ns else str(item.id)
            yield TrackedRow(name, item.header.stamp, item.header.frame_id, item.pose, item.scale)


def _detections(message: Any) -> Iterator[TrackedRow]:
    for item in message.detections:
        if not item.id:
            raise ValueError("a detection has no id: these are detections of single images, and no tracks")
        kind = item.results[0].hypothesis.class_id if len(item.results) else ""
        stamp, frame = message.header.stamp, message.header.frame_id
        yield TrackedRow(item.id, stamp, frame, item.bbox.center, item.bbox.size, kind=kind)


def _tracked(message: Any) -> Iterator[TrackedRow]:
    for item in message.objects:
        moving = item.kinematics
        likely = max(item.classification, key=lambda each: each.probability, default=None)
        yield TrackedRow(
            bytes(item.object_id.uuid).hex(),
            message.header.stamp,
            message.header.frame_id,
            moving.pose_with_covariance.pose,
            item.shape.dimensions,
            moving.twist_with_covariance.twist,
            (moving.pose_with_covariance.covariance, moving.twist_with_covariance.covariance),
            float(item.existence_probability),
            "" if likely is None else LABELS.get(likely.label, ""),
        )


#: By the type of the messages.
READERS: dict[str, Callable[[Any], Iterator[TrackedRow]]] = {
    "nav_msgs/msg/Odometry": _odometry,
    "visualization_msgs/msg/MarkerArray": _markers,
    "vision_msgs/msg/Detection3DArray": _detections,
    "autoware_perception_msgs/msg/TrackedObjects": _tracked,
    "autoware_auto_perception_msgs/msg/TrackedObjects": _tracked,
}


class RosBag(TrafficFormat):
    """ROS bag with Odometry, MarkerArray, Detection3DArray or TrackedObjects. Needs `trackbench[ros]`, and no ROS."""

    endings: ClassVar[tuple[str, ...]] = (".db3", ".bag")
    topic: str | None = Field(
        None, min_length=1, description="The topic with the tracks; needed only where several have some."
    )

    def rows(self, file: Path) -> TrackRows:
        try:
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            raise InputError("ROS bags need one more package: pip install 'trackbench[ros]'", file=file) from None
        named = file / BAG if file.is_dir() else file
        require_regular(named)
        # Bags that were recorded with ROS 2 Humble or before have no definitions of their own.
        default = get_typestore(Stores.ROS2_HUMBLE)
        try:
            with AnyReader([named.parent if named.name == BAG else file], default_typestore=default) as bag:
                types = {item.topic: item.msgtype for item in bag.connections if item.msgtype in READERS}
                topic = chosen_topic(types, READERS, self.topic, file)
                own = [item for item in bag.connections if item.topic == topic]
                if types[topic] not in bag.typestore.types:
                    message = f"the bag has no definition of {types[topic]}, nor has ROS 2 Humble"
                    raise InputError(message, file=file)
                read = READERS[types[topic]]
                every = (bag.deserialize(raw, item.msgtype) for item, _, raw in bag.messages(connections=own))
                return _rows([row for message in every for row in read(message)], file)
        except InputError:
            raise
        except Exception as error:  # The reader of bags lets whatever a damaged file leads to through.
            raise InputError(f"not a ROS bag that can be read: {shortened_text(one_line(error))}", file=file) from None


def _rows(tracked: list[TrackedRow], file: Path) -> TrackRows:
    if not tracked:
        raise InputError("there is no track in the messages of this topic", file=file)
    frames = sorted({row.frame for row in tracked})
    if len(frames) > 1:
        problem = (
            f"tracks are in several frames, and one that is fixed to the ground is needed: {', '.join(frames[:5])}"
        )
        raise InputError(shortened_text(problem, 300), file=file)
    first = min(row.stamp.sec for row in tracked)
    start = first if first > FROM_ZERO_S else 0
    numbers = np.array([_numbers(row, start) for row in tracked]).T
    time, px, py, heading, vx, vy, length, width, existence = numbers
    covariance = np.stack([_covariance(row, angle) for row, angle in zip(tracked, heading, strict=True)], axis=-1)
    known = {"vx": vx, "vy": vy, "length": length, "width": width, "existence": existence}
    stated: dict[str, Any] = {name: values for name, values in known.items() if np.isfinite(values).all()}
    if np.isfinite(covariance).any():
        stated["covariance"] = covariance
    kinds = [row.kind for row in tracked]
    ids = [row.id for row in tracked]
    return TrackRows(ids, time, px, py, heading=heading, kind=kinds, start=Decimal(start), **stated)


def _numbers(row: TrackedRow, start: int) -> tuple[float, ...]:
    """Time, x, y, heading, vx, vy, length, width, existence; NaN where a message does not state it."""
    position, turn = row.pose.position, row.pose.orientation
    heading = math.atan2(2 * (turn.w * turn.z + turn.x * turn.y), 1 - 2 * (turn.y**2 + turn.z**2))
    velocity, size = (math.nan, math.nan), (math.nan, math.nan)
    if row.twist is not None:
        cos, sin, ahead, left = math.cos(heading), math.sin(heading), row.twist.linear.x, row.twist.linear.y
        velocity = cos * ahead - sin * left, sin * ahead + cos * left
    if row.size is not None:
        size = row.size.x, row.size.y
    time = row.stamp.sec - start + 1e-9 * row.stamp.nanosec
    return time, position.x, position.y, heading, *velocity, *size, row.existence


def _covariance(row: TrackedRow, heading: float) -> Array:
    """``(4, 4)`` of px, py, vx, vy; NaN between position and velocity, which no message states, and where all are 0."""
    result = np.full((4, 4), np.nan)
    if row.covariances is None:
        return result
    position, velocity = (np.asarray(part).reshape(6, 6)[:2, :2] for part in row.covariances)
    turn = np.array([[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]])
    for place, block in ((0, position), (2, turn @ velocity @ turn.T)):
        if block.any():
            result[place : place + 2, place : place + 2] = block
    return result
