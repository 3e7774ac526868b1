"""The common scale of gains and masses: connected sets of joints, and what it would be otherwise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from ...errors import shorten
from ...model import Model
from ...parameters import Array
from ...robot.dynamics import moved_bodies
from ...servos import Servo
from ..plant.course import bodies_of, groups
from .identifiable import VAGUE
from .result import BY_GAIN, BY_INERTIALS, BY_NOTHING, ServoScale

NOTABLE = 1.1  # ratio of masses from which it is said
FEW_DEVIATIONS = 3.0
COMMON = 0.05  # probability of such different ratios, from which they count as one


def connected_sets(model: Model, joints: Sequence[str], driven: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Driven joints that share moved bodies: each set has one common scale. joints: those of the recordings."""
    numbers = [joints.index(joint) for joint in driven]
    return tuple(tuple(joints[k] for k in members) for members in groups(bodies_of(model, joints), numbers))


def scaled_masses(model: Model, joints: Sequence[str], ratio: float) -> Model:
    """Model whose bodies that some joints move are `ratio` times as heavy."""
    columns = [model.robot.index(joint) for joint in joints]
    moved = moved_bodies(model.robot)[columns].any(axis=0)
    factor = np.where(moved, ratio, 1.0)
    return replace(model, inertials=model.inertials * factor[:, None])


def mass_ratio(kp: Array, std: Array, stated: Array) -> tuple[float, float]:
    """Ratio of true masses to those of the description if the gains are as stated, and its standard deviation.

    kp, std, stated: (k,) of the joints of one connected set [N.m/rad]; kp as identified with the described masses.
    """
    weight = (kp / np.maximum(std, 1e-9 * kp)) ** 2
    log = float(np.sum(weight * np.log(stated / kp)) / np.sum(weight))
    spread = float(1.0 / np.sqrt(np.sum(weight)))
    return float(np.exp(log)), float(np.exp(log)) * spread


def known_scale(known: str, stated: Mapping[str, float], other: Sequence[str]) -> ServoScale:
    """Basis of the scale. known: "masses", "kp" or "nothing"; stated: gains by joint; other: alternatives."""
    if known == "masses":
        said = "the scale of gains and friction is that of the masses of the description"
        return ServoScale(BY_INERTIALS, said, tuple(other))
    if known == "kp":
        said = f"the scale of friction, armature and masses is that of the stated kp of {shorten(list(stated))}"
        return ServoScale(BY_GAIN, said)
    return ServoScale(
        BY_NOTHING,
        "kp and masses are identifiable only relative to each other; state one kp, or use the masses of the "
        "description, or repeat with a known payload",
    )


def implied_ratios(
    sets: Sequence[Sequence[str]],
    servos: Mapping[str, Servo],
    std: Mapping[str, float],
    stated: Mapping[str, float],
) -> list[tuple[Sequence[str], float, float]]:
    """Connected sets whose masses differ notably from the description if stated gains are true: ratio and its std.

    servos: identified with the masses of the description; std: of their kp where it is identifiable [N.m/rad];
    stated: kp by joint [N.m/rad].
    """
    found = []
    for members in sets:
        used = [j for j in members if stated.get(j, 0) > 0 and 0 < std.get(j, 0) < VAGUE * servos[j].kp]
        if not used:
            continue
        kp, spread, nominal = (np.array([of[j] for j in used]) for of in ({j: servos[j].kp for j in used}, std, stated))
        ratio, error = mass_ratio(kp, spread, nominal)
        if max(ratio, 1 / ratio) > NOTABLE and abs(np.log(ratio)) > FEW_DEVIATIONS * error / ratio:
            found.append((members, ratio, error))
    return found


def alternatives(
    sets: Sequence[Sequence[str]],
    servos: Mapping[str, Servo],
    std: Mapping[str, float],
    stated: Mapping[str, float],
) -> tuple[str, ...]:
    """One sentence for each connected set: the masses if the stated gains are true. Arguments as `implied_ratios`.

    Sets whose masses would change by the same factor, within its uncertainty, share a sentence.
    """
    found, said = implied_ratios(sets, servos, std, stated), []
    if len(found) == len(sets) > 1:
        logs = np.log([ratio for _, ratio, _ in found])
        weight = np.array([(ratio / error) ** 2 for _, ratio, error in found])
        mean = float(np.average(logs, weights=weight))
        if chi2.sf(np.sum(weight * (logs - mean) ** 2), len(found) - 1) > COMMON:
            every = [joint for members, _, _ in found for joint in members]
            found = [(every, float(np.exp(mean)), float(np.exp(mean) / np.sqrt(weight.sum())))]
    for members, ratio, error in found:
        gains = list(dict.fromkeys(f"{stated[j]:.4g}" for j in members if j in stated))
        option = f"kp={gains[0]}" if len(gains) == 1 else "kp"
        which = f"the part that {shorten(list(members))} move{'s' if len(members) == 1 else ''}"
        said.append(
            f"if the firmware's kp is {', '.join(gains)} as stated, {which} is {ratio:.2f} +- {1.96 * error:.2f} times "
            f"as heavy as the description says; --known {option} assumes that gain"
        )
    return tuple(said)
