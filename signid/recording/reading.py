"""The reading of a log, which turns it into rows: found beside it, or drafted from names and numbers of its columns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ..errors import RecordingError, UndecidedReading, readable, shorten
from ..types import Reading, Recording, Robot
from .columns import TORQUES
from .draft import DraftedMap, draft_map
from .names.mapping import DRIVE
from .names.vocabulary import Change

SUFFIX = ".reading.toml"  # of the name of the log
CHECK = "CHECK"  # in the reason of a unit that the user is to check
COMMAND = 0.999  # correlation of a torque with kp (q_des - q) - kd dq above which it is a command
EXAMINED, FEWEST = 20_000, 100  # [rows] that decide it, at most and at least
SHOWN = ("t", "q", "q_des", "dq", *TORQUES)  # kinds of columns that a reading lists


def reading_beside(source: object, folder: str | Path | None = None) -> Path | None:
    """The reading of a log that lies beside it, or in a folder; None without one."""
    if not isinstance(source, str | Path):
        return None
    path = reading_path(source, folder)
    return path if path.is_file() else None


def found_reading(file: object) -> Reading | None:
    """The reading in a file with a column map; None for another map."""
    if not isinstance(file, str | Path) or not str(file).endswith(SUFFIX):
        return None
    return Reading(Path(file).read_text(encoding="utf-8"), (), readable(str(file)))


def reading_path(source: str | Path, folder: str | Path | None = None) -> Path:
    """Path of the reading of a log, beside it or in a folder."""
    path = Path(source)
    return (path.parent if folder is None else Path(folder)) / f"{path.name}{SUFFIX}"


def draft_reading(source: str | Path, robot: Robot, topics: Sequence[str], error: RecordingError) -> Reading:
    """Draft the reading of a log whose columns are none of a recording.

    Raises:
        RecordingError: `error`, which its own names led to, if others mean no positions and torques, or are its own.
        UndecidedReading: lines are to be chosen.
    """
    try:
        drafted = draft_map(source, robot, topics)
    except RecordingError:
        raise error from None
    kinds = {line.kind for line in drafted.lines} | {key.partition("_")[0] for key, _ in drafted.offered}
    driven = kinds & {*TORQUES, "q_des"}
    if "q" not in kinds or not driven or all(line.guess.plain for line in drafted.lines):
        raise error
    if choices := [*_choices(drafted, bool(driven & {*TORQUES}))]:
        name = readable(str(source))
        raise UndecidedReading(f"{name}: lines of its reading are to be chosen: {', '.join(choices)}", drafted.text)
    return Reading(drafted.text, tuple(_rows(drafted, robot)))


def _choices(drafted: DraftedMap, torque: bool) -> Iterator[str]:
    """Clauses on what is to be chosen."""
    if drafted.offered:
        pairs = [f"{column} for {signal}" for signal, column in drafted.offered]
        yield f"choose the joints of columns (which?: {shorten(pairs, 3)})"
    guessed = {line.kind: line for line in drafted.lines if CHECK in line.noticed.why}
    for kind, line in guessed.items():
        if not (torque and kind in DRIVE):
            yield f"check the unit of {kind} ({line.noticed.why.removesuffix(f': {CHECK}').removesuffix(f', {CHECK}')})"
    yield from ((sentence.partition(": ")[2] or sentence).partition("; ")[0] for sentence in drafted.lacking)


def _rows(drafted: DraftedMap, robot: Robot) -> Iterator[tuple[str, str, str, str]]:
    """Columns that are read, with units and reasons: of time, then of each joint."""
    for joint, name in enumerate(("time", *robot.joints), -1):
        own = [line for line in drafted.lines if line.joint == joint and line.kind in SHOWN]
        units, reasons = [_unit(line.noticed.unit) for line in own], dict.fromkeys(line.noticed.why for line in own)
        if any(line.kind.endswith("current") for line in own):
            known = float(robot.actuators.torque_constant[joint])
            reasons[f"torque constant {f'{known:.4g}, stated' if known == known else 'to be estimated'}"] = None
        if own:
            yield name, ", ".join(line.guess.column for line in own), ", ".join(units), "; ".join(reasons)


def _unit(unit: str | Change) -> str:
    return unit if isinstance(unit, str) else f"value * {unit.scale / unit.over:.6g} + {unit.offset:.6g}"


def commanded_torques(recording: Recording) -> Iterator[str]:
    """A note on each torque that is no measurement: kp (q_des - q) - kd dq of the same rows explains it."""
    if not any(recording.columns["q_des"]) or not any(recording.columns["tau"]):
        return
    rows = recording.read(0, EXAMINED, servo=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        v = np.gradient(rows.q, rows.t, axis=0) if rows.dq is None and len(rows.t) > 1 else rows.dq
    if v is None or rows.q_des is None:
        return
    for j, name in enumerate(recording.joints):
        columns = np.column_stack([rows.q_des[:, j] - rows.q[:, j], -v[:, j], rows.tau[:, j]])
        columns = columns[np.isfinite(columns).all(axis=1)]
        errors, tau = columns[:, :2], columns[:, 2]
        if len(tau) < FEWEST or not recording.signed[j] or not tau.std():
            continue
        kp, kd = np.linalg.lstsq(errors, tau, rcond=None)[0].tolist()
        alike = float(np.corrcoef(errors @ [kp, kd], tau)[0, 1]) if (errors @ [kp, kd]).std() else 0.0
        if alike > COMMAND and kp > 0:
            fact = f"the torque of {name} is a command, not a measurement: {kp:.4g} (q_des - q) - {kd:.4g} dq"
            yield f"{fact} explains it (correlation {alike:.5f})"
