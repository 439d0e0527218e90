"""Bags of ROS 2 with one of each message that has tracks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

#: Of packages that rosbags does not know, as ROS has them, without what is not read.
DEFINITIONS = {
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score",
    "vision_msgs/msg/ObjectHypothesisWithPose": "ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose",
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
    "vision_msgs/msg/Detection3D": "std_msgs/Header header\nObjectHypothesisWithPose[] results\n"
    "BoundingBox3D bbox\nstring id",
    "vision_msgs/msg/Detection3DArray": "std_msgs/Header header\nDetection3D[] detections",
    "unique_identifier_msgs/msg/UUID": "uint8[16] uuid",
    "autoware_perception_msgs/msg/Shape": "uint8 type\ngeometry_msgs/Vector3 dimensions",
    "autoware_perception_msgs/msg/TrackedObjectKinematics": "geometry_msgs/PoseWithCovariance pose_with_covariance\n"
    "geometry_msgs/TwistWithCovariance twist_with_covariance",
    "autoware_perception_msgs/msg/ObjectClassification": "uint8 label\nfloat32 probability",
    "autoware_perception_msgs/msg/TrackedObject": "unique_identifier_msgs/UUID object_id\n"
    "float32 existence_probability\nObjectClassification[] classification\n"
    "TrackedObjectKinematics kinematics\nShape shape",
    "autoware_perception_msgs/msg/TrackedObjects": "std_msgs/Header header\nTrackedObject[] objects",
}
#: The log time of every message is later than its stamp, s.
LATE = 3
#: x, y, heading, speed along it, length, width, and the covariances of pose and twist.
CAR = (10.0, 20.0, 0.6, 8.0, 4.5, 1.8)
POSE_COVARIANCE = np.diag([0.4, 0.2, 0, 0, 0, 0.01])
TWIST_COVARIANCE = np.diag([0.5, 0.1, 0, 0, 0, 0.01])


class Body(NamedTuple):
    """One object of a message of several."""

    uuid: bytes = bytes(range(16))
    label: int = 1
    size: tuple[float, float] = CAR[4:]
    state: tuple[float, float, float, float] | None = None
    """x, y, heading, speed; as the car's unless given."""


class Messages:
    """Makes messages of a typestore that knows the definitions above."""

    def __init__(self) -> None:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.store = get_typestore(Stores.ROS2_HUMBLE)
        for name, text in DEFINITIONS.items():
            if name not in self.store.types:
                self.store.register(get_types_from_msg(text, name))

    def __call__(self, name: str, *values: Any) -> Any:
        return self.store.types[name](*values)

    def header(self, time: float, frame: str) -> Any:
        stamp = self("builtin_interfaces/msg/Time", math.floor(time), round(time % 1 * 1e9))
        return self("std_msgs/msg/Header", stamp, frame)

    def pose(self, time: float, state: tuple[float, ...] | None = None) -> Any:
        x, y, heading, speed, *_ = state or CAR
        along = 0.0 if state else speed * (time % 1000)
        point = self("geometry_msgs/msg/Point", x + along * math.cos(heading), y + along * math.sin(heading), 0.0)
        return self("geometry_msgs/msg/Pose", point, self.turn(heading))

    def turn(self, heading: float) -> Any:
        return self("geometry_msgs/msg/Quaternion", 0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2))

    def vector(self, x: float, y: float) -> Any:
        return self("geometry_msgs/msg/Vector3", x, y, 1.5)

    def moving(self, time: float, state: tuple[float, ...] | None = None) -> tuple[Any, Any]:
        twist = self("geometry_msgs/msg/Twist", self.vector((state or CAR)[3], 0.0), self.vector(0.0, 0.0))
        return (
            self("geometry_msgs/msg/PoseWithCovariance", self.pose(time, state), POSE_COVARIANCE.ravel()),
            self("geometry_msgs/msg/TwistWithCovariance", twist, TWIST_COVARIANCE.ravel()),
        )

    def odometry(self, time: float, frame: str = "map") -> Any:
        return self("nav_msgs/msg/Odometry", self.header(time, frame), "car", *self.moving(time))

    def markers(self, time: float, frame: str = "map") -> Any:
        size, nothing = self.vector(*CAR[4:]), self("builtin_interfaces/msg/Duration", 0, 0)
        colour = self("std_msgs/msg/ColorRGBA", 1.0, 0.0, 0.0, 1.0)
        texture = self("sensor_msgs/msg/CompressedImage", self.header(time, ""), "", np.zeros(0, np.uint8))
        mesh = self("visualization_msgs/msg/MeshFile", "", np.zeros(0, np.uint8))
        parts = [self.pose(time), size, colour, nothing, False, [], [], "", texture, [], "", "", mesh, False]
        shown = [(1, 0, 7), (9, 0, 7), (1, 2, 8)]
        marker = "visualization_msgs/msg/Marker"
        return self(
            "visualization_msgs/msg/MarkerArray",
            [self(marker, self.header(time, frame), "cars", number, kind, act, *parts) for kind, act, number in shown],
        )

    def detections(self, time: float, frame: str = "map", name: str = "a7") -> Any:
        hypothesis = self("vision_msgs/msg/ObjectHypothesis", "car", 0.9)
        result = self("vision_msgs/msg/ObjectHypothesisWithPose", hypothesis, self.moving(time)[0])
        box = self("vision_msgs/msg/BoundingBox3D", self.pose(time), self.vector(*CAR[4:]))
        item = self("vision_msgs/msg/Detection3D", self.header(0, ""), [result], box, name)
        return self("vision_msgs/msg/Detection3DArray", self.header(time, frame), [item])

    def tracked(self, time: float, frame: str = "map", bodies: Sequence[Body] = (Body(),)) -> Any:
        items = [self._tracked(body, time) for body in bodies]
        return self("autoware_perception_msgs/msg/TrackedObjects", self.header(time, frame), items)

    def _tracked(self, body: Body, time: float) -> Any:
        package = "autoware_perception_msgs/msg"
        name = self("unique_identifier_msgs/msg/UUID", np.frombuffer(body.uuid, dtype=np.uint8))
        kinematics = self(f"{package}/TrackedObjectKinematics", *self.moving(time, body.state))
        classes = [self(f"{package}/ObjectClassification", *each) for each in ((0, 0.1), (body.label, 0.8))]
        shape = self(f"{package}/Shape", 0, self.vector(*body.size))
        return self(f"{package}/TrackedObject", name, 0.75, classes, kinematics, shape)


def write_bag(
    folder: Path,
    messages: Sequence[tuple[str, Any]],
    *,
    definitions: bool = True,
    name: str = "bag",
    mcap: bool = False,
) -> Path:
    """A bag of messages, each with its topic, every 0.1 s of its log time; the file in its folder."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    store = Messages().store
    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    bag = folder / name
    with Writer(bag, version=9, storage_plugin=plugin) as writer:
        connections: dict[str, Any] = {}
        for number, (topic, message) in enumerate(messages):
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], round((LATE + 0.1 * number) * 1e9), store.serialize_cdr(message, kind))
    (file,) = bag.glob(f"*.{'mcap' if mcap else 'db3'}")
    if not definitions:
        _forget_definitions(file)
    return file


def _forget_definitions(file: Path) -> None:
    """As bags of ROS 2 Humble and older are."""
    import sqlite3

    base = sqlite3.connect(file)
    base.execute("DELETE FROM message_definitions")
    base.commit()
    base.close()
