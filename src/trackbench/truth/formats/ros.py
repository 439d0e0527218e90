"""Tracks in ROS bags, at the stamps of the message headers; ROS itself is not needed.

Sources: REP 103, "Standard Units of Measure and Coordinate Conventions"; definitions of ``nav_msgs``,
``visualization_msgs``, ``vision_msgs`` and ``autoware_perception_msgs``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from trackbench.base.errors import InputError, shortened_text
from trackbench.base.files import require_regular
from trackbench.base.plugins import one_line
from trackbench.truth.config.logs import BAG
from trackbench.truth.formats.mcap import Row, chosen_topic, rows_of_messages, time_of, yaw_of
from trackbench.truth.tracks import TrackRows, TrafficFormat

#: Type of a box, and actions that show it, in ``visualization_msgs/msg/Marker``.
CUBE, SHOWN = 1, (0,)
#: Classes by label of ``autoware_perception_msgs/msg/ObjectClassification``.
LABELS = {1: "car", 2: "truck", 3: "bus", 4: "trailer", 5: "motorcycle", 6: "bicycle", 7: "pedestrian"}


def _row(name: str, header: Any, pose: Any, size: Any = None, twist: Any = None, **more: Any) -> Row:
    """Return position, heading, size and velocity of one object; ``twist`` is in the object's own frame."""
    turn = pose.orientation
    heading = yaw_of(turn.x, turn.y, turn.z, turn.w)
    row: Row = {"time": time_of(header.stamp.sec, header.stamp.nanosec), "frame": header.frame_id, "id": name, **more}
    row |= {"x": float(pose.position.x), "y": float(pose.position.y), "heading": heading}
    if size is not None:
        row |= {"length": float(size.x), "width": float(size.y)}
    if twist is not None:
        cos, sin, ahead, left = math.cos(heading), math.sin(heading), twist.linear.x, twist.linear.y
        row |= {"vx": float(cos * ahead - sin * left), "vy": float(sin * ahead + cos * left)}
    return row


def _with_covariance(row: Row, pose: Any, twist: Any) -> Row:
    """Return the row with covariances of position and velocity; a matrix of zeros means unknown."""
    cos, sin = math.cos(row["heading"]), math.sin(row["heading"])
    turn = np.array([[cos, -sin], [sin, cos]])
    position, velocity = (np.asarray(part).reshape(6, 6)[:2, :2] for part in (pose.covariance, twist.covariance))
    for first, block in ((0, position), (2, turn @ velocity @ turn.T)):
        if block.any():
            row |= {f"p_{first + a}{first + b}": float(block[a, b]) for a, b in ((0, 0), (0, 1), (1, 1))}
    return row


def _odometry(message: Any) -> Iterator[Row]:
    pose, twist = message.pose, message.twist
    row = _row(message.child_frame_id or "object", message.header, pose.pose, None, twist.twist)
    yield _with_covariance(row, pose, twist)


def _markers(message: Any) -> Iterator[Row]:
    for item in message.markers:
        if item.type == CUBE and item.action in SHOWN:
            name = f"{item.ns}/{item.id}" if item.ns else str(item.id)
            yield _row(name, item.header, item.pose, item.scale)


def _detections(message: Any) -> Iterator[Row]:
    for item in message.detections:
        if not item.id:
            raise ValueError("a detection has no id: these are detections of single images, and no tracks")
        kind = item.results[0].hypothesis.class_id if len(item.results) else ""
        yield _row(item.id, message.header, item.bbox.center, item.bbox.size, **{"class": kind})


def _tracked(message: Any) -> Iterator[Row]:
    for item in message.objects:
        pose, twist = item.kinematics.pose_with_covariance, item.kinematics.twist_with_covariance
        likely = max(item.classification, key=lambda label: label.probability, default=None)
        name, size = bytes(item.object_id.uuid).hex(), item.shape.dimensions
        kind = "" if likely is None else LABELS.get(likely.label, "")
        more = {"class": kind, "existence": float(item.existence_probability)}
        yield _with_covariance(_row(name, message.header, pose.pose, size, twist.twist, **more), pose, twist)


#: Readers by type of the messages.
READERS: dict[str, Callable[[Any], Iterator[Row]]] = {
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
        # Bags of ROS 2 Humble or earlier contain no message definitions.
        default = get_typestore(Stores.ROS2_HUMBLE)
        try:
            with AnyReader([named.parent if named.name == BAG else file], default_typestore=default) as bag:
                types = {item.topic: item.msgtype for item in bag.connections if item.msgtype in READERS}
                topic = chosen_topic(types, READERS, self.topic, file)
                connections = [item for item in bag.connections if item.topic == topic]
                if types[topic] not in bag.typestore.types:
                    message = f"the bag has no definition of {types[topic]}, nor has ROS 2 Humble"
                    raise InputError(message, file=file)
                read = READERS[types[topic]]
                messages = (
                    bag.deserialize(raw, item.msgtype) for item, _, raw in bag.messages(connections=connections)
                )
                return rows_of_messages([row for message in messages for row in read(message)], file)
        except InputError:
            raise
        except Exception as error:  # A damaged file can cause any exception in the reader.
            raise InputError(f"not a ROS bag that can be read: {shortened_text(one_line(error))}", file=file) from None
