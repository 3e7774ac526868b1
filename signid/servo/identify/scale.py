"""The common scale of gains and masses: connected sets of joints, and what it would be otherwise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...errors import shorten
from ...parameters import Array
from ...servos import Servo
from ...types import Robot
from .result import BY_GAIN, BY_INERTIALS, BY_NOTHING, ServoScale

NOTABLE = 1.1  # ratio of masses from which it is said
FEW_DEVIATIONS = 3.0


def connected_sets(robot: Robot, joints: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Joints that share moved bodies, as sets in the order of the joints: each has one common scale."""
    model, count = robot.model, len(joints)
    supports = np.zeros((model.njoints, model.nv))
    for k in range(1, model.njoints):
        supports[k] = supports[model.parents[k]]
        supports[k, model.idx_vs[k] : model.idx_vs[k] + model.nvs[k]] = 1.0
    columns = [robot.index(joint) for joint in joints]
    moves = (supports @ np.abs(robot.drive[:, columns])) > 0  # (bodies, joints)
    label = np.arange(count)
    for body in moves:
        members = np.flatnonzero(body)
        if len(members):
            label[np.isin(label, label[members])] = label[members].min()
    return tuple(tuple(joints[k] for k in np.flatnonzero(label == one)) for one in dict.fromkeys(label.tolist()))


def mass_ratio(kp: Array, std: Array, stated: Array) -> tuple[float, float]:
    """Ratio of true masses to those of the description if the gains are as stated, and its standard deviation.

    kp, std, stated: (k,) of the joints of one connected set [N.m/rad]; kp as identified with the described masses.
    """
    weight = (kp / np.maximum(std, 1e-9 * kp)) ** 2
    log = float(np.sum(weight * np.log(stated / kp)) / np.sum(weight))
    spread = float(1.0 / np.sqrt(np.sum(weight)))
    return float(np.exp(log)), float(np.exp(log)) * spread


def known_scale(known: str, stated: Mapping[str, float]) -> ServoScale:
    """What the scale rests on. known: "masses", "kp" or "nothing"; stated: gains by joint [N.m/rad]."""
    if known == "masses":
        return ServoScale(BY_INERTIALS, "the scale of gains and friction is that of the masses of the description")
    if known == "kp":
        joints = shorten(list(stated))
        return ServoScale(BY_GAIN, f"the scale of friction, armature and masses is that of the stated kp of {joints}")
    return ServoScale(
        BY_NOTHING,
        "kp and masses are identifiable only relative to each other; state one kp, or use the masses of the "
        "description, or repeat with a known payload",
    )


def alternatives(
    sets: Sequence[Sequence[str]],
    servos: Mapping[str, Servo],
    std: Mapping[str, float],
    stated: Mapping[str, float],
    sure: Mapping[str, bool],
) -> tuple[str, ...]:
    """One sentence for each connected set: the masses if the stated gains are true.

    servos: identified with the masses of the description; std: of their kp [N.m/rad]; stated: kp by joint [N.m/rad];
    sure: whether the scale of a joint is identifiable.
    """
    said = []
    for members in sets:
        used = [j for j in members if stated.get(j, 0) > 0 and sure.get(j, False) and std.get(j, 0) > 0]
        if not used:
            continue
        kp, spread, nominal = (np.array([of[j] for j in used]) for of in ({j: servos[j].kp for j in used}, std, stated))
        ratio, error = mass_ratio(kp, spread, nominal)
        if max(ratio, 1 / ratio) < NOTABLE or abs(np.log(ratio)) < FEW_DEVIATIONS * error / ratio:
            continue
        gain = ", ".join(dict.fromkeys(f"{x:.4g}" for x in nominal))
        which = f"the part that {shorten(list(members))} move{'s' if len(members) == 1 else ''}"
        said.append(
            f"if the firmware's kp is {gain} as stated, {which} is {ratio:.2f} +- {1.96 * error:.2f} times as heavy as "
            f"the description says"
        )
    return tuple(said)
