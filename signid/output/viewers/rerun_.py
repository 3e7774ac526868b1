"""Logs as recordings of Rerun, with a view for each joint."""

from __future__ import annotations

from hashlib import sha256
from typing import Any

import numpy as np

from .signals import QUANTITIES, RESIDUALS, LogContent, LoggedRecording, LoggedSignal

TITLES = {
    "position": "position [rad or m]",
    "velocity": "velocity [rad/s or m/s]",
    "effort": "torque [N.m] or force [N]",
}


def write_rrd(log: LogContent) -> bytes:
    """Write a log: a curve for each quantity, joint and signal, findings as text, and a layout."""
    import rerun as rr

    stream = rr.RecordingStream("signid", recording_id=_identity(log), send_properties=False)
    buffer = stream.binary_stream()
    stream.send_recording_name(log.robot)
    for one in log.recordings:
        for signal in one.signals:
            for quantity in QUANTITIES:
                _send(rr, stream, log, one, signal, quantity)
    _send_findings(rr, stream, log)
    stream.send_blueprint(_layout(log))
    found = bytes(buffer.read() or b"")
    stream.disconnect()
    return found


def _identity(log: LogContent) -> str:
    """Identifier of the recording: the same for the same signals."""
    digest = sha256(log.robot.encode())
    for one in log.recordings:
        for signal in one.signals:
            for x in (signal.t, signal.position, signal.effort):
                digest.update(b"" if x is None else np.ascontiguousarray(x).tobytes())
    return digest.hexdigest()[:32]


def _place(one: LoggedRecording, *parts: str) -> list[str]:
    return [*([one.name] if one.name else []), *parts]


def _group(signal: LoggedSignal, quantity: str) -> str:
    """Curves of one view have a common group: a quantity, or its residual."""
    return f"{quantity}_residual" if signal.name in RESIDUALS else quantity


def _send(rr: Any, stream: Any, log: LogContent, one: LoggedRecording, signal: LoggedSignal, quantity: str) -> None:
    values = getattr(signal, quantity)
    if values is None:
        return
    for j, joint in enumerate(one.joints):
        known = np.isfinite(values[:, j])
        if known.any():
            path = rr.new_entity_path(_place(one, _group(signal, quantity), joint, signal.name))
            stream.log(path, rr.SeriesLines(names=signal.name), static=True)
            columns = rr.Scalars.columns(scalars=values[known, j])
            stream.send_columns(path, indexes=[_times(rr, log, signal.t[known])], columns=columns)


def _times(rr: Any, log: LogContent, t: Any) -> Any:
    """Time column: dates if the stamps count from 1970, else durations."""
    return rr.TimeColumn("time", timestamp=t) if log.dated else rr.TimeColumn("time", duration=t)


def _send_findings(rr: Any, stream: Any, log: LogContent) -> None:
    if log.headline:
        lines = [log.headline, *(f"- {mark.title}: {'; '.join(mark.lines)}" for mark in log.marks)]
        text = "\n".join([*lines, *(f"- note: {note}" for note in log.notes)])
        stream.log("summary", rr.TextDocument(text, media_type="text/markdown"), static=True)
        texts = [log.headline, *(f"{mark.title}: {'; '.join(mark.lines)}" for mark in log.marks)]
        levels = ["WARN" if log.marks else "INFO", *("WARN" if mark.cause else "INFO" for mark in log.marks)]
        times = np.array([log.start if mark.time is None else mark.time[0] for mark in log.marks])
        when = np.concatenate([[log.start], times])
        columns = rr.TextLog.columns(text=texts, level=levels)
        stream.send_columns("findings", indexes=[_times(rr, log, when)], columns=columns)


def _layout(log: LogContent) -> Any:
    """A tab for each quantity, with a plot for each joint; findings below."""
    import rerun as rr
    import rerun.blueprint as blueprint

    tabs = []
    for one in log.recordings:
        groups = dict.fromkeys(
            _group(signal, quantity)
            for quantity in ("effort", "position", "velocity")
            for signal in one.signals
            if getattr(signal, quantity) is not None
        )
        for group in groups:
            quantity, _, rest = group.partition("_")
            title = " ".join(filter(None, (one.name, TITLES[quantity], rest)))
            places = [(joint, rr.new_entity_path(_place(one, group, joint))) for joint in one.joints]
            plots = [blueprint.TimeSeriesView(origin=path, name=joint) for joint, path in places]
            tabs.append(blueprint.Grid(*plots, name=title))
    below = [blueprint.TextLogView(origin="findings", name="findings")] if log.headline else []
    whole = blueprint.Vertical(blueprint.Tabs(*tabs), *below, row_shares=[4, 1][: 1 + len(below)])
    return blueprint.Blueprint(whole, auto_layout=False, auto_views=False)
