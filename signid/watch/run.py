"""Model and stream -> events, as they are found."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..errors import InputError
from ..faults import recording_flags
from ..model import Model, ModelSource, as_model
from ..recording.names.mapping import ColumnMap
from ..robot import hold, resting
from ..typed import typed
from ..types import Law
from .events import Event, Note
from .sources import Stream, open_stream
from .watcher import QUIET, Watcher


@typed
def watch(
    model: ModelSource,
    stream: object,
    *,
    quiet: float = QUIET,
    columns: ColumnMap | None = None,
    follow: bool = False,
    idle: float = np.inf,
) -> Iterator[Event]:
    """Watch a robot at work: contacts and lasting changes, as events.

    A momentum observer compares torque with the model; thresholds follow from the covariance of the model and from the
    residual of a quiet first stretch. Memory is constant.

    Args:
        model: a model, or what `load_model` reads.
        stream: a recording (path, arrays, frame), a file that grows (with `follow`), "-" for standard input (CSV or
            JSON lines), "ros:TOPIC", or an iterable of texts with such lines.
        quiet: duration [s] of motion without contacts at the beginning, which gives the noise.
        columns: column map, as in `read_recording`.
        follow: whether a file is read on as it grows.
        idle: time [s] without rows after which a live stream ends.

    Raises:
        OptionError: rclpy is missing, or a number is out of range.
        RecordingError: the stream has no rows that can be used.
    """
    watcher, opened = open_watch(as_model(model, "watch"), stream, quiet, columns, follow, idle)
    return _events(watcher, opened)


def open_watch(
    model: Model,
    stream: object,
    quiet: float = QUIET,
    columns: ColumnMap | None = None,
    follow: bool = False,
    idle: float = np.inf,
) -> tuple[Watcher, Stream]:
    """The watcher of the joints of a stream, and the stream; arguments are those of `watch`."""
    Watcher(model, quiet=quiet)
    opened = open_stream(stream, model.robot, columns, follow, idle)
    return Watcher(_of_joints(model, opened.joints), quiet=quiet), opened


def stream_flags(model: Model, stream: Stream) -> tuple[str, ...]:
    """Faults of a recording that is played back; a live stream has none before it is read."""
    if stream.recording is None:
        return ()
    try:
        return recording_flags(model, [stream.recording])
    except InputError as error:
        return (f"the recording cannot be examined for faults: {error}",)


def _events(watcher: Watcher, opened: Stream) -> Iterator[Event]:
    yield from (Note(0.0, flag) for flag in stream_flags(watcher.model, opened))
    for rows in opened.chunks:
        if rows is not None and len(rows.t):
            yield from watcher.feed(*rows)
    yield from watcher.finish()
    if fault := watcher.fault():
        yield Note(0.0, fault)


def _of_joints(model: Model, joints: tuple[str, ...]) -> Model:
    """Model with the joints held that the stream lacks; its covariance remains that of the model's own joints."""
    robot = model.robot
    if joints == robot.joints:
        return model
    moving = hold(robot, resting(robot, but=joints))
    laws = list[Law]()
    for law in model.laws:
        names = [robot.joints[j] for j in law.joints]
        if all(name in joints for name in names):
            laws.append(Law(law.effect, tuple(joints.index(name) for name in names), law.parameters))
    return Model(moving, model.inertials, tuple(laws), model.covariance)
