"""MCAP files with messages of ROS 2 in CDR, which Foxglove, RViz, PlotJuggler and Rerun show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import IO, Any

import numpy as np

from ...version import __version__
from .links import QUANTITIES, Head, Links, Pose, Remark, Signal

TEXT, TIME = "std_msgs/msg/String", "builtin_interfaces/msg/Time"
LATCHED = ("/robot_description", "/tf_static")
INFO, WARN = 20, 30  # levels of rcl_interfaces/Log
NANO = 1_000_000_000
ENDLESS = "{sec: 9223372036, nsec: 854775807}"  # a duration of rosbag2
LATCH = (  # the quality of service that rosbag2 offers: history of the last one, reliable, transient local
    f"- {{history: 1, depth: 1, reliability: 1, durability: 1, deadline: {ENDLESS}, lifespan: {ENDLESS}, "
    f"liveliness: 1, liveliness_lease_duration: {ENDLESS}, avoid_ros_namespace_conventions: false}}"
)


class McapFile:
    """Writes each message as it comes. The same messages give the same bytes with the same version of mcap."""

    def __init__(self, out: IO[bytes], head: Head) -> None:
        from mcap.writer import Writer
        from rosbags.typesys import Stores, get_typestore

        self.store, self.writer, self.head = get_typestore(Stores.ROS2_HUMBLE), Writer(out), head
        self.writer.start(profile="ros2", library=f"signid {__version__}")
        self.schemas: dict[str, int] = {}
        self.channels: dict[str, int] = {}
        self.shift: float | None = None  # [s] before 0 of the first stamp: MCAP has no time before 0
        self.stamp = 0  # [ns] of the message
        self.links: Links | None = None

    def robot(self, t: float, links: Links) -> None:
        """Write /robot_description and /tf_static; from now on positions move the links on /tf."""
        self.links = links
        self._send("/robot_description", t, TEXT, data=links.robot.document)
        if links.fixed:
            self._frames("/tf_static", t, links.fixed)

    def signals(self, signals: Sequence[Signal]) -> None:
        """Write a JointState of each signal for each instant, in the order of time."""
        which = np.concatenate([np.full(len(each.t), k) for k, each in enumerate(signals)])
        row = np.concatenate([np.arange(len(each.t)) for each in signals])
        order = np.argsort(np.round(np.concatenate([each.t for each in signals]), 9), kind="stable")  # by [ns]
        for k, i in zip(which[order].tolist(), row[order].tolist(), strict=True):
            one, t = signals[k], float(signals[k].t[i])
            known = {key: x[i] for key in QUANTITIES if (x := getattr(one, key)) is not None}
            self._send(one.topic, t, "sensor_msgs/msg/JointState", header={}, name=one.joints, **known)
            if one.drawn and self.links is not None and np.isfinite(known["position"]).all():
                self._frames("/tf", t, self.links.poses(known["position"]))

    def remark(self, topic: str, remark: Remark) -> None:
        """Write a line of text, and an event also as JSON."""
        if remark.document:
            self._send("/signid/events", remark.t, TEXT, data=remark.document)
        given = {"level": WARN if remark.warning else INFO, "name": "signid", "msg": remark.sentence}
        self._send(topic, remark.t, "rcl_interfaces/msg/Log", **given)

    def close(self) -> None:
        """Write notes and the index."""
        notes = {f"note_{k + 1}": note for k, note in enumerate(self.head.notes)}
        self.writer.add_metadata("signid", {"robot": self.head.robot, "version": __version__, **notes})
        self.writer.finish()

    def _frames(self, topic: str, t: float, poses: Sequence[Pose]) -> None:
        moved = [
            {
                "header": {"frame_id": pose.parent},
                "child_frame_id": pose.child,
                "transform": {
                    "translation": dict(zip("xyz", pose.translation, strict=True)),
                    "rotation": dict(zip("xyzw", pose.rotation, strict=True)),
                },
            }
            for pose in poses
        ]
        self._send(topic, t, "tf2_msgs/msg/TFMessage", transforms=moved)

    def _send(self, topic: str, t: float, kind: str, **fields: Any) -> None:
        """Write a message with the stamp t [s]; seconds and their fraction are rounded apart, to keep digits."""
        self.shift = min(t, 0.0) if self.shift is None else self.shift
        whole, part = divmod(t - self.shift, 1.0)
        self.stamp = max(int(whole) * NANO + round(part * NANO), 0)
        if kind not in self.schemas:
            text = self.store.generate_msgdef(kind, ros_version=2)[0].encode()
            self.schemas[kind] = self.writer.register_schema(kind, "ros2msg", text)
        if topic not in self.channels:
            offered = {"offered_qos_profiles": LATCH if topic in LATCHED else ""}
            self.channels[topic] = self.writer.register_channel(topic, "cdr", self.schemas[kind], offered)
        data = bytes(self.store.serialize_cdr(self._message(kind, fields), kind))
        self.writer.add_message(self.channels[topic], self.stamp, data, self.stamp)

    def _message(self, kind: str, fields: Mapping[str, Any] | None) -> Any:
        """Make a message, stamped if it is given; its other fields that are not given are zero or empty."""
        if kind == TIME and fields is not None:
            fields = {"sec": self.stamp // NANO, "nanosec": self.stamp % NANO}
        given = {} if fields is None else {"stamp": {}, **fields}
        values = {name: self._value(form, given.get(name)) for name, form in self.store.fielddefs[kind][1]}
        return self.store.types[kind](**values)

    def _value(self, form: Any, given: Any) -> Any:
        node, inner = form
        if node.name == "NAME":
            return self._message(inner, given)
        if node.name == "BASE":
            return ("" if inner[0] == "string" else 0) if given is None else given
        item, of = inner[0]  # a sequence
        given = [] if given is None else given
        if item.name == "NAME":
            return [self._message(of, each) for each in given]
        return list(given) if of[0] == "string" else np.asarray(given, of[0])
