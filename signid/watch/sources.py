"""Streams: a recording that is played back, lines of a file that grows or of standard input, a topic of ROS 2."""

from __future__ import annotations

import os
import sys
import time
from codecs import BOM_UTF16_BE, BOM_UTF16_LE, IncrementalDecoder, getincrementaldecoder
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from pathlib import Path
from queue import Empty, Queue
from threading import Thread
from typing import Any, NamedTuple

import numpy as np

from ..errors import OptionError, RecordingError, readable
from ..recording import as_recording, read_recording
from ..recording.formats.json_ import parse_row
from ..recording.mapping import ColumnMap
from ..types import Array, Recording, Robot
from .intake import StreamRows

MAX_CHARACTERS, MAX_STREAM_COLUMNS = 1_000_000, 2_000  # characters of a line, columns of a stream
PROBES = 64  # rows of zeros and ones that show the conversion of each column
READ_INTERVAL = 0.025  # [s] rows that arrive within this time are processed together
MAX_READ_BYTES = 1 << 18  # [bytes] of a read
MAX_READS = 16  # reads of standard input that wait
PLAYED_ROWS = 100  # rows of a recording
TOPIC_PREFIX = "ros:"  # beginning of the name of a topic


class Parser:
    """Rows from text that arrives in pieces; lines that are no rows become rows of NaN."""

    def __init__(self, robot: Robot, columns: ColumnMap | None, name: str, rate: float | None = None) -> None:
        self.robot, self.columns, self.name, self.rate = robot, columns, name, rate
        self.rest: list[str] = []  # pieces of the line that is not complete
        self.header: list[str] | None = None
        self.convert: Callable[[Array], StreamRows] | None = None
        self.joints: tuple[str, ...] = ()
        self.json = False

    def rows(self, text: str) -> StreamRows | None:
        """Rows of the complete lines; None without one.

        Raises:
            RecordingError: a line is too long, or the first one is no header.
        """
        *lines, rest = text.split("\n")
        if lines:
            lines[0] = "".join((*self.rest, lines[0]))
            self.rest = []
        self.rest.append(rest)
        if sum(map(len, self.rest)) > MAX_CHARACTERS or any(len(line) > MAX_CHARACTERS for line in lines):
            raise RecordingError(
                f"{self.name} has a line of more than {MAX_CHARACTERS} characters; give one row of CSV or JSON per line"
            )
        found = [values for line in lines if (values := self._values(line.strip().removeprefix("\ufeff"))) is not None]
        if not found:
            return None
        assert self.convert is not None, "the first row sets it"
        return self.convert(np.array(found))

    def _values(self, line: str) -> list[float] | None:
        """Numbers of a line in the order of the header; None for the header and empty lines."""
        if not line:
            return None
        if self.header is None:
            self.json = line.startswith("{")
            names = list(_numbers(line) or ()) if self.json else [part.strip().strip('"') for part in line.split(",")]
            self._begin(names, line)
            if not self.json:
                return None
        assert self.header is not None, "the first line sets it"
        lost = [float("nan")] * len(self.header)
        if self.json:
            values = _numbers(line)
            return lost if values is None else [values.get(name, float("nan")) for name in self.header]
        parts = line.split(",")
        if len(parts) != len(self.header):
            return lost
        return None if [part.strip().strip('"') for part in parts] == self.header else list(map(_number, parts))

    def _begin(self, names: Sequence[str], line: str) -> None:
        """Assign the columns.

        Raises:
            RecordingError: the header, or the first object, has no such columns.
        """
        if len(set(names)) < 2:
            raise RecordingError(
                f"{self.name} begins with {line[:60]!r}; give a header of CSV such as t,q_1,tau_1 or JSON objects"
            )
        if len(names) > MAX_STREAM_COLUMNS:
            raise RecordingError(
                f"{self.name} has {len(names)} columns, more than {MAX_STREAM_COLUMNS}; give those of the robot"
            )
        if repeated := [name for name, count in Counter(names).items() if name and count > 1]:
            raise RecordingError(
                f"{self.name} names column {repeated[0]!r} twice in its header; give each its own name"
            )
        self.header = list(names)
        self.joints, self.convert = assign(self.header, self.robot, self.columns, self.name, self.rate)


