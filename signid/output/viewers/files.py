"""Files that take messages: MCAP, and Rerun, which reads the same messages. Their libraries are optional."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import current_thread, main_thread
from typing import IO, Any, NamedTuple

import numpy as np
import pinocchio as pin

from ...errors import OptionError
from ...model import Model
from ...robot import configuration
from ...robot.document import children, parse
from ...robot.joints import root_link
from ...robot.locate import find_mesh
from ...types import Array, Frozen, Robot
from ...version import __version__
from ...watch import Contact, Event, Note, WatchedBlocks
from ..report.write import open_output, refused_output

QUANTITIES = ("effort", "position", "velocity")  # of a signal
TEXT_SCHEMA = "std_msgs/msg/String"
LATCHED_TOPICS = ("/robot_description", "/tf_static")
INFO_LEVEL, WARN_LEVEL = 20, 30  # levels of rcl_interfaces/Log
NANOSECONDS = 1_000_000_000
ENDLESS = "{sec: 9223372036, nsec: 854775807}"  # a duration of rosbag2
LATCHED_QOS = (  # the quality of service that rosbag2 offers: history of the last one, reliable, transient local
    f"- {{history: 1, depth: 1, reliability: 1, durability: 1, deadline: {ENDLESS}, lifespan: {ENDLESS}, "
    f"liveliness: 1, liveliness_lease_duration: {ENDLESS}, avoid_ros_namespace_conventions: false}}"
)
LOG_LIBRARIES = {"rrd": ("rerun", "mcap", "rosbags"), "mcap": ("mcap", "rosbags")}  # modules by kind of log
PACKAGE_OF_MODULE = {"rerun": "rerun-sdk"}  # package of a module, if it has another name
RERUN_DECODERS = ("ros2_reflection", "ros2msg")  # of Rerun: transforms and texts, joint states
TITLES = {  # of plots
    "effort": "torque [N.m] or force [N]",
    "position": "position [rad or m]",
    "velocity": "velocity [rad/s or m/s]",
}
WATCH_LOG_RATE = 100.0  # [Hz] of rows; the residual has a time constant of 20 ms
EFFORT_TOPICS = ("predicted_torque", "external_torque", "threshold")  # topics, as in blocks of a watch


class Pose(NamedTuple):
    """Pose of a link in the frame of another."""

    parent: str
    child: str
    translation: list[float]  # [m]
    rotation: list[float]  # quaternion x, y, z, w


class Links:
    """Tree of the links of a URDF; each link that a joint moves has its pose in the link before it."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.data, self.root = robot, robot.model.createData(), root_link(robot)
        frames = robot.model.frames
        self.moving: list[tuple[int, int]] = []  # frames of the link before and of the link
        still: list[tuple[int, int]] = []
        for k, frame in enumerate(frames):
            before = frame.parentFrame
            while before and frames[before].type != pin.FrameType.BODY:
                before = frames[before].parentFrame
            if before and frame.type == pin.FrameType.BODY:
                (still if frames[before].parentJoint == frame.parentJoint else self.moving).append((before, k))
        self.fixed = self._poses(np.zeros(len(robot.joints)), still)

    def poses(self, q: Array) -> list[Pose]:
        """Poses of the links that joints move at positions q: (n,) [rad or m]."""
        return self._poses(q, self.moving)

    def _poses(self, q: Array, pairs: Sequence[tuple[int, int]]) -> list[Pose]:
        pin.framesForwardKinematics(self.robot.model, self.data, configuration(self.robot, q[None])[0])
        frames, placed, poses = self.robot.model.frames, self.data.oMf, []
        for before, k in pairs:
            pose = placed[before].actInv(placed[k])
            turn: Any = pin.Quaternion(pose.rotation).coeffs()
            poses.append(Pose(frames[before].name, frames[k].name, pose.translation.tolist(), turn.tolist()))
        return poses


@dataclass(frozen=True, eq=False)
class Signal(Frozen):
    """One kind of signal of n joints at N instants; None: the signal has no such quantity."""

    topic: str
    joints: tuple[str, ...]
    t: Array  # (N,) [s], as in the recording
    position: Array | None = None  # (N, n) [rad or m]
    velocity: Array | None = None  # (N, n) [rad/s or m/s]
    effort: Array | None = None  # (N, n) [N.m or N]; NaN where torque was not recorded
    drawn: bool = False  # whether its positions move the links


