"""Model and stream -> events, as they are found."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..errors import InputError, OptionError
from ..faults.examine import UNFIT
from ..faults.identified import recording_flags
from ..faults.result import named
from ..faults.search import CLAIMS
from ..model import Model, ModelSource, as_model, torque_model
from ..recording import read_recording
from ..recording.mapping import ColumnMap
from ..regression.factors import Misfit
from ..robot import configuration, hold, resting
from ..robot.dynamics import own_body, point_jacobian
from ..typed import typed
from ..types import Array, Law, Mask
from .changes import TIP_JOINT, Changes
from .intake import Blocks, Contact, Cutter, Event, Intake, LastingChange, Note, StreamRows, given_rows
from .observer import OBSERVER_GAIN, Framer, Frames, Momentum, Observed, Observer, Residual
from .quiet import Discrepancy, Quiet, learn
from .sources import Stream, open_stream

QUIET_DURATION = 10.0  # [s] of motion that give the noise
MAX_QUIET_RATIO = 6.0  # [1] longest quiet stretch, over the motion that it should have
SLOW_SPEED_RATIO = 0.05  # [1] over the largest of the quiet stretch; below, the direction of friction is uncertain
MIN_SLOW_SPEED = 0.01  # [rad/s or m/s] the same, at least
SLOW_SPEED_DEVIATIONS = 4.0  # [standard deviations] of the velocity, the same
SPEED_SHARE = 0.3  # [1] share of the quiet stretch that gives the speeds alone
PROCESSING_INTERVAL, MIN_PROCESSED_ROWS = 0.02, 21  # [s] of rows processed together; before the period is known
NOISE_EDGES = 16  # latest edges that give the noise of the velocity
DEAD_RATIO, LOADED_RATIO = 0.05, 0.05  # [1] deviation of a dead torque over that predicted; of that, over the largest
FAULT_ROW_INTERVAL = 0.01  # [s] between rows of the quiet stretch that are examined for faults, in about a second
MODEL_FAULTS = (*CLAIMS, "absolute torque", "units", "gain", UNFIT)  # torque does not follow the model
MIN_STREAM_ROWS = 2  # rows of a stream that can be watched
LOOKBACK = 4.0  # [s] before a change is noticed in which it may have looked like a contact
CORRELATION_TIME = 0.1  # [s] of the misfit of a model that states none
MIN_CHANGE_CONTACT = 3.0  # [s] a contact that is shorter is none of the changes
CONTACT_END_RATIO = 0.5  # [1] share of the threshold below which a contact ends
CONTACT_START_TIME = 0.004  # [s] above the threshold before a contact begins
CONTACT_END_TIME = 0.1  # [s] below `CONTACT_END_RATIO` before a contact ends
LISTED_JOINT_RATIO = 0.25  # [1] share of the threshold above which a joint is listed beside those that exceed it
MIN_DIRECTION_JOINTS = 3  # joints that a direction of the force needs


class WatchedBlocks(NamedTuple):
    """K blocks of n joints as the watch saw them, for logs."""

    t: Array  # (K,) [s]
    q: Array  # (K, n) [rad or m]
    v: Array  # (K, n) [rad/s or m/s]
    measured: Array  # (K, n) [N.m or N]
    predicted: Array  # (K, n) [N.m or N]
    residual: Array  # (K, n) [N.m or N] of the observer: external torque
    threshold: Array  # (K, n) [N.m or N]; NaN before the noise is known


class Watcher:
    """Watch a robot: `feed` takes rows as they come and returns events.

    The first seconds of motion must be free of contacts: they give the noise of the residual, beside the covariance of
    the model. `quiet` [s]: duration of that stretch. `sensitivity` [1]: 2 halves the thresholds of contacts.

    Raises:
        OptionError: no model, or a number that is not positive.
    """

    def __init__(self, model: ModelSource, *, quiet: float = QUIET_DURATION, sensitivity: float = 1.0) -> None:
        self.model = _watched(model, quiet, sensitivity)
        robot = self.model.robot
        self.momentum = Momentum(self.model)
        self.intake, self.cutter = Intake(robot), Cutter()
        self.observer, self.framer = Observer(len(robot.joints)), Framer(self.model, self.momentum)
        self.contacts = Contacts(self.model)
        n = len(robot.joints)
        self.duration, self.quiet, self.warm = quiet, Quiet(n), False
        self.sensitivity = sensitivity
        self.seen: list[Observed] = []
        self.sizes: Discrepancy | None = None
        self.changes: Changes | None = None
        self.past: list[Contact] = []  # that have ended, without a cause
        self.std = np.zeros(n)
        self.residual, self.threshold = np.zeros(n), np.full(n, np.nan)  # for a display
        self.ratio = np.zeros(n)  # [1] of what friction cannot explain of the residual to the threshold
        self.blocks: list[WatchedBlocks] = []  # of the last `feed`
        self.t = float("nan")
        self.ignored = bool(self.momentum.ignored)
        self.given = self.used = 0  # rows
        self.waiting: StreamRows | None = None  # rows that are processed with later ones
        self.speeds = np.zeros((0, n))  # [rad/s or m/s] of the latest edges
        self.rows: list[StreamRows] | None = []  # of the quiet stretch; None: it was examined for faults
        self.flags: list[str] = []  # reasons not to rely on the watch, one sentence each

    def feed(self, t: Array, q: Array, tau: Array, dq: Array | None = None) -> list[Event]:
        """Events of further rows: t (N,) [s], q (N, n) [rad or m], tau (N, n) [N.m or N], dq (N, n) [rad/s or m/s].

        Rows are processed in pieces of 20 ms, so that events do not depend on how the stream is cut; the last rows wait
        for further ones, or for `finish`. Masked values are missing.

        Raises:
            OptionError: arrays of other shapes, or without real numbers.
            RecordingError: t is not in seconds.
        """
        rows = given_rows(t, q, tau, dq, len(self.std))
        self.given += len(rows.t)
        waiting, start = rows if self.waiting is None else self.waiting.then(rows), 0
        events: list[Event] = []
        self.blocks.clear()
        while len(waiting.t) - start >= (size := self._size()):
            events += self._process(waiting.at(slice(start, start + size)))
            start += size
        self.waiting = waiting.at(slice(start, None))
        return events

    def _process(self, given: StreamRows) -> list[Event]:
        pieces, notes = self.intake.take(given)
        self.used += sum(len(piece.rows.t) for piece in pieces)
        events: list[Event] = list(notes)
        if self.ignored:
            names = ", ".join(dict.fromkeys(self.momentum.ignored))
            events.append(Note(float(given.t[0]), f"the watch ignores these laws of the model: {names}"))
            self.ignored = False
        for piece in pieces:
            if piece.fresh:
                self._restart()
            if self.rows is not None:
                self.rows.append(piece.rows)
            self.t = float(piece.rows.t[-1])
            if (blocks := self.cutter.cut(piece.rows)) is not None:
                events += self._blocks(blocks)
        return events

    @property
    def load(self) -> tuple[Array, Array] | None:
        """Payload that was named and is there now: mass and first moment (4,) [kg, kg.m], covariance; None without one.

        Of the last joint that the stream has; (4, 4) covariance [products of the units].
        """
        named = [] if self.changes is None else [one for one in self.changes.known if one.joint == TIP_JOINT]
        if not named or self.changes is None:
            return None
        size = len(named[-1].covariance)
        return self.changes.carried[:size], np.asarray(sum(one.covariance for one in named))

    def finish(self) -> list[Event]:
        """Events at the end of the stream: of rows that wait, and the end of a contact that is going on."""
        waiting, self.waiting = self.waiting, None
        self.blocks.clear()
        events = self._process(waiting) if waiting is not None and len(waiting.t) else []
        return events if self.contacts.begun is None else [*events, self.contacts.close(self.t, self.t)]

    def fault(self) -> str:
        """Sentence on a stream that has ended before anything was watched; empty if something was."""
        if self.used >= MIN_STREAM_ROWS:
            fact = f"nothing was watched: the stream ended within its first stretch of {self.duration:g} s of motion"
            return "" if self.sizes is not None else f"{fact}, which gives the thresholds; shorten it (--quiet)"
        fact = f"{self.used or 'none'} of the {self.given} rows" if self.given else "no row, only a header,"
        return f"{fact} could be watched; expected a number in t, q and tau of each joint, and t that increases"

    def _size(self) -> int:
        """Rows that are processed together."""
        period = self.intake.period
        return max(1, round(PROCESSING_INTERVAL / period)) if period > 0 else MIN_PROCESSED_ROWS

    def _restart(self) -> None:
        self.speeds = self.speeds[:0]
        for part in (self.cutter, self.observer, self.framer, self.contacts):
            part.restart()

    def _blocks(self, blocks: Blocks) -> list[Event]:
        self._slow(blocks)
        found = self.momentum.residual(blocks)
        frames, step = self.framer.frames(found), float(np.mean(blocks.step))
        if frames is not None:
            self.std = frames.std[-1]
            if self.changes is not None:
                self.std = np.hypot(self.std, self.changes.std(frames))
        seen = self.observer.observe(found, step)
        if self.sizes is None or self.changes is None:
            self._keep(found, seen.residual, np.full_like(seen.residual, np.nan))
            return self._calibrate(frames, seen, step)
        r, beyond = seen.beyond(self.changes.base)
        threshold = self.sizes.threshold(seen, self.std) * self.changes.raised / self.sensitivity
        self._keep(found, r, threshold)
        self.ratio = beyond[-1] / threshold[-1]
        events: list[Event] = []
        for contact in self.contacts.find(found.motion.t, r, beyond / threshold, found.motion.q, blocks.late):
            events.append(contact)
            if contact.end is not None:
                self.past.append(contact)
                if contact.end - contact.start < MIN_CHANGE_CONTACT:
                    self.changes.restart_after()
        if frames is not None:
            events += self._changed(frames, step)
        return events

    def _keep(self, found: Residual, residual: Array, threshold: Array) -> None:
        x, torque = found.motion, found.predicted + found.residual
        self.blocks.append(WatchedBlocks(x.t, x.q, x.v, torque, found.predicted, residual, threshold))
        self.residual, self.threshold = residual[-1], threshold[-1]

    def _changed(self, frames: Frames, step: float) -> list[Event]:
        assert self.changes is not None, "the noise is known"
        events: list[Event] = []
        for change in self.changes.add(frames, step * frames.blocks):
            events.append(change)
            if self.contacts.begun is not None:
                events.append(self.contacts.close(change.t, change.t, change.sentence))
            if change.corrects is None:
                events += self._explained(change)
        if events:
            self.momentum.load(self.changes.load)
            self.changes.load[:] = 0.0
            self.momentum.grown = np.maximum(self.changes.base[:, 1] - self.changes.first[:, 1], 0.0)
            self.contacts.restart()
            self.observer.restart()
        return events

    def _explained(self, change: LastingChange) -> list[Event]:
        """Contacts of the last seconds, which the change explains, with their cause."""
        assert self.changes is not None, "the noise is known"
        past, self.past = self.past, []
        late = [one for one in past if one.end is not None and one.end > self.changes.noticed - LOOKBACK]
        return [replace(one, t=change.t, cause=change.sentence, corrects=one.t) for one in late]

    def _slow(self, blocks: Blocks) -> None:
        """Speed below which the direction of friction is uncertain, from the largest one and the noise so far."""
        fastest = np.maximum(SLOW_SPEED_RATIO * np.abs(blocks.v).max(axis=0), MIN_SLOW_SPEED)
        self.speeds = np.concatenate([self.speeds[:-1], blocks.v])[-NOISE_EDGES:]  # the first is the last one before
        some = len(self.speeds) > 4
        noise = SLOW_SPEED_DEVIATIONS * np.std(np.diff(self.speeds, 2, axis=0), axis=0) / np.sqrt(6) if some else 0.0
        self.momentum.slow = np.maximum(self.momentum.slow, np.maximum(fastest, noise))

    def _calibrate(self, frames: Frames | None, seen: Observed, step: float) -> list[Event]:
        if frames is not None:
            self.quiet.add(frames, step * frames.blocks)
        if not self.warm:
            motion, total = self.quiet.moved, self.quiet.total
            if motion >= SPEED_SHARE * self.duration or total >= MAX_QUIET_RATIO * SPEED_SHARE * self.duration:
                self.quiet, self.warm = Quiet(len(self.std)), True
            return []
        self.seen.append(seen)
        if frames is None or (self.quiet.moved < self.duration and self.quiet.total < MAX_QUIET_RATIO * self.duration):
            return []
        level, moved, misfit = self.momentum.level, self.quiet.moved_long(), self._misfit()
        friction = np.column_stack([level["viscous_friction"], level["coulomb_friction"]])
        noise = self.quiet.noise(friction, misfit)
        whole = Observed(*(np.concatenate(parts) for parts in zip(*self.seen, strict=True)))
        self.sizes = learn(whole, whole.beyond(noise.base)[1], moved, misfit.size, self.intake.period)
        self.changes = Changes(self.model, noise)
        self.framer.narrow(noise.spread)
        self.quiet, self.seen = Quiet(len(self.std)), []
        t = float(frames.t[-1])
        self.flags += (unlike := self._unlike(whole, moved))
        return [self._watching(t, whole, moved), *(Note(t, flag) for flag in unlike)]

    def _unlike(self, seen: Observed, moved: Mask) -> tuple[str, ...]:
        """Faults of the quiet stretch, whose residual makes thresholds so wide that nothing exceeds them."""
        kept, self.rows = self.rows, None
        if kept is None:
            return ()
        predicted = seen.columns[:, 2]
        size, measured = predicted.std(axis=0), (predicted + seen.residual).std(axis=0)
        dead = (measured < DEAD_RATIO * size) & (moved | ((measured == 0) & (size > LOADED_RATIO * size.max())))
        if dead.any():
            joints = named([self.model.robot.joints[j] for j in np.flatnonzero(dead)])
            fact = f"the torque of {joints} does not follow the model: it hardly changes while the model's does"
            return (f"{fact}, so contacts are missed there; check its columns and sensors",)
        every = max(1, round(FAULT_ROW_INTERVAL / self.intake.period))
        t, q, tau = (np.concatenate(parts)[::every] for parts in zip(*(rows[:3] for rows in kept), strict=True))
        table = {"t": t}
        for joint, *both in zip(self.model.robot.joints, q.T, tau.T, strict=True):
            table |= {f"q_{joint}": both[0], f"tau_{joint}": both[1]}
        try:
            return recording_flags(self.model, [read_recording(table, self.model.robot)], kinds=MODEL_FAULTS)
        except InputError:  # too short, or too damaged, to be examined
            return ()

    def _misfit(self) -> Misfit:
        """Misfit of the model; none where it states none."""
        n, known = len(self.std), self.model.misfit
        if known is None:
            return Misfit(np.zeros(n), np.full(n, CORRELATION_TIME), np.nan)
        return replace(known, size=np.nan_to_num(known.size), length=np.nan_to_num(known.length, nan=CORRELATION_TIME))

    def _watching(self, t: float, seen: Observed, moved: Mask) -> Note:
        assert self.sizes is not None, "the quiet stretch is over"
        usual = np.median(self.sizes.threshold(seen, self.std), axis=0) / self.sensitivity
        robot = self.model.robot
        units = ["N" if p else "N.m" for p in robot.prismatic]
        sizes = (f"{j} {x:.3g} {u}" for j, x, u in zip(robot.joints, usual, units, strict=True))
        still = [name for name, some in zip(robot.joints, moved, strict=True) if not some]
        about = f"; {', '.join(still)} did not move: thresholds in motion are those of the model" if still else ""
        return Note(t, f"watching; usual thresholds: {', '.join(sizes)}{about}")


@typed
def watch(
    model: ModelSource,
    stream: object,
    *,
    quiet: float = QUIET_DURATION,
    sensitivity: float = 1.0,
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
        sensitivity: 2 halves the thresholds of contacts, with more false ones [1].
        columns: column map, as in `read_recording`.
        follow: whether a file is read on as it grows.
        idle: time [s] without rows after which a live stream ends.

    Raises:
        OptionError: rclpy is missing, or a number is out of range.
        RecordingError: the stream has no rows that can be used.
    """
    model = as_model(model, "watch")
    watcher, opened = open_watch(model, stream, quiet, sensitivity, columns=columns, follow=follow, idle=idle)
    return _events(watcher, opened)


