"""Two laws -> the motion that would tell them apart, in a sentence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import maximum_filter1d

from ...deadline import time_is_up
from ...effects import EFFECTS
from ...effects.base import TorqueLaw
from ...effects.law import coefficient_count, law_columns
from ...effects.naming import law_place
from ...model import Model
from ...regression.motion import Motion
from ...regression.projection import leave
from ...simulation.excite.limits import build_limits
from ...simulation.excite.motions.fourier import Fourier
from ...simulation.excite.motions.random_motion import random_parameters, sample
from ...types import Array, Law
from ..data.motions import torque_of

SEARCH, UNSOUGHT = "the search for motions that separate alternatives", "not searched for: time was up"
MOTIONS, DURATION, RATE = 6, 8.0, 50.0  # random ones, [s], [Hz]
INDEPENDENT = 20.0  # [Hz] samples of torque with independent errors
HARMONICS, AMPLITUDE = 5, (0.3, 0.9)  # least and most share of the limits
STRUCTURAL = 1e-6  # of a law's sum of squares: less is the same law
REVERSAL, STILL = 0.01, 5.0  # [rad/s or m/s] width of a reversal, and how many of them are near one
NEAR = 0.06  # [s] before and after a reversal in which torque does not count


def tell_apart(model: Model, law: Law, rival: Law, floor: Array, seed: int) -> str:
    """Along which of some random motions a rival explains least of a law.

    Args:
        model: the simulation.
        law: with all its numbers.
        rival: with its shape.
        floor: (n,) noise of torque [N.m or N].
        seed: of the motions.

    Source: T-optimality, Atkinson, Fedorov, Biometrika 62(1), 1975.
    """
    if time_is_up(SEARCH):
        return UNSOUGHT
    tried = [(*_left(model, law, rival, floor, motion), motion) for motion in _motions(model, seed)]
    left, share, motion = max(tried, key=lambda t: t[0])
    if max(s for _, s, _ in tried) < STRUCTURAL:
        if _is_wider(rival, law):
            return f"no motion can tell them apart: it does what {law.effect.name} does, by more numbers"
        return "no motion can tell them apart; another sensor or a known load is needed"
    joint = _widest(model, motion, (*law.joints, *rival.joints))
    unit, names = "m" if model.robot.prismatic[joint] else "rad", ",".join(_written(model, x) for x in (law, rival))
    q, v = motion.q[:, joint], motion.v[:, joint]
    return (
        f"{model.robot.joints[joint]} from {q.min():.2g} to {q.max():.2g} {unit} at up to {np.abs(v).max():.2g} "
        f"{unit}/s, all joints moving: a random motion of {DURATION:g} s sets them {np.sqrt(left):.2g} standard "
        f"deviations apart; signid excite ROBOT --separate {names} finds a better one"
    )


def _is_wider(rival: Law, law: Law) -> bool:
    """Whether a torque at the same joint has more numbers, so that it is the other one when some are zero."""
    alike = all(isinstance(one.effect, TorqueLaw) for one in (rival, law)) and rival.joints == law.joints
    return alike and coefficient_count(rival) > coefficient_count(law)


def _motions(model: Model, seed: int) -> list[Motion]:
    robot, rng = model.robot, np.random.default_rng(seed)
    limits, t = build_limits(robot), np.arange(int(DURATION * RATE)) / RATE
    family, out = Fourier(DURATION, HARMONICS, 1 / DURATION), list[Motion]()
    basis = family.basis(t)
    for _ in range(MOTIONS):
        drawn = sample(family, robot.joints, random_parameters(basis, limits, rng, AMPLITUDE), t)
        slow = np.full(len(robot.joints), REVERSAL)
        motion = Motion(robot, drawn.t, drawn.q, drawn.v, drawn.a, slow=slow)
        torque = model.inverse(motion)
        out.append(replace(motion, recorded=torque, predicted=torque))
    return out


def _left(model: Model, law: Law, rival: Law, floor: Array, motion: Motion) -> tuple[float, float]:
    """Sum of squares over noise that the rival and the usual laws leave of a law's torque, and its share."""
    n = len(model.robot.joints)
    torque = np.zeros((len(motion), n))
    for j, x in torque_of(law, motion).items():
        torque[:, j] = x
    columns = [_wide(rival, motion, n)]
    beside = [effect for effect in EFFECTS if effect.usual and effect is not law.effect]
    columns += [_wide(Law(effect, (j,)), motion, n) for effect in beside for j in law.joints]
    weight = _clear(motion) / floor
    y = (torque * weight).ravel()
    x = np.concatenate(columns, axis=2) * weight[:, :, None]
    x = x.reshape(len(y), -1)
    rest = leave(y, x)
    left, whole = float(rest @ rest), float(y @ y)
    return left * INDEPENDENT / RATE, left / whole if whole > 0 else 0.0


def _clear(motion: Motion) -> Array:
    """(N, n) 0 near reversals, where torque counts little, else 1."""
    sign = np.sign(motion.v)
    turns = (np.abs(motion.v) < STILL * REVERSAL) | (np.diff(sign, axis=0, append=sign[-1:]) != 0)
    return np.asarray(1.0 - maximum_filter1d(turns.astype(float), 2 * round(NEAR * RATE) + 1, axis=0))


def _wide(law: Law, motion: Motion, n: int) -> Array:
    rows, columns = law_columns(law, motion)
    out = np.zeros((len(motion), n, columns.shape[2]))
    out[:, list(rows)] = columns
    return out


def _widest(model: Model, motion: Motion, joints: tuple[int, ...]) -> int:
    """Of some joints the one that moves most of its range."""
    few = joints if len(joints) < len(model.robot.joints) else range(len(model.robot.joints))
    return max(few, key=lambda j: float(np.ptp(motion.q[:, j])))


def _written(model: Model, law: Law) -> str:
    joint, values = law_place(law, model.robot)
    where = "" if joint is None or law.effect.scope == "tip" else f"@{joint}"
    return f"{law.effect.name}{where}" + (f":partner={values['partner']}" if "partner" in values else "")
