"""ROS 1 bags, ROS 2 bags and MCAP files: joint states, trajectories and controller states."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from difflib import get_close_matches
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...errors import RecordingError, shorten
from ...types import Array, Table
from ..streams import WRAP, Stamps, TimedColumns, at_times, plural
from ..vocabulary import WORDS
from .base import About, Format, MemoryTable, Topic, memory_limited

MAX_TOPIC_ITEMS = 1000  # maximum number of joints, lists of joints, or kinds of values, in a topic
BACK = 0.01  # accepted share of header stamps that decrease or repeat
MAX_CLOCK_OFFSET = 0.5e9  # accepted difference between the clocks of header stamps [ns]


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

    def values(self, names: Sequence[str], kind: str, joint: str) -> Array:
        """Values (N,) [unit of the kind] of one of the joints, reading by reading."""
        if kind not in self.signals:
            return np.full(len(self.order), np.nan)
        return np.frombuffer(self.signals[kind]).reshape(-1, len(names))[:, names.index(joint)]


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
                if len(layout.signals) >= MAX_TOPIC_ITEMS:
                    fault = f"has more than {MAX_TOPIC_ITEMS} kinds of values; name another topic"
                    raise RecordingError(f"topic {self.topic} {fault}")
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
        if len(self.layouts) >= MAX_TOPIC_ITEMS or len({*self.joints, *names}) > MAX_TOPIC_ITEMS:
            fault = f"names more than {MAX_TOPIC_ITEMS} joints, or lists of joints; give the topic of one robot"
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
    "position": "q",
    "velocity": "dq",
    "acceleration": "ddq",
    "effort": "tau",
    "voltage": "volt",
    "temperature": "temp",
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


def join(gathered: Sequence[Gather], topics: Sequence[Topic], source: str) -> MemoryTable:
    """Join topics of a log that all have messages.

    The slowest topic with positions or torques defines the rows. Topics of similar or higher rate are interpolated at
    these rows, but not across gaps; slower topics are omitted. Header stamps are used if they are set, increase, and
    come from one clock; otherwise the times of receipt.

    Raises:
        RecordingError: the topics have no position and no torque, or a single reading.
    """
    by_header, clock = _clock(gathered)
    notes: list[str] = []
    only_plans = all(gather.plans for gather in gathered)
    streams = [stream for gather in gathered for stream in _streams(gather, by_header, only_plans, notes)]
    mains: dict[str, TimedColumns] = {}  # the fullest stream with positions or torques, by topic
    for stream in streams:
        if any(name.startswith(("q_", "tau_")) and not name.startswith("q_des_") for name in stream.columns):
            mains[stream.topic] = max(mains.get(stream.topic, stream), stream, key=lambda main: main.weight)
    if not mains:
        raise RecordingError(f"{source}: the topics have no position and no torque; name other topics")
    if len(mains) > 1 and (single := [topic for topic, stream in mains.items() if len(stream.t) < 2]):
        raise RecordingError(f"{source}: topic {single[0]} has a single reading and cannot be joined to another")
    base = max(mains.values(), key=lambda main: main.period)
    others = [stream for stream in streams if stream is not base]
    columns, inside = at_times(base, others, notes, slower=False)
    t = base.t[inside]
    if only_plans:
        notes.append("the values are those of a commanded trajectory, unless measured values were published as one")
    if not any(name.startswith("tau_") for name in columns):
        servo = any(name.startswith("q_des_") for name in columns)
        consequence = ": it is a recording of servos" if servo else ", so identification is not possible"
        notes.append(f"no torque was recorded (effort is empty){consequence}")
    origin = int(t[0]) / 1e9
    since = f"{origin:.9g} s"
    if 3e8 < origin < 9e9:  # a date
        since = datetime.fromtimestamp(origin, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    clock = f"{clock}, counted from {since}"
    about = About(tuple(dict.fromkeys(notes)), topics=tuple(topics), clock=clock, origin=origin)
    return MemoryTable({"t": (t - t[0]) / 1e9, **columns}, {}, source, about)


def _clock(gathered: Sequence[Gather]) -> tuple[bool, str]:
    """Whether header stamps are used, and the description of the clock."""
    offsets = []
    for gather in gathered:
        for layout in gather.layouts.values():
            stamps, received = np.frombuffer(layout.stamps, np.int64), np.frombuffer(layout.received, np.int64)
            if not (stamps[1:] if len(stamps) > 1 else stamps).all():  # the first stamp of a simulation may be zero
                return False, f"time of receipt (header stamps of {gather.topic} are not set)"
            if not gather.plans and np.sum(np.diff(stamps) <= 0) > BACK * len(stamps):
                return False, f"time of receipt (header stamps of {gather.topic} do not increase)"
            offsets += [] if gather.plans else [float(np.median(received - stamps))]
    if offsets and np.ptp(offsets) > MAX_CLOCK_OFFSET:
        return False, f"time of receipt (clocks of the header stamps are {np.ptp(offsets) / 1e9:.3g} s apart)"
    return True, "header stamps"


def _streams(gather: Gather, by_header: bool, only_plans: bool, notes: list[str]) -> Iterator[TimedColumns]:
    """Group joints that occur in the same messages, in any order."""
    if gather.misfits:
        notes.append(f"{gather.topic}: omitted lists with another length than the names: {gather.misfits}")
    places: dict[tuple[int, ...], list[str]] = {}
    for joint in gather.joints:
        places.setdefault(tuple(k for k, names in enumerate(gather.layouts) if joint in names), []).append(joint)
    lacking: dict[str, list[str]] = {}
    for place, joints in places.items():
        parts = [(names, layout) for k, (names, layout) in enumerate(gather.layouts.items()) if k in place]
        t, rows = _in_order(gather, [layout for _, layout in parts], by_header, notes)
        columns = {}
        for kind in dict.fromkeys(chain.from_iterable(layout.signals for _, layout in parts)):
            for joint in joints:
                values = np.concatenate([layout.values(names, kind, joint) for names, layout in parts])[rows]
                name = f"{kind}_{joint}" if only_plans or not gather.plans else f"q_des_{joint}" if kind == "q" else ""
                if name and (np.isnan(values).all() or (kind != "q" and not np.nan_to_num(values).any())):
                    lacking.setdefault(kind, []).append(joint)
                elif name:
                    columns[name] = values
        yield TimedColumns(gather.topic, t, columns, {name: WRAP for name in columns if name.startswith("q_")})
    for kind, joints in lacking.items():
        if kind == "dq_des":
            continue
        what = "effort" if kind == "tau" else WORDS.get(kind, kind)
        notes.append(f"{gather.topic}: {what} of {shorten(joints)} is NaN or zero throughout: omitted")


def _in_order(
    gather: Gather, layouts: Sequence[Layout], by_header: bool, notes: list[str]
) -> tuple[Stamps, np.ndarray]:
    """Increasing times of the readings of several layouts, and the indices of these readings."""
    t = np.concatenate([np.frombuffer(x.stamps if by_header else x.received, np.int64) for x in layouts])
    rows = np.argsort(np.concatenate([np.frombuffer(x.order, np.int64) for x in layouts]))
    t = t[rows]
    if gather.plans:
        later = np.minimum.accumulate(np.append(t[1:], np.iinfo(np.int64).max)[::-1])[::-1]
        if replaced := int(np.sum(t >= later)):
            notes.append(f"{gather.topic}: {replaced} points are replaced by those of a later trajectory")
        return t[t < later], rows[t < later]
    if back := int(np.sum(np.diff(t) < 0)):
        notes.append(f"{gather.topic}: {plural(back, 'message')} out of order: sorted by time")
        order = np.argsort(t, kind="stable")
        t, rows = t[order], rows[order]
    fresh = np.diff(t, prepend=t[0] - 1) > 0
    if repeated := int(np.sum(~fresh)):
        notes.append(f"{gather.topic}: {plural(repeated, 'message')} with the time of the previous one: omitted")
    return t[fresh], rows[fresh]


PARTS = (".db3", ".mcap", ".zstd", ".yaml")  # suffixes of the files in a bag folder
MAX_QUOTE_LENGTH = 120  # maximum length of a quoted library message [characters]
STANDARD = ("sensor_msgs/", "trajectory_msgs/")  # message types that are equal in all releases of ROS
EXPECTED = " or ".join(", ".join(kind.rpartition("/")[2] for kind in READERS).rsplit(", ", 1))
Topics = dict[str, list[Any]]  # rosbags connections by topic


class RosBag(Format):
    """Read by the library rosbags, without an installation of ROS."""

    name, suffixes = "rosbag", (".bag", ".mcap", ".db3")
    description = "ROS 1 bag, ROS 2 bag (its folder, .db3 or .mcap): joint states, trajectories, controller states"

    def recognises(self, path: Path) -> bool:
        return (path / "metadata.yaml").is_file() if path.is_dir() else super().recognises(path)

    def files(self, path: Path) -> Sequence[Path]:
        if not path.is_dir():
            return [path]
        return sorted(part for part in path.iterdir() if part.suffix in PARTS and part.is_file())

    def open(self, path: Path) -> Table:
        return self.select(path, ())

    def select(self, path: Path, topics: Sequence[str]) -> Table:
        with _one_error(path), memory_limited(), _reader(path) as (bag, first):
            known: Topics = {}
            for connection in bag.connections:
                known.setdefault(connection.topic, []).append(connection)
            chosen = _named(path, known, topics) if topics else _chosen(path, known, bag, first)
            gathered = _gathered(bag, known, chosen, first)
            if empty := [gather.topic for gather in gathered if not gather.readings]:
                raise RecordingError(f"{path}: topic {empty[0]} holds no joints; name another topic")
            unread = [
                Topic(name, _kind(at), sum(c.msgcount for c in at), float("nan"), (), False)
                for name, at in known.items()
                if name not in chosen and _kind(at) in READERS
            ]
            return join(gathered, [*map(_topic, gathered), *unread], str(path))


@contextmanager
def _one_error(path: Path) -> Iterator[None]:
    """Convert all exceptions of the library to one RecordingError."""
    try:
        yield
    except RecordingError as error:
        if str(error).startswith(str(path)):
            raise
        raise RecordingError(f"{path}: {error}") from error
    except ImportError as error:
        advice = "reading ROS bags and MCAP needs the library rosbags; install it with: pip install 'signid[ros]'"
        raise RecordingError(f"{path}: {advice}") from error
    except MemoryError as error:
        raise RecordingError(f"{path} needs more memory than there is, or is damaged; split it by time") from error
    except Exception as error:  # broken files also raise struct, index and type errors
        quoted = " ".join(str(error).split())[:MAX_QUOTE_LENGTH].rstrip(".")
        reason = f" ({quoted})" if quoted else ""
        raise RecordingError(f"{path} is no ROS bag, or a damaged one{reason}; copy or record it again") from error


@contextmanager
def _reader(path: Path) -> Iterator[tuple[Any, bool]]:
    """Open bag, and whether it is a ROS 1 bag."""
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    for part in path.iterdir() if path.is_dir() else [path]:
        if not (part.is_file() or part.is_dir()):
            raise RecordingError(f"{path}: {part.name} is not a regular file; copy the bag again")
    first = path.suffix.lower() == ".bag"
    with Reader1(path) if first else Reader2(path) as bag:
        yield bag, first


def _kind(connections: Sequence[Any]) -> str:
    """Message type of a topic, "" if it has several."""
    kinds = {connection.msgtype for connection in connections}
    return kinds.pop() if len(kinds) == 1 else ""


def _named(path: Path, known: Topics, topics: Sequence[str]) -> list[str]:
    names = []
    for asked in dict.fromkeys(topics):
        name = next((name for name in known if name.strip("/") == asked.strip("/")), None)
        if name is None:
            close = get_close_matches(asked, known, 1)
            guess = f" (perhaps {close[0]} is meant)" if close else ""
            raise RecordingError(f"{path} has no topic {asked}{guess}; it has {shorten(sorted(known)) or 'none'}")
        if _kind(known[name]) not in READERS:
            kinds = shorten(sorted({connection.msgtype for connection in known[name]}))
            raise RecordingError(f"{path}: topic {name} holds {kinds}; expected {EXPECTED}")
        names.append(name)
    return names


def _chosen(path: Path, known: Topics, bag: Any, first: bool) -> list[str]:
    """The only topic of joint states, else of controller states, else of trajectories."""
    for kind in READERS:
        names = [name for name, at in known.items() if _kind(at) == kind and sum(c.msgcount for c in at)]
        if len(names) > 1:
            listed = [_topic(gather) for gather in _gathered(bag, known, names, first)]
            facts = [f"{t.name} ({t.messages} messages, {t.rate:.4g} Hz, {shorten(t.joints, 3)})" for t in listed]
            short = kind.rpartition("/")[2]
            advice = "choose with signid convert --topic, which can be repeated"
            raise RecordingError(f"{path} has {len(names)} topics of {short}: {'; '.join(facts)}; {advice}")
        if names:
            return names
    others = shorten(sorted(f"{name} ({connections[0].msgtype})" for name, connections in known.items()), 3)
    raise RecordingError(f"{path} has no messages of {EXPECTED}; it has {others or 'no topic'}")


def _gathered(bag: Any, known: Topics, names: Sequence[str], first: bool) -> list[Gather]:
    """All messages of the named topics."""
    from rosbags.interfaces import MessageDefinitionFormat as Form
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    read = {name: Gather(name, _kind(known[name])) for name in names}
    wanted = [connection for name in names for connection in known[name]]
    decode = {}  # decoders by type; types that differ between releases are defined by the bag
    for kind in {connection.msgtype for connection in wanted}:
        store = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
        if kind in DEFINITIONS:
            for name, text in DEFINITIONS.items():
                store.register(get_types_from_msg(text, name))
        elif not kind.startswith(STANDARD):
            stated = next((c.msgdef for c in wanted if c.msgtype == kind and c.msgdef.format != Form.NONE), None)
            if stated is None:
                fault = "differs between releases of ROS and is not defined in the bag; record MCAP, which defines it"
                raise RecordingError(f"the type {kind} {fault}")
            types = (
                get_types_from_msg(stated.data, kind) if stated.format == Form.MSG else get_types_from_idl(stated.data)
            )
            store.register({name: parts for name, parts in types.items() if name not in store.fielddefs})
        decode[kind] = store.deserialize_ros1 if first else store.deserialize_cdr
    for at, received, data in bag.messages(connections=wanted):
        read[at.topic].add(decode[at.msgtype](data, at.msgtype), received)
    return list(read.values())


def _topic(gather: Gather) -> Topic:
    return Topic(gather.topic, gather.kind, gather.messages, gather.rate, gather.joints, True)


PLUGIN = RosBag()
