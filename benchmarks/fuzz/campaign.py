"""Supervision of worker processes: an input that hangs or ends its process is counted, and the run continues."""

from __future__ import annotations

import json
import os
import queue
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..summary import ONE_THREAD
from .worker import STATE, Progress

READERS = "benchmarks.fuzz.sources"
CHUNK = 4000  # inputs per order
WALL = 40.0  # [s] after which an input's process is ended, whatever it waits for
POLL = 0.5  # [s]
LARGEST = 2000  # [MB] peak memory after which a worker is replaced


@dataclass
class Finding:
    """A fault, the first input that shows it, and the number of inputs that do."""

    reader: str
    fault: str
    first: int
    count: int = 1


@dataclass
class Row:
    """Results of one reader."""

    reader: str
    inputs: int = 0
    seconds: float = 0.0  # of the processor
    refused: int = 0
    accepted: int = 0
    peak: int = 0  # [MB]
    findings: dict[str, Finding] = field(default_factory=dict)

    def add(self, number: int, fault: str) -> None:
        """Count a fault."""
        if fault in self.findings:
            self.findings[fault].count += 1
            self.findings[fault].first = min(number, self.findings[fault].first)
        else:
            self.findings[fault] = Finding(self.reader, fault, number)


@dataclass(frozen=True)
class Order:
    """Inputs start..stop of a reader, end exclusive."""

    reader: str
    start: int
    stop: int
    seed: int


class Worker:
    """A worker process that is replaced when it dies."""

    def __init__(self, folder: Path, module: str, wall: float) -> None:
        self._folder, self._module, self._wall = folder, module, wall
        self._process: subprocess.Popen[bytes] | None = None
        self._unread = b""

    def carry_out(self, order: Order, row: Row, lock: threading.Lock) -> None:
        """Give all inputs of an order to the reader, and add the results to its row."""
        start = order.start
        while start < order.stop:
            process = self._started()
            assert process.stdin is not None
            text = json.dumps({"reader": order.reader, "start": start, "stop": order.stop, "seed": order.seed})
            process.stdin.write(text.encode() + b"\n")
            process.stdin.flush()
            dead = self._listen(process, row, lock)
            now = self._progress()
            if dead and now.number < 0:
                raise RuntimeError(f"a worker cannot start: {dead}")
            with lock:
                row.refused, row.accepted = row.refused + now.refused, row.accepted + now.accepted
                row.seconds += now.seconds
                row.inputs += now.refused + now.accepted + bool(dead)
                if dead:
                    row.add(max(now.number, start), dead)
            if not dead:
                return
            self.stop()
            start = max(now.number, start) + 1

    def stop(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    def _started(self) -> subprocess.Popen[bytes]:
        (self._folder / "state").write_bytes(STATE.pack(*Progress()))
        if self._process is None:
            command = [sys.executable, "-m", "benchmarks.fuzz.worker", "state", "noise", self._module]
            here = str(Path(__file__).parents[2])
            paths = os.pathsep.join(x for x in (here, os.environ.get("PYTHONPATH", "")) if x)
            self._unread = b""
            self._process = subprocess.Popen(
                command,
                cwd=self._folder,
                env={**os.environ, **ONE_THREAD, "PYTHONPATH": paths},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
            )
        return self._process

    def _progress(self) -> Progress:
        return Progress(*STATE.unpack((self._folder / "state").read_bytes()))

    def _listen(self, process: subprocess.Popen[bytes], row: Row, lock: threading.Lock) -> str:
        """Take the answers of an order; return why the process ended before its end, "" if it did not."""
        assert process.stdout is not None
        while True:
            if not select.select([process.stdout], [], [], POLL)[0]:
                now = self._progress()
                if now.number >= 0 and time.monotonic() - now.start > self._wall:
                    return f"over {self._wall:.0f} s, process ended"
                continue
            received = os.read(process.stdout.fileno(), 65536)
            if not received:
                return self._death(process.wait())
            *lines, self._unread = (self._unread + received).split(b"\n")
            for answer in map(json.loads, lines):
                if "done" in answer:
                    with lock:
                        row.peak = max(row.peak, answer["peak"])
                    if answer["peak"] > LARGEST:
                        self.stop()
                    return ""
                with lock:
                    row.add(answer["number"], answer["fault"])

    def _death(self, code: int) -> str:
        printed = (self._folder / "noise").read_text("utf-8", "replace").strip().splitlines()
        why = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        return f"process ended by {why}: {printed[-1][:100] if printed else ''}"


def run_campaign(
    counts: dict[str, int],
    seed: int,
    jobs: int,
    report: Callable[[Sequence[Row]], Any] = lambda rows: None,
    *,
    module: str = READERS,
    wall: float = WALL,
) -> list[Row]:
    """Give a number of inputs to each reader of a module; `report` gets the rows after each order."""
    rows, lock = {name: Row(name) for name in counts}, threading.Lock()
    pieces = [
        Order(name, start, min(start + CHUNK, count), seed)
        for name, count in counts.items()
        for start in range(0, count, CHUNK)
    ]
    orders: queue.SimpleQueue[Order] = queue.SimpleQueue()
    failed = list[Exception]()
    for order in pieces:
        orders.put(order)

    def work(folder: Path) -> None:
        worker = Worker(folder, module, wall)
        try:
            while True:
                order = orders.get_nowait()
                worker.carry_out(order, rows[order.reader], lock)
                report(list(rows.values()))
        except queue.Empty:
            return
        except Exception as error:
            failed.append(error)
        finally:
            worker.stop()

    with tempfile.TemporaryDirectory() as place:
        folders = [Path(place) / str(k) for k in range(jobs)]
        for folder in folders:
            folder.mkdir()
        threads = [threading.Thread(target=work, args=(folder,), daemon=True) for folder in folders]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    if failed:
        raise failed[0]
    return list(rows.values())
