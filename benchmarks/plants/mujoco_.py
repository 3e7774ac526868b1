"""A robot in MuJoCo that follows a given motion in closed loop and logs itself as a real robot would.

Nothing of signid is used: MuJoCo's own parser reads the URDF, its own dynamics move the robot.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]

STEP = 2.5e-4  # s, of the simulation
COMMAND = 4  # steps between two values of the feed-forward
BANDWIDTH, DAMPING = 2 * np.pi * 8.0, 0.9  # rad/s and 1, of the position loop
KNOWN = 0.9  # share of the dynamics that the feed-forward knows
HARMONICS, FUNDAMENTAL = 10, 0.1  # of a motion: their number, and the first [Hz]
SPEED, ACCELERATION, RANGE = 1.5, 5.0, 1.0  # rad/s, rad/s2, rad that a motion keeps within
CORNER = 3.0  # Hz, of coloured noise


@dataclass(frozen=True)
class Drives:
    """What the joints add to the bodies, n values each [kg.m2, N.m.s/rad, N.m, N.m]; offsets as the motor must add."""

    armature: Sequence[float]
    viscous_friction: Sequence[float]
    coulomb_friction: Sequence[float]
    torque_offset: Sequence[float]


@dataclass(frozen=True)
class Body:
    """A URDF as MuJoCo understands it: joints that are not named are welded, some links are heavier than stated."""

    urdf: str  # the text
    joints: tuple[str, ...]
    heavier: Mapping[str, float] = field(default_factory=dict)  # link -> factor on its mass and its inertia


class Motion(NamedTuple):
    """Positions as Fourier series, n joints: sums of sine / frequency - cosine / frequency about a centre."""

    sine: Array  # (HARMONICS, n) [rad/s]
    cosine: Array  # (HARMONICS, n) [rad/s]
    centre: Array  # (n,) [rad]

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, velocity, acceleration, (N, n) each [rad, rad/s, rad/s2] at times (N,) [s]."""
        w = 2 * np.pi * FUNDAMENTAL * np.arange(1, HARMONICS + 1)[:, None]
        s, c = np.sin(t[:, None] * w.T), np.cos(t[:, None] * w.T)
        q = s @ (self.sine / w) - c @ (self.cosine / w) + self.centre
        return q, c @ self.sine + s @ self.cosine, c @ (self.cosine * w) - s @ (self.sine * w)


class Track(NamedTuple):
    """What truly happened: positions, and the torque of the motors at those very moments."""

    t: Array  # (N,) [s]
    q: Array  # (N, n) [rad]
    tau: Array  # (N, n) [N.m]


def draw_motion(centre: Sequence[float], seed: int) -> Motion:
    """A random motion as large as speed, acceleration and range allow.

    Args:
        centre: (n,) [rad].
        seed: of the series' coefficients.
    """
    order = np.arange(1, HARMONICS + 1)[:, None]
    sine, cosine = np.random.default_rng(seed).standard_normal((2, HARMONICS, len(centre))) / order**1.2
    period = np.arange(0, 1 / FUNDAMENTAL, 1e-3)
    sizes = [np.abs(x).max(0) for x in Motion(sine, cosine, np.zeros(len(centre))).at(period)]
    scale = np.min([limit / size for limit, size in zip((RANGE, SPEED, ACCELERATION), sizes, strict=True)], axis=0)
    return Motion(sine * scale, cosine * scale, np.array(centre, dtype=float))


