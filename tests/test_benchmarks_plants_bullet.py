"""Agreement of the Bullet and MuJoCo plants with the same faults."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from faulty import ARM, BARE, CARRIED, DRIVES, LAWS, MOTION, PENDULUM, WEIGHT, plant

pytest.importorskip("mujoco", reason="MuJoCo is not installed; pip install 'signid[bench]'")

pytest.importorskip("pybullet", reason="PyBullet is not installed; pip install 'signid[bench]'")

from benchmarks.plants import pybullet_ as bullet  # noqa: E402
from benchmarks.plants.bodies import Body, Drives  # noqa: E402
from benchmarks.plants.control import Table, draw_motion  # noqa: E402
from benchmarks.plants.faults import Fault  # noqa: E402
from benchmarks.plants.mujoco_ import simulate  # noqa: E402
from signid.robot import load_robot  # noqa: E402

BOTH = [
    (),
    ("asymmetric_friction", "armature"),
    ("coulomb_friction", "viscous_friction", "stribeck_friction", "position_friction"),
    ("load_friction", "friction_drift", "quadratic_friction"),
    ("presliding_friction", "spring", "torque_offset"),
    ("cable_torque", "counterbalance", "torque_ripple"),
    ("joint_coupling",),
    ("fluid_drag", "external_contact"),
    ("tustin_friction", "double_ripple", "soft_stop", "friction_step", "crossed_torque"),
]
ALIKE = 1e-6  # rad between the simulators


def alike(body: Body, drives: Drives, motion: Any, duration: float, faults: list[Fault]) -> None:
    one, other = (run(body, drives, motion, duration, 1000, faults) for run in (simulate, bullet.simulate))
    assert np.max(np.abs(one.q - other.q)) < ALIKE
    assert np.max(np.abs(one.tau - other.tau)) < 5e-4 * np.sqrt(np.mean(one.tau**2))


@pytest.mark.parametrize("effects", BOTH, ids="-".join)
def test_bullet_agrees_with_mujoco(effects: tuple[str, ...]) -> None:
    alike(ARM, DRIVES, MOTION, 1.2, [LAWS[effect][0] for effect in effects])


@pytest.mark.parametrize(
    "fault",
    [
        plant("payload", None, **CARRIED),
        plant("link_inertia", mass=-0.2, first_moment_x=-0.06, first_moment_y=0.01, first_moment_z=0.02),
        plant("base_tilt", None, x=0.05, y=-0.04),
        plant("encoder_offset", offset=0.02),
        plant("torque_saturation", 0, limit=1.1),
        plant("torque_lag", time_constant=0.01),
        plant("channel_swap", partner="joint_3"),
    ],
    ids=lambda fault: fault.effect,
)
def test_bullet_has_the_same_bodies_and_recording_faults(fault: Fault) -> None:
    alike(Body(ARM.urdf, ARM.joints, {"link_3": 1.1}), DRIVES, MOTION, 0.6, [fault])


@pytest.mark.parametrize(
    ("name", "joints", "centre"),
    [("ur5", 6, (0.0, -1.2, 1.2, -0.5, 0.5, 0.0)), ("panda", 7, (0.0, -0.3, 0.0, -1.8, 0.0, 1.8, 0.5))],
)
def test_bullet_agrees_with_mujoco_on_known_robots(name: str, joints: int, centre: tuple[float, ...]) -> None:
    robot = load_robot(name)
    body, whole = Body(robot.document, robot.joints[:joints]), np.ones(joints)
    drives = Drives(0.1 * whole, 0.5 * whole, 0.5 * whole, 0 * whole)
    alike(body, drives, draw_motion(centre, 1), 0.4, [plant("fluid_drag", None, coefficient=3.0)])


def test_bullet_holds_at_rest_exactly_and_refuses_unsupported_faults() -> None:
    limp = Fault("torque_saturation", "joint_1", {"limit": 0.0})
    stuck = Fault("coulomb_friction", "joint_1", {"level": 1.01 * WEIGHT})
    still = np.zeros((2, 1))
    table = Table(np.array([0.0, 1.0]), still + np.pi / 2, still, still)
    track = bullet.simulate(PENDULUM, BARE, table, 0.5, 100, [limp, stuck])
    assert np.max(np.abs(track.q - np.pi / 2)) < 1e-9
    for fault in (plant("joint_elasticity", stiffness=1e3), plant("backlash", gap=0.01)):
        with pytest.raises(ValueError, match="MuJoCo's plant"):
            bullet.simulate(ARM, DRIVES, MOTION, 0.1, 1000, [fault])
