"""The MuJoCo plant of the demonstration: its equations, and the concealed laws."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from plant import law

from signid.cli.demo.conceal import conceal
from signid.cli.demo.plant import STEP, run_plant
from signid.cli.demo.run import take_arm
from signid.errors import RobotError
from signid.model import Model, stated_inertials, stated_laws
from signid.output.export.mjcf import mjcf_laws
from signid.regression.motion import Motion
from signid.robot import load_robot
from signid.simulation.excite.families import rest_to_rest_motion
from signid.types import Law


def known(name: str) -> Model:
    robot = take_arm(load_robot(name))
    return Model(robot, stated_inertials(robot), stated_laws(robot))


def along(model: Model, seconds: float = 4.0) -> Motion:
    drawn = rest_to_rest_motion(model.robot, seconds, 0.02, 1)
    return Motion(model.robot, drawn.t, drawn.q, drawn.v, drawn.a)


def test_the_plant_obeys_the_description_and_the_concealed_laws() -> None:
    """Compare with Pinocchio and explicit laws over a MuJoCo step: damping at its end, the rest at its beginning."""
    stated = known("3r")
    laws = [law("spring", 0, stiffness=3.0, rest=0.2), law("viscous_friction", 1, coefficient=0.4)]
    body = {"mass": 0.3, "first_moment_x": 0.06, "first_moment_y": -0.01, "first_moment_z": 0.02}
    laws += [law("armature", 2, inertia=0.05), law("payload", 2, **body), law("base_tilt", 0, 1, 2, x=0.05, y=-0.08)]
    true = Model(stated.robot, stated.inertials, tuple(laws))
    moved = run_plant(true, stated, rest_to_rest_motion(stated.robot, 3.0, 0.004, 1))
    whole, change = stated.robot.model.copy(), moved.true_a * STEP / 2
    whole.gravity.linear = pin.exp3(np.array([0.05, -0.08, 0])).T @ whole.gravity.linear
    whole.inertias[3] += pin.Inertia(0.3, np.array([0.2, -1 / 30, 1 / 15]), np.zeros((3, 3)))
    data, expected = whole.createData(), []
    for q, v, a, dv in list(zip(moved.q, moved.true_v, moved.true_a, change, strict=True))[::10]:
        dissipated = np.array([3.0 * (q[0] - 0.2), 0.4 * (v + dv)[1], 0.05 * a[2]])
        expected.append(pin.rnea(whole, data, q, v - dv, a) + dissipated)
    np.testing.assert_allclose(moved.tau[::10], expected, atol=1e-9, rtol=1e-7)
    assert np.abs(moved.q - moved.desired).max() > 1e-3, "the controller knows nothing of it"


def test_the_plant_has_the_stated_friction() -> None:
    stated = known("panda")
    level, joint = 2.0, 1
    true = replace(stated, laws=(*stated.laws, law("coulomb_friction", joint, level=level)))
    moved = run_plant(true, stated, rest_to_rest_motion(stated.robot, 3.0, 0.004, 1))
    rest = moved.tau - stated.inverse(Motion(stated.robot, moved.t, moved.q, moved.true_v, moved.true_a))
    sliding = np.abs(moved.true_v[:, joint]) > 0.02
    np.testing.assert_allclose(rest[sliding, joint], level * np.sign(moved.true_v[sliding, joint]), atol=0.02)
    assert np.abs(np.delete(rest, joint, axis=1)).max() < 0.05 and sliding.mean() > 0.5


def test_an_immovable_robot_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    stated = known("3r")
    heavy = law("payload", 2, mass=1e4, first_moment_x=1e3, first_moment_y=0.0, first_moment_z=0.0)
    with pytest.raises(RobotError, match="3r does not follow its motion in MuJoCo"):
        run_plant(replace(stated, laws=(heavy,)), stated, rest_to_rest_motion(stated.robot, 3.0, 0.004, 1))
    assert list(tmp_path.iterdir()) == [], "MuJoCo leaves no log"


@pytest.mark.parametrize("name", ["1r", "3r", "emps", "panda", "ur5", "xarm7"])
def test_concealed_laws_are_visible_and_exportable(name: str) -> None:
    """A concealed law fits in an MJCF, is missing in the simulation, and is a visible but minor part of the torque."""
    stated = known(name)
    motion, drawn = along(stated), list[tuple[Law, ...]]()
    torque = stated.inverse(motion)
    for seed in range(12):
        laws = conceal(stated, motion, seed)
        again = conceal(stated, motion, seed)
        assert [(x.effect.name, x.joints, dict(x.parameters)) for x in laws] == [
            (x.effect.name, x.joints, dict(x.parameters)) for x in again
        ]
        true = replace(stated, laws=(*stated.laws, *laws))
        assert all(x in mjcf_laws(true) for x in laws) and len({(x.effect.name, x.joints) for x in laws}) == len(laws)
        has = {(x.effect.name, x.joints) for x in stated.laws if any(x.parameters.values())}
        assert not has & {(x.effect.name, x.joints) for x in laws}
        shares = np.std(true.inverse(motion) - torque, axis=0) / np.std(torque, axis=0)
        assert 0.05 < shares.max() < 20
        drawn.append(laws)
    assert len({tuple(str(x.parameters) for x in laws) for laws in drawn}) == 12
    assert len({tuple(x.effect.name for x in laws) for laws in drawn}) >= 2


def test_the_arm_moves_and_the_hand_rests() -> None:
    assert take_arm(load_robot("panda")).joints == tuple(f"panda_joint{j}" for j in range(1, 8))
    assert take_arm(load_robot("ur5")).joints == load_robot("ur5").joints
    assert take_arm(load_robot("kinova")).joints == tuple(f"j2s6s200_joint_{j}" for j in range(1, 7))
    assert len(take_arm(load_robot("solo12")).joints) == 3, "a leg"
