"""Diagnose a simulation of drives and robot with recordings of commands and positions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...deadline import ends_in_time
from ...effects import EFFECTS
from ...errors import OptionError, RecordingError
from ...faults.commands import audit_flags
from ...model import Model, ModelSource, as_model, with_servos
from ...recording import Recordings, as_recordings
from ...servos import ServoGrid
from ...typed import typed
from ...types import Array, Law, Mask, Progress
from ..fit.coordinates import BODY, Coordinates
from ..identify.fits import closed_loops
from ..plant import roll_out
from ..plant.course import bodies_of, groups
from ..search.data import ServoData, position_noise, servo_data
from ..validate import need_commands, prepared_model
from .closed_loop import ClosedLoop
from .conclude import ServoDiagnosis, ServoRepeats, conclude, fits, unproven
from .hypotheses import HYPOTHESES
from .search import GroupSearch, search

WINDOW = 0.8  # [s] of the closed loops; longer ones hardly add information, and the cost becomes rough
MOST_WINDOWS = 60  # windows that are searched, spread over the recordings
FLAGGED_RMS_GROWTH = 1.15  # [1] growth of the rms error over whole recordings that is flagged
DEAD = 0.05  # [1] of the stated gain, below which a drive counts as off
MIN_REPEAT_SECONDS = 1.0  # [s] shortest stretch of equal commands
COMMAND_TOLERANCE = 1e-3  # [1] of the range of a command, up to which two values are equal
MOVING = 0.05  # [1] of its range, by which a command changes within a window
HISTORY = 0.3  # [s] of equal commands before a comparison, unless both recordings begin: longest delay of a drive
BASE = 0.04  # [s] to both sides of a row, over which its speed is measured
LIKE = 4.0  # [1] times noise, within which positions are equal
FADE = 0.1  # [s] in which a difference of speeds fades: as a position, it is within LIKE, too
COMPARED = 0.5  # [s] shortest comparison
MAX_LATER_REPEATS = 8  # later repeats of one window that are compared with it


@typed
@ends_in_time
def diagnose_servos(
    model: ModelSource,
    recordings: Recordings,
    *,
    held_out: Recordings = (),
    skip: Sequence[str] = (),
    actuators: str | Path | None = None,
    window: float = WINDOW,
    seed: int = 0,
    progress: Progress | None = None,
) -> ServoDiagnosis:
    """Name what a simulation of position drives lacks; the mismatch is that of closed loops, in rad.

    Args:
        model: simulation with `servos`, or a robot whose actuators file states kp of its drives.
        recordings: with commanded positions q_des_J.
        held_out: held-out recordings; default: the last of several, or the last 30 % of a single one.
        skip: effects to exclude from the search.
        actuators: TOML that states firmware gains of recordings; None: that of the robot.
        window: length of the closed loops from measured states [s].
        seed: recorded in the result; nothing is random.
        progress: called with the current step and the share that is done.

    Raises:
        OptionError: the model has no drive of a commanded joint, or an effect does not exist.
        RecordingError: a recording cannot be used, or a drive does not follow its command at all.
    """
    given = as_model(model, "diagnose_servos")
    read, unseen = (as_recordings(each, given.robot, "diagnose_servos") for each in (recordings, held_out))
    if not read:
        raise OptionError("no recording was given; at least one is needed")
    known = [*dict.fromkeys(law.effect for law in HYPOTHESES), "payload"]
    if wrong := next((name for name in skip if name not in known and name not in EFFECTS.names), None):
        raise OptionError(f"{wrong!r} is no effect of position drives; skip one of {', '.join(known)}")
    need_commands((*read, *unseen), moving=True)
    driven, robot, flags, notes = prepared_model("the simulation", given, (*read, *unseen), actuators)
    data = servo_data(robot, read, unseen)
    found: list[tuple[tuple[int, ...], GroupSearch, ClosedLoop]] = []
    noise = position_noise(data.train)
    columns = [j for j, joint in enumerate(data.joints) if joint in driven.servos and joint in data.driven]
    if not columns:
        raise OptionError("the recordings command no joint whose drive the simulation has; state kp in actuators.toml")
    sets = groups(bodies_of(driven, data.joints), columns)
    for k, joints in enumerate(sets):
        _say(progress, "searching", 0.1 + 0.7 * k / len(sets))
        found.append((joints, *_searched(driven, data, joints, noise, skip, window)))
    extended = _extended(driven, data, found)
    _say(progress, "simulating held-out recordings", 0.85)
    before, given_traces = closed_loops(driven, driven.servos, data.held_out)
    after, traces = before, given_traces
    if extended.servos != driven.servos or extended.laws != driven.laws:
        after, traces = closed_loops(extended, extended.servos, data.held_out)
    worse = [
        f"{joint}: over whole held-out recordings, the rms error grows from {old:.3g} to {new:.3g} {unit} with what "
        f"was found; it explains short motions only"
        for joint, unit, old, new in zip(after.joints, after.units, before.whole_rms, after.whole_rms, strict=True)
        if new > FLAGGED_RMS_GROWTH * old
    ]
    grids = data.train if data.held_out is data.train else (*data.train, *data.held_out)
    findings, unexplained, verdict, more = conclude(data, found, noise)
    return ServoDiagnosis(
        robot=driven.robot,
        verdict=verdict,
        findings=findings,
        unexplained=unexplained,
        before=fits(driven, data, found, noise, last=False),
        after=fits(driven, data, found, noise, last=True),
        rollout_before=before,
        rollout_after=after,
        repeats=servo_repeats(grids, columns, noise, lambda grid: roll_out(extended, extended.servos, grid) - grid.q),
        traces=tuple(replace(x, nominal=own.simulated) for x, own in zip(traces, given_traces, strict=True)),
        model=extended,
        inputs=data.inputs,
        flags=tuple(dict.fromkeys((*audit_flags(given.robot, (*read, *unseen)), *flags, *more, *worse))),
        notes=tuple(dict.fromkeys(notes)),
        seed=seed,
    )


def _searched(
    model: Model, data: ServoData, joints: tuple[int, ...], noise: Array, skip: Sequence[str], window: float
) -> tuple[GroupSearch, ClosedLoop]:
    """Search of one group, and its windows on held-out recordings."""
    servos = tuple(model.servos[data.joints[j]] for j in joints)
    loop = ClosedLoop(model, data.train, joints, servos, window, MOST_WINDOWS)
    while True:
        found = search(loop, Coordinates(servos), noise[list(joints)], skip)
        unseen = ClosedLoop(model, data.held_out, joints, found.last.where.servos, window, MOST_WINDOWS)
        if not (worse := unproven(found, unseen)):
            break
        skip = (*skip, *worse)
    for step in found.steps:
        old, new = step.before.where.servos[step.joint].kp, found.last.where.servos[step.joint].kp
        if step.law.numbers == ("kp",) and new < DEAD * old:
            name = data.joints[joints[step.joint]]
            raise RecordingError(
                f"joint {name} does not follow its command: the best gain is {100 * (new / old - 1):.0f} % from the "
                f"stated one; its drive seems to be off: mark these rows with on_{name} = 0, or leave its command out"
            )
    return found, unseen


def _extended(model: Model, data: ServoData, found: Sequence[tuple[tuple[int, ...], GroupSearch, ClosedLoop]]) -> Model:
    """The simulation with the numbers that were found, and a body at a last link."""
    servos, laws = dict(model.servos), list(model.laws)
    for joints, one, _ in found:
        for j, servo in zip(joints, one.last.where.servos, strict=True):
            servos[data.joints[j]] = servo
        if one.last.where.body is not None:
            tip = model.robot.index(data.joints[joints[one.setting.loop.leaf]])
            laws.append(Law(EFFECTS["payload"], (tip,), dict(zip(BODY, one.last.where.body, strict=True))))
    return with_servos(replace(model, laws=tuple(laws)), servos, complete=True)


def _say(progress: Progress | None, step: str, share: float) -> None:
    if progress is not None:
        progress(step, share)


class Pair(NamedTuple):
    """Rows of two stretches whose commands are equal: of grids `a` and `b`, from rows `i` and `j`."""

    a: int
    i: int
    b: int
    j: int
    rows: int


def servo_repeats(
    grids: Sequence[ServoGrid], driven: Sequence[int], noise: Array, error: Callable[[ServoGrid], Array]
) -> ServoRepeats | None:
    """Differences of repeats beside the mismatch of a simulation on the same rows; None without repeats.

    driven: columns of the joints with drives; noise: (n,) [rad or m]; error: simulated minus measured positions (N, n)
    [rad or m] of a grid.
    """
    pairs = [like for pair in repeated(grids, driven) for like in _alike(grids, driven, noise, pair)]
    pairs = [pair for pair in pairs if _counts(grids, driven, pair)]
    if not pairs:
        return None
    errors = {g: error(grids[g]) for g in sorted({g for p in pairs for g in (p.a, p.b)})}
    differences = np.vstack([_rows(grids[p.a].q, p.i, p) - _rows(grids[p.b].q, p.j, p) for p in pairs])[:, driven]
    left = np.vstack([_rows(errors[g], k, p) for p in pairs for g, k in ((p.a, p.i), (p.b, p.j))])[:, driven]
    rms, mismatch = np.sqrt(np.mean(differences**2, axis=0) / 2), np.sqrt(np.mean(left**2, axis=0))
    share = np.minimum((rms / np.maximum(mismatch, 1e-12)) ** 2, 1.0)
    joints = tuple(grids[0].joints[j] for j in driven)
    return ServoRepeats(joints, len(pairs), sum(p.rows for p in pairs) * grids[0].step, rms, mismatch, share)


def repeated(grids: Sequence[ServoGrid], driven: Sequence[int]) -> list[Pair]:
    """Stretches of at least MIN_REPEAT_SECONDS whose commands are equal and change, each with its later repeats."""
    signals = [(grid.command, grid.on, grid.command_speed, grid.feed_forward) for grid in grids]
    inputs = [np.hstack([x[:, driven] for x in each if x is not None]) for each in signals]  # all that drives are given
    size = np.max([np.max(x, axis=0) for x in inputs], axis=0) - np.min([np.min(x, axis=0) for x in inputs], axis=0)
    tolerance = COMMAND_TOLERANCE * size + 1e-9
    length = round(MIN_REPEAT_SECONDS * grids[0].rate)
    found: list[Pair] = []
    for a, x in enumerate(inputs):
        for i in range(0, len(x) - length + 1, length):
            if not np.any(np.ptp(x[i : i + length, : len(driven)], axis=0) > MOVING * size[: len(driven)] + 1e-9):
                continue
            for k, (b, j) in enumerate(_places(inputs, grids, a, i, length, tolerance)):
                if k >= MAX_LATER_REPEATS:
                    break
                if not any(p.a == a and p.b == b and p.j - p.i == j - i and p.i <= i < p.i + p.rows for p in found):
                    found.append(_grown(inputs, Pair(a, i, b, j, length), tolerance))
    return found


def _places(
    inputs: Sequence[Array], grids: Sequence[ServoGrid], a: int, i: int, length: int, tolerance: Array
) -> Iterator[tuple[int, int]]:
    """Later rows (grid, row) at which the window from row i of grid a repeats."""
    window = inputs[a][i : i + length]
    marks = (0, length // 3, 2 * length // 3, length - 1)
    for b in range(a, len(inputs)):
        x, first = inputs[b], i + length if b == a else 0
        count = len(x) - length + 1 - first
        if count <= 0 or x.shape[1] != window.shape[1] or not np.array_equal(grids[a].gain, grids[b].gain):
            continue
        same = np.ones(count, bool)
        for mark in marks:
            rows = np.flatnonzero(same)
            same[rows] = _equal(x[first + rows + mark], window[mark], tolerance)
        for j in (first + np.flatnonzero(same)).tolist():
            if np.all(_equal(x[j : j + length], window, tolerance)):
                yield b, j


def _equal(x: Array, y: Array, tolerance: Array) -> Mask:
    return np.asarray(np.all(np.abs(x - y) <= tolerance, axis=-1))


def _grown(inputs: Sequence[Array], pair: Pair, tolerance: Array) -> Pair:
    """The pair with all rows before and after it that are equal, too."""
    a, i, b, j, rows = pair
    before = min(i, j)
    same = _equal(inputs[a][i - before : i], inputs[b][j - before : j], tolerance)[::-1]
    earlier = before if same.all() else int(np.argmin(same))
    after = min(len(inputs[a]) - i, len(inputs[b]) - j)
    same = _equal(inputs[a][i : i + after], inputs[b][j : j + after], tolerance)
    later = after if same.all() else int(np.argmin(same))
    return Pair(a, i - earlier, b, j - earlier, earlier + later)


def _alike(grids: Sequence[ServoGrid], driven: Sequence[int], noise: Array, pair: Pair) -> Iterator[Pair]:
    """Rows of a pair from the first at which all positions and speeds are equal within noise; none if there is none."""
    one, other = (_rows(grids[g].q, k, pair)[:, driven] for g, k in ((pair.a, pair.i), (pair.b, pair.j)))
    limit, rate = LIKE * np.sqrt(2) * noise[list(driven)], grids[0].rate
    gap = one - other
    if pair.i == 0 and pair.j == 0 and np.all(np.abs(gap[:2]) <= limit):
        start = 0
    else:
        reach = max(round(BASE * rate), 1)
        speed = np.full_like(gap, np.inf)
        speed[reach:-reach] = (gap[2 * reach :] - gap[: -2 * reach]) * rate / (2 * reach)
        like = np.all((np.abs(gap) <= limit) & (np.abs(speed) * FADE <= limit), axis=1)
        like[: round(HISTORY * rate)] = False
        start = int(np.argmax(like)) if like.any() else pair.rows
    if pair.rows - start >= COMPARED * rate:
        yield Pair(pair.a, pair.i + start, pair.b, pair.j + start, pair.rows - start)


def _counts(grids: Sequence[ServoGrid], driven: Sequence[int], pair: Pair) -> bool:
    """Whether a command changes in the rows that are compared, and they are no copies of one recording."""
    if np.array_equal(_rows(grids[pair.a].q, pair.i, pair), _rows(grids[pair.b].q, pair.j, pair)):
        return False
    every = np.vstack([grid.command[:, driven] for grid in grids])
    rows = _rows(grids[pair.a].command, pair.i, pair)[:, driven]
    return bool(np.any(np.ptp(rows, axis=0) > MOVING * np.ptp(every, axis=0) + 1e-9))


def _rows(x: Array, first: int, pair: Pair) -> Array:
    return x[first : first + pair.rows]