def simulate(body: Body, drives: Drives, motion: Motion, duration: float, rate: float) -> Track:
    """The robot along a motion: PD control with a feed-forward that knows 90 % of the dynamics and no friction.

    Torque and acceleration belong to the same moment: a step's torque moves the robot from k to k + 1, and the
    second difference of the positions k - 1, k, k + 1 is the acceleration of that very step.

    Args:
        body: rigid bodies.
        drives: n joints.
        motion: n joints.
        duration: [s].
        rate: of the log [Hz]; 1 / STEP shows every step.
    """
    every = round(1 / (rate * STEP))
    if abs(every * rate * STEP - 1) > 1e-9:
        raise ValueError(f"a log at {rate:g} Hz falls between the steps of {STEP:g} s")
    t = np.arange(round(duration / STEP) + 1) * STEP
    desired, velocity, _ = motion.at(t)
    known = _compile(body, drives, frictionless=True, weigh=False)
    inertia = _mean_inertia(known, body.joints, desired[:: len(t) // 20])
    stiffness, damping = inertia * BANDWIDTH**2, 2 * DAMPING * inertia * BANDWIDTH
    command = _feed_forward(known, body.joints, motion, t) + stiffness * desired + damping * velocity
    q, v = _roll(body, drives, (stiffness, damping), command - np.array(drives.torque_offset), desired[0], velocity[0])
    tau = command[:-1] - stiffness * q[:-1] - damping * v[1:]  # implicit integration damps with the next velocity
    kept = slice(0, None, every)
    return Track(t[:-1][kept], q[:-1][kept], tau[kept])


def log(track: Track, seed: int, bits: int = 17, white: float = 0.0, coloured: float = 0.0) -> dict[str, Array]:
    """The columns of a recording: t, q_1 ..., tau_1 ...

    Args:
        track: what truly happened.
        seed: of the noise, and of the encoders' zeros between two counts.
        bits: of the encoders, per turn.
        white: standard deviation of white torque noise, as a share of the joint's rms torque.
        coloured: the same of noise through a first-order low-pass at 3 Hz.
    """
    rng = np.random.default_rng(seed)
    count = 2 * np.pi / 2**bits
    zero = rng.uniform(0, count, track.q.shape[1])
    q = np.round((track.q - zero) / count) * count + zero
    size = np.sqrt(np.mean(track.tau**2, axis=0))
    noise = white * rng.standard_normal(track.tau.shape) + coloured * _coloured(rng, track)
    columns = {"t": track.t}
    columns |= {f"q_{j + 1}": x for j, x in enumerate(q.T)}
    return columns | {f"tau_{j + 1}": x for j, x in enumerate((track.tau + size * noise).T)}


def inertials(body: Body) -> dict[str, tuple[float, Array, Array]]:
    """Per moving link its mass [kg], first moment (3,) [kg.m] and inertia (3, 3) [kg.m2] about the joint's frame."""
    zero = [0.0] * len(body.joints)
    model = _compile(body, Drives(zero, zero, zero, zero))
    found = {}
    for joint in body.joints:
        i = int(model.joint(joint).bodyid[0])
        mass, centre, rotation = float(model.body_mass[i]), model.body_ipos[i], np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.body_iquat[i])
        axes = rotation.reshape(3, 3)
        inertia = axes @ np.diag(model.body_inertia[i]) @ axes.T
        moved = inertia + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        found[model.body(i).name] = (mass, mass * centre, moved)
    return found


def _bare(body: Body) -> str:
    """The URDF without its looks, with the joints welded that do not move."""
    root = ElementTree.fromstring(body.urdf.encode())
    for link in root.iter("link"):
        for part in (*link.findall("visual"), *link.findall("collision")):
            link.remove(part)
    for other in [child for child in root if child.tag not in ("link", "joint")]:
        root.remove(other)
    for joint in root.findall("joint"):
        if joint.get("name") not in body.joints:
            joint.set("type", "fixed")
    return ElementTree.tostring(root, encoding="unicode")


def _compile(
    body: Body,
    drives: Drives,
    gains: tuple[Array, Array] | None = None,
    frictionless: bool = False,
    weigh: bool = True,
) -> Any:
    spec = mujoco.MjSpec.from_string(_bare(body))
    for i, name in enumerate(body.joints):
        motor = spec.add_actuator(name=f"motor_{i + 1}", target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.gainprm[0] = 1
        if gains is not None:
            motor.biastype = mujoco.mjtBias.mjBIAS_AFFINE
            motor.biasprm[:3] = 0, -gains[0][i], -gains[1][i]
    model = spec.compile()
    for link, factor in body.heavier.items() if weigh else ():
        model.body(link).mass *= factor
        model.body(link).inertia *= factor
    dofs = _dofs(model, body.joints)
    model.dof_armature[dofs] = drives.armature
    model.dof_damping[dofs] = 0 if frictionless else drives.viscous_friction
    model.dof_frictionloss[dofs] = 0 if frictionless else drives.coulomb_friction
    model.dof_solref[:], model.dof_solimp[:] = [2 * STEP, 1], [0.9999, 0.9999, 0.001, 0.5, 2]  # sliding at 1 mm/s
    model.jnt_actfrclimited[:] = 0
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.opt.iterations, model.opt.tolerance = 50, 1e-12
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def _dofs(model: Any, joints: Sequence[str]) -> list[int]:
    return [int(model.joint(name).dofadr[0]) for name in joints]


def _mean_inertia(model: Any, joints: Sequence[str], positions: Array) -> Array:
    """(n,) [kg.m2] diagonal of the mass matrix, on average."""
    data, dofs = mujoco.MjData(model), _dofs(model, joints)
    full, diagonal = np.zeros((model.nv, model.nv)), np.zeros((len(positions), len(dofs)))
    for k, q in enumerate(positions):
        data.qpos[dofs] = q
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        diagonal[k] = np.diag(full)[dofs]
    return np.asarray(diagonal.mean(0))


def _feed_forward(model: Any, joints: Sequence[str], motion: Motion, t: Array) -> Array:
    """(N, n) [N.m] at times (N,) [s]."""
    data, dofs = mujoco.MjData(model), _dofs(model, joints)
    coarse = t[::COMMAND]
    torque = np.zeros((len(coarse), len(dofs)))
    for k, (q, v, a) in enumerate(zip(*motion.at(coarse), strict=True)):
        data.qpos[dofs], data.qvel[dofs], data.qacc[dofs] = q, v, a
        mujoco.mj_inverse(model, data)
        torque[k] = data.qfrc_inverse[dofs]
    return KNOWN * np.column_stack([np.interp(t, coarse, column) for column in torque.T])


def _roll(
    body: Body, drives: Drives, gains: tuple[Array, Array], command: Array, q: Array, v: Array
) -> tuple[Array, Array]:
    """Positions and velocities (N, n) [rad, rad/s] from the first state on, under commands (N, n) [N.m]."""
    model = _compile(body, drives, gains)
    n, dofs = model.nv, _dofs(model, body.joints)
    if model.nq != n or n != len(body.joints):
        raise ValueError("only joints of one position each are simulated")
    start = np.zeros(1 + 2 * n)
    start[1:][dofs], start[1 + n :][dofs] = q, v
    states, _ = rollout.rollout(model, [mujoco.MjData(model)], start[None], command[None, :-1])
    states = np.vstack([start, states[0]])
    return states[:, 1 : 1 + n][:, dofs], states[:, 1 + n :][:, dofs]


def _coloured(rng: np.random.Generator, track: Track) -> Array:
    """(N, n) [1] of unit variance, stationary from the first sample on."""
    keep = float(np.exp(-2 * np.pi * CORNER * (track.t[1] - track.t[0])))
    noise = rng.standard_normal(track.tau.shape)
    noise[1:] *= np.sqrt(1 - keep**2)
    return np.asarray(lfilter([1.0], [1.0, -keep], noise, axis=0))
