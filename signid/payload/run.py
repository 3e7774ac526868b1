"""Recordings without and with a load, or one in which it is picked up -> mass, centre and inertia of the load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..deadline import ends_in_time
from ..errors import OptionError, RecordingError, shorten
from ..faults import recording_flags
from ..model import Model, ModelSource, as_model, load_model
from ..recording import Recordings, as_recordings
from ..regression.session import Options, prepare
from ..typed import typed
from ..types import Input, Progress, Recording, Robot
from .pick_up import weigh_within
from .result import Payload
from .weigh import weigh

ROLES = ("recording, without the load", "recording, with the load")
WITHIN = "recording, in which the load is picked up"


@typed
@ends_in_time
def payload(
    robot: ModelSource,
    without: Recordings,
    carrying: Recordings | None = None,
    *,
    options: Options | None = None,
    progress: Progress | None = None,
) -> Payload:
    """Identify the load of the last link from recordings without it and with it, or from one that has both.

    Base parameters are estimated without and with the load. Parameters of the robot itself are equal in both and cancel
    in the difference; friction and offsets may have changed a little. The difference is projected onto the nearest
    physically possible body. Misfit beyond noise and such changes widens the intervals.

    A single recording is searched for the moments at which the load is picked up and put down (`moments` of the
    result). If there is none, the result has `found` False, a flag with the reason, and no numbers.

    Args:
        robot: as `load_robot` or `load_model` gives it; `model` of the result is it with the load.
        without: recordings of the robot alone, or the one in which it picks the load up.
        carrying: recordings of the robot with the load; None: the load is picked up in the other recording.
        options: effects, cut-off and the like.
        progress: called with the current step and the share that is done.

    Raises:
        RecordingError: a recording cannot be used, or lacks signs of torque.
        OptionError: one side has no recording, or one was given twice.

    Source: Khalil, Gautier, Lemoine, IEEE ICRA 2007; feasible bodies: Wensing, Kim, Slotine, IEEE RA-L 3(1), 2018.
    """
    model, options = as_model(robot, "payload"), options or Options()
    robot = model.robot
    without = as_recordings(without, robot, "payload")
    if carrying is None:
        if len(without) != 1:
            raise OptionError(
                f"a load that is picked up is sought in one recording, not in {len(without)}; give one of them, or "
                "recordings without and with the load"
            )
        _check_signs(without)
        session = prepare(robot, without, without, options)
        bare = _bare(model, session.robot)
        return replace(weigh_within(session, _inputs((without, WITHIN)), progress), bare=bare)
    carrying = as_recordings(carrying, robot, "payload")
    both = [*without, *carrying]
    _check(without, carrying)
    session = prepare(robot, both, both, options)
    sides = session.train[: len(without)], session.train[len(without) :]
    bare = _bare(model, session.robot)
    found = weigh(session, sides, _inputs((without, ROLES[0]), (carrying, ROLES[1])), progress)
    return replace(found, flags=(*_fault_flags(bare, found, without, carrying), *found.flags), bare=bare)


def _bare(model: Model, moving: Robot) -> Model:
    """The given model; of a description, with the joints held that the recordings do not move.

    Raises:
        OptionError: the model was identified, and the recordings do not move all of its joints.
    """
    if moving.joints == model.robot.joints:
        return model
    described = load_model(model.robot)
    if not (np.array_equal(model.inertials, described.inertials) and len(model.laws) == len(described.laws)):
        lacking = shorten([joint for joint in model.robot.joints if joint not in moving.joints])
        raise OptionError(
            f"the recordings have no position of {lacking}, and the model moves all of its joints; give the description"
        )
    return load_model(moving)


def _fault_flags(
    bare: Model, found: Payload, without: Sequence[Recording], carrying: Sequence[Recording]
) -> tuple[str, ...]:
    """Recording faults of either side: of the given robot alone, and with the load that was found."""
    sides = ((bare, without), (replace(bare, laws=(*bare.laws, found.law)), carrying))
    return tuple(dict.fromkeys(flag for model, side in sides for flag in recording_flags(model, side)))


def _inputs(*sides: tuple[Sequence[Recording], str]) -> tuple[Input, ...]:
    return tuple(Input(r.path, r.sha256, role) for side, role in sides for r in side)


def _check(without: Sequence[Recording], carrying: Sequence[Recording]) -> None:
    for name, side in (("without", without), ("with", carrying)):
        if not side:
            raise OptionError(f"no recording {name} the load was given; the load is the difference of the two")
    both = [*without, *carrying]
    if len({recording.sha256 for recording in both}) < len(both):
        raise OptionError("the same samples were given twice; give each recording once, without the load or with it")
    _check_signs(both)


def _check_signs(recordings: Sequence[Recording]) -> None:
    for recording in recordings:
        if not recording.signed.all():
            name = recording.path or "a recording"
            raise RecordingError(f"{name} lacks signs of torque; a load is found from torque that has its sign")
