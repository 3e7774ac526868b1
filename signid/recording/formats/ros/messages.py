"""Collect the messages of a topic into arrays."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ....errors import RecordingError

MOST = 1000  # maximum number of joints, lists of joints, or kinds of values, in a topic


class Reading(NamedTuple):
    """Values of some joints at one instant."""

    names: Sequence[str]
    stamp: int  # header stamp [ns], 0 if not set
    after: int  # offset from the stamp, or from the time of receipt [ns]
    values: Mapping[str, Sequence[float]]  # by kind of column; may be empty


@dataclass
class Layout:
    """All readings of one list of joints; `signals` holds the values of all joints, reading by reading."""

    received: array[int] = field(default_factory=partial(array, "q"))  # time of receipt [ns]
    stamps: array[int] = field(default_factory=partial(array, "q"))  # header stamp [ns], 0 if not set
    order: array[int] = field(default_factory=partial(array, "q"))  # index of arrival in the topic
    signals: dict[str, array[float]] = field(default_factory=dict)  # by kind, NaN where missing


class Gather:
    """Collector of the messages of one topic."""

    def __init__(self, topic: str, kind: str) -> None:
        self.topic, self.kind = topic, kind
        self.layouts: dict[tuple[str, ...], Layout] = {}
        self.readings = self.misfits = self.messages = 0
        self.first = self.last = 0  # time of receipt [ns]
        self._read = READERS[kind]

    @property
    def plans(self) -> bool:
        """Whether the messages are commands instead of measurements."""
        return self.kind == "trajectory_msgs/msg/JointTrajectory"

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints in the order of their first message."""
        return tuple(dict.fromkeys(name for names in self.layouts for name in names))

    @property
    def rate(self) -> float:
        """Rate of the messages [Hz], NaN if there are too few."""
        return (self.messages - 1) * 1e9 / (self.last - self.first) if self.last > self.first else np.nan

    def add(self, message: Any, received: int) -> None:
        """Add a message received at a time [ns]; joint names that repeat, or are too many, are an error."""
        self.first, self.last = (self.first if self.messages else received), received
        self.messages += 1
        for reading in self._read(message):
            if reading.names:
                self._take(reading, received)

    def _take(self, reading: Reading, received: int) -> None:
        names = tuple(reading.names)
        layout = self.layouts.get(names) or self._open(names)
        for kind, values in reading.values.items():
            if kind not in layout.signals:
                if not len(values):
                    continue
                if len(layout.signals) >= MOST:
                    raise RecordingError(f"topic {self.topic} has more than {MOST} kinds of values; name another topic")
                layout.signals[kind] = array("d", [np.nan]) * (len(names) * len(layout.order))
            column = layout.signals[kind]
            if len(values) == len(names):
                column.frombytes(np.ascontiguousarray(values, np.float64).tobytes())
            else:
                column.extend([np.nan] * len(names))
                self.misfits += len(values) > 0
        for kind in layout.signals.keys() - reading.values.keys():
            layout.signals[kind].extend([np.nan] * len(names))
        layout.received.append(received + reading.after)
        layout.stamps.append(reading.stamp + reading.after if reading.stamp else 0)
        layout.order.append(self.readings)
        self.readings += 1

    def _open(self, names: tuple[str, ...]) -> Layout:
        if len(self.layouts) >= MOST or len({*self.joints, *names}) > MOST:
            fault = f"names more than {MOST} joints, or lists of joints; give the topic of one robot"
            raise RecordingError(f"topic {self.topic} {fault}")
        if len(set(names)) < len(names):
            raise RecordingError(f"topic {self.topic} names a joint twice in one message; correct its publisher")
        return self.layouts.setdefault(names, Layout())


def _nanoseconds(time: Any) -> int:
    return int(time.sec) * 1_000_000_000 + int(time.nanosec)


def _joint_state(message: Any) -> Iterator[Reading]:
    values = {"q": message.position, "dq": message.velocity, "tau": message.effort}
    yield Reading(message.name, _nanoseconds(message.header.stamp), 0, values)


def _trajectory(message: Any) -> Iterator[Reading]:
    stamp = _nanoseconds(message.header.stamp)
    for point in message.points:
        values = {"q": point.positions, "dq": point.velocities, "ddq": point.accelerations, "tau": point.effort}
        yield Reading(message.joint_names, stamp, _nanoseconds(point.time_from_start), values)


def _controller_state(message: Any) -> Iterator[Reading]:
    """Older messages have desired and actual, newer ones reference and feedback; some have both and fill one."""
    actual, desired = ([getattr(message, name) for name in pair if hasattr(message, name)] for pair in PAIRS)

    def first(points: Sequence[Any], part: str) -> Sequence[float]:
        return next((values for point in points if len(values := getattr(point, part))), ())

    values = {kind: first(actual, part) for kind, part in (("q", "positions"), ("dq", "velocities"), ("tau", "effort"))}
    values |= {"q_des": first(desired, "positions"), "dq_des": first(desired, "velocities")}
    yield Reading(message.joint_names, _nanoseconds(message.header.stamp), 0, values)


def _dynamic_joint_state(message: Any) -> Iterator[Reading]:
    """Values by joint and name of the interface; a joint may lack what others have."""
    joints, values = message.joint_names, dict[str, list[float]]()
    for k, (joint, interface) in enumerate(zip(joints, message.interface_values, strict=True)):
        if len({*interface.interface_names}) < len(interface.interface_names):
            raise RecordingError(f"a message names an interface of {joint} twice; correct its publisher")
        for name, value in zip(interface.interface_names, interface.values, strict=True):
            values.setdefault(INTERFACES.get(name, name), [np.nan] * len(joints))[k] = value
    yield Reading(joints, _nanoseconds(message.header.stamp), 0, values)


INTERFACES = {  # kind of column by the name of an interface of ros2_control; others keep their name
    **{"position": "q", "velocity": "dq", "acceleration": "ddq", "effort": "tau"},
    **{"voltage": "volt", "temperature": "temp"},
}
DYNAMIC = "control_msgs/msg/DynamicJointState"
DEFINITIONS = {  # types that are equal in all releases, but not known to the library
    DYNAMIC: "std_msgs/Header header\nstring[] joint_names\ncontrol_msgs/InterfaceValue[] interface_values",
    "control_msgs/msg/InterfaceValue": "string[] interface_names\nfloat64[] values",
}
PAIRS = (("actual", "feedback"), ("desired", "reference"))
READERS: Mapping[str, Callable[[Any], Iterator[Reading]]] = {  # in the order of preference without named topics
    "sensor_msgs/msg/JointState": _joint_state,
    DYNAMIC: _dynamic_joint_state,
    "control_msgs/msg/JointTrajectoryControllerState": _controller_state,
    "trajectory_msgs/msg/JointTrajectory": _trajectory,
}