def open_watch(
    model: Model,
    stream: object,
    quiet: float = QUIET_DURATION,
    sensitivity: float = 1.0,
    *,
    columns: ColumnMap | None = None,
    rate: float | None = None,
    follow: bool = False,
    idle: float = np.inf,
) -> tuple[Watcher, Stream]:
    """The watcher of the joints of a stream, and the stream; arguments are those of `watch`."""
    _watched(model, quiet, sensitivity)  # before waiting for the stream
    opened = open_stream(stream, model.robot, columns, follow, idle, rate)
    watcher = Watcher(_of_joints(model, opened.joints), quiet=quiet, sensitivity=sensitivity)
    if opened.recording is not None:  # all of it is examined: `stream_flags`
        watcher.rows = None
    return watcher, opened


@typed
def _watched(model: ModelSource, quiet: float, sensitivity: float) -> Model:
    """Model to watch with, if it, the duration of the quiet stretch [s] and the sensitivity [1] can be used."""
    if not 0 < quiet < 1e5:
        raise OptionError(f"quiet is {quiet:g} s; give the duration of the stretch without contacts, such as 10")
    if not 0 < sensitivity < 1e3:
        raise OptionError(f"sensitivity is {sensitivity:g}; give a positive number, such as 2 for half the thresholds")
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
    misfit = model.misfit
    if misfit is not None:
        kept = [robot.joints.index(name) for name in moving.joints]
        misfit = replace(misfit, size=misfit.size[kept], length=misfit.length[kept])
    return Model(moving, model.inertials, tuple(laws), model.covariance, misfit)


