"""Diagnose a simulation of drives and robot with recordings of commands and positions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from ...deadline import ends_in_time
from ...effects import EFFECTS
from ...errors import OptionError, RecordingError
from ...faults.commands import audit_flags
from ...model import Model, ModelSource, as_model, with_servos
from ...recording import Recordings, as_recordings
from ...typed import typed
from ...types import Array, Law, Progress
from ..fit.coordinates import BODY, Coordinates
from ..identify.assess import closed_loops
from ..identify.result import ServoRollOut, ServoTrace
from ..plant import roll_out
from ..plant.course import bodies_of, groups
from ..search.data import ServoData, position_noise, servo_data
from ..validate import need_commands, prepared_model
from .closed_loop import ClosedLoop
from .conclude import conclude, fits, unproven
from .hypotheses import HYPOTHESES
from .repeats import servo_repeats
from .result import ServoDiagnosis, ServoRepeats
from .search import GroupSearch, search

WINDOW = 0.8  # [s] of the closed loops; longer ones hardly add information, and the cost becomes rough
MOST_WINDOWS = 60  # windows that are searched, spread over the recordings
WORSE = 1.15  # [1] growth of the rms error over whole recordings that is flagged
DEAD = 0.05  # [1] of the stated gain, below which a drive counts as off


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
    _check_skipped(skip)
    need_commands((*read, *unseen), moving=True)
    driven, robot, flags, notes = prepared_model("the simulation", given, (*read, *unseen), actuators)
    data = servo_data(robot, read, unseen)
    found: list[tuple[tuple[int, ...], GroupSearch, ClosedLoop]] = []
    noise = position_noise(data.train)
    sets = _sets(driven, data)
    for k, joints in enumerate(sets):
        _say(progress, "searching", 0.1 + 0.7 * k / len(sets))
        found.append((joints, *_searched(driven, data, joints, noise, skip, window)))
    extended = _extended(driven, data, found)
    _say(progress, "simulating held-out recordings", 0.85)
    before, after, traces = _rolled(driven, extended, data)
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
        repeats=_repeats(extended, data, noise),
        traces=traces,
        model=extended,
        inputs=data.inputs,
        flags=tuple(
            dict.fromkeys((*audit_flags(given.robot, (*read, *unseen)), *flags, *more, *_worse(before, after)))
        ),
        notes=tuple(dict.fromkeys(notes)),
        seed=seed,
    )


def _check_skipped(skip: Sequence[str]) -> None:
    known = [*dict.fromkeys(law.effect for law in HYPOTHESES), "payload"]
    if wrong := next((name for name in skip if name not in known and name not in EFFECTS.names), None):
        raise OptionError(f"{wrong!r} is no effect of position drives; skip one of {', '.join(known)}")


def _sets(model: Model, data: ServoData) -> list[tuple[int, ...]]:
    """Joints with a drive, in groups that share a moved body."""
    driven = [j for j, joint in enumerate(data.joints) if joint in model.servos and joint in data.driven]
    if not driven:
        raise OptionError("the recordings command no joint whose drive the simulation has; state kp in actuators.toml")
    return list(groups(bodies_of(model, data.joints), driven))


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


def _rolled(
    given: Model, extended: Model, data: ServoData
) -> tuple[ServoRollOut, ServoRollOut, tuple[ServoTrace, ...]]:
    """Closed loops of held-out recordings before and after; `nominal` of the traces is the given simulation."""
    before, first = closed_loops(given, given.servos, data.held_out)
    after, traces = before, first
    if extended.servos != given.servos or extended.laws != given.laws:
        after, traces = closed_loops(extended, extended.servos, data.held_out)
    return before, after, tuple(replace(x, nominal=own.simulated) for x, own in zip(traces, first, strict=True))


def _repeats(model: Model, data: ServoData, noise: Array) -> ServoRepeats | None:
    """Repeats of one command among all recordings; `model` is the extended simulation. noise: (n,) [rad or m]."""
    grids = data.train if data.held_out is data.train else (*data.train, *data.held_out)
    driven = [j for j, joint in enumerate(data.joints) if joint in model.servos and joint in data.driven]
    return servo_repeats(grids, driven, noise, lambda grid: roll_out(model, model.servos, grid) - grid.q)


def _worse(before: ServoRollOut, after: ServoRollOut) -> Iterator[str]:
    """Sentences on joints whose whole held-out recordings the extended simulation predicts worse."""
    for joint, unit, old, new in zip(after.joints, after.units, before.whole_rms, after.whole_rms, strict=True):
        if new > WORSE * old:
            yield (
                f"{joint}: over whole held-out recordings, the rms error grows from {old:.3g} to {new:.3g} {unit} with "
                f"what was found; it explains short motions only"
            )


def _say(progress: Progress | None, step: str, share: float) -> None:
    if progress is not None:
        progress(step, share)
