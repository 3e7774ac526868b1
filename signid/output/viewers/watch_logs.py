"""Logs of a watch, which take its messages as it goes on."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from threading import current_thread, main_thread
from types import TracebackType

import numpy as np

from ...model import Model
from ...watch import Contact, Event, Note, WatchedBlocks
from ..replay.shapes import reach
from ..report.write import open_output, refused_output
from .files import log_file
from .links import Arrow, Head, Links, Remark, Signal

RATE = 100.0  # [Hz] of rows; the residual has a time constant of 20 ms
LONG, THICK = 0.3, 0.02  # [1] length and thickness of an arrow over the reach of the robot
STATE = {"effort": ("torque", "measured"), "position": ("q", "q"), "velocity": ("v", "v")}  # curves


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
        self.robot, self.bodies, self.sentence = model.robot, model.bodies(), sentence
        self.links, self.reach = Links(model.robot), reach(model.robot)
        self.q = np.zeros(len(model.robot.joints))  # [rad or m] of the last row
        self.begun, self.last = False, -np.inf
        head = Head(model.robot.name, f"watch of {model.robot.name}")
        with ExitStack() as stack:
            self.files = []
            for kind, path in files.items():
                guard = partial(refused_output, path, f"--{kind}")
                out = stack.enter_context(open_output(path, f"--{kind}"))
                file = log_file(kind, out, head, package_dirs)
                stack.callback(guard()(file.close))
                self.files.append((file, guard))
            self.stack = stack.pop_all()

    def take(self, blocks: Sequence[WatchedBlocks], events: Sequence[Event]) -> None:
        """Write rows at up to 100 Hz, then events.

        Raises:
            OutputError: a file cannot be written.
        """
        with _uninterrupted():
            signals = self._signals(blocks)
            remarks = [self._remark(event) for event in events]
            times = [*(float(each.t[0]) for each in signals), *(remark.t for remark in remarks)]
            for file, guard in self.files:
                with guard():
                    if times and not self.begun:
                        file.robot(times[0], self.links)
                    if signals:
                        file.signals(signals)
                    for remark in remarks:
                        file.remark(remark)
            self.begun = self.begun or bool(times)

    def _signals(self, blocks: Sequence[WatchedBlocks]) -> list[Signal]:
        """Signals of the rows that are due."""
        if not blocks:
            return []
        rows, kept = WatchedBlocks(*map(np.concatenate, zip(*blocks, strict=True))), []
        for k, t in enumerate(rows.t.tolist()):
            if not self.last <= t < self.last + 0.999 / RATE:
                kept.append(k)
                self.last = t
        if not kept:
            return []
        t, q, v, measured, *efforts = (x[kept] for x in rows)
        self.q, joints = q[-1], self.robot.joints
        signals = [Signal("/joint_states", STATE, joints, t, q, v, measured, drawn=True)]
        names = {"predicted_torque": "predicted", "external_torque": "residual", "threshold": "threshold"}
        for (topic, curve), x in zip(names.items(), efforts, strict=True):
            signals.append(Signal(f"/signid/{topic}", {"effort": ("torque", curve)}, joints, t, effort=x))
        return signals

    def _remark(self, event: Event) -> Remark:
        """An event; a warning when a contact begins and for a change."""
        contact = event if isinstance(event, Contact) else None
        warning = not isinstance(event, Note) and (contact is None or contact.end is None)
        text = json.dumps(event.document(), ensure_ascii=False)
        arrow = None if contact is None else self._arrow(contact)
        return Remark(event.t, self.sentence(event), text, warning, arrow)

    def _arrow(self, contact: Contact) -> Arrow:
        """Arrow of the force on the link, its tip at the centre of mass."""
        body = self.robot.links.index(contact.link) + 1
        self.links.poses(self.q)
        tip = self.links.data.oMi[body].act(self.bodies.inertias[body].lever)
        way = None if contact.direction is None else LONG * self.reach * np.array(contact.direction)
        return Arrow(tip, way, THICK * self.reach, contact.end is not None, bool(contact.cause))

    def __enter__(self) -> WatchLogs:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with _uninterrupted():
            self.stack.__exit__(kind, error, trace)


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Ctrl-C waits until a record is complete."""
    if current_thread() is not main_thread():
        yield
        return
    asked: list[object] = []
    before = signal.signal(signal.SIGINT, lambda *given: asked.append(given))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if asked:
        raise KeyboardInterrupt
