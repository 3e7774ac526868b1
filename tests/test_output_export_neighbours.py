"""Files for ROS 2 and Isaac Lab hold the numbers of the model."""

from __future__ import annotations

import ast
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import yaml
from exported import states

import signid
from signid.effects.naming import parse_law
from signid.model import Model, stated_inertials

ROBOT = signid.load_robot("3r")
LAWS = (
    "armature@1:inertia=0.1",
    "viscous_friction@2:coefficient=0.5",
    "coulomb_friction@2:level=0.8",
    "torque_offset@3:offset=-0.04",
    "payload:mass=0.3,first_moment_x=0.03",
)
MODEL = Model(ROBOT, stated_inertials(ROBOT), tuple(parse_law(law, ROBOT) for law in LAWS))


def test_the_ros_parameters_give_the_torque_of_the_model() -> None:
    made = signid.export(MODEL, "ros")
    assert made.notes == ()
    parameters = yaml.safe_load(made.text)["/**"]["ros__parameters"]["dynamics"]
    assert [parameters["joint"][joint]["effort_limit"] for joint in ROBOT.joints] == ROBOT.effort_limit.tolist()
    robot = ROBOT.model.copy()
    for body, link in enumerate(ROBOT.links, 1):
        robot.inertias[body] = inertia(parameters["link"][link])
    data, drives = robot.createData(), parameters["joint"]
    motion = states(ROBOT)
    for q, v, a, expected in zip(motion.q, motion.v, motion.a, MODEL.inverse(motion), strict=True):
        torque = pin.rnea(robot, data, q, v, a)
        for j, joint in enumerate(parameters["joints"]):
            known = drives.get(joint, {})
            torque[j] += known.get("armature", 0) * a[j] + known.get("viscous_friction", 0) * v[j]
            torque[j] += known.get("coulomb_friction", 0) * np.sign(v[j]) + known.get("torque_offset", 0)
        np.testing.assert_allclose(torque, expected, rtol=1e-9, atol=1e-9)


def test_the_ros_parameters_have_no_empty_map() -> None:
    robot = replace(ROBOT, effort_limit=np.full(3, np.inf))
    written = signid.export(Model(robot, stated_inertials(robot), ()), "ros").text
    assert "joint:" not in written and "{}" not in written  # the reader of rcl takes what follows for its content


def inertia(link: dict[str, Any]) -> pin.Inertia:
    i = link["inertia"]
    matrix = [[i["ixx"], i["ixy"], i["ixz"]], [i["ixy"], i["iyy"], i["iyz"]], [i["ixz"], i["iyz"], i["izz"]]]
    return pin.Inertia(link["mass"], np.array(link["centre_of_mass"]), np.array(matrix))


def test_the_actuators_of_isaac_lab_are_those_of_the_model() -> None:
    made = signid.export(MODEL, "isaaclab")
    assert [flag.partition(":")[0] for flag in made.flags] == [
        "an actuator group of Isaac Lab cannot hold torque_offset of joint_3",
        "an actuator group of Isaac Lab cannot hold payload of joint_3",
    ]
    (call,) = (node for node in ast.walk(ast.parse(made.text)) if isinstance(node, ast.Call))
    assert isinstance(call.func, ast.Name) and call.func.id == "ImplicitActuatorCfg"
    arguments = {word.arg: ast.literal_eval(word.value) for word in call.keywords}
    assert all(map(re.fullmatch, arguments["joint_names_expr"], ROBOT.joints))
    assert arguments["armature"] == {"joint_1": 0.1, "joint_2": 0.0, "joint_3": 0.0}
    assert arguments["viscous_friction"]["joint_2"] == 0.5
    assert arguments["friction"] == arguments["dynamic_friction"] == {"joint_1": 0.0, "joint_2": 0.8, "joint_3": 0.0}
    assert arguments["stiffness"] is None and "torque_offset" in made.text


def test_omitted_parameters_are_reported() -> None:
    more = Model(ROBOT, MODEL.inertials, (*MODEL.laws, parse_law("spring@1:stiffness=3,rest=0", ROBOT)))
    for kind, name in (("ros", "a ROS parameter file"), ("isaaclab", "an actuator group of Isaac Lab")):
        made = signid.export(more, kind)
        (flag,) = (flag for flag in made.flags if "spring of joint_1" in flag)
        assert flag.startswith(f"{name} cannot hold") and flag in made.text
