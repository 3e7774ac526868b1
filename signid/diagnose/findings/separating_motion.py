"""Two laws -> the motion that would distinguish them, in a sentence."""

from __future__ import annotations

import numpy as np

from ...deadline import time_is_up
from ...effects import EFFECTS
from ...effects.base import TorqueLaw
from ...effects.law import coefficient_count
from ...effects.naming import law_place
from ...model import Model
from ...regression.motion import Motion
from ...simulation.excite.families import Fourier, random_parameters
from ...simulation.excite.limits import build_limits
from ...simulation.excite.separation import STRUCTURAL, law_distance, wide_columns, with_torque
from ...types import Array, Law

SEARCH, UNSOUGHT = "the search for motions that separate alternatives", "not searched for: time was up"
MOTIONS, DURATION, RATE = 6, 8.0, 50.0  # random ones, [s], [Hz]
HARMONICS, AMPLITUDE = 5, (0.3, 0.9)  # least and most share of the limits


def tell_apart(model: Model, law: Law, rival: Law, floor: Array, seed: int) -> str:
    """Along which of some random motions a rival explains least of a law; floor: (n,) noise of torque [N.m or N].

    Source: T-optimality, Atkinson, Fedorov, Biometrika 62(1), 1975.
    """
    if time_is_up(SEARCH):
        return UNSOUGHT
    tried = [(*_distance(law, rival, floor, motion), motion) for motion in _motions(model, seed)]
    left, share, motion = max(tried, key=lambda t: t[0])
    if max(s for _, s, _ in tried) < STRUCTURAL:
        if _is_wider(rival, law):
            return f"no motion can distinguish them: it does what {law.effect.name} does, by more numbers"
        return "no motion can distinguish them; another sensor or a known load is needed"
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
    family = Fourier(DURATION, HARMONICS, 1 / DURATION)
    basis = family.basis(t)
    drawn = (random_parameters(basis, limits, rng, AMPLITUDE) for _ in range(MOTIONS))
    return [with_torque(model, family.sample(robot.joints, x, t)) for x in drawn]


def _distance(law: Law, rival: Law, floor: Array, motion: Motion) -> tuple[float, float]:
    """Distance of two laws while the usual laws are fitted at the joints of the first, and its share."""
    beside = [Law(effect, (j,)) for effect in EFFECTS if effect.usual and effect is not law.effect for j in law.joints]
    return law_distance(law, rival, motion, wide_columns(beside, motion), floor)


def _widest(model: Model, motion: Motion, joints: tuple[int, ...]) -> int:
    """The one of some joints that moves over most of its range."""
    few = joints if len(joints) < len(model.robot.joints) else range(len(model.robot.joints))
    return max(few, key=lambda j: float(np.ptp(motion.q[:, j])))


def _written(model: Model, law: Law) -> str:
    joint, values = law_place(law, model.robot)
    where = "" if joint is None or law.effect.scope == "tip" else f"@{joint}"
    return f"{law.effect.name}{where}" + (f":partner={values['partner']}" if "partner" in values else "")