class Remark(NamedTuple):
    """A line of text: an event of a watch, a verdict or a finding."""

    t: float  # [s]
    sentence: str
    warning: bool
    document: str = ""  # JSON of an event


class Head(NamedTuple):
    """Robot, title and notes of a log."""

    robot: str
    title: str
    dated: bool = False  # whether time stamps count from 1970
    notes: Sequence[str] = ()


class McapFile:
    """Writes each message as it comes. The same messages give the same bytes with the same version of mcap."""

    def __init__(self, out: IO[bytes], head: Head, package_dirs: Sequence[str] = ()) -> None:
        from mcap.writer import Writer
        from rosbags.typesys import Stores, get_typestore

        self.store, self.writer, self.head = get_typestore(Stores.ROS2_HUMBLE), Writer(out), head
        self.writer.start(profile="ros2", library=f"signid {__version__}")
        self.channels: dict[str, int] = {}
        self.shift: float | None = None  # [s] before 0 of the first stamp: MCAP has no time before 0
        self.links: Links | None = None

    def robot(self, t: float, links: Links) -> None:
        """Write /robot_description and /tf_static; from now on positions move the links on /tf."""
        self.links = links
        self._send("/robot_description", t, self._made(TEXT_SCHEMA, data=links.robot.document))
        if links.fixed:
            self._frames("/tf_static", t, links.fixed)

    def signals(self, signals: Sequence[Signal]) -> None:
        """Write a JointState of each signal for each instant, in the order of time."""
        rows = [(t, series, i) for series in signals for i, t in enumerate(series.t.tolist())]
        for t, series, i in sorted(rows, key=lambda row: round(row[0], 9)):  # by [ns]
            values = {key: np.zeros(0) if (x := getattr(series, key)) is None else x[i] for key in QUANTITIES}
            state = self._made("sensor_msgs/msg/JointState", header=self._header(t), name=list(series.joints), **values)
            self._send(series.topic, t, state)
            if series.drawn and self.links is not None and np.isfinite(values["position"]).all():
                self._frames("/tf", t, self.links.poses(values["position"]))

    def remark(self, topic: str, remark: Remark) -> None:
        """Write a line of text, and an event also as JSON."""
        if remark.document:
            self._send("/signid/events", remark.t, self._made(TEXT_SCHEMA, data=remark.document))
        content = {"level": WARN_LEVEL if remark.warning else INFO_LEVEL, "name": "signid", "msg": remark.sentence}
        stamp = self._header(remark.t).stamp
        log = self._made("rcl_interfaces/msg/Log", stamp=stamp, file="", function="", line=0, **content)
        self._send(topic, remark.t, log)

    def close(self) -> None:
        """Write notes and the index."""
        notes = {f"note_{k + 1}": note for k, note in enumerate(self.head.notes)}
        self.writer.add_metadata("signid", {"robot": self.head.robot, "version": __version__, **notes})
        self.writer.finish()

    def _frames(self, topic: str, t: float, poses: Sequence[Pose]) -> None:
        made, moved = self._made, []
        for pose in poses:
            place = made("geometry_msgs/msg/Vector3", **dict(zip("xyz", pose.translation, strict=True)))
            turn = made("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", pose.rotation, strict=True)))
            there = made("geometry_msgs/msg/Transform", translation=place, rotation=turn)
            names = {"header": self._header(t, pose.parent), "child_frame_id": pose.child}
            moved.append(made("geometry_msgs/msg/TransformStamped", **names, transform=there))
        self._send(topic, t, made("tf2_msgs/msg/TFMessage", transforms=moved))

    def _made(self, kind: str, **fields: Any) -> Any:
        return self.store.types[kind](**fields)

    def _header(self, t: float, frame: str = "") -> Any:
        sec, nanosec = divmod(self._stamp(t), NANOSECONDS)
        stamp = self._made("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        return self._made("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def _stamp(self, t: float) -> int:
        """Stamp [ns] of a time [s]; seconds and their fraction are rounded apart, to keep digits."""
        self.shift = min(t, 0.0) if self.shift is None else self.shift
        whole, part = divmod(t - self.shift, 1.0)
        return max(int(whole) * NANOSECONDS + round(part * NANOSECONDS), 0)

    def _send(self, topic: str, t: float, message: Any) -> None:
        kind, stamp = message.__msgtype__, self._stamp(t)
        if topic not in self.channels:
            text = self.store.generate_msgdef(kind, ros_version=2)[0].encode()
            offered = {"offered_qos_profiles": LATCHED_QOS if topic in LATCHED_TOPICS else ""}
            schema = self.writer.register_schema(kind, "ros2msg", text)
            self.channels[topic] = self.writer.register_channel(topic, "cdr", schema, offered)
        data = bytes(self.store.serialize_cdr(message, kind))
        self.writer.add_message(self.channels[topic], stamp, data, stamp)


def check_library(kind: str) -> None:
    """Check that the libraries of a kind of log, "rrd" or "mcap", are installed.

    Raises:
        OptionError: one is missing.
    """
    lacking = [PACKAGE_OF_MODULE.get(module, module) for module in LOG_LIBRARIES[kind] if find_spec(module) is None]
    if lacking:
        raise OptionError(
            f"writing .{kind} files needs {' and '.join(lacking)}, which is not installed; "
            f"install the viewers with: pip install 'signid[viewers]'"
        )


class RerunFile(McapFile):
    """Keeps the messages in a temporary file until it is closed, and has Rerun read them, with meshes of packages."""

    def __init__(self, out: IO[bytes], head: Head, package_dirs: Sequence[str] = ()) -> None:
        self.out, self.package_dirs, self.scratch = out, package_dirs, TemporaryDirectory()
        self.place = Path(self.scratch.name, "messages.mcap")
        self.messages = self.place.open("wb")
        self.shown: dict[str, Signal] = {}  # a signal of each topic
        super().__init__(self.messages, head)

    def signals(self, signals: Sequence[Signal]) -> None:
        """Write signals, each with its plots."""
        self.shown |= {series.topic: series for series in signals}
        super().signals(signals)

    def close(self) -> None:
        """Write the file. Rerun's own writer hides errors of a full disk, and its pieces would be no file."""
        import rerun as rr
        from rerun.chunk import McapReader
        from rerun.urdf import UrdfTree

        with self.scratch:
            with self.messages:
                super().close()
            stream = rr.RecordingStream("signid", send_properties=False)
            buffer = stream.binary_stream()
            stream.send_recording_name(self.head.title)
            time = "timestamp_ns" if self.head.dated else "duration_ns"
            if self.links is not None:
                drawn = self.place.with_name("robot.urdf")
                drawn.write_bytes(_with_meshes(self.links.robot, self.package_dirs))
                shapes = (
                    chunk for chunk in UrdfTree.from_file_path(drawn).stream() if chunk.entity_path != "/tf_static"
                )
                stream.send_chunks(list(shapes))  # messages move the links
            stream.send_chunks(McapReader(self.place, timeline_type=time, decoders=RERUN_DECODERS).stream())
            stream.send_blueprint(self._layout())
            self.out.write(buffer.read() or b"")
            stream.disconnect()

    def _layout(self) -> Any:
        """The robot beside a tab for each quantity, with a plot for each joint; texts below."""
        import rerun as rr
        import rerun.blueprint as blueprint

        plots: dict[str, dict[str, dict[str, Any]]] = {}  # looks of curves by tab, joint and path
        for topic, course in self.shown.items():
            folder, _, name = topic.rpartition("/")
            for quantity in (key for key in QUANTITIES if getattr(course, key) is not None):
                words = (folder.removeprefix("/signid"), TITLES[quantity], "residual" if "residual" in name else "")
                tab = plots.setdefault(" ".join(filter(None, words)), {})
                for joint in course.joints:
                    only = [joint == other for other in course.joints]
                    look = rr.SeriesLines.from_fields(names=[name] * len(only), visible_series=only)
                    tab.setdefault(joint, {})[f"{topic}/{quantity}"] = look
        tabs, drawn = [], []
        for title, tab in plots.items():
            views = (
                blueprint.TimeSeriesView(name=joint, contents=[*looks], overrides=looks) for joint, looks in tab.items()
            )
            tabs.append(blueprint.Grid(*views, name=title))
        if self.links is not None:
            frame = blueprint.SpatialInformation(target_frame=self.links.root)
            drawn = [blueprint.Spatial3DView(origin="/", name="robot", spatial_information=frame)]
        above, below = blueprint.Horizontal(*drawn, blueprint.Tabs(*tabs)), blueprint.TextLogView(name="remarks")
        whole = blueprint.Vertical(above, below, row_shares=[4, 1])
        return blueprint.Blueprint(whole, auto_layout=False, auto_views=False)


def _with_meshes(robot: Robot, package_dirs: Sequence[str]) -> bytes:
    """URDF with the paths of meshes that are found, without other meshes and collision shapes beside visual ones."""
    from lxml import etree

    root = parse(robot.document)
    for link in children(root, "link"):
        for shape in children(link, "collision") if children(link, "visual") else ():
            link.remove(shape)
    for mesh in list(root.iter("mesh")):
        if (path := find_mesh(mesh.get("filename", ""), robot.path, package_dirs)) is not None:
            mesh.set("filename", str(path.absolute()))
        else:  # Rerun would warn on the terminal
            shape = mesh.getparent().getparent()
            shape.getparent().remove(shape)
    return bytes(etree.tostring(root))


FILE_OF_KIND = {"mcap": McapFile, "rrd": RerunFile}  # by kind of log


class WatchLogs:
    """Files that take what a watch found; complete also after Ctrl-C, absent after an error.

    Args:
        model: the watched model.
        files: paths by kind, "rrd" or "mcap".
        sentence: an event as a sentence.
        package_dirs: folders of packages of meshes, which a file of Rerun contains.

    Raises:
        OutputError: a file cannot be written.
    """

    def __init__(
        self,
        model: Model,
        files: Mapping[str, Path],
        sentence: Callable[[Event], str],
        package_dirs: Sequence[str] = (),
    ) -> None:
        self.robot, self.sentence = model.robot, sentence
        self.last = -np.inf  # [s] time of the last row that was written
        head = Head(model.robot.name, f"watch of {model.robot.name}")
        with ExitStack() as stack:
            self.files = []
            for kind, path in files.items():
                guard = partial(refused_output, path, f"--{kind}")
                out = stack.enter_context(open_output(path, f"--{kind}"))
                file = FILE_OF_KIND[kind](out, head, package_dirs)
                stack.callback(guard()(file.close))
                self.files.append((file, guard))
            self.stack = stack.pop_all()

    def take(self, blocks: Sequence[WatchedBlocks], events: Sequence[Event]) -> None:
        """Write rows at up to 100 Hz, then events.

        Raises:
            OutputError: a file cannot be written.
        """
        with _uninterrupted():
            signals, remarks = self._signals(blocks), list[Remark]()
            for event in events:  # a warning when a contact begins and for a change
                calm = isinstance(event, Note) or (isinstance(event, Contact) and event.end is not None)
                text = json.dumps(event.document(), ensure_ascii=False)
                remarks.append(Remark(event.t, self.sentence(event), not calm, text))
            times = [*(float(series.t[0]) for series in signals), *(remark.t for remark in remarks)]
            for file, guard in self.files:
                with guard():
                    if times and file.links is None and self.robot.kind == "urdf":
                        file.robot(times[0], Links(self.robot))
                    if signals:
                        file.signals(signals)
                    for remark in remarks:
                        file.remark("/signid/log", remark)

    def _signals(self, blocks: Sequence[WatchedBlocks]) -> list[Signal]:
        """Signals of the rows that are due."""
        rows, kept = [np.concatenate(x) for x in zip(*blocks, strict=True)], list[int]()
        for k, t in enumerate(rows[0].tolist() if rows else ()):
            if not self.last <= t < self.last + 0.999 / WATCH_LOG_RATE:
                kept.append(k)
                self.last = t
        if not kept:
            return []
        t, q, v, measured, *rest = (x[kept] for x in rows)
        joints, efforts = self.robot.joints, zip(EFFORT_TOPICS, rest, strict=True)
        state = Signal("/joint_states", joints, t, q, v, measured, drawn=True)
        return [state, *(Signal(f"/signid/{name}", joints, t, effort=x) for name, x in efforts)]

    def __enter__(self) -> WatchLogs:
        return self

    def __exit__(self, *raised: Any) -> None:
        with _uninterrupted():
            self.stack.__exit__(*raised)


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Ctrl-C waits until a record is complete."""
    if current_thread() is not main_thread():
        yield
        return
    asked: list[object] = []
    before = signal.signal(signal.SIGINT, lambda *arguments: asked.append(arguments))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if asked:
        raise KeyboardInterrupt
