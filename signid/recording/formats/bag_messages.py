"""Messages of one topic of a log, gathered into arrays as they are read."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import RecordingError
from ...types import Array

if TYPE_CHECKING:
    Ints = array[int]
    Floats = array[float]
else:
    Ints = Floats = array  # takes no parameters when it runs

MOST = 1000  # joints, or lists of joints, in one topic
Stamps = NDArray[np.int64]  # [ns]


class Reading(NamedTuple):
    """What a message says of some joints at one moment."""

    names: Sequence[str]
    stamp: int  # [ns] of the header, 0 where it is not set
    after: int  # [ns] after the stamp, or after it was received
    values: Mapping[str, Sequence[float]]  # by kind of column; empty where nothing is said


@dataclass
class Layout:
    """All that was said of one list of joints; `signals` holds a value for each joint, one reading after the other."""

    received: Ints = field(default_factory=lambda: array("q"))  # [ns]
    stamps: Ints = field(default_factory=lambda: array("q"))  # [ns], 0 where not set
    order: Ints = field(default_factory=lambda: array("q"))  # of arrival in the topic
    signals: dict[str, Floats] = field(default_factory=dict)

    def values(self, kind: str, joints: int) -> Array:
        """(N, joints) of one kind [rad or m, N.m or N, and their rates], NaN where nothing was said."""
        return np.frombuffer(self.signals[kind]).reshape(-1, joints)


class Gather:
    """Feed it the messages of one topic with `add`."""

    def __init__(self, topic: str, kind: str) -> None:
        self.topic, self.kind = topic, kind
        self.layouts: dict[tuple[str, ...], Layout] = {}
        self.readings = self.misfits = self.messages = 0
        self.first = self.last = 0  # [ns] received
        self._read = READERS[kind]

    @property
    def plans(self) -> bool:
        """Whether its messages say what is to be, not what is."""
        return self.kind == "trajectory_msgs/msg/JointTrajectory"

    @property
    def joints(self) -> tuple[str, ...]:
        """In the order in which they were first heard of."""
        return tuple(dict.fromkeys(name for names in self.layouts for name in names))

    @property
    def rate(self) -> float:
        """Of its messages [Hz], NaN where there are too few to tell."""
        return (self.messages - 1) * 1e9 / (self.last - self.first) if self.last > self.first else np.nan

    def add(self, message: Any, received: int) -> None:
        """Take a message that was received at a time [ns].

        Raises:
            RecordingError: it names a joint twice, or there are too many joints to be a robot's.
        """
        self.first, self.last = (self.first if self.messages else received), received
        self.messages += 1
        for reading in self._read(message):
            if reading.names:
                self._take(reading, received)

    def _take(self, reading: Reading, received: int) -> None:
        names = tuple(reading.names)
        layout = self.layouts.get(names)
        if layout is None:
            layout = self._open(names)
        for kind, values in reading.values.items():
            column = layout.signals.get(kind)
            if column is None:
                if not len(values):
                    continue
                column = layout.signals[kind] = array("d", [np.nan]) * (len(names) * len(layout.order))
            if len(values) == len(names):
                column.frombytes(np.ascontiguousarray(values, np.float64).tobytes())
            else:
                column.extend([np.nan] * len(names))
                self.misfits += len(values) > 0
        layout.received.append(received + reading.after)
        layout.stamps.append(reading.stamp + reading.after if reading.stamp else 0)
        layout.order.append(self.readings)
        self.readings += 1

    def _open(self, names: tuple[str, ...]) -> Layout:
        if len(self.layouts) >= MOST or len({*self.joints, *names}) > MOST:
            raise RecordingError(
                f"topic {self.topic} names more than {MOST} joints, or lists of them; it is no robot's"
            )
        if len(set(names)) < len(names):
            raise RecordingError(f"topic {self.topic} names a joint twice in one message; mend what publishes it")
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
    """Older messages say desired and actual, newer ones reference and feedback; some have both and fill one."""
    actual, desired = ([getattr(message, name) for name in pair if hasattr(message, name)] for pair in PAIRS)

    def first(points: Sequence[Any], part: str) -> Sequence[float]:
        return next((values for point in points if len(values := getattr(point, part))), ())

    values = {
        "q": first(actual, "positions"),
        "dq": first(actual, "velocities"),
        "tau": first(actual, "effort"),
        "q_des": first(desired, "positions"),
    }
    yield Reading(message.joint_names, _nanoseconds(message.header.stamp), 0, values)


PAIRS = (("actual", "feedback"), ("desired", "reference"))
READERS: Mapping[str, Callable[[Any], Iterator[Reading]]] = {  # what is read before what, where nothing is asked for
    "sensor_msgs/msg/JointState": _joint_state,
    "control_msgs/msg/JointTrajectoryControllerState": _controller_state,
    "trajectory_msgs/msg/JointTrajectory": _trajectory,
}