def assign(
    names: Sequence[str], robot: Robot, columns: ColumnMap | None, name: str, rate: float | None = None
) -> tuple[tuple[str, ...], Callable[[Array], StreamRows]]:
    """Joints of columns, and the conversion of their values (N, columns) to rows.

    Raises:
        RecordingError: the columns are none of a recording with signed torque.
    """
    probe = np.tile(np.arange(PROBES, dtype=float)[:, None] / PROBES, (1, len(names)))
    try:
        found = read_recording(dict(zip(names, probe.T, strict=True)), robot, columns=columns, rate=rate)
    except RecordingError as error:
        raise RecordingError(str(error).replace("the recording", name)) from None
    check(found, name)
    samples, place = found.read(), {column: k for k, column in enumerate(names)}
    if bare := [j for j, q in zip(found.joints, found.columns["q"], strict=True) if q not in place]:
        raise RecordingError(f"{name} has velocities but no position of {', '.join(bare)}; give q_J of every joint")
    parts: list[tuple[list[int], Array, Array]] = []
    for key, values in (("t", samples.t[:, None]), ("q", samples.q), ("tau", samples.tau), ("dq", samples.dq)):
        if values is None or not all(found.columns[key]) or (key == "t" and rate):
            continue
        offset = values[0]
        parts.append(([place[c] for c in found.columns[key]], (values[-1] - offset) * PROBES / (PROBES - 1), offset))

    before = count(0)

    def convert(table: Array) -> StreamRows:
        others = [table[:, columns] * factor + offset for columns, factor, offset in parts]
        t = np.array([next(before) / rate for _ in table]) if rate else others.pop(0)[:, 0]
        return StreamRows(t, *others)

    return found.joints, convert


def check(recording: Recording, name: str) -> None:
    """Check that the torque of every joint is recorded, with its sign and in N.m.

    Raises:
        RecordingError: it is not.
    """
    if lacking := [j for j, column in zip(recording.joints, recording.columns["tau"], strict=True) if not column]:
        raise RecordingError(f"{name} has no torque of {', '.join(lacking)}; give tau_J or current_J of every joint")
    if not recording.signed.all():
        raise RecordingError(f"{name} has torque without its sign, which a watch cannot use; give tau_J or current_J")
    if recording.scaled is not None:
        raise RecordingError(f"{name} has currents of unknown torque constants; state them in the actuators file")


def played(recording: Recording) -> Iterator[StreamRows]:
    """Rows of a recording in chunks."""
    for start in range(0, len(recording), PLAYED_ROWS):
        samples = recording.read(start, start + PLAYED_ROWS)
        yield StreamRows(samples.t, samples.q, samples.tau, samples.dq)


def _numbers(line: str) -> dict[str, float] | None:
    """Numbers of a JSON object by column; None if it is none."""
    try:
        return {name: value for name, value in parse_row(line).items() if not isinstance(value, str)}
    except ValueError:
        return None


def _number(part: str) -> float:
    try:
        return float(part)
    except ValueError:
        return float("nan")


class Stream(NamedTuple):
    """Joints of a stream and its chunks of rows; None while no row arrives."""

    joints: tuple[str, ...]
    chunks: Iterator[StreamRows | None]
    recording: Recording | None = None  # that is played back


def open_stream(
    stream: object,
    robot: Robot,
    columns: ColumnMap | None = None,
    follow: bool = False,
    idle: float = np.inf,
    rate: float | None = None,
) -> Stream:
    """Open a stream; it waits for the first rows of a live one, whose columns name the joints.

    Args:
        stream: "-", "ros:TOPIC", a path, a Recording, arrays by column name, or an iterable of texts with lines.
        robot: the robot whose joints the columns name.
        columns: column map, as of a recording.
        follow: whether a file is read on as it grows.
        idle: [s] without rows after which a live stream ends.
        rate: [Hz] of the rows of a recording without times.

    Raises:
        RecordingError: the stream cannot be used.
        OptionError: rclpy is missing.
    """
    if isinstance(stream, str) and stream.startswith(TOPIC_PREFIX):
        return _topic(stream.removeprefix(TOPIC_PREFIX), robot, idle)
    if isinstance(stream, str) and stream == "-":
        return _parsed(_standard_input(idle), Parser(robot, columns, "standard input", rate))
    if isinstance(stream, str | Path) and follow:
        return _parsed(_growing(Path(stream), idle), Parser(robot, columns, readable(str(stream)), rate))
    if isinstance(stream, Iterator) or (
        isinstance(stream, Sequence) and not isinstance(stream, str) and all(isinstance(x, str) for x in stream)
    ):
        return _parsed(iter(stream), Parser(robot, columns, "the stream", rate))
    source: Any = stream
    recording = (
        read_recording(source, robot, columns=columns, rate=rate)
        if isinstance(source, str | Path)
        else as_recording(source, robot, "watch")
    )
    check(recording, recording.path or "the recording")
    return Stream(recording.joints, played(recording), recording)


def _parsed(texts: Iterator[str], parser: Parser) -> Stream:
    name, first = parser.name, None
    for text in texts:
        if (first := parser.rows(text)) is not None or parser.header is not None:
            break
    if parser.header is None:
        raise RecordingError(f"{name} has no rows; give a header of CSV such as t,q_1,tau_1 and rows, or JSON objects")

    def chunks() -> Iterator[StreamRows | None]:
        yield first
        for text in texts:
            yield parser.rows(text) if text else None
        yield parser.rows("\n")

    return Stream(parser.joints, chunks())


