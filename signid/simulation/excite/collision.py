"""Distances between the links of a robot, by coal through Pinocchio."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from ...errors import RobotError
from ...robot import configuration
from ...robot.description.document import parse
from ...robot.locate import find_mesh
from ...types import Array, Frozen, Robot
from .limits import Limits

POSTURES = 200  # random postures for statistics of the distances
SPARED = 0.25  # [1] largest extra clearance of a pair, over its median distance beyond the clearance
ALWAYS = 0.5  # [1] share of the postures in which a pair is too near, above which its shapes overlap by design


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
        wanted = clearance + np.clip(SPARED * (self.usual - clearance), 0, spare)
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
        geometry = pin.buildGeomFromUrdfString(robot.model, _placed(robot), pin.GeometryType.COLLISION)
        for item in geometry.geometryObjects:
            if hasattr(item.geometry, "buildConvexRepresentation"):  # a mesh; signed distances need convex shapes
                item.geometry.buildConvexRepresentation(False)
                item.geometry = item.geometry.convex
    except Exception as error:  # Pinocchio's exceptions have no common base class
        return None, f"self-collision was not checked: {' '.join(str(error).split())[:200]}"
    pairs = _pairs(robot, geometry)
    if not pairs:
        return None, f"self-collision was not checked: {robot.name} has no two shapes that can collide"
    _keep(geometry, pairs)
    q = np.random.default_rng(seed).uniform(limits.lower, limits.upper, (POSTURES, len(robot.joints)))
    found = Collision(robot, geometry, np.zeros(len(pairs))).distances(q)
    apart = (found < clearance).mean(0) <= ALWAYS
    if not apart.any():
        return None, "self-collision was not checked: the shapes overlap by design"
    _keep(geometry, [pair for pair, free in zip(pairs, apart, strict=True) if free])
    return Collision(robot, geometry, np.median(found[:, apart], axis=0)), ""


def _placed(robot: Robot) -> str:
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


def _keep(geometry: Any, pairs: list[tuple[int, int]]) -> None:
    geometry.removeAllCollisionPairs()
    for first, second in pairs:
        geometry.addCollisionPair(pin.CollisionPair(first, second))


def _pairs(robot: Robot, geometry: Any) -> list[tuple[int, int]]:
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