class Contacts:
    """State of the contact that is going on."""

    def __init__(self, model: Model) -> None:
        self.robot = model.robot
        self.bodies = model.bodies()
        self.data = self.bodies.createData()
        self.above = self.below = self.peak = 0.0
        self.before: float | None = None  # [s] time of the last block
        self.begun: Contact | None = None
        self.most: tuple[float, Array, Array, Array] | None = (
            None  # ratio, of each joint, residual, position at the largest moment
        )

    def restart(self) -> None:
        """Begin a new stretch."""
        self.above, self.below, self.before = 0.0, 0.0, None

    def find(self, t: Array, r: Array, ratio: Array, q: Array, late: float) -> list[Contact]:
        """Events of K blocks.

        t: (K,) [s]; r: (K, n) residual [N.m or N]; ratio: (K, n) of it to its threshold [1]; q: (K, n) [rad or m];
        late: delay of the blocks [s].
        """
        largest = ratio.max(axis=1)
        before, self.before = self.before, float(t[-1])
        if self.begun is None and not (largest > 1).any():
            self.above = 0.0
            return []
        events: list[Contact] = []
        before = float(t[0]) if before is None else before
        for k, (now, size) in enumerate(zip(t.tolist(), largest.tolist(), strict=True)):
            step, before = max(now - before, 0.0), now
            if self.begun is None:
                self.above = self.above + step if size > 1 else 0.0
                if size > 1 and self.above >= min(CONTACT_START_TIME, step * 1.5):
                    rise = min(1.0, 1.0 / max(size, 1.0)) / OBSERVER_GAIN  # [s] of a constant torque to the threshold
                    begin = now - self.above - float(rise)
                    self.begun = self._contact(now + late, ratio[k], r[k], q[k], begin)
                    self.most, self.below = (size, ratio[k].copy(), r[k].copy(), q[k].copy()), 0.0
                    self.peak = now
                    events.append(self.begun)
                continue
            assert self.most is not None, "it is set with `begun`"
            if size > self.most[0]:
                self.most, self.peak = (size, ratio[k].copy(), r[k].copy(), q[k].copy()), now
            self.below = self.below + step if size < CONTACT_END_RATIO else 0.0
            if self.below >= CONTACT_END_TIME:
                events.append(self.close(now + late, self._end(now)))
        return events

    def _end(self, now: float) -> float:
        """End of the force [s]: before the decay of the residual, and not before its largest moment."""
        assert self.most is not None, "a contact is going on"
        return max(now - self.below - float(np.log(self.most[0] / CONTACT_END_RATIO)) / OBSERVER_GAIN, self.peak)

    def close(self, t: float, end: float, cause: str | None = None) -> Contact:
        """End of the contact, with its largest torque."""
        assert self.begun is not None and self.most is not None, "a contact is going on"
        _, ratio, r, q = self.most
        begun, self.begun, self.above = self.begun, None, 0.0
        ended = self._contact(t, ratio, r, q, begun.start)
        names = self.robot.joints
        listed = {*begun.joints, *ended.torque}
        torque = {name: float(x) for name, x in zip(names, r, strict=True) if name in listed}
        return replace(ended, torque=torque, end=max(end, begun.start), cause=cause)

    def _contact(self, t: float, ratio: Array, r: Array, q: Array, start: float) -> Contact:
        names = self.robot.joints
        over = np.flatnonzero(ratio > 1)
        loaded = over if len(over) else np.array([int(np.argmax(ratio))])
        torque = {names[j]: float(r[j]) for j in np.flatnonzero(ratio > LISTED_JOINT_RATIO)}
        body = own_body(self.robot, int(loaded.max()))
        return Contact(
            t,
            tuple(names[j] for j in loaded),
            self.robot.links[body],
            torque,
            self._direction(body, q, r) if loaded.max() + 1 >= MIN_DIRECTION_JOINTS else None,
            start,
        )

    def _direction(self, body: int, q: Array, r: Array) -> tuple[float, float, float] | None:
        """Direction in the world of a force at the centre of mass of a body that loads the joints by r."""
        position = configuration(self.robot, q[None])[0]
        lever = self.bodies.inertias[body + 1].lever
        jacobian = point_jacobian(self.bodies, self.data, position, body + 1, lever) @ self.robot.drive
        force = np.linalg.lstsq(jacobian.T, -r, rcond=1e-3)[0]
        size = float(np.linalg.norm(force))
        return None if not size > 0 else (float(force[0] / size), float(force[1] / size), float(force[2] / size))
