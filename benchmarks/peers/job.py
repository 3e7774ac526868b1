"""Nine faults of a UR10 and recordings with each from MuJoCo; the job files for all tools."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..concealed.session import actuators_file
from ..plants.bodies import Body, Drives, bare
from ..plants.control import COMMAND, KNOWN, STEP, Motion, Track, Track as Moved, clock, gains
from ..plants.faults import Fault
from ..plants.mujoco_ import build, inverse, mean_inertia, simulate
from ..regressor import HARMONICS, RATE, REACH, Array, drives, load

ENCODER, TORQUE = 1e-4, 0.02  # white noise of position [rad], and of torque over its standard deviation [1]
ONE = "shoulder_lift_joint"
TILT, MASS, OUT, LATE, OFFSET, GAIN = np.deg2rad(3.0), 1.5, 0.1, 0.010, 0.02, 0.9  # [rad], [kg], [m], [s], [rad], [1]
SLOW, LOAD, ASIDE = 0.05, 0.1, 0.3  # Stribeck velocity [rad/s], load friction [1], asymmetry over Coulomb friction [1]
DROP = 0.6  # Stribeck level over Coulomb friction [1]
SIGNS = "signs"  # pseudo-effect of torque without signs


@dataclass(frozen=True)
class Case:
    """One fault and the words that count as naming it."""

    name: str
    effect: str  # signid's name; "" for the healthy robot
    faults: tuple[Fault, ...] = ()
    words: tuple[str, ...] = ()
    unsigned: bool = False  # torque is recorded without sign
    declared: bool = False  # missing signs are declared to the tool, which only signid supports

    @property
    def joints(self) -> tuple[str | None, ...]:
        """Joints of the faults."""
        return tuple(fault.joint for fault in self.faults)


@dataclass(frozen=True, eq=False)
class Arm:
    """Description and drives that all tools receive."""

    body: Body
    drives: Drives

    @classmethod
    def ur10(cls) -> Arm:
        """Arm and drives of the base-parameter benchmark."""
        robot = load("ur10")
        return cls(Body(robot.document, robot.joints), drives(robot))


def cases(arm: Arm) -> tuple[Case, ...]:
    """The healthy robot, then each fault; friction and delay act on all joints."""

    def each(effect: str, **numbers: float | Array) -> tuple[Fault, ...]:
        n = len(arm.body.joints)
        values = {key: np.broadcast_to(x, n).tolist() for key, x in numbers.items()}
        return tuple(Fault(effect, j, {key: x[i] for key, x in values.items()}) for i, j in enumerate(arm.body.joints))

    dry, mount = np.array(arm.drives.coulomb_friction), Fault("base_tilt", None, {"x": 0.0, "y": TILT})
    load = {"mass": MASS, "first_moment_x": 0.0, "first_moment_y": 0.0, "first_moment_z": MASS * OUT}
    held = Fault("payload", arm.body.joints[-1], load)
    late, read = Fault("time_delay", None, {"delay": LATE}), Fault("encoder_offset", ONE, {"offset": OFFSET})
    weak, none = Fault("torque_gain", ONE, {"error": GAIN - 1}), np.zeros(len(dry))
    one_way = {"coulomb_positive": ASIDE * dry, "coulomb_negative": none}
    aside = each("asymmetric_friction", viscous_positive=none, viscous_negative=none, **one_way)
    unsigned = ("absolute", "unsigned", "without a sign", "sign is lost", "signs are lost")
    stribeck = each("stribeck_friction", level=DROP * dry, velocity=SLOW)
    return (
        Case("clean", ""),
        Case("base tilt 3 deg", mount.effect, (mount,), ("tilt", "gravity", "base orientation", "level")),
        Case("payload 1.5 kg", held.effect, (held,), ("payload", "load", "heavier")),
        Case("torque 10 ms late", late.effect, (late,), ("delay", "late", "lag", "latency", "time shift")),
        Case("Stribeck, 60 % of Coulomb", "stribeck_friction", stribeck, ("stribeck", "low speed", "breakaway")),
        Case("encoder offset 0.02 rad", read.effect, (read,), ("encoder", "offset", "bias", "zero position")),
        Case("torque gain 0.9, one joint", weak.effect, (weak,), ("gain", "scale", "torque constant")),
        Case("load-dependent friction 0.1", "load_friction", each("load_friction", coefficient=LOAD), ("load",)),
        Case("Coulomb 30 % more one way", "asymmetric_friction", aside, ("asymmetr", "direction", "one way")),
        Case("sign lost", SIGNS, (), unsigned, unsigned=True),
        Case("sign lost, declared", SIGNS, (), unsigned, unsigned=True, declared=True),
    )


def motion(arm: Arm, seed: int) -> Motion:
    """Motion of the base-parameter benchmark: five harmonics of 0.1 Hz with random phases."""
    n, order = len(arm.body.joints), np.arange(1, HARMONICS + 1)
    sines, cosines = np.random.default_rng(seed).standard_normal((2, n, HARMONICS))
    size = REACH / np.sum(np.hypot(sines, cosines), axis=1)
    rate = np.zeros((2, 10, n))  # the plants' Fourier motion has ten harmonics
    rate[:, :HARMONICS] = (np.stack([sines, -cosines]) * size[:, None] * 2 * np.pi * 0.1 * order).swapaxes(1, 2)
    return Motion(rate[0], rate[1], np.zeros(n))


def record(arm: Arm, case: Case, seed: int, duration: float) -> Moved:
    """Recording along a motion [s, rad, N.m]; the noise seed is the same for all faults."""
    moved = simulate(arm.body, arm.drives, motion(arm, seed), duration, RATE, case.faults)
    rng = np.random.default_rng([seed, 7])
    q = moved.q + ENCODER * rng.standard_normal(moved.q.shape)
    tau = moved.tau + TORQUE * moved.tau.std(axis=0) * rng.standard_normal(moved.tau.shape)
    return Moved(moved.t, q, np.abs(tau) if case.unsigned else tau)


STATED = ("armature", "viscous_friction", "coulomb_friction")


class Loop(NamedTuple):
    """Controller of n motors: torque is command - stiffness q - damper v."""

    command: Array  # (N, n) [N.m] at every step
    stiffness: Array  # (n,) [N.m/rad]
    damper: Array  # (n,) [N.m.s/rad]
    q: Array  # (n,) [rad] at the start
    v: Array  # (n,) [rad/s] at the start


def describe(arm: Arm, folder: Path) -> None:
    """Write robot.urdf and actuators.toml."""
    (folder / "robot.urdf").write_text(bare(arm.body), encoding="utf-8")
    (folder / "actuators.toml").write_text(actuators_file(arm.drives, arm.body.joints), encoding="utf-8")


def hand_over(arm: Arm, train: Track, test: Track, looped: float, folder: Path) -> None:
    """Write job.npz: both recordings, drives, and `looped` [s] of the control loop along the first motion."""
    loop = _follow(arm, 0, float(train.t[-1]) + 1 / RATE, looped)
    drives = (np.array(getattr(arm.drives, key)) for key in STATED)
    np.savez(
        folder / "job.npz",
        joints=np.array(arm.body.joints),
        step=STEP,
        **dict(zip(("armature", "damping", "frictionloss"), drives, strict=True)),
        **{f"test_{key}": x for key, x in test._asdict().items()},
        **{f"loop_{key}": x for key, x in loop._asdict().items()},
        **train._asdict(),
    )


def _follow(arm: Arm, seed: int, duration: float, looped: float) -> Loop:
    """First `looped` [s] of the plant's controller without knowledge of faults, for a motion of a duration [s]."""
    t, _ = clock(0.0, duration, RATE)
    reference = motion(arm, seed)
    q, v, _ = reference.at(t)
    model, joints, coarse = build(arm.body, arm.drives, frictionless=True), arm.body.joints, t[::COMMAND]
    stiffness, damper = gains(mean_inertia(model, joints, q[:: max(len(t) // 20, 1)]))
    known = KNOWN * inverse(model, joints, *reference.at(coarse))
    forward = np.column_stack([np.interp(t, coarse, x) for x in known.T])
    command = forward + stiffness * q + damper * v
    return Loop(command[: round(looped / STEP) + 1], stiffness, damper, q[0], v[0])