def _standard_input(idle: float) -> Iterator[str]:
    """Text of standard input as it arrives; "" after each tick without any."""
    source, arrived, last, decode = sys.stdin.fileno(), Queue[bytes](maxsize=MAX_READS), time.monotonic(), _Decoder()

    def read() -> None:
        while True:
            got = os.read(source, MAX_READ_BYTES)
            arrived.put(got)
            if not got:
                return
            if len(got) < MAX_READ_BYTES // 4:
                time.sleep(READ_INTERVAL)  # the pipe collects rows meanwhile

    Thread(target=read, daemon=True).start()  # not select: it reads no pipes on Windows
    while True:
        try:
            parts = [arrived.get(timeout=2 * READ_INTERVAL)]
        except Empty:
            if time.monotonic() - last > idle:
                return
            yield ""
            continue
        while parts[-1] and not arrived.empty():
            parts.append(arrived.get())
        yield decode(b"".join(parts))
        last = time.monotonic()  # the work on these rows is no time without any
        if not parts[-1]:
            return


class _Decoder:
    """Text of bytes that arrive in pieces: UTF-16 if they begin like its mark, which UTF-8 never does, else UTF-8."""

    def __init__(self) -> None:
        self.decoder: IncrementalDecoder | None = None

    def __call__(self, content: bytes) -> str:
        if self.decoder is None and content:
            kind = "utf-16" if content[:1] in (BOM_UTF16_LE[:1], BOM_UTF16_BE[:1]) else "utf-8"
            self.decoder = getincrementaldecoder(kind)("replace")
        return "" if self.decoder is None else self.decoder.decode(content)


def _growing(path: Path, idle: float) -> Iterator[str]:
    """Text of a file as it grows; from its beginning again if it is shortened or replaced."""
    last, place, source, decode = time.monotonic(), 0, _open_file(path), _Decoder()
    try:
        while True:
            got = source.read(MAX_READ_BYTES)
            if got:
                place += len(got)
                yield decode(got)
                last = time.monotonic()
                if len(got) == MAX_READ_BYTES:
                    continue
            elif time.monotonic() - last > idle:
                return
            elif _replaced(path, source, place):
                source.close()
                place, source, decode = 0, _open_file(path), _Decoder()
            else:
                yield ""
            time.sleep(READ_INTERVAL)
    finally:
        source.close()


def _open_file(path: Path) -> Any:
    """Open a regular file; a pipe in its place would wait for a writer."""
    if not path.is_file():
        fault = "is not a file" if path.exists() else "does not exist"
        raise RecordingError(f"{readable(str(path))} {fault}; give a file that grows, or - for standard input")
    return open(path, "rb", opener=lambda name, flags: os.open(name, flags | getattr(os, "O_NONBLOCK", 0)))


def _replaced(path: Path, source: Any, place: int) -> bool:
    try:
        now = path.stat()
    except OSError:
        return False
    return now.st_size < place or now.st_ino != os.fstat(source.fileno()).st_ino


def _topic(name: str, robot: Robot, idle: float) -> Stream:
    """Rows of sensor_msgs/JointState messages of a topic of ROS 2."""
    try:
        import rclpy  # type: ignore[import-not-found,unused-ignore]
        from sensor_msgs.msg import JointState  # type: ignore[import-not-found,unused-ignore]
    except ImportError:
        raise OptionError(
            f"the topic {name} needs rclpy, which is not installed here; source the setup file of ROS 2, or give a "
            f"recording, a file with --follow, or - for standard input"
        ) from None
    return Stream(robot.joints, _messages(rclpy, JointState, name, robot, idle))


def _messages(rclpy: Any, kind: Any, name: str, robot: Robot, idle: float) -> Iterator[StreamRows | None]:
    waiting: list[Any] = []
    rclpy.init()
    node = rclpy.create_node("signid_watch")
    node.create_subscription(kind, name, waiting.append, 1000)
    last = time.monotonic()
    try:
        while time.monotonic() - last <= idle:
            end = time.monotonic() + READ_INTERVAL
            while (left := end - time.monotonic()) > 0:
                rclpy.spin_once(node, timeout_sec=left)
            rows = [row for message in waiting if (row := _row(message, robot)) is not None]
            waiting.clear()
            if rows:
                table = np.array(rows)
                t, q, tau, dq = np.split(table, np.cumsum([1, len(robot.joints), len(robot.joints)]), axis=1)
                yield StreamRows(t[:, 0], q, tau, dq if np.isfinite(dq).all() else None)
                last = time.monotonic()
            else:
                yield None
    finally:
        node.destroy_node()
        if rclpy.ok():  # after Ctrl-C it is shut down
            rclpy.shutdown()


def _row(message: Any, robot: Robot) -> list[float] | None:
    """Stamp, positions, efforts and velocities of a message; None if it is of other joints."""
    place = {name: k for k, name in enumerate(message.name)}
    if not all(joint in place for joint in robot.joints):
        return None
    at = [place[joint] for joint in robot.joints]
    stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
    signals = (message.position, message.effort, message.velocity)
    return [stamp, *(float(x[k]) if k < len(x) else float("nan") for x in signals for k in at)]
