"""The watch: rows in, events out, with a state of constant size."""

from __future__ import annotations

import numpy as np

from ..errors import OptionError
from ..model import Model, ModelSource, as_model, torque_model
from ..types import Array
from .blocks import Blocks, Cutter
from .changes import Changes
from .contacts import PEAK, SIGMAS, Contacts
from .events import Event, Note
from .frames import Framer, Frames
from .intake import Intake, StreamRows
from .momentum import Momentum
from .quiet import Quiet, QuietNoise

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
        if not 0 < quiet < 1e5:
            raise OptionError(f"quiet is {quiet:g} s; give the duration of the stretch without contacts, such as 10")
        self.model: Model = torque_model(as_model(model, "watch"))
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
