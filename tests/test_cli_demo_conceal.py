"""Laws that a demonstration conceals, and joints that move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from signid.cli.demo import conceal, take_arm
from signid.model import Model, stated_inertials, stated_laws
from signid.output.export.formats import held
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
        assert all(x in held(true, "mjcf") for x in laws) and len({(x.effect.name, x.joints) for x in laws}) == len(
            laws
        )
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
