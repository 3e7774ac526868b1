"""Signs and zeros of recorded positions against the description: sentences on what gravity shows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from ...errors import shorten
from ...model import Model
from ...servos import Servo
from ..plant.course import bodies_of
from ..search.data import ServoData
from ..zeros import JointZero, find_zeros, turns

MOST_JOINTS = 7  # beyond them the search over signs and zeros is too long
CLEAR = 0.9  # probability from which a sign is identifiable


def joint_zeros(
    model: Model, data: ServoData, servos: Mapping[str, Servo], seed: int
) -> tuple[tuple[JointZero, ...], tuple[str, ...]]:
    """Sign and zero of each revolute joint with a drive, and notes; servos: drives that start a fit."""
    robot = bodies_of(model, data.joints)
    driven = {joint: servos[joint] for joint in data.driven if joint in servos}
    turning = [joint for j, joint in enumerate(data.joints) if joint in driven and turns(robot, j)]
    if len(turning) > MOST_JOINTS:
        note = f"signs and zeros of positions are not compared with gravity: {len(turning)} joints are too many"
        return (), (note,)
    zeros = find_zeros(robot, data.train, driven, seed)
    return zeros, tuple(_notes(zeros))


def zero_flags(zeros: Sequence[JointZero], columns: Mapping[str, str]) -> Iterator[str]:
    """A sentence on each joint whose sign or zero differs from the description; columns: of q, by joint."""
    for one in zeros:
        if not one.changed or one.zero is None or one.std is None:
            continue
        turned = one.sign < 0
        scale = "scale = -1, " if turned else ""
        entry = f'q_{one.joint} = {{ column = "{columns.get(one.joint, "...")}", {scale}offset = {one.zero:.4g} }}'
        what = "has the opposite sign, and its zero is" if turned else "has a zero that is"
        unsure = (
            ""
            if one.sign_probability >= CLEAR
            else f", whose sign is not sure (probability {one.sign_probability:.2f}),"
        )
        yield (
            f"{one.joint}: the recorded position{unsure} {what} {one.zero:.3g} ± {1.96 * one.std:.2g} rad off the "
            f"description, by the load of the joints (probability {_percent(one.probability)}); nothing was changed, "
            f"and the scale rests on this gravity: for positions in rad write {entry}, and q_des_{one.joint} alike, "
            f"into the column map (--columns), or pass the columns.toml that -o writes"
        )


def _percent(probability: float) -> str:
    return "> 99 %" if probability > 0.99 else f"{100 * probability:.0f} %"


def _notes(zeros: Sequence[JointZero]) -> Iterator[str]:
    """Joints whose zeros nothing shows, if that of another joint is off."""
    lost = [one.joint for one in zeros if not one.identifiable]
    if lost and any(one.changed for one in zeros):
        yield f"{shorten(lost)}: sign and zero of the position are not identifiable; gravity hardly depends on them"
