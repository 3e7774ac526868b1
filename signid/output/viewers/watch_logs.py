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
from ..report.write import open_output, refused_output
from .files import log_file
from .links import Head, Links, Remark, Signal

RATE = 100.0  # [Hz] of rows; the residual has a time constant of 20 ms
EFFORTS = ("predicted_torque", "external_torque", "threshold")  # topics, as in blocks of a watch


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
                    if times and not self.begun and self.robot.kind == "urdf":
                        file.robot(times[0], Links(self.robot))
                    if signals:
                        file.signals(signals)
                    for remark in remarks:
                        file.remark("/signid/log", remark)
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
        t, q, v, measured, *rest = (x[kept] for x in rows)
        joints, efforts = self.robot.joints, zip(EFFORTS, rest, strict=True)
        state = Signal("/joint_states", joints, t, q, v, measured, drawn=True)
        return [state, *(Signal(f"/signid/{name}", joints, t, effort=x) for name, x in efforts)]

    def _remark(self, event: Event) -> Remark:
        """An event; a warning when a contact begins and for a change."""
        ended = isinstance(event, Contact) and event.end is not None
        text = json.dumps(event.document(), ensure_ascii=False)
        return Remark(event.t, self.sentence(event), not isinstance(event, Note) and not ended, text)

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
