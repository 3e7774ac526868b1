"""Limits of a motion: of the joints, and between bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from ...errors import OptionError, RobotError
from ...robot import configuration
from ...robot.document import parse
from ...robot.locate import find_mesh
from ...types import Array, Frozen, Mask, Robot

DISTANCE_POSTURES = 200  # random postures for statistics of the distances
MAX_EXTRA_SHARE = 0.25  # [1] largest extra clearance of a pair, over its median distance beyond the clearance
OVERLAP_SHARE = 0.5  # [1] share of the postures in which a pair is too near, above which its shapes overlap by design
USED_LIMIT_SHARE = 0.95  # [1] share of every limit that a motion may use
FREE_RANGE = (np.pi, 0.5)  # [rad], [m] default position limit on either side of zero
FREE_SPEED = (2.0, 0.25)  # [rad/s], [m/s] default velocity limit
FREE_RISE_TIME = 0.25  # [s] time to reach the velocity limit at the default acceleration limit

GivenLimit = float | Sequence[float] | Array | None


@dataclass(frozen=True, eq=False)
class Collision(Frozen):
    """Collision shapes of a robot, meshes as convex hulls, and the pairs that can collide."""

    robot: Robot
    geometry: Any  # pin.GeometryModel with these pairs
    usual: Array  # (pairs,) [m] median distance over random postures

    def distance(self, q: Array) -> Array:
        """Smallest distance (N,) [m] at each of q (N, n) [rad or m], negative if links overlap."""
        return np.asarray(self.distances(q).min(axis=1))

    def distances(self, q: Array) -> Array:
        """Distances (N, pairs) [m] at each of q (N, n) [rad or m]."""
        model, data, placed = self.robot.model, self.robot.model.createData(), self.geometry.createData()
        out = np.empty((len(q), len(self.geometry.collisionPairs)))
        for i, where in enumerate(configuration(self.robot, q)):
            pin.computeDistances(model, data, self.geometry, placed, where)
            out[i] = [found.min_distance for found in placed.distanceResults]
        return out

    def penalty(self, q: Array, clearance: float, spare: float) -> tuple[float, Array]:
        """Mean square of the missing share of each pair's clearance, and its derivative.

        The derivative at positions q (N, n) [rad or m] is (N, n) [1/rad or 1/m]. Extra distance `spare` [m] is desired
        beyond the clearance [m], but at most a quarter of a pair's median distance, for links that are always near.
        """
        model, data, placed = self.robot.model, self.robot.model.createData(), self.geometry.createData()
        wanted = clearance + np.clip(MAX_EXTRA_SHARE * (self.usual - clearance), 0, spare)
        total, slope = 0.0, np.zeros_like(q)
        for i, where in enumerate(configuration(self.robot, q)):
            pin.computeDistances(model, data, self.geometry, placed, where)
            near = [k for k, found in enumerate(placed.distanceResults) if found.min_distance < wanted[k]]
            if near:
                pin.computeJointJacobians(model, data, where)
            for k in near:
                lack = 1 - placed.distanceResults[k].min_distance / wanted[k]  # more than 1 if shapes overlap
                total += lack**2
                slope[i] += 2 * lack * (-self._parting(model, data, k, placed) / wanted[k] @ self.robot.drive)
        return total / len(q), slope / len(q)

    def _parting(self, model: Any, data: Any, k: int, placed: Any) -> Array:
        """Derivative (nv,) [1/rad] of the distance of a pair."""
        found, pair, slope = placed.distanceResults[k], self.geometry.collisionPairs[k], np.zeros(model.nv)
        ends = (pair.first, found.getNearestPoint1(), -1.0), (pair.second, found.getNearestPoint2(), 1.0)
        for shape, point, sign in ends:
            joint = self.geometry.geometryObjects[shape].parentJoint
            if joint:
                jacobian = np.reshape(pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED), (6, model.nv))
                arm = point - data.oMi[joint].translation
                slope += sign * (found.normal @ jacobian[:3] + np.cross(arm, found.normal) @ jacobian[3:])
        return slope


def build_collision(robot: Robot, limits: Limits, clearance: float, seed: int = 0) -> tuple[Collision | None, str]:
    """Collision shapes of a robot with the pairs that can collide; None and the reason if there are none.

    Pairs of one link and of links joined by one moving joint are left out. So are pairs nearer than the clearance in
    more than half of 200 random postures within the limits: their shapes overlap by design.
    """
    if robot.kind != "urdf":
        return None, f"self-collision was not checked: shapes are read from a URDF only, this is {robot.kind.upper()}"
    try:
        geometry = pin.buildGeomFromUrdfString(robot.model, _placed_meshes(robot), pin.GeometryType.COLLISION)
        for item in geometry.geometryObjects:
            if hasattr(item.geometry, "buildConvexRepresentation"):  # a mesh; signed distances need convex shapes
                item.geometry.buildConvexRepresentation(False)
                item.geometry = item.geometry.convex
    except Exception as error:  # Pinocchio's exceptions have no common base class
        return None, f"self-collision was not checked: {' '.join(str(error).split())[:200]}"
    pairs = _collision_pairs(robot, geometry)
    if not pairs:
        return None, f"self-collision was not checked: {robot.name} has no two shapes that can collide"
    _set_pairs(geometry, pairs)
    q = np.random.default_rng(seed).uniform(limits.lower, limits.upper, (DISTANCE_POSTURES, len(robot.joints)))
    found = Collision(robot, geometry, np.zeros(len(pairs))).distances(q)
    apart = (found < clearance).mean(0) <= OVERLAP_SHARE
    if not apart.any():
        return None, "self-collision was not checked: the shapes overlap by design"
    _set_pairs(geometry, [pair for pair, free in zip(pairs, apart, strict=True) if free])
    return Collision(robot, geometry, np.median(found[:, apart], axis=0)), ""


def _placed_meshes(robot: Robot) -> str:
    """URDF with absolute paths of its collision meshes."""
    from lxml import etree

    root = parse(robot.document)
    for mesh in root.iterfind(".//{*}collision//{*}mesh"):
        name = mesh.get("filename") or ""
        path = find_mesh(name, robot.path)
        if path is None:
            raise RobotError(f"the mesh {name} is not found")
        mesh.set("filename", path.resolve().as_posix())
    return str(etree.tostring(root, encoding="unicode"))


def _set_pairs(geometry: Any, pairs: list[tuple[int, int]]) -> None:
    geometry.removeAllCollisionPairs()
    for first, second in pairs:
        geometry.addCollisionPair(pin.CollisionPair(first, second))


def _collision_pairs(robot: Robot, geometry: Any) -> list[tuple[int, int]]:
    """Pairs of shapes on links that are at least two moving joints apart."""
    model, moves = robot.model, np.asarray(np.any(robot.drive, axis=1))
    body = [0]  # per joint, the first of the joints that are fixed to it
    for i in range(1, model.njoints):
        joint = model.joints[i]
        moving = moves[joint.idx_v : joint.idx_v + joint.nv].any()
        body.append(i if moving else body[model.parents[i]])
    before = [body[model.parents[i]] for i in range(model.njoints)]
    at = [body[item.parentJoint] for item in geometry.geometryObjects]
    joined = {(a, a) for a in body} | {(a, before[a]) for a in body} | {(before[a], a) for a in body}
    return [(i, j) for i in range(len(at)) for j in range(i + 1, len(at)) if (at[i], at[j]) not in joined]


@dataclass(frozen=True, eq=False)
class Limits(Frozen):
    """Limits of n joints; a motion uses at most the share `margin` of each."""

    lower: Array  # (n,) [rad or m]
    upper: Array  # (n,) [rad or m]
    velocity: Array  # (n,) [rad/s or m/s]
    acceleration: Array  # (n,) [rad/s2 or m/s2]
    torque: Array  # (n,) [N.m or N], inf where none
    margin: float = USED_LIMIT_SHARE
    notes: tuple[str, ...] = ()

    @property
    def middle(self) -> Array:
        return (self.lower + self.upper) / 2

    @property
    def half(self) -> Array:
        """Half of the usable position range, (n,) [rad or m]."""
        return self.margin * (self.upper - self.lower) / 2

    @property
    def allowed(self) -> Array:
        """Usable limits (3, n) [rad or m, and per s, per s2]: half of the range, velocity and acceleration."""
        return np.array([self.half, self.margin * self.velocity, self.margin * self.acceleration])

    def shares(self, q: Array, v: Array, a: Array) -> Array:
        """Signed shares (3, N, n) [1] of the usable limits.

        Samples are q (N, n) [rad or m], v (N, n) [rad/s or m/s], a (N, n) [rad/s2 or m/s2].
        """
        return np.array([q - self.middle, v, a]) / self.allowed[:, None]


def build_limits(
    robot: Robot,
    *,
    lower: GivenLimit = None,
    upper: GivenLimit = None,
    velocity: GivenLimit = None,
    acceleration: GivenLimit = None,
    torque: GivenLimit = None,
    margin: float = USED_LIMIT_SHARE,
) -> Limits:
    """Limits of the description, or the given ones: one number for all joints, or one for each.

    Defaults if the description has none: half a turn (0.5 m) on either side of zero, 2 rad/s (0.25 m/s), no torque
    limit. The default acceleration limit reaches the velocity limit in 0.25 s. Units are rad or m, s, and N.m or N.

    Raises:
        OptionError: a limit leaves no motion, or the number of limits is not that of the joints.
    """
    if not 0 < margin <= 1:
        raise OptionError(f"the margin is {margin:g}; give a share of the limits above 0 and at most 1")
    notes: list[str] = []
    span = np.where(robot.prismatic, FREE_RANGE[1], FREE_RANGE[0])
    low, up = _joint_limits(robot, "lower", lower, robot.lower), _joint_limits(robot, "upper", upper, robot.upper)
    bare = ~np.isfinite(low) | ~np.isfinite(up)
    low = np.where(np.isfinite(low), low, np.where(np.isfinite(up), up - 2 * span, -span))
    up = np.where(np.isfinite(up), up, low + 2 * span)
    speed = _joint_limits(robot, "velocity", velocity, robot.velocity_limit)
    free = ~np.isfinite(speed)
    speed = np.where(free, np.where(robot.prismatic, FREE_SPEED[1], FREE_SPEED[0]), speed)
    notes += _note(robot, bare, "no position limit is stated: half a turn (0.5 m) on either side of zero is used")
    notes += _note(robot, free, f"no velocity limit is stated: {FREE_SPEED[0]:g} rad/s ({FREE_SPEED[1]:g} m/s) is used")
    if acceleration is None:
        notes.append(f"the acceleration limit is the one that reaches the velocity limit in {FREE_RISE_TIME:g} s")
    rise = _joint_limits(robot, "acceleration", acceleration, speed / FREE_RISE_TIME)
    effort = _joint_limits(robot, "torque", torque, robot.effort_limit)
    notes += _note(robot, ~np.isfinite(effort), "no torque limit is stated")
    for j, joint in enumerate(robot.joints):
        if not low[j] < up[j]:
            raise OptionError(
                f"joint {joint} would move from {low[j]:g} to {up[j]:g}; the lower limit must be below the upper"
            )
        for name, size in {"velocity": speed, "acceleration": rise, "torque": effort}.items():
            if not size[j] > 0:
                raise OptionError(
                    f"the {name} limit of joint {joint} is {size[j]:g}, which leaves no motion; "
                    "give a positive one, or hold the joint with --lock"
                )
    return Limits(low, up, speed, rise, effort, margin, tuple(notes))


def _joint_limits(robot: Robot, name: str, value: GivenLimit, stated: Array) -> Array:
    n = len(robot.joints)
    if value is None:
        return np.array(stated, float)
    array = np.asarray(value, float)
    if array.shape not in ((), (n,)) or np.isnan(array).any():
        raise OptionError(f"the {name} limit has shape {array.shape}; give one number, or one for each of {n} joints")
    return np.broadcast_to(array, (n,)).copy()


def _note(robot: Robot, which: Mask, text: str) -> list[str]:
    named = [joint for joint, bare in zip(robot.joints, which, strict=True) if bare]
    return [f"{', '.join(named)}: {text}"] if named else []
