"""Logs as MCAP files with messages of ROS 2, which Foxglove and PlotJuggler plot."""

from __future__ import annotations

import io
from typing import Any, NamedTuple

import numpy as np

from ...version import __version__
from .signals import LogContent, LoggedRecording, LoggedSignal

JOINTS, FINDINGS = "sensor_msgs/msg/JointState", "diagnostic_msgs/msg/DiagnosticArray"
OK, WARN = b"\x00", b"\x01"  # levels of diagnostic_msgs/DiagnosticStatus
NANO = 1_000_000_000


class _Topic(NamedTuple):
    """A signal on its channel."""

    channel: int
    joints: list[str]
    signal: LoggedSignal
    stamps: Any  # (N,) int64 [ns]


def write_mcap(log: LogContent) -> bytes:
    """Write a log: topics /measured, /predicted, /extended, /residual and so on of JointState, /findings.

    The same log gives the same bytes with the same version of the library mcap.
    """
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    out = io.BytesIO()
    writer = Writer(out)
    writer.start(profile="ros2", library=f"signid {__version__}")
    schemas = {
        kind: writer.register_schema(kind, "ros2msg", store.generate_msgdef(kind, ros_version=2)[0].encode())
        for kind in (JOINTS, FINDINGS)
    }

    def channel(topic: str, kind: str) -> int:
        return int(writer.register_channel(topic, "cdr", schemas[kind]))

    topics = [
        _Topic(channel(_topic(one, signal.name), JOINTS), list(one.joints), signal, _stamps(signal.t - log.shift))
        for one in log.recordings
        for signal in one.signals
    ]
    if log.headline:
        first = int(_stamps(np.array([log.start - log.shift]))[0])
        data = store.serialize_cdr(_findings(store.types, log, first), FINDINGS)
        writer.add_message(channel("/findings", FINDINGS), first, bytes(data), first)
    _write_signals(writer, store, topics)
    notes = {f"note_{k + 1}": note for k, note in enumerate(log.notes)}
    writer.add_metadata("signid", {"robot": log.robot, "version": __version__, **notes})
    writer.finish()
    return out.getvalue()


def _topic(one: LoggedRecording, name: str) -> str:
    return f"/{one.name}/{name}" if one.name else f"/{name}"


def _stamps(t: Any) -> Any:
    """Time stamps (N,) [ns]; seconds and their fraction apart, to keep digits."""
    whole = np.floor(t)
    return whole.astype(np.int64) * NANO + np.rint((t - whole) * NANO).astype(np.int64)


def _header(types: Any, stamp: int) -> Any:
    time = types["builtin_interfaces/msg/Time"](sec=stamp // NANO, nanosec=stamp % NANO)
    return types["std_msgs/msg/Header"](stamp=time, frame_id="")


def _write_signals(writer: Any, store: Any, topics: list[_Topic]) -> None:
    """Write the messages of all signals in the order of time."""
    message, none = store.types[JOINTS], np.zeros(0)
    which = np.concatenate([np.full(len(topic.stamps), k) for k, topic in enumerate(topics)])
    row = np.concatenate([np.arange(len(topic.stamps)) for topic in topics])
    order = np.argsort(np.concatenate([topic.stamps for topic in topics]), kind="stable")
    for k, i in zip(which[order].tolist(), row[order].tolist(), strict=True):
        topic = topics[k]
        stamp, signal = int(topic.stamps[i]), topic.signal
        parts = (none if x is None else x[i] for x in (signal.position, signal.velocity, signal.effort))
        made = message(_header(store.types, stamp), topic.joints, *parts)
        writer.add_message(topic.channel, stamp, bytes(store.serialize_cdr(made, JOINTS)), stamp)


def _findings(types: Any, log: LogContent, stamp: int) -> Any:
    """Verdict and findings: a warning for each cause, with its numbers as lines."""
    status, pair = types["diagnostic_msgs/msg/DiagnosticStatus"], types["diagnostic_msgs/msg/KeyValue"]
    entries = [status(WARN[0] if log.marks else OK[0], "verdict", log.headline, log.robot, [])]
    for mark in log.marks:
        lines = [pair(f"line_{k + 1}", line) for k, line in enumerate(mark.lines)]
        where = [pair("joint", joint) for joint in mark.joints]
        level, message = (WARN if mark.cause else OK)[0], "; ".join(mark.lines)
        entries.append(status(level, mark.title, message, log.robot, [*where, *lines]))
    return types[FINDINGS](_header(types, stamp), entries)
