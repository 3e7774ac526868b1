"""Laws by the names of joints: names that do not fit the robot give an error message."""

from __future__ import annotations

import pytest
from toys import CHAIN, toy

import signid
from signid.effects.naming import parse_law
from signid.errors import OptionError, RobotError


def test_a_pair_on_a_robot_with_one_joint_is_refused() -> None:
    for text in ("channel_swap:partner=joint_1", "channel_swap@joint_1:partner=joint_1"):
        with pytest.raises(OptionError, match="none is named|couples two joints"):
            parse_law(text, signid.load_robot("1r"))


def test_a_missing_partner_is_refused() -> None:
    robot = toy(*CHAIN)
    assert parse_law("channel_swap:partner=y", robot).joints == (0, 1)
    for text in ("channel_swap:partner=elbow", "channel_swap@z:partner=elbow"):
        with pytest.raises(RobotError, match="elbow"):
            parse_law(text, robot)
