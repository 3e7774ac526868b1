"""Seed logs of the robot 1r: ROS bags and MCAP by the library rosbags, and a LeRobot dataset."""

from __future__ import annotations

import io
import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from signid.recording.formats.ros import DEFINITIONS

JOINT, ROWS, STEP, FPS = "joint_1", 40, 20_000_000, 50  # STEP [ns]
STATE, CONTROL = "sensor_msgs/msg/JointState", "control_msgs/msg/JointTrajectoryControllerState"
DYNAMIC = "control_msgs/msg/DynamicJointState"
DEFINITION = """std_msgs/Header header\nstring[] joint_names\ntrajectory_msgs/JointTrajectoryPoint desired
trajectory_msgs/JointTrajectoryPoint actual\n"""
TABLE, DESCRIPTION = "data/chunk-000/file-000.parquet", "meta/info.json"


def bag1(kind: str, squeeze: str = "") -> bytes:
    """ROS 1 bag with messages of one type; `squeeze` names the chunk compression."""
    store = _store(Stores.ROS1_NOETIC)
    with tempfile.TemporaryDirectory() as folder:
        writer = Writer1(path := Path(folder) / "r.bag")
        if squeeze:
            writer.set_compression(Writer1.CompressionFormat[squeeze])
        with writer as bag:
            topic = bag.add_connection("/joints", kind, typestore=store)
            for k in range(ROWS):
                bag.write(topic, k * STEP, store.serialize_ros1(_message(store, kind, k), kind))
        return path.read_bytes()


def bag2(kind: str, mcap: bool = False, squeeze: str = "") -> Mapping[str, bytes]:
    """Files by name of a ROS 2 bag with messages of one type."""
    store = _store(Stores.ROS2_HUMBLE)
    with tempfile.TemporaryDirectory() as folder:
        form = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
        writer = Writer2(path := Path(folder) / "r", version=9, storage_plugin=form)
        if squeeze:
            writer.set_compression(CompressionMode[squeeze], CompressionFormat.ZSTD)
        with writer as bag:
            topic = bag.add_connection("/joints", kind, typestore=store)
            for k in range(ROWS):
                bag.write(topic, k * STEP, store.serialize_cdr(_message(store, kind, k), kind))
        return {part.name: part.read_bytes() for part in path.iterdir()}


def dataset() -> Mapping[str, bytes]:
    """Files by name of a LeRobot dataset with two episodes."""
    number = np.arange(2 * ROWS) % ROWS
    values = {"observation.state": np.sin(number / 5), "observation.effort": np.cos(number / 5), "action": number / 9}
    columns = {name: pl.Series(value[:, None], dtype=pl.Array(pl.Float32, 1)) for name, value in values.items()}
    index = {"timestamp": (number / FPS).astype(np.float32), "frame_index": number}
    frame = pl.DataFrame({**columns, **index, "episode_index": np.repeat([0, 1], ROWS)})
    features = {name: {"dtype": "float32", "shape": [1], "names": [f"{JOINT}.pos"]} for name in values}
    features["observation.effort"]["names"] = {"motors": [JOINT]}
    table = io.BytesIO()
    frame.write_parquet(table)
    info = {"codebase_version": "v3.0", "fps": FPS, "features": features}
    return {TABLE: table.getvalue(), DESCRIPTION: json.dumps(info).encode()}


def _store(release: Stores) -> Any:
    store = get_typestore(release)
    for kind, text in {CONTROL: DEFINITION, **DEFINITIONS}.items():
        store.register(get_types_from_msg(text, kind))
    return store


def _message(store: Any, kind: str, k: int) -> Any:
    types, now = store.types, np.sin(k / 5)
    stamp = types["builtin_interfaces/msg/Time"](1, k * STEP)
    header = types["std_msgs/msg/Header"]
    head = header(k, stamp, "") if "seq" in header.__annotations__ else header(stamp, "")
    q, tau, none = np.array([now]), np.array([2 * now]), np.empty(0)
    if kind == STATE:
        return types[STATE](head, [JOINT], q, none, tau)
    if kind == DYNAMIC:
        interface = types["control_msgs/msg/InterfaceValue"]
        return types[DYNAMIC](
            head, [JOINT], [interface(["position", "effort", "current"], np.array([now, 2 * now, k]))]
        )
    after = types["builtin_interfaces/msg/Duration"](0, 0)
    point = types["trajectory_msgs/msg/JointTrajectoryPoint"]
    return types[CONTROL](head, [JOINT], point(q, none, none, none, after), point(q, none, none, tau, after))
