"""Logs as MCAP files with messages of ROS 2, which Foxglove, RViz and PlotJuggler show."""

from __future__ import annotations

import io
from typing import Any, NamedTuple

import numpy as np

from ...version import __version__
from .links import Links
from .signals import QUANTITIES, LogContent, LoggedSignal
from .topics import McapTopics, header, send_frames, send_joints, send_robot, stamps

OK, WARN = 0, 1  # levels of diagnostic_msgs/DiagnosticStatus


class _Topic(NamedTuple):
    """A signal on its topic."""

    name: str
    joints: tuple[str, ...]
    signal: LoggedSignal
    stamps: Any  # (N,) int64 [ns]


def write_mcap(log: LogContent) -> bytes:
    """Write a log: topics /measured, /predicted, /extended, /residual and so on of JointState, /findings.

    Of a single recording also the robot: /robot_description, /tf and /tf_static of the measured positions. The same log
    gives the same bytes with the same version of the library mcap.
    """
    out = io.BytesIO()
    topics = McapTopics(out)
    signals = [
        _Topic(
            f"/{one.name}/{signal.name}" if one.name else f"/{signal.name}",
            one.joints,
            signal,
            stamps(signal.t - log.shift),
        )
        for one in log.recordings
        for signal in one.signals
    ]
    first = int(stamps(np.array([log.start - log.shift]))[0])
    if log.headline:
        topics.send("/findings", first, _findings(topics, log, first))
    links = None if log.drawn is None else Links(log.drawn)
    if links is not None:
        send_robot(topics, first, links)
    _send_signals(topics, signals, links)
    notes = {f"note_{k + 1}": note for k, note in enumerate(log.notes)}
    topics.writer.add_metadata("signid", {"robot": log.robot, "version": __version__, **notes})
    topics.close()
    return out.getvalue()


def _send_signals(topics: McapTopics, signals: list[_Topic], links: Links | None) -> None:
    """Write the messages of all signals in the order of time; measured positions move the links."""
    which = np.concatenate([np.full(len(each.stamps), k) for k, each in enumerate(signals)])
    row = np.concatenate([np.arange(len(each.stamps)) for each in signals])
    order = np.argsort(np.concatenate([each.stamps for each in signals]), kind="stable")
    for k, i in zip(which[order].tolist(), row[order].tolist(), strict=True):
        name, joints, signal, times = signals[k]
        known = {key: x[i] for key in QUANTITIES if (x := getattr(signal, key)) is not None}
        send_joints(topics, name, int(times[i]), joints, **known)
        if links is not None and name == "/measured" and np.isfinite(known["position"]).all():
            send_frames(topics, "/tf", int(times[i]), links.poses(known["position"]))


def _findings(topics: McapTopics, log: LogContent, stamp: int) -> Any:
    """Verdict and findings: a warning for each cause, with its numbers as lines."""

    def status(level: int, name: str, message: str, values: list[tuple[str, str]]) -> Any:
        pairs = [topics.make("diagnostic_msgs/msg/KeyValue", key=key, value=x) for key, x in values]
        given = {"level": level, "name": name, "message": message, "hardware_id": log.robot, "values": pairs}
        return topics.make("diagnostic_msgs/msg/DiagnosticStatus", **given)

    entries = [status(WARN if log.marks else OK, "verdict", log.headline, [])]
    for mark in log.marks:
        values = [("joint", joint) for joint in mark.joints]
        values += [(f"line_{k + 1}", line) for k, line in enumerate(mark.lines)]
        entries.append(status(WARN if mark.cause else OK, mark.title, "; ".join(mark.lines), values))
    return topics.make("diagnostic_msgs/msg/DiagnosticArray", header=header(topics, stamp), status=entries)
