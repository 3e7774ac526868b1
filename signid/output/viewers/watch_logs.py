"""Logs of a watch, written as it goes on."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from threading import current_thread, main_thread
from types import TracebackType
from typing import IO

import numpy as np

from ...model import Model
from ...watch import Event, WatchedBlocks
from ..report.write import open_output, refused_output
from .topics import McapTopics, RosTopics
from .watched import WatchMessages, WatchWriter

RATE = 100.0  # [Hz] of rows; the residual has a time constant of 20 ms


class WatchLogs:
    """Files and topics that take what a watch found; complete also after Ctrl-C, absent after an error.

    Args:
        model: the watched model.
        files: paths by kind, "rrd" or "mcap".
        publish: whether topics of ROS 2 take it, too.
        sentence: an event as a sentence.
        package_dirs: folders of packages of meshes, which a file of Rerun contains.

    Raises:
        OptionError: rclpy is not installed.
        OutputError: a file cannot be written.
    """

    def __init__(
        self,
        model: Model,
        files: Mapping[str, Path],
        publish: bool,
        sentence: Callable[[Event], str],
        package_dirs: Sequence[str] = (),
    ) -> None:
        self.sentence, self.last = sentence, -np.inf
        self.writers: list[tuple[WatchWriter, Callable[[], AbstractContextManager[None]]]] = []
        with ExitStack() as stack:
            if publish:
                self._add(stack, WatchMessages(RosTopics("signid_watch_results"), model, whole=False), nullcontext)
            for kind, path in files.items():
                file = stack.enter_context(open_output(path, f"--{kind}"))
                made = WatchMessages(McapTopics(file), model, whole=True) if kind == "mcap" else None
                writer = made or _rerun(file, model, package_dirs)
                self._add(stack, writer, partial(refused_output, path, f"--{kind}"))
            self.stack = stack.pop_all()

    def _add(self, stack: ExitStack, writer: WatchWriter, guard: Callable[[], AbstractContextManager[None]]) -> None:
        def close() -> None:
            with guard():
                writer.close()

        stack.callback(close)
        self.writers.append((writer, guard))

    def take(self, blocks: Sequence[WatchedBlocks], events: Sequence[Event]) -> None:
        """Write rows at up to 100 Hz, then events.

        Raises:
            OutputError: a file cannot be written.
        """
        if not self.writers:
            return
        with _uninterrupted():
            rows = self._thinned(blocks)
            for writer, guard in self.writers:
                with guard():
                    if rows:
                        writer.rows(rows)
                    for event in events:
                        writer.event(event, self.sentence(event))

    def _thinned(self, blocks: Sequence[WatchedBlocks]) -> WatchedBlocks | None:
        kept = list[WatchedBlocks]()
        for each in blocks:
            rows = []
            for k, t in enumerate(each.t.tolist()):
                if not self.last <= t < self.last + 0.999 / RATE:
                    rows.append(k)
                    self.last = t
            kept += [WatchedBlocks(*(x[rows] for x in each))] if rows else []
        return WatchedBlocks(*(np.concatenate(x) for x in zip(*kept, strict=True))) if kept else None

    def __enter__(self) -> WatchLogs:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with _uninterrupted():
            self.stack.__exit__(kind, error, trace)


def _rerun(file: IO[bytes], model: Model, package_dirs: Sequence[str]) -> WatchWriter:
    from .watched_rerun import WatchRerun

    return WatchRerun(file, model, package_dirs)


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
