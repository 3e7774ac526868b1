"""What every effect must obey; `faults` walks one effect and says what is wrong with it."""

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from signid.effects.base import BodyLaw, Effect, TorqueLaw
from signid.effects.law import law_columns
from signid.motion import Motion
from signid.robot import load_robot
from signid.types import Array, Law

NUMPY = {name: getattr(np, name) for name in "abs sign exp sin cos clip where sum".split()}
JOINT = 1


def smooth_motion(count: int = 400) -> Motion:
    """A smooth motion of a six-joint arm that passes through rest."""
    robot, t = load_robot("ur5"), np.arange(count) * 0.01
    w, phase = np.linspace(1.1, 2.9, 6), np.linspace(0, 2, 6)
    angle = t[:, None] * w + phase
    return Motion(robot, t, np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle))


def printed(effect: Effect, motion: Motion) -> Array:
    """The law as its card prints it."""
    x = motion.at((JOINT,))
    names = {key: getattr(x, key)[:, 0] for key in ("q", "v", "a", "load")} | {"t": motion.t}
    return np.broadcast_to(eval(effect.equation, NUMPY | names | dict(effect.example)), motion.t.shape)


def reshaped(effect: BodyLaw, motion: Motion) -> Array:
    """What a body law adds to Pinocchio's own inverse dynamics."""
    model = motion.robot.model.copy()
    effect.reshape(model, JOINT, JOINT + 1, **effect.example)
    data = model.createData()
    states = zip(motion.configuration, *motion.rates, strict=True)
    return np.array([pin.rnea(model, data, *state)[JOINT] for state in states]) - motion.load[:, JOINT]


def faults(effect: Effect) -> Iterator[str]:
    """One sentence for each law of the contract that an effect breaks."""
    motion, law = smooth_motion(), Law(effect, (JOINT,), effect.example)
    if not (effect.name and effect.equation and effect.source and type(effect).__doc__):
        yield "its card is incomplete"
    if set(effect.example) != set(effect.parameters):
        yield "its example does not give every parameter"
        return
    back = effect.physical(effect.coefficients(effect.example), effect.shape(effect.example))
    if set(back) != set(effect.example) or any(abs(back[k] - effect.example[k]) > 1e-9 for k in back):
        yield "coefficients and physical are no inverses"
    rows, columns = law_columns(law, motion)
    if columns.shape != (len(motion), len(rows), max(1, len(effect.linear()))) or not np.isfinite(columns).all():
        yield "its columns have another shape, or are not finite"
        return
    torque = columns[:, 0] @ np.array(effect.coefficients(effect.example))
    size = np.abs(torque).max()
    if np.abs(torque - printed(effect, motion)).max() > 1e-9 * size:
        yield "its equation and its columns differ"
    if isinstance(effect, BodyLaw) and np.abs(torque - reshaped(effect, motion)).max() > 1e-9 * size:
        yield "its columns and the reshaped bodies differ"
    if effect.dissipative and (torque * motion.v[:, JOINT] < -1e-12 * size).any():
        yield "it does not dissipate"
    if effect.reverses != jumps(effect, motion):
        yield "its columns jump with the direction of motion, and `reverses` denies it, or the other way round"
    if isinstance(effect, TorqueLaw) == isinstance(effect, BodyLaw):
        yield "it is of no kind, or of two"


def jumps(effect: Effect, motion: Motion) -> bool:
    """Whether the columns change when only the direction of motion does."""
    turned = Motion(motion.robot, motion.t, motion.q, motion.v, motion.a)
    object.__setattr__(turned, "direction", -motion.direction)
    law = Law(effect, (JOINT,), effect.example)
    return not np.array_equal(law_columns(law, motion)[1], law_columns(law, turned)[1])
