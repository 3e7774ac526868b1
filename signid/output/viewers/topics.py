"""Topics of ROS 2, in an MCAP file or live, and the messages on them that show a robot."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import IO, Any, Protocol

import numpy as np

from ...types import Array
from ...version import __version__
from .links import Links, Pose, drawn_urdf

STATES, FRAMES, TEXT = "sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage", "std_msgs/msg/String"
LATCHED = ("/robot_description", "/tf_static")
NANO = 1_000_000_000
ENDLESS = "{sec: 9223372036, nsec: 854775807}"  # a duration of rosbag2
LATCH = (  # the quality of service that rosbag2 offers: history of the last one, reliable, transient local
    f"- {{history: 1, depth: 1, reliability: 1, durability: 1, deadline: {ENDLESS}, lifespan: {ENDLESS}, "
    f"liveliness: 1, liveliness_lease_duration: {ENDLESS}, avoid_ros_namespace_conventions: false}}"
)


class Topics(Protocol):
    """Where messages go."""

    def make(self, kind: str, **fields: Any) -> Any:
        """Make a message of a kind; fields that are not given are zero or empty."""

    def send(self, topic: str, stamp: int, message: Any) -> None:
        """Write a message [ns]."""

    def close(self) -> None:
        """End."""


class McapTopics:
    """Topics in an MCAP file, with messages in CDR and their ROS 2 definitions."""

    def __init__(self, out: IO[bytes]) -> None:
        from mcap.writer import Writer
        from rosbags.typesys import Stores, get_typestore

        self.store, self.writer = get_typestore(Stores.ROS2_HUMBLE), Writer(out)
        self.writer.start(profile="ros2", library=f"signid {__version__}")
        self.schemas: dict[str, int] = {}
        self.channels: dict[str, int] = {}

    def make(self, kind: str, **fields: Any) -> Any:
        """Make a message of a kind; fields that are not given are zero or empty."""
        values = {name: self._value(form, fields.get(name)) for name, form in self.store.fielddefs[kind][1]}
        return self.store.types[kind](**values)

    def _value(self, form: Any, given: Any) -> Any:
        node, inner = form
        if node.name == "NAME":
            return self.make(inner) if given is None else given
        if node.name == "BASE":
            return ("" if inner[0] == "string" else 0) if given is None else given
        item, of = inner[0]  # a sequence
        given = [] if given is None else given
        return np.asarray(given, of[0]) if item.name == "BASE" and of[0] != "string" else given

    def send(self, topic: str, stamp: int, message: Any) -> None:
        """Write a message [ns]; not before 0."""
        kind = message.__msgtype__
        if kind not in self.schemas:
            text = self.store.generate_msgdef(kind, ros_version=2)[0].encode()
            self.schemas[kind] = self.writer.register_schema(kind, "ros2msg", text)
        if topic not in self.channels:
            offered = {"offered_qos_profiles": LATCH if topic in LATCHED else ""}
            self.channels[topic] = self.writer.register_channel(topic, "cdr", self.schemas[kind], offered)
        self.writer.add_message(self.channels[topic], stamp, bytes(self.store.serialize_cdr(message, kind)), stamp)

    def close(self) -> None:
        """Write the index."""
        self.writer.finish()


class RosTopics:
    """Topics of a node of ROS 2, in a context of its own beside that of a subscription."""

    def __init__(self, name: str) -> None:
        import rclpy  # type: ignore[import-not-found,unused-ignore]
        from rclpy.context import Context  # type: ignore[import-not-found,unused-ignore]

        self.context = Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node(name, context=self.context)
        self.publishers: dict[str, Any] = {}

    def make(self, kind: str, **fields: Any) -> Any:
        """Make a message of a kind; fields that are not given are zero or empty."""
        package, _, name = kind.split("/")
        return getattr(import_module(f"{package}.msg"), name)(**fields)

    def send(self, topic: str, _stamp: int, message: Any) -> None:
        """Publish a message; nothing after a shutdown of ROS."""
        if not self.context.ok():
            return
        if topic not in self.publishers:
            self.publishers[topic] = self.node.create_publisher(type(message), topic, 100)
        self.publishers[topic].publish(message)

    def close(self) -> None:
        """End the node."""
        self.node.destroy_node()
        if self.context.ok():
            self.context.shutdown()


def stamps(t: Array) -> Any:
    """Time stamps (N,) [ns] of times; seconds and their fraction apart, to keep digits.

    t: (N,) [s].
    """
    whole = np.floor(t)
    return whole.astype(np.int64) * NANO + np.rint((t - whole) * NANO).astype(np.int64)


def clock(topics: Topics, stamp: int) -> Any:
    """A builtin_interfaces/Time."""
    return topics.make("builtin_interfaces/msg/Time", sec=stamp // NANO, nanosec=stamp % NANO)


def header(topics: Topics, stamp: int, frame: str = "") -> Any:
    """A std_msgs/Header."""
    return topics.make("std_msgs/msg/Header", stamp=clock(topics, stamp), frame_id=frame)


def send_joints(topics: Topics, topic: str, stamp: int, joints: Sequence[str], **signals: Array | None) -> None:
    """Write a sensor_msgs/JointState.

    signals: (n,) position [rad or m], velocity [rad/s or m/s] and effort [N.m or N].
    """
    known = {name: x.tolist() for name, x in signals.items() if x is not None}
    topics.send(topic, stamp, topics.make(STATES, header=header(topics, stamp), name=list(joints), **known))


def send_frames(topics: Topics, topic: str, stamp: int, poses: Sequence[Pose]) -> None:
    """Write a tf2_msgs/TFMessage."""
    made = []
    for pose in poses:
        place = topics.make("geometry_msgs/msg/Vector3", **dict(zip("xyz", pose.translation, strict=True)))
        turn = topics.make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", pose.rotation, strict=True)))
        moved = topics.make("geometry_msgs/msg/Transform", translation=place, rotation=turn)
        head = header(topics, stamp, pose.parent)
        made.append(
            topics.make("geometry_msgs/msg/TransformStamped", header=head, child_frame_id=pose.child, transform=moved)
        )
    topics.send(topic, stamp, topics.make(FRAMES, transforms=made))


def send_robot(topics: Topics, stamp: int, links: Links) -> None:
    """Write /robot_description and /tf_static, which viewers need to draw the robot that /tf moves."""
    topics.send("/robot_description", stamp, topics.make(TEXT, data=drawn_urdf(links)))
    if links.fixed:
        send_frames(topics, "/tf_static", stamp, links.fixed)
