"""Bags of every kind, written by the library itself, and the messages in them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

JOINTS = ("shoulder", "elbow", "wrist")
START = 1_700_000_000_000_000_000  # [ns]
STATE, PLAN = "sensor_msgs/msg/JointState", "trajectory_msgs/msg/JointTrajectory"
CONTROL = "control_msgs/msg/JointTrajectoryControllerState"
DYNAMIC, INTERFACE = "control_msgs/msg/DynamicJointState", "control_msgs/msg/InterfaceValue"
POINT = "trajectory_msgs/JointTrajectoryPoint"
OLD, NEW = ("desired", "actual"), ("reference", "feedback")
Message = tuple[str, Any, int]  # topic, message, received [ns]


def store(first: bool = False, parts: Sequence[str] = OLD) -> Any:
    """Message types of ROS 1 or ROS 2, including a controller state that is missing in the library."""
    known = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
    fields = [f"{POINT} {part}" for part in (*parts, "error")]
    known.register(get_types_from_msg("\n".join(["std_msgs/Header header", "string[] joint_names", *fields]), CONTROL))
    known.register(get_types_from_msg("string[] interface_names\nfloat64[] values", INTERFACE))
    fields = ["std_msgs/Header header", "string[] joint_names", f"{INTERFACE} interface_values".replace(" ", "[] ")]
    known.register(get_types_from_msg("\n".join(fields), DYNAMIC))
    return known


def _header(known: Any, stamp: int) -> Any:
    time = known.types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9))
    kind = known.types["std_msgs/msg/Header"]
    return kind(0, time, "") if "seq" in kind.__annotations__ else kind(time, "")


def _floats(values: Iterable[float]) -> np.ndarray:
    return np.array([*values], np.float64)


def state(
    known: Any, stamp: int, names: Sequence[str], q: Iterable[float], dq: Iterable[float], tau: Iterable[float]
) -> Any:
    """A JointState."""
    return known.types[STATE](_header(known, stamp), [*names], *map(_floats, (q, dq, tau)))


def point(known: Any, after: int, *values: Iterable[float]) -> Any:
    """Positions, velocities, accelerations, efforts at a time after the stamp [ns]."""
    full = [*map(_floats, values), *[_floats(())] * (4 - len(values))]
    duration = known.types["builtin_interfaces/msg/Duration"](*divmod(after, 10**9))
    return known.types["trajectory_msgs/msg/JointTrajectoryPoint"](*full, duration)


def plan(known: Any, stamp: int, names: Sequence[str], points: Sequence[Any]) -> Any:
    """A JointTrajectory."""
    return known.types[PLAN](_header(known, stamp), [*names], [*points])


def control(known: Any, stamp: int, names: Sequence[str], desired: Any, actual: Any) -> Any:
    """A JointTrajectoryControllerState."""
    return known.types[CONTROL](_header(known, stamp), [*names], desired, actual, point(known, 0))


def dynamic(known: Any, stamp: int, values: Mapping[str, Mapping[str, float]]) -> Any:
    """A DynamicJointState of values by joint and interface."""
    interfaces = [known.types[INTERFACE]([*each], _floats(each.values())) for each in values.values()]
    return known.types[DYNAMIC](_header(known, stamp), [*values], interfaces)


def write1(path: Path, known: Any, messages: Iterable[Message], squeeze: str = "") -> Path:
    """A bag of ROS 1; its chunks may be compressed."""
    bag = Writer1(path)
    if squeeze:
        bag.set_compression(Writer1.CompressionFormat[squeeze])
    return _filled(bag, known, messages, known.serialize_ros1)


def write2(path: Path, known: Any, messages: Iterable[Message], mcap: bool = False, squeeze: str = "") -> Path:
    """A bag of ROS 2, its folder; its messages, its file or the chunks in it may be compressed."""
    bag = Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3)
    if squeeze:
        bag.set_compression(CompressionMode[squeeze], CompressionFormat.ZSTD)
    return _filled(bag, known, messages, known.serialize_cdr)


def _filled(bag: Any, known: Any, messages: Iterable[Message], serialize: Callable[[Any, str], Any]) -> Path:
    with bag:
        at: dict[str, Any] = {}
        for topic, message, received in messages:
            kind = message.__msgtype__
            at[topic] = at.get(topic) or bag.add_connection(topic, kind, typestore=known)
            bag.write(at[topic], received, serialize(message, kind))
    return Path(bag.path)


def bare(folder: Path, suffix: str) -> Path:
    """The file inside a bag's folder, alone."""
    return next(folder.glob(f"*{suffix}")).rename(folder.parent / f"bare{suffix}")


KINDS: dict[str, Callable[[Path, Any, Iterable[Message]], Path]] = {
    "ROS 1": lambda folder, known, messages: write1(folder / "a.bag", known, messages),
    "ROS 2": lambda folder, known, messages: write2(folder / "a", known, messages),
    "ROS 2, MCAP": lambda folder, known, messages: write2(folder / "a", known, messages, mcap=True),
    "a bare db3": lambda folder, known, messages: bare(write2(folder / "a", known, messages), ".db3"),
    "a bare MCAP": lambda folder, known, messages: bare(write2(folder / "a", known, messages, mcap=True), ".mcap"),
    "messages compressed": lambda folder, known, messages: write2(folder / "a", known, messages, squeeze="MESSAGE"),
    "file compressed": lambda folder, known, messages: write2(folder / "a", known, messages, squeeze="FILE"),
    "MCAP in chunks": lambda folder, known, messages: write2(
        folder / "a", known, messages, mcap=True, squeeze="STORAGE"
    ),
}


def swung(n: int = 400, rate: float = 100.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(n,) times [ns], and (n, 3) positions, velocities and torques."""
    t = np.arange(n) / rate
    w = np.array([2.0, 3.0, 5.0])
    q, dq = np.sin(np.outer(t, w)), w * np.cos(np.outer(t, w))
    return np.rint(t * 1e9).astype(np.int64), q, dq, 2 * q + 0.3 * dq + 0.1


def states(known: Any, topic: str = "/joint_states", late: int = 2_000_000, **options: Any) -> list[Message]:
    """Joint states as a robot publishes them."""
    t, q, dq, tau = swung(**options)
    stamps = [START + int(each) for each in t]
    rows = zip(stamps, q, dq, tau, strict=True)
    return [(topic, state(known, stamp, JOINTS, *row), stamp + late) for stamp, *row in rows]
