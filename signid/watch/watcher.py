"""Model and stream -> events, as they are found."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..errors import InputError, OptionError
from ..faults.identified import recording_flags
from ..model import Model, ModelSource, as_model, torque_model
from ..recording.names.mapping import ColumnMap
from ..robot import hold, resting
from ..typed import typed
from ..types import Array, Law
from .blocks import Blocks, Cutter
from .changes import Changes
from .contacts import PEAK, SIGMAS, Contacts, Momentum
from .events import Event, Note
from .frames import Framer, Frames
from .intake import Intake, StreamRows
from .sources import Stream, open_stream
from .windows import Quiet, QuietNoise

QUIET = 10.0  # [s] of motion that give the noise
PATIENCE = 6.0  # [1] longest quiet stretch, over the motion that it should have
SLOWEST = 0.05  # [1] speed below which the direction of friction is uncertain, over the largest of the quiet stretch
JITTER = 4.0  # [standard deviations] of the velocity, the same
WARM = 0.3  # [1] share of the quiet stretch that gives the speeds alone
LONGEST, FEWEST = 0.1, 100  # [s] of rows that are processed together; rows, before the period is known
FEWEST_USED = 2  # rows of a stream that can be watched
BRIEF = 3.0  # [s] a contact that is shorter is none of the changes


class Watcher:
    """Watch a robot: `feed` takes rows as they come and returns events.

    The first seconds of motion must be free of contacts: they give the noise of the residual, beside the covariance of
    the model. `quiet` [s]: duration of that stretch.

    Raises:
        OptionError: no model, or a duration that is not positive.
    """

    def __init__(self, model: ModelSource, *, quiet: float = QUIET) -> None:
        self.model = _checked(model, quiet)
        robot = self.model.robot
        self.momentum = Momentum(self.model)
        self.intake, self.cutter = Intake(robot), Cutter()
        self.framer, self.contacts = Framer(self.model, self.momentum), Contacts(self.model)
        n = len(robot.joints)
        self.duration, self.quiet, self.warm = quiet, Quiet(n), False
        self.noise: QuietNoise | None = None
        self.changes: Changes | None = None
        self.power, self.peak, self.blocks = np.zeros(n), np.zeros(n), 0
        self.std = np.zeros(n)
        self.residual, self.threshold = np.zeros(n), np.full(n, np.nan)  # for a display
        self.t = float("nan")
        self.ignored = bool(self.momentum.ignored)
        self.given = self.used = 0  # rows

    def feed(self, t: Array, q: Array, tau: Array, dq: Array | None = None) -> list[Event]:
        """Events of further rows: t (N,) [s], q (N, n) [rad or m], tau (N, n) [N.m or N], dq (N, n) [rad/s or m/s]."""
        pieces, notes = self.intake.take(StreamRows(t, q, tau, dq))
        self.given, self.used = self.given + len(t), self.used + sum(len(piece.rows.t) for piece in pieces)
        events: list[Event] = list(notes)
        if self.ignored and len(t):
            names = ", ".join(dict.fromkeys(self.momentum.ignored))
            events.append(Note(float(t[0]), f"the watch ignores these laws of the model: {names}"))
            self.ignored = False
        for piece in pieces:
            if piece.fresh:
                self._restart()
            for start in range(0, len(piece.rows.t), self._size()):
                rows = piece.rows.at(slice(start, start + self._size()))
                self.t = float(rows.t[-1])
                if (blocks := self.cutter.cut(rows)) is not None:
                    events += self._blocks(blocks)
        return events

    def finish(self) -> list[Event]:
        """Events at the end of the stream: the end of a contact that is going on."""
        return [] if self.contacts.begun is None else [self.contacts.close(self.t, self.t)]

    def fault(self) -> str:
        """Sentence on a stream that has ended without rows that could be watched; empty if there were some."""
        if self.used >= FEWEST_USED:
            return ""
        fact = f"{self.used or 'none'} of the {self.given} rows" if self.given else "no row, only a header,"
        return f"{fact} could be watched; expected a number in t, q and tau of each joint, and t that increases"

    def _size(self) -> int:
        """Rows that are processed together."""
        period = self.intake.period
        return max(1, round(LONGEST / period)) if period > 0 else FEWEST

    def _restart(self) -> None:
        for part in (self.cutter, self.framer, self.contacts):
            part.restart()

    def _blocks(self, blocks: Blocks) -> list[Event]:
        if self.noise is None:
            self._slow(blocks)
        found = self.momentum.residual(blocks)
        frames = self.framer.frames(found)
        step = float(np.mean(blocks.step))
        if frames is not None:
            self.std = frames.std[-1]
        rest = found.residual
        if self.changes is not None:
            rest = rest - self._known(found.motion.v, found.motion.direction, found.predicted)
        r, margin = self.contacts.filtered(rest, found.uncertain, step)
        self.residual = r[-1]
        if self.noise is None or self.changes is None:
            return self._calibrate(frames, r, margin, step)
        self.threshold = np.maximum(SIGMAS * np.hypot(self.noise.filtered, self.std), PEAK * self.noise.peak)
        events: list[Event] = []
        for contact in self.contacts.find(found.motion.t, r, margin, self.threshold, found.motion.q, blocks.late):
            events.append(contact)
            if contact.end is not None and contact.end - contact.start < BRIEF:
                self.changes.restart_after()
        if frames is not None:
            events += self._changed(frames, step)
        return events

    def _changed(self, frames: Frames, step: float) -> list[Event]:
        assert self.changes is not None, "the noise is known"
        events: list[Event] = []
        for change in self.changes.add(frames, step * frames.blocks):
            events.append(change)
            if self.contacts.begun is not None:
                events.append(self.contacts.close(change.t, change.t, change.sentence))
        if events:
            self.momentum.load(self.changes.load)
            self.changes.load[:] = 0.0
            self.momentum.grown = np.maximum(self.changes.base[:, 1] - self.changes.first[:, 1], 0.0)
            self.contacts.restart()
        return events

    def _known(self, v: Array, direction: Array, predicted: Array) -> Array:
        """Torque (K, n) of the changes that are known."""
        assert self.changes is not None, "the noise is known"
        base = self.changes.base
        return np.asarray(base[:, 0] * v + base[:, 1] * direction + base[:, 2] * predicted + base[:, 3])

    def _slow(self, blocks: Blocks) -> None:
        """Speed below which the direction of friction is uncertain, from the velocities of the quiet stretch."""
        fastest = SLOWEST * np.abs(blocks.v).max(axis=0)
        noise = JITTER * np.std(np.diff(blocks.v, 2, axis=0), axis=0) / np.sqrt(6) if len(blocks.v) > 4 else 0.0
        self.momentum.slow = np.maximum(self.momentum.slow, np.maximum(fastest, noise))

    def _calibrate(self, frames: Frames | None, r: Array, margin: Array, step: float) -> list[Event]:
        if not self.warm:
            if frames is not None:
                self.quiet.add(frames, step * frames.blocks)
            if self.quiet.moved >= WARM * self.duration or self.quiet.total >= PATIENCE * WARM * self.duration:
                self.quiet, self.warm = Quiet(len(self.std)), True
            return []
        over = np.maximum(np.abs(r) - margin, 0.0)
        self.power += np.sum(over**2, axis=0)
        self.peak, self.blocks = np.maximum(self.peak, over.max(axis=0)), self.blocks + len(r)
        if frames is None:
            return []
        self.quiet.add(frames, step * frames.blocks)
        if self.quiet.moved < self.duration and self.quiet.total < PATIENCE * self.duration:
            return []
        base, frame, inflation = self.quiet.base()
        self.noise = QuietNoise(np.sqrt(self.power / self.blocks), self.peak, frame, inflation, base)
        self.changes = Changes(self.model, self.noise)
        self.quiet = Quiet(len(base))
        smallest = np.maximum(SIGMAS * np.hypot(self.noise.filtered, self.std), PEAK * self.peak)
        robot = self.model.robot
        units = ["N" if p else "N.m" for p in robot.prismatic]
        sizes = (f"{j} {x:.3g} {u}" for j, x, u in zip(robot.joints, smallest, units, strict=True))
        return [Note(float(frames.t[-1]), f"watching; thresholds: {', '.join(sizes)}")]


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
    _checked(model, quiet)  # before waiting for the stream
    opened = open_stream(stream, model.robot, columns, follow, idle)
    return Watcher(_of_joints(model, opened.joints), quiet=quiet), opened


def _checked(model: ModelSource, quiet: float) -> Model:
    """Model to watch with, if it and the duration of the quiet stretch [s] can be used."""
    if not 0 < quiet < 1e5:
        raise OptionError(f"quiet is {quiet:g} s; give the duration of the stretch without contacts, such as 10")
    return torque_model(as_model(model, "watch"))


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
